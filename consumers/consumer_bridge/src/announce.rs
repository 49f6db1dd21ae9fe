//! What a bridge tells the others: which topics it has to offer, and how they are made.

use anyhow::{Context as _, ensure};
use schema_bus::names;
use schema_bus::qos::Qos;
use schema_frames::{About, Modality, ResultType, SCHEMA_VERSION};
use serde::{Deserialize, Serialize};

use crate::wire::VERSION;

/// Most topics that are taken from one bridge: more than a domain can have.
const MAX_TOPICS: usize = 65_536;
/// Longest name of a topic, bytes: longer ones have no service.
const MAX_NAME_BYTES: usize = 200;
/// Longest name of a machine or a domain, characters; the rest is cut off.
const MAX_PLACE_CHARS: usize = 64;
/// Most places for readers, waiting and borrowed samples that another bridge may ask for: they cost
/// shared memory here.
const MAX_CAPACITY: usize = 256;

/// What a topic carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Sensor frames.
    Frames,
    /// Results of users' programs.
    Results,
    /// `world/snapshot`.
    Snapshot,
    /// A document of the world.
    Document,
}

/// One topic on offer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Offer {
    /// Name without the domain.
    pub name: String,
    /// What it carries.
    pub kind: Kind,
    /// Type of results; empty otherwise.
    #[serde(default)]
    pub result: String,
    /// What the type of results leaves open.
    #[serde(default)]
    pub about: About,
    /// Readers that the topic has places for.
    pub readers: usize,
    /// Samples that wait for a reader.
    pub buffer: usize,
    /// Samples that a reader may hold.
    pub borrowed: usize,
}

impl Offer {
    /// Type of its results.
    pub fn result_type(&self) -> Option<ResultType> {
        ResultType::from_name(&self.result)
    }

    /// Modality of its frames, by its name.
    pub fn modality(&self) -> Option<Modality> {
        self.name.rsplit('/').next().and_then(Modality::from_name)
    }

    /// `of` with the numbers of the offer.
    pub fn qos(&self, of: Qos) -> Qos {
        Qos {
            readers: self.readers,
            buffer: self.buffer,
            borrowed: self.borrowed,
            ..of
        }
    }

    fn check(&self) -> anyhow::Result<()> {
        ensure!(
            self.name.len() <= MAX_NAME_BYTES,
            "the name of a topic has {} bytes; {MAX_NAME_BYTES} are allowed",
            self.name.len()
        );
        let is_world = names::rig_of(&self.name) == "world";
        let fits = match self.kind {
            Kind::Snapshot => self.name == names::WORLD_SNAPSHOT,
            Kind::Document => DOCUMENTS.contains(&self.name.as_str()),
            Kind::Frames => !is_world && self.modality().is_some(),
            Kind::Results => !names::is_reserved(&self.name) && self.result_type().is_some(),
        };
        ensure!(fits, "{:?} cannot be a topic of {:?}", self.name, self.kind);
        for (n, what) in [
            (self.readers, "readers"),
            (self.buffer, "samples that wait"),
            (self.borrowed, "samples that a reader holds"),
        ] {
            ensure!(
                (1..=MAX_CAPACITY).contains(&n),
                "{:?} asks for {n} {what}; 1 to {MAX_CAPACITY} are allowed",
                self.name
            );
        }
        Ok(())
    }
}

/// Documents of a world; the last one says that the world is there.
pub const DOCUMENTS: [&str; 5] = [
    names::WORLD_MAP,
    names::WORLD_ACTORS,
    names::WORLD_CATALOGUE,
    names::WORLD_SPAWN_POINTS,
    names::WORLD_INFO,
];

/// All that a bridge has to offer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Announcement {
    /// Version of what bridges say to each other.
    pub v: u16,
    /// Schema of the frames.
    pub schema: u16,
    /// Name of its machine, for messages.
    pub host: String,
    /// Its domain, for messages.
    pub domain: String,
    /// Whether it takes requests and controls for its world.
    pub control: bool,
    /// Whether its world waits for lockstep participants of others.
    pub lockstep: bool,
    /// Topics by name.
    pub topics: Vec<Offer>,
}

impl Announcement {
    /// Reads what another bridge sent. Topics that cannot be are left out; a sentence about them comes
    /// with the announcement.
    ///
    /// # Errors
    /// A sentence for another version, or for what is no announcement.
    pub fn parse(text: &[u8]) -> anyhow::Result<(Announcement, Option<String>)> {
        #[derive(Deserialize)]
        struct Versions {
            v: u16,
            schema: u16,
        }
        let no_announcement = "what another bridge says about itself cannot be read";
        let found: Versions = serde_json::from_slice(text).context(no_announcement)?;
        ensure!(
            found.v == VERSION,
            "another bridge speaks version {}, this one {VERSION}; rebuild the older of the two",
            found.v
        );
        ensure!(
            found.schema == SCHEMA_VERSION,
            "another bridge carries frames of schema {}, this one {SCHEMA_VERSION}; rebuild the older of the two",
            found.schema
        );
        let mut announcement: Announcement =
            serde_json::from_slice(text).context(no_announcement)?;
        for name in [&mut announcement.host, &mut announcement.domain] {
            if let Some((end, _)) = name.char_indices().nth(MAX_PLACE_CHARS) {
                name.truncate(end);
            }
        }
        announcement.topics.truncate(MAX_TOPICS);
        let (mut n_refused, mut first) = (0_usize, None);
        announcement.topics.retain(|offer| match offer.check() {
            Ok(()) => true,
            Err(error) => {
                n_refused += 1;
                first.get_or_insert(error);
                false
            }
        });
        let refused = first.map(|error| {
            format!("it offers topics that cannot be, {n_refused} of them; the first: {error}")
        });
        Ok((announcement, refused))
    }

    /// Whether it has a world to offer.
    pub fn has_world(&self) -> bool {
        let is_info = |offer: &Offer| offer.name == names::WORLD_INFO;
        self.topics.iter().any(is_info)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn offer(name: &str, kind: Kind) -> Offer {
        Offer {
            name: name.into(),
            kind,
            result: String::new(),
            about: About::default(),
            readers: 8,
            buffer: 2,
            borrowed: 3,
        }
    }

    #[test]
    fn what_cannot_be_is_left_out() {
        let boxes = Offer {
            result: "boxes2d".into(),
            ..offer("detector/boxes", Kind::Results)
        };
        let greedy = Offer {
            readers: 100_000,
            ..offer("ego/rear/rgb", Kind::Frames)
        };
        let long_name = format!("{}/rgb", "x".repeat(MAX_NAME_BYTES));
        let sent = Announcement {
            v: VERSION,
            schema: SCHEMA_VERSION,
            host: "ä".repeat(100),
            domain: "gantry".into(),
            control: true,
            lockstep: false,
            topics: vec![
                offer("ego/front/rgb", Kind::Frames),
                boxes.clone(),
                offer("world/info", Kind::Document),
                offer("control/world", Kind::Document),
                offer("world/info", Kind::Frames),
                Offer {
                    name: "world/map".into(),
                    ..boxes
                },
                greedy,
                offer(&long_name, Kind::Frames),
            ],
        };
        let (found, refused) = Announcement::parse(&serde_json::to_vec(&sent).unwrap()).unwrap();
        assert!(refused.is_some_and(|sentence| sentence.contains("5 of them")));
        assert_eq!(found.topics, sent.topics[..3]);
        assert!(found.has_world());
        assert_eq!(found.host, "ä".repeat(MAX_PLACE_CHARS));
        let newer = Announcement { v: 9, ..sent };
        let error = Announcement::parse(&serde_json::to_vec(&newer).unwrap()).unwrap_err();
        assert!(error.to_string().contains("version 9"), "{error}");
    }
}
