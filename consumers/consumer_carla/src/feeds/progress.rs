//! Who waits for what: how far each reader is, and the bell that rings when one has got further.
//!
//! A frame that cannot be written waits in shared memory, where newer ones push it out (two fit): a
//! slow client loses frames. In synchronous mode nothing may be lost, so [`Readers::settle`] holds
//! the next step back until every reader has taken what there was.

use std::io::Write as _;
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use schema_bus::mono_now;

use crate::lock::lock;

/// How long a step waits for a reader whose client has not connected yet.
const CONNECT_STEP: Duration = Duration::from_secs(1);
/// How long a step waits for a client that does not take its messages.
const WRITE_STEP: Duration = Duration::from_secs(5);
/// How long turning cameras on or off waits for all of them.
const SWITCH: Duration = Duration::from_secs(2);
/// How often the conditions of a wait are looked at without a bell.
const LOOK: Duration = Duration::from_millis(20);

/// How far a reader is, for those who wait for it.
#[derive(Debug)]
pub struct Progress {
    stream: u32,
    /// Everything published before this `CLOCK_MONOTONIC` was taken.
    taken_nanos: AtomicU64,
    is_connected: AtomicBool,
    /// Found too slow to wait for; until it has caught up.
    lags: AtomicBool,
    /// A camera's that is not to be read; `None` for what has no readers of its own.
    is_shut: Option<AtomicBool>,
    poke: UnixStream,
}

impl Progress {
    /// Of a reader of `stream` that begins now. A byte through `poke` wakes it. `is_shut` is
    /// whether it is a camera that is not to be read, if it is a camera.
    pub fn new(stream: u32, is_shut: Option<bool>, poke: UnixStream) -> Progress {
        Progress {
            stream,
            taken_nanos: AtomicU64::new(mono_now().0),
            is_connected: AtomicBool::new(false),
            lags: AtomicBool::new(false),
            is_shut: is_shut.map(AtomicBool::new),
            poke,
        }
    }

    /// Its client has come.
    pub fn connect(&self) {
        self.is_connected.store(true, Ordering::Release);
    }

    /// Everything published before was taken.
    pub fn take(&self, nanos: u64) {
        self.taken_nanos.store(nanos, Ordering::Release);
        self.lags.store(false, Ordering::Release);
    }

    /// Nobody waits for what has ended.
    pub fn finish(&self) {
        self.taken_nanos.store(u64::MAX, Ordering::Release);
    }

    /// Whether it is a camera that is not read; `None` if it is no camera.
    pub fn is_shut(&self) -> Option<bool> {
        Some(self.is_shut.as_ref()?.load(Ordering::Acquire))
    }

    /// Says that a camera is not read any more, or is again.
    pub fn set_shut(&self, shut: bool) {
        if let Some(is_shut) = &self.is_shut {
            is_shut.store(shut, Ordering::Release);
        }
    }

    /// Whether the reader still exists, which holds the other reference.
    fn is_alive(self: &Arc<Self>) -> bool {
        Arc::strong_count(self) > 1
    }

    fn wake(&self) {
        // A full pipe wakes as well as one byte more.
        let _ = (&self.poke).write(&[1]);
    }
}

/// All readers, and the bell.
#[derive(Debug, Default)]
pub struct Readers {
    active: Mutex<Vec<Arc<Progress>>>,
    taken: Condvar,
}

impl Readers {
    /// One more, whose progress the reader holds too.
    pub fn add(&self, progress: Arc<Progress>) {
        lock(&self.active).push(progress);
    }

    /// Whether somebody reads this stream.
    pub fn has_reader(&self, stream: u32) -> bool {
        lock(&self.active)
            .iter()
            .any(|progress| progress.stream == stream && progress.is_alive())
    }

    /// Progress of one more listener of a stream that somebody reads. Who waits for the listener
    /// wakes the stream's newest reader, on which it depends.
    pub fn add_listener(&self, stream: u32) -> Option<Arc<Progress>> {
        let mut active = lock(&self.active);
        let poke = active
            .iter()
            .rev()
            .find(|progress| progress.stream == stream && progress.is_alive())?
            .poke
            .try_clone()
            .ok()?;
        let progress = Arc::new(Progress::new(stream, None, poke));
        active.push(progress.clone());
        Some(progress)
    }

    /// Rings the bell: some reader's progress has changed.
    pub fn ring(&self) {
        // Under the lock, so that who has just looked is waiting by now.
        drop(lock(&self.active));
        self.taken.notify_all();
    }

    /// Waits until every reader has taken what was published before `since_nanos`. A client that
    /// does not take its messages is waited for once; it then loses frames until it has caught up.
    pub fn settle(&self, since_nanos: u64) {
        let began = Instant::now();
        let is_behind = |progress: &&Arc<Progress>| {
            progress.taken_nanos.load(Ordering::Acquire) < since_nanos
                && !progress.lags.load(Ordering::Acquire)
        };
        let mut active = lock(&self.active);
        active
            .iter()
            .filter(is_behind)
            .for_each(|behind| behind.wake());
        while let Some(behind) = active.iter().find(is_behind) {
            let is_connected = behind.is_connected.load(Ordering::Acquire);
            if began.elapsed()
                >= if is_connected {
                    WRITE_STEP
                } else {
                    CONNECT_STEP
                }
            {
                let fault = if is_connected {
                    "does not take its sensor's messages"
                } else {
                    "asked for a sensor's stream and does not connect"
                };
                tracing::warn!(
                    stream = behind.stream,
                    "a client {fault}; it loses frames until it does"
                );
                behind.lags.store(true, Ordering::Release);
                continue;
            }
            active = self
                .taken
                .wait_timeout(active, LOOK)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
        active.retain(|progress| progress.is_alive());
    }

    /// Waits until every camera of a connected client is shut, or open.
    pub fn await_cameras(&self, shut: bool) {
        let is_late = |progress: &&Arc<Progress>| {
            progress.is_shut().is_some_and(|is_shut| is_shut != shut)
                && progress.is_connected.load(Ordering::Acquire)
                && progress.is_alive()
        };
        let began = Instant::now();
        let mut active = lock(&self.active);
        while active.iter().any(|progress| is_late(&progress)) && began.elapsed() < SWITCH {
            active.iter().filter(is_late).for_each(|late| late.wake());
            active = self
                .taken
                .wait_timeout(active, LOOK)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
    }
}
