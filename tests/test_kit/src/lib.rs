//! Real processes for tests: start, wait for a line, pause, kill −9, and prove that nothing is
//! left.
//!
//! Every test has a [`Sandbox`]: a working directory, a domain and an iceoryx2 root and prefix of
//! its own, so that tests can run
//! side by side and "nothing left behind" is a fact. Only processes that a sandbox started are ever
//! signalled.
//! Nothing here depends on the speed of the machine: conditions are waited for, and a watchdog ends
//! what hangs.

#![forbid(unsafe_code)]

pub mod process;
pub mod sandbox;

pub use process::{Ended, Process};
pub use sandbox::Sandbox;

use std::time::{Duration, Instant};

/// How long a test waits for a condition before it fails: far beyond any sane duration, so that
/// only a hang reaches it.
pub const PATIENCE: Duration = Duration::from_secs(120);

/// Polls `condition` until it gives a value.
///
/// # Panics
/// After [`PATIENCE`], with `what` in the message.
pub fn eventually<T>(what: &str, mut condition: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(value) = condition() {
            return value;
        }
        assert!(
            start.elapsed() < PATIENCE,
            "waited {PATIENCE:?} in vain for: {what}"
        );
        std::thread::sleep(Duration::from_millis(10));
    }
}
