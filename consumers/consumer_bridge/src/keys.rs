//! zenoh's keys of everything that bridges say to each other. They begin with the network's name, and
//! chunks that begin with `@` are never matched by a wildcard.
//!
//! | key | what |
//! |---|---|
//! | `NET/@bridge/ID` | liveliness token of a bridge |
//! | `NET/@bridge/ID/topics` | its announcement |
//! | `NET/from/ID/TOPIC` | samples of a topic that the bridge exports; asked, the newest document or snapshot |
//! | `NET/to/ID/control/world` | requests to the world behind the bridge |
//! | `NET/to/ID/control/vehicles` | controls for it |
//! | `NET/to/ID/control/ack` | acknowledgements of lockstep participants |
//! | `NET/to/ID/clock` | asked: its clock |

/// Keys of one network of bridges.
#[derive(Clone, Debug)]
pub struct Keys {
    net: String,
}

impl Keys {
    /// Keys that begin with `net`, which [`valid_network`] accepts.
    pub fn new(net: &str) -> Keys {
        Keys { net: net.into() }
    }

    /// Liveliness token of the bridge `id`; `*` for those of all.
    pub fn alive(&self, id: &str) -> String {
        format!("{}/@bridge/{id}", self.net)
    }

    /// Announcement of the bridge `id`; `*` for those of all.
    pub fn topics(&self, id: &str) -> String {
        format!("{}/@bridge/{id}/topics", self.net)
    }

    /// Samples of `topic` from the bridge `id`; `**` for all topics.
    pub fn from(&self, id: &str, topic: &str) -> String {
        format!("{}/from/{id}/{topic}", self.net)
    }

    /// What is sent to the bridge `id`: `control/world` and its like.
    pub fn to(&self, id: &str, what: &str) -> String {
        format!("{}/to/{id}/{what}", self.net)
    }

    /// Id of the bridge in the key of a token or an announcement; nothing if it is no id of zenoh's,
    /// which have at most 32 hexadecimal digits.
    pub fn bridge_of<'k>(&self, key: &'k str) -> Option<&'k str> {
        let rest = key.strip_prefix(&self.net)?.strip_prefix("/@bridge/")?;
        let id = rest.split('/').next()?;
        (id.len() <= 32 && id.bytes().all(|digit| digit.is_ascii_hexdigit())).then_some(id)
    }

    /// Topic in the key of a sample of the bridge `id`.
    pub fn topic_of<'k>(&self, id: &str, key: &'k str) -> Option<&'k str> {
        let rest = key.strip_prefix(&self.net)?.strip_prefix("/from/")?;
        rest.strip_prefix(id)?.strip_prefix('/')
    }
}

/// Whether `name` can name a network of bridges: one or more chunks of a key without wildcards.
pub fn valid_network(name: &str) -> bool {
    let valid = |chunk: &str| {
        !chunk.is_empty()
            && chunk
                .bytes()
                .all(|b| b.is_ascii_alphanumeric() || b"_-.".contains(&b))
    };
    name.len() <= 64 && name.split('/').all(valid)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_and_topics_are_found_in_keys() {
        let keys = Keys::new("lab/gantry");
        assert_eq!(keys.bridge_of(&keys.alive("a1")), Some("a1"));
        assert_eq!(keys.bridge_of(&keys.topics("a1")), Some("a1"));
        assert_eq!(keys.bridge_of(&keys.alive(&"a".repeat(33))), None);
        assert_eq!(keys.bridge_of(&keys.alive("x1")), None);
        let key = keys.from("a1", "ego/front/rgb");
        assert_eq!(keys.topic_of("a1", &key), Some("ego/front/rgb"));
        assert_eq!(keys.topic_of("a2", &key), None);
        assert!(valid_network("gantry") && valid_network("lab/7"));
        assert!(!valid_network("") && !valid_network("a/*") && !valid_network("@a"));
    }
}
