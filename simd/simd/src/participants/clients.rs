//! What stepped mode does without a client: runs on by itself after a while, unless told to wait.

use crate::settings::cli::OnLostClient;

/// Time without any client after which stepped mode runs on by itself (`--on-lost-client resume`).
const LOST_CLIENT_NANOS: u64 = 10_000_000_000;

/// How often a daemon looks for processes that were killed: a dead one counts as a client or a reader
/// until it is cleaned up.
const CLEAN_NANOS: u64 = 500_000_000;

/// The same for a daemon that has no time to spare between ticks: sensors render for a dead reader
/// for less than a second.
const BUSY_CLEAN_NANOS: u64 = 800_000_000;

/// Time to spare until the next tick that cleaning takes at most in the usual case: a millisecond
/// and a half with a dozen processes.
pub const CLEANING_NANOS: u64 = 5_000_000;

/// When clients were last there. Times are `CLOCK_MONOTONIC` nanoseconds.
#[derive(Clone, Copy, Debug)]
pub struct Clients {
    last_seen_nanos: u64,
    last_cleaned_nanos: u64,
    is_running_alone: bool,
}

impl Clients {
    /// Counts from now.
    pub fn new(now_nanos: u64) -> Clients {
        Clients {
            last_seen_nanos: now_nanos,
            last_cleaned_nanos: now_nanos,
            is_running_alone: false,
        }
    }

    /// Whether stepped mode runs on without cues.
    pub fn is_running_alone(&self) -> bool {
        self.is_running_alone
    }

    /// A client is there.
    pub fn seen(&mut self, now_nanos: u64) {
        self.last_seen_nanos = now_nanos;
    }

    /// A client takes the stepping over; returns whether the daemon had run on by itself.
    pub fn take_over(&mut self, now_nanos: u64) -> bool {
        self.seen(now_nanos);
        std::mem::take(&mut self.is_running_alone)
    }

    /// Whether it is time to clean up after processes that were killed. Without time to spare it is
    /// put off, but not for long: a sensor goes on rendering for a dead reader.
    pub fn must_clean(&mut self, now_nanos: u64, is_idle: bool) -> bool {
        let wait_nanos = if is_idle {
            CLEAN_NANOS
        } else {
            BUSY_CLEAN_NANOS
        };
        let is_due = now_nanos.saturating_sub(self.last_cleaned_nanos) > wait_nanos;
        if is_due {
            self.last_cleaned_nanos = now_nanos;
        }
        is_due
    }

    /// No client is there. Returns whether the daemon begins to run on by itself.
    pub fn missed(&mut self, now_nanos: u64, on_lost_client: OnLostClient) -> bool {
        let begins = on_lost_client == OnLostClient::Resume
            && !self.is_running_alone
            && now_nanos.saturating_sub(self.last_seen_nanos) > LOST_CLIENT_NANOS;
        self.is_running_alone |= begins;
        begins
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_daemon_runs_on_once_and_a_client_takes_over() {
        let mut clients = Clients::new(0);
        assert!(!clients.missed(LOST_CLIENT_NANOS, OnLostClient::Resume));
        assert!(!clients.missed(LOST_CLIENT_NANOS + 1, OnLostClient::Wait));
        assert!(clients.missed(LOST_CLIENT_NANOS + 1, OnLostClient::Resume));
        assert!(clients.is_running_alone());
        assert!(
            !clients.missed(LOST_CLIENT_NANOS + 2, OnLostClient::Resume),
            "it runs already"
        );
        assert!(clients.take_over(LOST_CLIENT_NANOS + 3));
        assert!(!clients.is_running_alone() && !clients.take_over(LOST_CLIENT_NANOS + 4));
        let busy = BUSY_CLEAN_NANOS;
        assert!(
            !clients.must_clean(CLEAN_NANOS, true) && clients.must_clean(CLEAN_NANOS + 1, true)
        );
        assert!(
            !clients.must_clean(busy, false) && clients.must_clean(busy + CLEAN_NANOS + 2, false)
        );
        assert!(!clients.missed(2 * LOST_CLIENT_NANOS, OnLostClient::Resume));
    }
}
