//! All listeners of a sensor but the first: one reader for them together.

use std::io::Read as _;
use std::os::fd::AsFd as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::time::{Duration, Instant};

use schema_bus::mono_now;

use super::{Feed, Feeds, LOOK, Outlet, Progress};
use crate::gateway::lock;
use crate::relay::Relay;

/// Messages that wait for each of them.
const BACKLOG: usize = 4;

impl Feeds {
    /// If somebody reads this stream already: takes a place in the relay that sends to all others.
    pub(super) fn beside<R>(
        self: &Arc<Self>,
        stream: u32,
        join: impl FnOnce(&Relay, Arc<Progress>) -> R,
    ) -> Option<R> {
        let mut relays = lock(&self.relays);
        let is_read = |progress: &&Arc<Progress>| {
            progress.stream == stream && Arc::strong_count(progress) > 1
        };
        let relay = match relays.get(&stream) {
            Some(relay) => relay.clone(),
            None => {
                lock(&self.active).iter().find(is_read)?;
                let feed = self.open(stream)?;
                feed.progress.connect();
                let relay = Arc::new(Relay::new(BACKLOG));
                let (feeds, to) = (self.clone(), relay.clone());
                let spawned = std::thread::Builder::new()
                    .name("relay".into())
                    .spawn(move || feeds.relay(stream, feed, &to));
                if let Err(error) = spawned {
                    tracing::warn!(stream, %error, "cannot start a thread for the listeners of a stream");
                    return None;
                }
                relays.insert(stream, relay.clone());
                relay
            }
        };
        // Who waits for a listener wakes the relay's feed, on which it depends.
        let mut active = lock(&self.active);
        let poke = active.iter().rev().find(is_read)?.poke.try_clone().ok()?;
        let progress = Arc::new(Progress {
            stream,
            taken_nanos: AtomicU64::new(mono_now().0),
            is_connected: AtomicBool::new(false),
            lags: AtomicBool::new(false),
            is_shut: None,
            poke,
        });
        active.push(progress.clone());
        drop(active);
        // Before the lock is given back: a relay without listeners ends.
        Some(join(&relay, progress))
    }

    /// Reads for all listeners of a stream but the first, until there are none.
    fn relay(&self, stream: u32, mut feed: Feed, relay: &Arc<Relay>) {
        const IDLE: Duration = Duration::from_secs(2);
        let mut last_heard = Instant::now();
        while !self.is_over(&mut feed) {
            if relay.has_listeners() {
                last_heard = Instant::now();
            } else if last_heard.elapsed() > IDLE {
                let mut relays = lock(&self.relays);
                if !relay.has_listeners() {
                    relays.remove(&stream);
                    return;
                }
            }
            let done = self.pass_on(&mut feed, &mut Outlet::Relay(relay));
            let waited = feed.wake.wait_beside(&[feed.poked.as_fd()], LOOK);
            match (done, waited) {
                (Ok(nanos), Ok(ready)) => {
                    relay.promise(nanos);
                    if ready[0] {
                        // All that matters is that something came.
                        let _ = feed.poked.read(&mut [0; 64]);
                    }
                }
                (Err(error), _) => {
                    tracing::warn!(stream, %error, "the listeners of a stream end");
                    break;
                }
                (_, Err(error)) => {
                    tracing::warn!(stream, %error, "the listeners of a stream end");
                    break;
                }
            }
        }
        lock(&self.relays).remove(&stream);
        relay.close();
    }
}
