//! How far each reader is, and waiting for readers to catch up.
//!
//! A frame that a client does not take waits in shared memory, where two fit; newer frames push it
//! out, so a slow client loses frames. In synchronous mode nothing may be lost: [`Readers::settle`]
//! delays the next step until every reader has taken the frames of the last one.

use std::io::Write as _;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex};
use schema_bus::mono_now;

/// How long a step waits for a reader whose client has not connected yet.
const CONNECT_STEP: Duration = Duration::from_secs(1);
/// How long a step waits for a client that does not take its messages.
const WRITE_STEP: Duration = Duration::from_secs(5);
/// How long switching no-rendering mode waits for all cameras to follow.
const SWITCH: Duration = Duration::from_secs(2);
/// How often a waiting thread checks its condition without being notified.
const LOOK: Duration = Duration::from_millis(20);

/// How far a reader is.
#[derive(Debug)]
pub struct Progress {
    stream: u32,
    /// The RPC connection of the client that asked for the stream and may not have connected yet.
    owner: Option<u64>,
    /// The reader has taken everything published before this time (`CLOCK_MONOTONIC`).
    taken_nanos: AtomicU64,
    is_connected: AtomicBool,
    /// Whether a step gave up waiting for this reader; reset once it has caught up.
    lags: AtomicBool,
    /// For cameras: whether no-rendering mode has closed the readers. `None` for everything else.
    is_shut: Option<AtomicBool>,
    poke: UnixStream,
}

impl Progress {
    /// The progress of a reader that starts now, for a client with the RPC connection `owner` if it
    /// is about to connect. A byte written to `poke` wakes the reader. `is_shut` is given for cameras
    /// only: whether no-rendering mode keeps them closed.
    pub fn new(
        stream: u32,
        owner: Option<u64>,
        is_shut: Option<bool>,
        poke: UnixStream,
    ) -> Progress {
        Progress {
            stream,
            owner,
            taken_nanos: AtomicU64::new(mono_now().0),
            is_connected: AtomicBool::new(false),
            lags: AtomicBool::new(false),
            is_shut: is_shut.map(AtomicBool::new),
            poke,
        }
    }

    /// Notes that the client has connected.
    pub fn connect(&self) {
        self.is_connected.store(true, Ordering::Release);
    }

    /// The reader has taken everything published before `nanos`.
    pub fn take(&self, nanos: u64) {
        self.taken_nanos.store(nanos, Ordering::Release);
        self.lags.store(false, Ordering::Release);
    }

    /// Steps must not wait for a reader that has ended.
    pub fn finish(&self) {
        self.taken_nanos.store(u64::MAX, Ordering::Release);
    }

    /// Whether this camera is closed; `None` if it is not a camera.
    pub fn is_shut(&self) -> Option<bool> {
        Some(self.is_shut.as_ref()?.load(Ordering::Acquire))
    }

    /// Notes that a camera was closed or opened.
    pub fn set_shut(&self, shut: bool) {
        if let Some(is_shut) = &self.is_shut {
            is_shut.store(shut, Ordering::Release);
        }
    }

    /// Whether a step of the client with this RPC connection waits for the reader. For one whose
    /// client has not connected yet only that client's own steps wait: anybody may ask for streams.
    fn delays(&self, connection: u64) -> bool {
        self.is_connected.load(Ordering::Acquire) || self.owner == Some(connection)
    }

    /// Whether the reader still exists; it holds the other reference.
    fn is_alive(self: &Arc<Self>) -> bool {
        Arc::strong_count(self) > 1
    }

    fn wake(&self) {
        // A full pipe wakes the reader, too, so this error can be ignored.
        let _ = (&self.poke).write(&[1]);
    }
}

/// All readers, and the condition variable that their progress notifies.
#[derive(Debug, Default)]
pub struct Readers {
    active: Mutex<Vec<Arc<Progress>>>,
    taken: Condvar,
}

impl Readers {
    /// Adds a reader, which keeps the other reference to its progress.
    pub fn add(&self, progress: Arc<Progress>) {
        self.active.lock().push(progress);
    }

    /// Forgets readers that have ended. Each keeps a socket, and in a world that runs freely no step
    /// looks at them.
    pub fn sweep(&self) {
        self.active.lock().retain(|progress| progress.is_alive());
    }

    /// Whether this stream has a reader.
    pub fn has_reader(&self, stream: u32) -> bool {
        self.active
            .lock()
            .iter()
            .any(|progress| progress.stream == stream && progress.is_alive())
    }

    /// Adds the progress of one more listener of a stream that has a reader. A listener gets its
    /// messages from the stream's newest reader, so waiting for it wakes that reader.
    pub fn add_listener(&self, stream: u32, owner: Option<u64>) -> Option<Arc<Progress>> {
        let mut active = self.active.lock();
        let poke = active
            .iter()
            .rev()
            .find(|progress| progress.stream == stream && progress.is_alive())?
            .poke
            .try_clone()
            .ok()?;
        let progress = Arc::new(Progress::new(stream, owner, None, poke));
        active.push(progress.clone());
        Some(progress)
    }

    /// Wakes everyone who waits for readers: some progress has changed.
    pub fn ring(&self) {
        // Taking the lock closes the gap between a waiter's check and its wait.
        drop(self.active.lock());
        self.taken.notify_all();
    }

    /// Before a step of the client with this RPC connection: waits until every reader has taken
    /// everything published before `since_nanos`. A client that does not take its messages delays
    /// only one step; after that it loses frames until it has caught up. A stream that was asked for
    /// and that nobody has connected to delays steps of who asked, and of nobody else.
    pub fn settle(&self, since_nanos: u64, connection: u64) {
        let began = Instant::now();
        let is_behind = |progress: &&Arc<Progress>| {
            progress.taken_nanos.load(Ordering::Acquire) < since_nanos
                && progress.delays(connection)
                && !progress.lags.load(Ordering::Acquire)
        };
        let mut active = self.active.lock();
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
            self.taken.wait_for(&mut active, LOOK);
        }
        active.retain(|progress| progress.is_alive());
    }

    /// Waits until every camera of a connected client is closed (`shut`) or open.
    pub fn await_cameras(&self, shut: bool) {
        let is_late = |progress: &&Arc<Progress>| {
            progress.is_shut().is_some_and(|is_shut| is_shut != shut)
                && progress.is_connected.load(Ordering::Acquire)
                && progress.is_alive()
        };
        let began = Instant::now();
        let mut active = self.active.lock();
        while active.iter().any(|progress| is_late(&progress)) && began.elapsed() < SWITCH {
            active.iter().filter(is_late).for_each(|late| late.wake());
            self.taken.wait_for(&mut active, LOOK);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A reader that never takes anything, and whether the step waited for it until it gave up.
    #[test]
    fn a_stream_that_nobody_connects_to_delays_only_who_asked_for_it() {
        let readers = Readers::default();
        let (poke, _poked) = UnixStream::pair().unwrap();
        let unused = Arc::new(Progress::new(7, Some(1), None, poke));
        unused.taken_nanos.store(0, Ordering::Release);
        readers.add(unused.clone());
        for _ in 0..20 {
            readers.settle(1, 2);
            assert!(!unused.lags.load(Ordering::Acquire), "nobody waited for it");
        }
        readers.settle(1, 1);
        assert!(unused.lags.load(Ordering::Acquire), "its own client did");
        // Once its client has connected, everybody's steps wait for it.
        unused.take(0);
        unused.connect();
        let taken = unused.clone();
        let taker = std::thread::spawn(move || taken.take(1));
        readers.settle(1, 2);
        assert_eq!(unused.taken_nanos.load(Ordering::Acquire), 1);
        taker.join().unwrap();
    }
}
