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

/// A client that still listens to its old stream this long after a load timed out waiting for the
/// answer and continues with the old stream.
const LEAVE_NANOS: u64 = 10_000_000_000;

/// A client's world stream.
#[derive(Debug)]
pub struct Place {
    stream: u32,
    is_retired: Retired,
}

impl Place {
    /// The load succeeded, so the client will connect to a new stream.
    pub fn leave(&self) {
        self.is_retired
            .store(mono_now().0 + LEAVE_NANOS, Ordering::Release);
    }
}

/// World streams, by the RPC connections that asked for them.
#[derive(Debug, Default)]
pub(crate) struct Places {
    n_made: u32,
    of: BTreeMap<u64, Place>,
    /// Retired streams by number, until they send again; a connection that arrives late finds its
    /// stream silent, too.
    left: BTreeMap<u32, Retired>,
}

impl Places {
    /// The number of a client's current world stream.
    pub fn stream_of(&mut self, connection: u64) -> u32 {
        let n_made = &mut self.n_made;
        let place = self.of.entry(connection).or_insert_with(|| {
            let stream = FIRST_OWN_WORLD_STREAM + *n_made;
            *n_made = (*n_made + 1) % (u32::MAX - FIRST_OWN_WORLD_STREAM);
            Place {
                stream,
                is_retired: Retired::default(),
            }
        });
        place.stream
    }

    /// The silence flag of the stream that a connection asks for.
    pub fn retired(&mut self, stream: u32) -> Retired {
        self.left.retain(|_, retired| !is_served(retired));
        let held = self
            .of
            .values()
            .find(|place| place.stream == stream)
            .map(|place| &place.is_retired);
        held.or_else(|| self.left.get(&stream))
            .cloned()
            .unwrap_or_default()
    }

    /// Silences a client's world stream until [`Place::leave`] or [`Places::restore`] is called
    /// with the returned place.
    pub fn retire(&mut self, connection: u64) -> Option<Place> {
        let place = self.of.remove(&connection)?;
        place.is_retired.store(u64::MAX, Ordering::Release);
        self.left.retain(|_, retired| !is_served(retired));
        self.left.insert(place.stream, place.is_retired.clone());
        Some(place)
    }

    /// Undoes [`Places::retire`]: the stream sends again and stays the client's own.
    pub fn restore(&mut self, connection: u64, place: Place) {
        place.is_retired.store(0, Ordering::Release);
        self.left.remove(&place.stream);
        self.of.insert(connection, place);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::streams::is_world;

    #[test]
    fn a_client_has_a_stream_per_world_and_nobody_elses() {
        let mut places = Places::default();
        let (one, other) = (places.stream_of(1), places.stream_of(2));
        assert!(
            one != other
                && places.stream_of(1) == one
                && is_world(one)
                && is_world(1)
                && !is_world(2)
        );
        let flags = [one, other].map(|stream| places.retired(stream));
        let place = places.retire(1).unwrap();
        assert_eq!(flags.each_ref().map(is_served), [false, true]);
        assert!(
            !is_served(&places.retired(one)),
            "one that connects after its client left is as silent"
        );
        places.restore(1, place);
        assert!(is_served(&flags[0]) && places.stream_of(1) == one);
        let place = places.retire(1).unwrap();
        place.leave();
        let waits_nanos = flags[0].load(Ordering::Acquire) - mono_now().0;
        assert!(
            !is_served(&flags[0]) && waits_nanos <= LEAVE_NANOS,
            "a client that gave up hears the old stream again"
        );
        assert!(!is_served(&places.retired(one)));
        flags[0].store(0, Ordering::Release);
        assert!(
            is_served(&places.retired(one)) && places.left.is_empty(),
            "what is served again is forgotten"
        );
        let next = places.stream_of(1);
        assert!(next != one && next != other);
    }
}
