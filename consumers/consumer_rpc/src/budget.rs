//! Memory that connections may take, one by one and together.
//!
//! Each connection has an [`Account`] for all that it owns: the request that is read and run, the
//! answer that it has not taken, and what the service keeps for it. A connection that exceeds its
//! account is closed. All accounts draw on the [`Budget`] of their server, where small messages are
//! free: there are only so many connections.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use launch_cli::accept::Seldom;

/// Most bytes that one connection may own at a time: its request, its answer, and what is kept for
/// it. The text of a map, the largest answer, may have 128 MiB.
pub const MAX_CONNECTION_BYTES: usize = 192 << 20;
/// Memory that the requests and answers of all connections of a server may take together, bytes.
pub const MAX_MESSAGE_BYTES: usize = 512 << 20;
/// A message of at most so many bytes costs the server's budget nothing, and larger ones are counted
/// in such steps.
const STEP: usize = 1 << 16;
/// Warnings in ten seconds about one connection, and about all of a server.
const WARNINGS: [u64; 2] = [8, 64];

/// Why something may not be kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OverBudget {
    /// The connection owns too much; it is closed.
    #[error(
        "this connection owns more than {} MiB of requests, answers and what is kept for it; ask for less at a time",
        MAX_CONNECTION_BYTES >> 20
    )]
    Connection,
    /// All connections of the server together own too much.
    #[error("the messages of all clients together take too much memory now; send it again later")]
    Server,
}

/// What is left for all connections of a server. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Budget(Arc<Common>);

#[derive(Debug)]
struct Common {
    left: AtomicUsize,
    warnings: Seldom,
}

impl Budget {
    /// For so many bytes.
    pub fn new(bytes: usize) -> Budget {
        Budget(Arc::new(Common {
            left: AtomicUsize::new(bytes),
            warnings: Seldom::of(WARNINGS[1]),
        }))
    }

    /// Whether one more warning about a client may be logged now; then with the number of those
    /// that were left unsaid.
    pub fn may_warn(&self) -> Option<u64> {
        self.0.warnings.is_due()
    }

    /// The account of a connection, which owns nothing yet.
    pub fn account(&self, number: u64) -> Account {
        Account(Arc::new(Owned {
            number,
            budget: self.clone(),
            left: AtomicUsize::new(MAX_CONNECTION_BYTES),
            is_over: AtomicBool::new(false),
            warnings: Seldom::of(WARNINGS[0]),
        }))
    }
}

/// What one connection owns. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Account(Arc<Owned>);

#[derive(Debug)]
struct Owned {
    number: u64,
    budget: Budget,
    left: AtomicUsize,
    is_over: AtomicBool,
    warnings: Seldom,
}

impl Account {
    /// The account of a connection that has no server, as in tests.
    pub fn of(number: u64) -> Account {
        Budget::new(MAX_MESSAGE_BYTES).account(number)
    }

    /// Number of the connection; numbers rise and never come back.
    pub fn number(&self) -> u64 {
        self.0.number
    }

    /// For a message of which nothing has come yet.
    pub fn share(&self) -> Share {
        Share {
            account: self.clone(),
            needed: 0,
            taken: STEP,
        }
    }

    /// Keeps so many bytes for the connection until the result is dropped.
    ///
    /// # Errors
    /// [`OverBudget::Connection`]; the connection is closed then.
    pub fn hold(&self, bytes: usize) -> Result<Holding, OverBudget> {
        self.pay(bytes)?;
        Ok(Holding {
            account: self.clone(),
            bytes,
        })
    }

    /// Whether the connection has exceeded its account.
    pub fn is_over(&self) -> bool {
        self.0.is_over.load(Ordering::Acquire)
    }

    /// Whether one more warning about this client may be logged now; then with the number of those
    /// that were left unsaid.
    pub fn may_warn(&self) -> Option<u64> {
        let unsaid_here = self.0.warnings.is_due()?;
        let unsaid = self.0.budget.may_warn()?;
        Some(unsaid_here + unsaid)
    }

    fn pay(&self, bytes: usize) -> Result<(), OverBudget> {
        if take(&self.0.left, bytes) {
            return Ok(());
        }
        self.0.is_over.store(true, Ordering::Release);
        Err(OverBudget::Connection)
    }

    fn pay_back(&self, bytes: usize) {
        self.0.left.fetch_add(bytes, Ordering::AcqRel);
    }
}

fn take(left: &AtomicUsize, bytes: usize) -> bool {
    let paid = left.fetch_update(Ordering::AcqRel, Ordering::Acquire, |left| {
        left.checked_sub(bytes)
    });
    paid.is_ok()
}

/// Memory that is kept for a connection; given back when this is dropped.
#[derive(Debug)]
pub struct Holding {
    account: Account,
    bytes: usize,
}

impl Drop for Holding {
    fn drop(&mut self) {
        self.account.pay_back(self.bytes);
    }
}

/// What one message takes; given back when this is dropped.
#[derive(Debug)]
pub struct Share {
    account: Account,
    needed: usize,
    /// From the server's budget, with the first step, which is free.
    taken: usize,
}

impl Share {
    /// Takes so many more bytes, all or none.
    ///
    /// # Errors
    /// [`OverBudget`] if too few are left.
    pub fn take(&mut self, bytes: usize) -> Result<(), OverBudget> {
        self.account.pay(bytes)?;
        self.needed = self.needed.saturating_add(bytes);
        if self.needed <= self.taken {
            return Ok(());
        }
        let more = (self.needed - self.taken).next_multiple_of(STEP);
        if !take(&self.account.0.budget.0.left, more) {
            self.needed -= bytes;
            self.account.pay_back(bytes);
            return Err(OverBudget::Server);
        }
        self.taken += more;
        Ok(())
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        self.account.pay_back(self.needed);
        let left = &self.account.0.budget.0.left;
        left.fetch_add(self.taken - STEP, Ordering::AcqRel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_messages_share_and_small_ones_are_free() {
        let budget = Budget::new(2 * STEP);
        let account = budget.account(1);
        let mut small: Vec<Share> = (0..100).map(|_| account.share()).collect();
        assert!(small.iter_mut().all(|share| share.take(STEP).is_ok()));
        let (mut one, mut other) = (account.share(), budget.account(2).share());
        assert!(one.take(2 * STEP).is_ok() && one.take(1).is_ok() && other.take(STEP).is_ok());
        assert_eq!(other.take(1), Err(OverBudget::Server), "nothing is left");
        drop(one);
        assert!(other.take(STEP).is_ok());
        drop((small, other));
        assert_eq!(budget.0.left.load(Ordering::Acquire), 2 * STEP);
        assert_eq!(account.0.left.load(Ordering::Acquire), MAX_CONNECTION_BYTES);
    }

    #[test]
    fn a_connection_owns_only_so_much_of_all_kinds_together() {
        let budget = Budget::new(usize::MAX);
        let (account, other) = (budget.account(1), budget.account(2));
        let kept = account.hold(MAX_CONNECTION_BYTES - 2).unwrap();
        let mut share = account.share();
        assert_eq!(share.take(2), Ok(()));
        assert!(!account.is_over());
        assert_eq!(share.take(1), Err(OverBudget::Connection));
        assert!(account.is_over() && account.hold(1).is_err());
        assert!(!other.is_over() && other.hold(1).is_ok());
        drop(kept);
        drop(share);
        assert!(account.hold(MAX_CONNECTION_BYTES).is_ok());
        assert!(account.is_over(), "it is closed all the same");
    }
}
