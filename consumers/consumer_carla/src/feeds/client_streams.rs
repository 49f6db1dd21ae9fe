//! Which world stream belongs to which client.
//!
//! The 0.9.16 client keeps its streams by number. After `load_world` it subscribes to a new world
//! stream while one of its threads may still handle a snapshot of the old one. If both streams have
//! the same number, the client frees the new one while it connects, and its process crashes.
//! Therefore each client gets a new stream number for every world that it loads, and its old stream
//! is silent while it changes over.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use schema_bus::mono_now;

use crate::wire::streams::FIRST_OWN_WORLD_STREAM;

/// When a world stream starts to send snapshots (again), in nanoseconds of `CLOCK_MONOTONIC`;
/// `u64::MAX` means not yet known.
pub(crate) type Retired = Arc<AtomicU64>;

/// Whether the stream sends snapshots now.
pub(crate) fn is_served(retired: &Retired) -> bool {
    mono_now().0 >= retired.load(Ordering::Acquire)
}

/// How long a client's old stream stays silent after a load. A client that still listens to it then
/// has timed out on the load and continues with its old world.
const LEAVE_NANOS: u64 = 10_000_000_000;

/// A client's world stream.
#[derive(Debug)]
pub struct ClientStream {
    stream: u32,
    is_retired: Retired,
}

impl ClientStream {
    /// The load succeeded, so the client will connect to a new stream.
    pub fn leave(&self) {
        self.is_retired
            .store(mono_now().0 + LEAVE_NANOS, Ordering::Release);
    }
}

/// World streams, by the RPC connections that asked for them.
#[derive(Debug, Default)]
pub(crate) struct ClientStreams {
    n_made: u32,
    of: BTreeMap<u64, ClientStream>,
    /// Retired streams by number, until they send again; a connection that arrives late finds its
    /// stream silent, too.
    left: BTreeMap<u32, Retired>,
    /// Episodes that clients have left, by connection, until they ask for the next one.
    left_episodes: BTreeMap<u64, u64>,
}

impl ClientStreams {
    /// The number of a client's current world stream.
    pub fn stream_of(&mut self, connection: u64) -> u32 {
        let n_made = &mut self.n_made;
        let own = self.of.entry(connection).or_insert_with(|| {
            let stream = FIRST_OWN_WORLD_STREAM + *n_made;
            *n_made = (*n_made + 1) % (u32::MAX - FIRST_OWN_WORLD_STREAM);
            ClientStream {
                stream,
                is_retired: Retired::default(),
            }
        });
        own.stream
    }

    /// The RPC connection of the client that this world stream belongs to.
    pub fn owner(&self, stream: u32) -> Option<u64> {
        let mut owners = self.of.iter().filter(|(_, own)| own.stream == stream);
        owners.next().map(|(connection, _)| *connection)
    }

    /// Notes which episode a client has left.
    pub fn note_left(&mut self, connection: u64, episode: u64) {
        self.left_episodes.insert(connection, episode);
    }

    /// The episode that the client has left since it last asked here.
    pub fn take_left(&mut self, connection: u64) -> Option<u64> {
        self.left_episodes.remove(&connection)
    }

    /// The silence flag of the stream that a connection asks for.
    pub fn retired(&mut self, stream: u32) -> Retired {
        self.left.retain(|_, retired| !is_served(retired));
        let held = self
            .of
            .values()
            .find(|own| own.stream == stream)
            .map(|own| &own.is_retired);
        held.or_else(|| self.left.get(&stream))
            .cloned()
            .unwrap_or_default()
    }

    /// Silences a client's world stream until [`ClientStream::leave`] or [`ClientStreams::restore`] is called
    /// with the returned stream.
    pub fn retire(&mut self, connection: u64) -> Option<ClientStream> {
        let own = self.of.remove(&connection)?;
        own.is_retired.store(u64::MAX, Ordering::Release);
        self.left.retain(|_, retired| !is_served(retired));
        self.left.insert(own.stream, own.is_retired.clone());
        Some(own)
    }

    /// Undoes [`ClientStreams::retire`]: the stream sends again and stays the client's own.
    pub fn restore(&mut self, connection: u64, own: ClientStream) {
        own.is_retired.store(0, Ordering::Release);
        self.left.remove(&own.stream);
        self.of.insert(connection, own);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::streams::is_world;

    #[test]
    fn a_client_has_a_stream_per_world_and_nobody_elses() {
        let mut client_streams = ClientStreams::default();
        let (one, other) = (client_streams.stream_of(1), client_streams.stream_of(2));
        assert!(
            one != other
                && client_streams.stream_of(1) == one
                && is_world(one)
                && is_world(1)
                && !is_world(2)
        );
        let flags = [one, other].map(|stream| client_streams.retired(stream));
        let own = client_streams.retire(1).unwrap();
        assert_eq!(flags.each_ref().map(is_served), [false, true]);
        assert!(
            !is_served(&client_streams.retired(one)),
            "one that connects after its client left is as silent"
        );
        client_streams.restore(1, own);
        assert!(is_served(&flags[0]) && client_streams.stream_of(1) == one);
        let own = client_streams.retire(1).unwrap();
        own.leave();
        let waits_nanos = flags[0].load(Ordering::Acquire) - mono_now().0;
        assert!(
            !is_served(&flags[0]) && waits_nanos <= LEAVE_NANOS,
            "a client that gave up hears the old stream again"
        );
        assert!(!is_served(&client_streams.retired(one)));
        flags[0].store(0, Ordering::Release);
        assert!(
            is_served(&client_streams.retired(one)) && client_streams.left.is_empty(),
            "what is served again is forgotten"
        );
        let next = client_streams.stream_of(1);
        assert!(next != one && next != other);
    }
}
