//! Expected clients: they asked where a stream is, and have not connected to it yet.
//!
//! A client asks for a stream's place right before it connects, and may step the world in between.
//! So what will serve it is made ready with the question and collects messages from then on.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use crate::lock::lock;

/// How long a client is expected.
const CONNECT: Duration = Duration::from_secs(10);
/// Clients that may be expected at a time.
pub const MAX_EXPECTED: usize = 256;

/// What is ready for expected clients, by the streams that they asked for, oldest first.
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
    /// Whether [`MAX_EXPECTED`] clients are expected already.
    pub fn is_full(&self) -> bool {
        lock(&self.0).values().map(VecDeque::len).sum::<usize>() >= MAX_EXPECTED
    }

    /// Keeps `source` for a client that is about to connect to `stream`.
    pub fn add(&self, stream: u32, source: T) {
        let since = Instant::now();
        lock(&self.0)
            .entry(stream)
            .or_default()
            .push_back(Waiting { since, source });
    }

    /// What was made ready first for a client of `stream`.
    pub fn take(&self, stream: u32) -> Option<T> {
        let waiting = lock(&self.0).get_mut(&stream)?.pop_front()?;
        Some(waiting.source)
    }

    /// Drops what is ready for clients that did not connect in time.
    pub fn sweep(&self) {
        let mut expected = lock(&self.0);
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

    /// Changes everything that is ready.
    pub fn for_each(&self, mut change: impl FnMut(&mut T)) {
        for waiting in lock(&self.0).values_mut().flatten() {
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
            expected.add(stream, source);
        }
        let taken = [7, 7, 7, 8].map(|stream| expected.take(stream));
        assert_eq!(taken, [Some("a"), Some("c"), None, Some("b")]);
        (0..MAX_EXPECTED).for_each(|_| expected.add(9, "d"));
        assert!(expected.is_full());
        expected.sweep();
        assert!(expected.is_full(), "what is new stays");
    }
}
