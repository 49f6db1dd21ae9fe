//! Expected clients: they asked where a stream is and have not connected to it yet.
//!
//! A client asks for a stream's token right before it connects, and it may step the world in
//! between. The source that will serve it is therefore opened when it asks, and collects messages
//! from then on, so that the client misses none.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use parking_lot::Mutex;

/// How long a source waits for its client.
const CONNECT: Duration = Duration::from_secs(10);
/// Most streams that may be expected at a time, of all clients together.
pub const MAX_EXPECTED: usize = 256;
/// Most of them of one client.
pub const MAX_EXPECTED_OF_ONE: usize = 64;

/// Sources that wait for their clients, by stream; within a stream the oldest comes first.
#[derive(Debug)]
pub struct Expected<T>(Mutex<BTreeMap<u32, VecDeque<Waiting<T>>>>);

#[derive(Debug)]
struct Waiting<T> {
    since: Instant,
    /// The RPC connection of the client.
    owner: u64,
    source: T,
}

impl<T> Default for Expected<T> {
    fn default() -> Self {
        Expected(Mutex::default())
    }
}

impl<T> Expected<T> {
    /// Keeps `source` for the client with the RPC connection `owner`, which is about to connect to
    /// `stream`. If [`MAX_EXPECTED_OF_ONE`] of it are kept already, its oldest one is given up and
    /// returned, with its stream; if [`MAX_EXPECTED`] are, the oldest of the client with the most of
    /// them: who asks very often and never comes takes nothing from anybody else.
    pub fn add(&self, stream: u32, owner: u64, source: T) -> Option<(u32, T)> {
        let mut expected = self.0.lock();
        let mut n_of = BTreeMap::<u64, usize>::new();
        for waiting in expected.values().flatten() {
            *n_of.entry(waiting.owner).or_default() += 1;
        }
        let most = n_of.iter().max_by_key(|(_, n)| **n).map(|(of, _)| *of);
        let given_up = if n_of.get(&owner) >= Some(&MAX_EXPECTED_OF_ONE) {
            take_oldest(&mut expected, owner)
        } else if n_of.values().sum::<usize>() >= MAX_EXPECTED {
            most.and_then(|of| take_oldest(&mut expected, of))
        } else {
            None
        };
        expected.entry(stream).or_default().push_back(Waiting {
            since: Instant::now(),
            owner,
            source,
        });
        given_up
    }

    /// Hands out the source that has waited longest for a client of `stream`.
    pub fn take(&self, stream: u32) -> Option<T> {
        let waiting = self.0.lock().get_mut(&stream)?.pop_front()?;
        Some(waiting.source)
    }

    /// Drops the sources of clients that did not connect in time.
    pub fn sweep(&self) {
        let mut expected = self.0.lock();
        for waiting in expected.values_mut() {
            while waiting
                .front()
                .is_some_and(|first| first.since.elapsed() > CONNECT)
            {
                waiting.pop_front();
            }
        }
        expected.retain(|_, waiting| !waiting.is_empty());
    }

    /// Runs `change` on every waiting source.
    pub fn for_each(&self, mut change: impl FnMut(&mut T)) {
        for waiting in self.0.lock().values_mut().flatten() {
            change(&mut waiting.source);
        }
    }
}

/// Takes out the source of a client that has waited longest, with its stream.
fn take_oldest<T>(
    expected: &mut BTreeMap<u32, VecDeque<Waiting<T>>>,
    owner: u64,
) -> Option<(u32, T)> {
    let all = expected.iter_mut();
    let oldest = all.filter_map(|(stream, waiting)| {
        let at = waiting.iter().position(|one| one.owner == owner)?;
        Some((*stream, waiting, at))
    });
    let (stream, waiting, at) = oldest.min_by_key(|(_, waiting, at)| waiting[*at].since)?;
    Some((stream, waiting.remove(at)?.source))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clients_get_what_was_made_ready_for_their_stream_in_order() {
        let expected = Expected::default();
        for (stream, source) in [(7, "a"), (8, "b"), (7, "c")] {
            assert_eq!(expected.add(stream, 1, source), None);
        }
        let taken = [7, 7, 7, 8].map(|stream| expected.take(stream));
        assert_eq!(taken, [Some("a"), Some("c"), None, Some("b")]);
    }

    #[test]
    fn who_asks_very_often_loses_its_own() {
        let expected = Expected::default();
        assert_eq!(expected.add(1, 1, "first"), None);
        for n in 1..MAX_EXPECTED_OF_ONE {
            assert_eq!(expected.add(2 + n as u32 % 3, 1, "more"), None);
        }
        assert_eq!(expected.add(7, 2, "another's"), None);
        assert_eq!(expected.add(9, 1, "new"), Some((1, "first")));
        assert_eq!(expected.take(7), Some("another's"));
        // All together, the one with the most of them loses one.
        for owner in 3..6 {
            for _ in 1..MAX_EXPECTED_OF_ONE {
                assert_eq!(expected.add(8, owner, "of three"), None);
            }
        }
        let given_up = (0..4).map(|n| expected.add(8, 10 + n, "late"));
        assert_eq!(given_up.flatten().count(), 1);
        expected.sweep();
        assert_eq!(expected.take(9), Some("new"), "what is new stays");
    }
}
