//! When to look whether a topic's frames still come the way that they are waited for: its writer may
//! end, or leave the topic to a process on another GPU.

use std::time::{Duration, Instant};

/// Time between two looks for a writer that is missing, and longest sleep without one.
pub const LOOK: Duration = Duration::from_millis(500);
/// How long a topic may be on no GPU until its frames are uploaded: longer than a camera takes to
/// move from one process to another.
const PATIENCE: Duration = Duration::from_secs(2);

/// Looks after a topic on which no frame waits.
#[derive(Debug)]
pub struct Watch {
    looked: Instant,
    missing_since: Option<Instant>,
}

impl Watch {
    /// The writer was there just now.
    pub fn new() -> Watch {
        Watch {
            looked: Instant::now(),
            missing_since: None,
        }
    }

    /// Whether it is time for a look.
    pub fn is_due(&mut self) -> bool {
        let is_due = self.looked.elapsed() >= LOOK;
        if is_due {
            self.looked = Instant::now();
        }
        is_due
    }

    /// Nobody keeps the topic on a GPU; returns whether that has been so for long.
    pub fn is_missing_for_long(&mut self) -> bool {
        let since = self.missing_since.get_or_insert_with(Instant::now);
        since.elapsed() >= PATIENCE
    }

    /// A process keeps it on a GPU.
    pub fn is_there(&mut self) {
        self.missing_since = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_stays_missing_is_given_up() {
        let mut watch = Watch::new();
        assert!(!watch.is_due(), "it has just been looked at");
        assert!(!watch.is_missing_for_long());
        let long_ago = Instant::now() - 2 * PATIENCE;
        watch.looked = long_ago;
        watch.missing_since = Some(long_ago);
        assert!(watch.is_due() && !watch.is_due());
        assert!(watch.is_missing_for_long());
        watch.is_there();
        assert!(!watch.is_missing_for_long());
    }
}
