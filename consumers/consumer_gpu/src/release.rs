//! Slots that go back once the GPU is done with them. Whoever drops a tensor may have given the GPU
//! work that still reads it.

use std::collections::VecDeque;
use std::sync::Arc;

use parking_lot::Mutex;

use crate::cuda::Event;

/// What waits for the GPU before it is dropped.
#[derive(Debug)]
pub struct Releases<T>(Mutex<VecDeque<(Event, T)>>);

impl<T> Releases<T> {
    /// Nothing waits.
    pub fn new() -> Arc<Releases<T>> {
        Arc::new(Releases(Mutex::new(VecDeque::new())))
    }

    /// Keeps `held` until the GPU has done what it was given before `event`.
    pub fn push(&self, event: Event, held: T) {
        self.0.lock().push_back((event, held));
    }

    /// Drops what the GPU is done with; returns whether that was anything.
    pub fn sweep(&self) -> bool {
        let mut over = Vec::new();
        let mut waiting = self.0.lock();
        while let Some((event, _)) = waiting.front() {
            if !event.is_over() {
                break;
            }
            over.extend(waiting.pop_front());
        }
        drop(waiting);
        !over.is_empty()
    }

    /// Drops what the GPU is done with, or waits for the oldest; `false` if nothing waits.
    pub fn make_room(&self) -> bool {
        self.sweep() || self.wait_for_one()
    }

    /// Waits for the oldest, and drops it; `false` if nothing waits.
    pub fn wait_for_one(&self) -> bool {
        let oldest = self.0.lock().pop_front();
        match oldest {
            Some((event, held)) => {
                event.wait();
                drop(held);
                true
            }
            None => false,
        }
    }
}

impl<T> Drop for Releases<T> {
    fn drop(&mut self) {
        while self.wait_for_one() {}
    }
}
