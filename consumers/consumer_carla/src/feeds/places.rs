//! Which world stream belongs to which client.
//!
//! The 0.9.16 client keeps its streams by number. After `load_world` it takes a new world stream
//! while one of its threads may still be at work
//! on a snapshot of the old one; if both have the same number, the new one is freed while it
//! connects, and the client's process ends. So each
//! client has a number of its own for every world that it loads, and what it had before a load is
//! sent nothing while it changes over.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use schema_bus::mono_now;

use crate::wire::streams::FIRST_OWN_WORLD_STREAM;

/// From when on, by the monotonic clock in nanoseconds, snapshots go to what listens to a world
/// stream.
pub(crate) type Retired = Arc<AtomicU64>;

/// Whether snapshots go to it now.
pub(crate) fn is_served(retired: &Retired) -> bool {
    mono_now().0 >= retired.load(Ordering::Acquire)
}

/// A client that has not left its old stream for so long after a load had given up waiting for the
/// load, and goes on with it.
const LEAVE_NANOS: u64 = 10_000_000_000;

/// A client's world stream.
#[derive(Debug)]
pub struct Place {
    stream: u32,
    is_retired: Retired,
}

impl Place {
    /// The load was answered: the client takes a new stream.
    pub fn leave(&self) {
        self.is_retired
            .store(mono_now().0 + LEAVE_NANOS, Ordering::Release);
    }
}

/// World streams by the RPC connections that asked for them.
#[derive(Debug, Default)]
pub(crate) struct Places {
    n_made: u32,
    of: BTreeMap<u64, Place>,
    /// Those that clients leave or have left, by number, until they are served again: who connects
    /// only now finds them silent too.
    left: BTreeMap<u32, Retired>,
}

impl Places {
    /// The number of a client's world stream until it loads a world.
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

    /// Of one that connects.
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

    /// Nothing goes to a client's world stream until [`Place::leave`] or [`Places::restore`] is
    /// called on what this gives.
    pub fn retire(&mut self, connection: u64) -> Option<Place> {
        let place = self.of.remove(&connection)?;
        place.is_retired.store(u64::MAX, Ordering::Release);
        self.left.retain(|_, retired| !is_served(retired));
        self.left.insert(place.stream, place.is_retired.clone());
        Some(place)
    }

    /// It goes on after all.
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
