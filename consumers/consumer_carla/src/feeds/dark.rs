//! Cameras without rendering: nobody reads them, so that nothing is drawn for them.

use std::io::Write as _;
use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use schema_bus::WaitSet;

use super::{Feed, Feeds, Progress};
use crate::gateway::lock;

/// How long turning cameras on or off waits for all of them.
const SWITCH: Duration = Duration::from_secs(2);

impl Feeds {
    /// Whether cameras stay dark: then nobody reads them, and nothing is rendered for them. Returns
    /// when all have changed.
    pub fn set_no_rendering(&self, on: bool) {
        if self.no_rendering.swap(on, Ordering::AcqRel) == on {
            return;
        }
        for (_, feed) in lock(&self.waiting).values_mut().flatten() {
            self.shut_or_open(feed);
        }
        let is_late = |progress: &&Arc<Progress>| {
            let differs = progress
                .is_shut
                .as_ref()
                .is_some_and(|shut| shut.load(Ordering::Acquire) != on);
            differs
                && progress.is_connected.load(Ordering::Acquire)
                && Arc::strong_count(progress) > 1
        };
        let began = Instant::now();
        let mut active = lock(&self.active);
        while active.iter().any(|progress| is_late(&progress)) && began.elapsed() < SWITCH {
            for late in active.iter().filter(is_late) {
                // A full pipe wakes as well as one byte more.
                let _ = (&late.poke).write(&[1]);
            }
            active = self
                .taken
                .wait_timeout(active, Duration::from_millis(20))
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
    }

    /// Lets go of a camera's readers, or takes them again.
    pub(super) fn shut_or_open(&self, feed: &mut Feed) {
        let progress = feed.progress.clone();
        let Some(is_shut) = &progress.is_shut else {
            return;
        };
        let shut = self.no_rendering.load(Ordering::Acquire);
        if is_shut.load(Ordering::Acquire) == shut {
            return;
        }
        if shut {
            feed.waiting.clear();
            feed.readers.clear();
            feed.wake = WaitSet::new();
        } else if let Some(Err(error)) = self.bus.get().map(|bus| feed.read_topics(bus)) {
            tracing::warn!(actor = feed.actor, %error, "cannot read a camera again");
        }
        is_shut.store(shut, Ordering::Release);
        drop(lock(&self.active));
        self.taken.notify_all();
    }
}
