//! The world stream: one snapshot message per tick to every client, before the tick's sensor
//! messages.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TrySendError, bounded};
use parking_lot::{Condvar, Mutex, MutexGuard};

use crate::feeds::client_streams::{self, ClientStream, ClientStreams, Retired};
use crate::feeds::held_answers::HeldAnswers;
use crate::feeds::lost_managers::LostManagers;
use crate::wire::streams::{Recipient, StreamMessage};

/// Messages that may wait for a slow client; beyond that its newest are dropped.
const BACKLOG: usize = 256;
/// How often a connection without messages is checked for its end.
const LOOK: Duration = Duration::from_millis(500);
/// How long after a snapshot it is repeated for clients that may have lost it.
const REPEAT_AFTER: Duration = Duration::from_millis(100);
/// How long sensor messages wait for a client that is slow to take a snapshot.
const SNAPSHOT_FIRST: Duration = Duration::from_millis(50);

/// A client that listens to the world.
#[derive(Debug)]
struct Subscriber {
    queue: Sender<StreamMessage>,
    pace: Arc<Pace>,
}

/// How far a subscriber is.
#[derive(Debug)]
struct Pace {
    /// Newest tick that was written to its connection.
    written: AtomicU64,
    /// Whether sensor messages gave up waiting for this client; reset once it has caught up.
    lags: AtomicBool,
}

#[derive(Debug, Default)]
struct Audience {
    newest: Option<StreamMessage>,
    subscribers: Vec<Subscriber>,
}

/// The world stream.
#[derive(Debug, Default)]
pub struct WorldStream {
    /// Answers that wait for clients to connect to this stream, among others.
    pub held_answers: HeldAnswers,
    /// Traffic Managers whose end costs clients a snapshot.
    pub lost_managers: LostManagers,
    audience: Mutex<Audience>,
    client_streams: Mutex<ClientStreams>,
    written: Condvar,
    newest_tick: AtomicU64,
}

impl WorldStream {
    fn audience(&self) -> MutexGuard<'_, Audience> {
        self.audience.lock()
    }

    fn client_streams(&self) -> MutexGuard<'_, ClientStreams> {
        self.client_streams.lock()
    }

    /// The number of the world stream of the client with this RPC connection.
    pub fn stream_of(&self, connection: u64) -> u32 {
        self.client_streams().stream_of(connection)
    }

    /// Silences the stream of a client that loads a world; afterwards the client takes a new one.
    pub fn retire(&self, connection: u64) -> Option<ClientStream> {
        self.client_streams().retire(connection)
    }

    /// Notes which episode a client has left, by CARLA's id.
    pub fn note_left(&self, connection: u64, episode: u64) {
        self.client_streams().note_left(connection, episode);
    }

    /// The episode that the client has left since it last asked here.
    pub fn take_left(&self, connection: u64) -> Option<u64> {
        self.client_streams().take_left(connection)
    }

    /// The load failed: the client keeps the stream that [`WorldStream::retire`] returned.
    pub fn restore(&self, connection: u64, own: ClientStream) {
        self.client_streams().restore(connection, own);
    }

    /// Sends a snapshot to all listeners and keeps it for clients that connect later.
    pub fn send(&self, message: StreamMessage) {
        let mut audience = self.audience();
        audience.subscribers.retain(|subscriber| {
            match subscriber.queue.try_send(message.clone()) {
                Ok(()) => true,
                Err(TrySendError::Full(_)) => {
                    tracing::warn!(
                        "a client is {BACKLOG} snapshots behind; one was dropped for it"
                    );
                    true
                }
                Err(TrySendError::Disconnected(_)) => false,
            }
        });
        self.newest_tick.store(message.tick, Ordering::Release);
        audience.newest = Some(message);
        drop(audience);
        self.written.notify_all();
    }

    /// Drops the snapshot that is kept for clients that connect later.
    pub fn forget(&self) {
        self.audience().newest = None;
        self.newest_tick.store(0, Ordering::Release);
    }

    /// Waits until the snapshot of `tick` was written to every client that keeps up, so that no
    /// sensor message overtakes it.
    pub fn await_snapshot(&self, tick: u64) {
        let deadline = Instant::now() + SNAPSHOT_FIRST;
        let mut audience = self.audience();
        loop {
            let is_behind = |subscriber: &&Subscriber| {
                subscriber.pace.written.load(Ordering::Acquire) < tick
                    && !subscriber.pace.lags.load(Ordering::Acquire)
            };
            let is_sent = self.newest_tick.load(Ordering::Acquire) >= tick;
            if is_sent
                && !audience
                    .subscribers
                    .iter()
                    .any(|subscriber| is_behind(&subscriber))
            {
                return;
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                audience
                    .subscribers
                    .iter()
                    .filter(is_behind)
                    .for_each(|slow| slow.pace.lags.store(true, Ordering::Release));
                return;
            }
            self.written.wait_for(&mut audience, left);
        }
    }

    fn subscribe(&self) -> (Receiver<StreamMessage>, Arc<Pace>) {
        let (queue, messages) = bounded(BACKLOG);
        let mut audience = self.audience();
        // A new client did not get earlier snapshots, so nobody needs to wait for those.
        let pace = Arc::new(Pace {
            written: AtomicU64::new(self.newest_tick.load(Ordering::Acquire)),
            lags: AtomicBool::new(false),
        });
        if let Some(newest) = &audience.newest {
            // A new queue has room for one message.
            let _ = queue.try_send(newest.clone());
        }
        audience.subscribers.push(Subscriber {
            queue,
            pace: pace.clone(),
        });
        (messages, pace)
    }

    /// Sends snapshots to a client until it disconnects.
    pub(crate) fn serve(&self, stream: u32, client: &Recipient) -> std::io::Result<()> {
        let (is_retired, owner) = {
            let mut streams = self.client_streams();
            (streams.retired(stream), streams.owner(stream))
        };
        let (messages, pace) = self.subscribe();
        if let Some(owner) = owner {
            self.held_answers.joined(owner);
        }
        let served = self.send_all(client, &messages, &pace, &is_retired);
        // Sensor messages must not wait for a client that has gone.
        drop(messages);
        pace.written.store(u64::MAX, Ordering::Release);
        self.written.notify_all();
        served
    }

    fn send_all(
        &self,
        client: &Recipient,
        messages: &Receiver<StreamMessage>,
        pace: &Pace,
        is_retired: &Retired,
    ) -> std::io::Result<()> {
        let mut last = None;
        loop {
            let is_lossy = self.lost_managers.is_recent();
            match messages.recv_timeout(if is_lossy { REPEAT_AFTER } else { LOOK }) {
                Ok(message) => {
                    if client_streams::is_served(is_retired) {
                        client.send(&message.bytes, &[])?;
                        last = Some(message.clone());
                    } else if client.has_ended()? {
                        return Ok(());
                    }
                    pace.written.store(message.tick, Ordering::Release);
                    if messages.is_empty() {
                        pace.lags.store(false, Ordering::Release);
                    }
                    // Taking the lock closes the gap between a waiter's check and its wait.
                    drop(self.audience());
                    self.written.notify_all();
                }
                Err(RecvTimeoutError::Timeout) if client.has_ended()? => return Ok(()),
                Err(RecvTimeoutError::Timeout) => {
                    let lost = last.take_if(|_| self.lost_managers.is_recent());
                    if let Some(message) = lost.filter(|_| client_streams::is_served(is_retired)) {
                        client.send(&message.bytes, &[])?;
                    }
                }
                Err(RecvTimeoutError::Disconnected) => return Ok(()),
            }
        }
    }
}
