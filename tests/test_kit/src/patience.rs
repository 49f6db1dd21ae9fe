//! Waits for a condition, with a limit that only a hang reaches.

use std::time::{Duration, Instant};

/// How long a test waits for a condition before it fails. This is far longer than anything takes,
/// so that only a hang reaches it.
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
