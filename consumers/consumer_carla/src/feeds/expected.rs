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
/// Most clients that are expected at a time.
pub const MAX_EXPECTED: usize = 256;

/// Sources that wait for their clients, by stream; within a stream the oldest comes first.
#[derive(Debug)]
pub struct Expected<T>(Mutex<BTreeMap<u32, VecDeque<Waiting<T>>>>);

#[derive(Debug)]
struct Waiting<T> {
    since: Instant,
    source: T,
}

impl<T> Default for Expected<T> {
    fn default() -> Self {
        Expected(Mutex::default())
    }
}

impl<T> Expected<T> {
    /// Keeps `source` for the client that is about to connect to `stream`. If [`MAX_EXPECTED`] are
    /// kept already, the oldest of the stream with the most of them is given up and returned, with
    /// its stream: who asks very often and never comes delays nobody else.
    pub fn add(&self, stream: u32, source: T) -> Option<(u32, T)> {
        let since = Instant::now();
        let mut expected = self.0.lock();
        let mut given_up = None;
        if expected.values().map(VecDeque::len).sum::<usize>() >= MAX_EXPECTED
            && let Some((most, waiting)) = expected.iter_mut().max_by_key(|(_, all)| all.len())
        {
            let oldest = waiting.pop_front();
            given_up = oldest.map(|waiting| (*most, waiting.source));
        }
        expected
            .entry(stream)
            .or_default()
            .push_back(Waiting { since, source });
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clients_get_what_was_made_ready_for_their_stream_in_order() {
        let expected = Expected::default();
        for (stream, source) in [(7, "a"), (8, "b"), (7, "c")] {
            assert_eq!(expected.add(stream, source), None);
        }
        let taken = [7, 7, 7, 8].map(|stream| expected.take(stream));
        assert_eq!(taken, [Some("a"), Some("c"), None, Some("b")]);
        assert!((0..MAX_EXPECTED).all(|_| expected.add(9, "d").is_none()));
        expected.sweep();
        assert_eq!(expected.add(7, "e"), Some((9, "d")), "what is new stays");
        assert_eq!(expected.take(7), Some("e"));
    }
}
