//! Waiting: how long a call may take, and sleeping until an event.

use std::time::{Duration, Instant};

use schema_bus::Listener;

use crate::border::Failure;

/// Longest single sleep: a writer that was killed announces nothing.
const SLICE: Duration = Duration::from_millis(100);
/// Between two looks for a topic that is missing.
const LOOK_EVERY: Duration = Duration::from_millis(10);

/// Until when a call may wait.
#[derive(Clone, Copy, Debug)]
pub struct Patience(Option<Instant>);

impl Patience {
    /// `nanos` from now on; less than 0 has no limit.
    pub fn new(nanos: i64) -> Patience {
        let wait = u64::try_from(nanos).ok().map(Duration::from_nanos);
        Patience(wait.and_then(|wait| Instant::now().checked_add(wait)))
    }

    /// Time that is left, at most `most`.
    pub fn left(&self, most: Duration) -> Duration {
        let left = |end: Instant| end.saturating_duration_since(Instant::now());
        self.0.map_or(most, |end| left(end).min(most))
    }

    /// Whether it is over.
    pub fn is_over(&self) -> bool {
        self.left(SLICE).is_zero()
    }

    /// Time for one sleep.
    pub fn slice(&self) -> Duration {
        self.left(SLICE)
    }

    /// Opens something, again and again while it does not exist.
    pub fn open<T>(&self, mut open: impl FnMut() -> Result<T, Failure>) -> Result<T, Failure> {
        loop {
            match open() {
                Err(failure) if failure.may_appear() && !self.is_over() => {
                    std::thread::sleep(self.left(LOOK_EVERY));
                }
                other => return other,
            }
        }
    }

    /// Looks until something is found or the patience is over, and sleeps until `event` in between.
    ///
    /// Pending notifications are taken before the look, so that none is slept through, and a woken
    /// reader has its sample two system calls earlier than by taking them after the sleep.
    pub fn look<T>(
        &self,
        event: &Listener,
        mut look: impl FnMut() -> Result<Option<T>, Failure>,
    ) -> Result<Option<T>, Failure> {
        loop {
            if let Some(found) = look()? {
                return Ok(Some(found));
            }
            event.drain()?;
            let found = look()?;
            if found.is_some() || self.is_over() {
                return Ok(found);
            }
            event.wait_pending(self.slice());
        }
    }
}
