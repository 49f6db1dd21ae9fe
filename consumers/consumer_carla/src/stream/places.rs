//! Which world stream belongs to which client.
//!
//! The 0.9.16 client keeps its streams by number. After `load_world` it takes a new world stream while one of its threads may still be at work
//! on a snapshot of the old one; if both have the same number, the new one is freed while it connects, and the client's process ends. So each
//! client has a number of its own for every world that it loads, and what it had before a load is sent nothing more.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Clients' own world streams count from here; actors' streams never come so far.
const FIRST: u32 = 0x8000_0000;

/// Whether what listens to a world stream is to be sent nothing more.
pub(super) type Retired = Arc<AtomicBool>;

/// A client's world stream.
#[derive(Debug)]
pub struct Place {
    stream: u32,
    is_retired: Retired,
}

/// World streams by the RPC connections that asked for them.
#[derive(Debug, Default)]
pub(super) struct Places {
    n_made: u32,
    of: BTreeMap<u64, Place>,
}

/// Whether a number is that of a world stream.
pub fn is_world(stream: u32) -> bool {
    stream == super::WORLD_STREAM || stream >= FIRST
}

impl Places {
    /// The number of a client's world stream until it loads a world.
    pub fn stream_of(&mut self, connection: u64) -> u32 {
        let n_made = &mut self.n_made;
        let place = self.of.entry(connection).or_insert_with(|| {
            let stream = FIRST + *n_made;
            *n_made = (*n_made + 1) % (u32::MAX - FIRST);
            Place { stream, is_retired: Retired::default() }
        });
        place.stream
    }

    /// Of one that connects.
    pub fn retired(&self, stream: u32) -> Retired {
        self.of.values().find(|place| place.stream == stream).map(|place| place.is_retired.clone()).unwrap_or_default()
    }

    /// Nothing more goes to a client's world stream.
    pub fn retire(&mut self, connection: u64) -> Option<Place> {
        let place = self.of.remove(&connection)?;
        place.is_retired.store(true, Ordering::Release);
        Some(place)
    }

    /// It goes on after all.
    pub fn restore(&mut self, connection: u64, place: Place) {
        place.is_retired.store(false, Ordering::Release);
        self.of.insert(connection, place);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_client_has_a_stream_per_world_and_nobody_elses() {
        let mut places = Places::default();
        let (one, other) = (places.stream_of(1), places.stream_of(2));
        assert!(one != other && places.stream_of(1) == one && is_world(one) && is_world(1) && !is_world(2));
        let flags = [one, other].map(|stream| places.retired(stream));
        let place = places.retire(1).unwrap();
        assert_eq!(flags.each_ref().map(|flag| flag.load(Ordering::Acquire)), [true, false]);
        places.restore(1, place);
        assert!(!flags[0].load(Ordering::Acquire) && places.stream_of(1) == one);
        places.retire(1);
        let next = places.stream_of(1);
        assert!(next != one && next != other);
    }
}
