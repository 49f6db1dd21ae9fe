//! How nodes of ROS 2 find each other over zenoh, as `rmw_zenoh_cpp` does since Jazzy: keys of topics,
//! tokens of liveliness, and what goes along with each message.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering::Relaxed};
use std::time::{SystemTime, UNIX_EPOCH};

use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::CongestionControl;
use zenoh::sample::Sample;
use zenoh::{Session, Wait as _};

use crate::outbox::watch_readers;
use crate::ros2::types::Type;

/// Messages that a subscription of ours or a late reader may fall behind: quality of service that
/// differs from `rmw_zenoh_cpp`'s default in the depth of the history alone.
const QOS: &str = "::,5:,:,:,,";
/// Name of the node.
const NODE: &str = "gantry_bridge";
/// Bytes of a publisher's number in an attachment.
const GID_BYTES: usize = 16;

/// One node of ROS 2 and what it has in the graph.
#[derive(Debug)]
pub struct Node {
    session: Session,
    domain_id: u32,
    next_id: AtomicI64,
    _token: LivelinessToken,
}

impl Node {
    /// Appears in the graph of the domain.
    ///
    /// # Errors
    /// What zenoh says.
    pub fn new(session: &Session, domain_id: u32) -> anyhow::Result<Node> {
        let zid = session.zid();
        let key = format!("@ros2_lv/{domain_id}/{zid}/0/0/NN/%/%/{NODE}");
        Ok(Node {
            _token: token(session, &key)?,
            session: session.clone(),
            domain_id,
            next_id: AtomicI64::new(1),
        })
    }

    fn entity(&self, kind: &str, topic: &str, of: &Type) -> String {
        format!(
            "@ros2_lv/{}/{}/0/{}/{kind}/%/%/{NODE}/{}/{}/{}/{QOS}",
            self.domain_id,
            self.session.zid(),
            self.next_id.fetch_add(1, Relaxed),
            topic.replace('/', "%"),
            of.dds_name(),
            of.hash,
        )
    }

    fn key(&self, topic: &str, of: &Type, hash: &str) -> String {
        format!(
            "{}/{}/{}/{hash}",
            self.domain_id,
            topic.trim_matches('/'),
            of.dds_name()
        )
    }

    /// Offers a topic (`/carla/ego/front/image`); `wake` is called when the first node subscribes and
    /// when the last one ends.
    ///
    /// # Errors
    /// What zenoh says.
    pub fn publish(
        &self,
        topic: &str,
        of: &Type,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> anyhow::Result<Topic> {
        let failed = |error: zenoh::Error| anyhow::anyhow!("cannot offer {topic}: {error}");
        let entity = self.entity("MP", topic, of);
        let publisher = self
            .session
            .declare_publisher(self.key(topic, of, of.hash))
            .congestion_control(CongestionControl::Drop)
            .wait()
            .map_err(failed)?;
        let wanted = watch_readers(&publisher, wake).map_err(failed)?;
        Ok(Topic {
            publisher,
            wanted,
            sequence: AtomicI64::new(0),
            gid: gid_of(&entity),
            _token: token(&self.session, &entity)?,
        })
    }

    /// Subscribes to a topic of any version of the type.
    ///
    /// # Errors
    /// What zenoh says.
    pub fn subscribe(
        &self,
        topic: &str,
        of: &Type,
        take: impl Fn(Sample) + Send + Sync + 'static,
    ) -> anyhow::Result<Subscription> {
        let subscriber = self
            .session
            .declare_subscriber(self.key(topic, of, "*"))
            .callback(take)
            .wait()
            .map_err(|error| anyhow::anyhow!("cannot subscribe to {topic}: {error}"))?;
        Ok(Subscription {
            _subscriber: subscriber,
            _token: token(&self.session, &self.entity("MS", topic, of))?,
        })
    }
}

/// A topic that this node publishes.
#[derive(Debug)]
pub struct Topic {
    publisher: Publisher<'static>,
    wanted: Arc<AtomicBool>,
    sequence: AtomicI64,
    gid: [u8; GID_BYTES],
    _token: LivelinessToken,
}

/// A topic that this node subscribes to.
#[derive(Debug)]
pub struct Subscription {
    _subscriber: Subscriber<()>,
    _token: LivelinessToken,
}

impl Topic {
    /// Whether any node subscribes.
    pub fn is_wanted(&self) -> bool {
        self.wanted.load(Relaxed)
    }

    /// Sends a message.
    ///
    /// # Errors
    /// What zenoh says.
    pub fn send(&self, message: Vec<u8>) -> anyhow::Result<()> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH);
        let now_nanos = now.map_or(0, |since| since.as_nanos() as i64);
        let sequence = self.sequence.fetch_add(1, Relaxed) + 1;
        self.publisher
            .put(message)
            .attachment(attachment(sequence, now_nanos, &self.gid))
            .wait()
            .map_err(|error| anyhow::anyhow!("the link takes no message: {error}"))
    }
}

/// Number, time and publisher of a message, as zenoh's own serialization writes them.
fn attachment(sequence: i64, now_nanos: i64, gid: &[u8; GID_BYTES]) -> Vec<u8> {
    [
        &sequence.to_le_bytes()[..],
        &now_nanos.to_le_bytes(),
        &[GID_BYTES as u8],
        gid,
    ]
    .concat()
}

/// A number of a publisher: 128 bits of its token, which is unique (FNV-1a).
fn gid_of(entity: &str) -> [u8; GID_BYTES] {
    let fold = |hash: u128, byte: u8| {
        (hash ^ u128::from(byte)).wrapping_mul(0x0000_0000_0100_0000_0000_0000_0000_013b)
    };
    let hash = entity
        .bytes()
        .fold(0x6c62_272e_07bb_0142_62b8_2175_6295_c58d, fold);
    hash.to_le_bytes()
}

fn token(session: &Session, key: &str) -> anyhow::Result<LivelinessToken> {
    session
        .liveliness()
        .declare_token(key.to_owned())
        .wait()
        .map_err(|error| anyhow::anyhow!("cannot appear in the graph of ROS 2: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_attachment_has_33_bytes() {
        let bytes = attachment(3, 1 << 40, &[7; 16]);
        assert_eq!(bytes.len(), 33);
        assert_eq!(&bytes[..8], &3i64.to_le_bytes());
        assert_eq!(bytes[16], 16);
        assert_eq!(&bytes[17..], &[7; 16]);
    }

    #[test]
    fn numbers_of_publishers_differ() {
        // FNV-1a of 128 bits has these published values.
        assert_eq!(
            u128::from_le_bytes(gid_of("")),
            0x6c62_272e_07bb_0142_62b8_2175_6295_c58d
        );
        assert_eq!(
            u128::from_le_bytes(gid_of("a")),
            0xd228_cb69_6f1a_8caf_7891_2b70_4e4a_8964
        );
        assert_ne!(gid_of("a/1"), gid_of("a/2"));
    }
}
