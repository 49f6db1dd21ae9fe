//! Memory that the messages of all connections may take together. Small messages are free: there
//! are only so many connections.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A message of at most so many bytes costs nothing, and larger ones are counted in such steps.
const STEP: usize = 1 << 16;

/// What is left for all.
#[derive(Clone, Debug)]
pub struct Budget(Arc<AtomicUsize>);

impl Budget {
    /// For so many bytes.
    pub fn new(bytes: usize) -> Budget {
        Budget(Arc::new(AtomicUsize::new(bytes)))
    }

    /// Nothing is taken yet.
    pub fn share(&self) -> Share {
        Share {
            budget: self.clone(),
            needed: 0,
            taken: STEP,
        }
    }
}

/// What one message takes; given back when this is dropped.
#[derive(Debug)]
pub struct Share {
    budget: Budget,
    needed: usize,
    /// With the first step, which is free.
    taken: usize,
}

impl Share {
    /// Takes so many more bytes; false if too few are left.
    #[must_use]
    pub fn take(&mut self, bytes: usize) -> bool {
        self.needed = self.needed.saturating_add(bytes);
        if self.needed <= self.taken {
            return true;
        }
        let more = (self.needed - self.taken).next_multiple_of(STEP);
        let left = &self.budget.0;
        let paid = left.fetch_update(Ordering::AcqRel, Ordering::Acquire, |left| {
            left.checked_sub(more)
        });
        if paid.is_ok() {
            self.taken += more;
        }
        paid.is_ok()
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        self.budget.0.fetch_add(self.taken - STEP, Ordering::AcqRel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_messages_share_and_small_ones_are_free() {
        let budget = Budget::new(2 * STEP);
        let mut small: Vec<Share> = (0..100).map(|_| budget.share()).collect();
        assert!(small.iter_mut().all(|share| share.take(STEP)));
        let (mut one, mut other) = (budget.share(), budget.share());
        assert!(one.take(2 * STEP) && one.take(1) && other.take(STEP));
        assert!(!other.take(1), "nothing is left");
        drop(one);
        assert!(other.take(STEP) && !other.take(usize::MAX));
        drop((small, other));
        assert_eq!(budget.0.load(Ordering::Acquire), 2 * STEP);
    }
}
