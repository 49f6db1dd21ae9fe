//! The streaming server: a client sends a stream's number and is sent that stream's messages, each
//! after its length.
//!
//! Here are the connections and the world stream; streams of sensors are in [`crate::feeds`].

mod places;

use std::io::{IoSlice, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::os::fd::AsFd as _;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TrySendError, bounded};
use schema_bus::WaitSet;

use crate::feeds::Feeds;
use places::{Places, Retired};

pub use places::{Place, is_world};

/// Stream of the world snapshots, for who asks for no own one.
pub const WORLD_STREAM: u32 = 1;
/// Messages that wait for a slow client before the newest are dropped for it.
const BACKLOG: usize = 256;
/// Open streaming connections.
const MAX_CONNECTIONS: usize = 512;
/// A client that connects and says nothing is dropped after this.
const HANDSHAKE: Duration = Duration::from_secs(10);
/// A client that takes nothing off its connection is dropped after this.
const WRITE: Duration = Duration::from_secs(30);
/// How often an idle connection is looked at.
const LOOK: Duration = Duration::from_millis(500);
/// How long sensors' messages wait for a client that is slow to take a snapshot.
const SNAPSHOT_FIRST: Duration = Duration::from_millis(50);

/// The message of one snapshot, shared by all its receivers.
#[derive(Clone, Debug)]
pub struct WorldMessage {
    /// Tick it shows.
    pub tick: u64,
    /// Its bytes.
    pub bytes: Arc<[u8]>,
}

/// Who listens to the world.
#[derive(Debug)]
struct Subscriber {
    queue: Sender<WorldMessage>,
    /// Newest tick that was written to its connection.
    written: Arc<AtomicU64>,
    /// Whether it was found too slow to wait for.
    lags: Arc<AtomicBool>,
}

#[derive(Debug, Default)]
struct WorldStream {
    newest: Option<WorldMessage>,
    subscribers: Vec<Subscriber>,
}

/// The world stream.
#[derive(Debug, Default)]
pub struct Streams {
    world: Mutex<WorldStream>,
    places: Mutex<Places>,
    written: Condvar,
    newest_tick: AtomicU64,
}

impl Streams {
    fn world(&self) -> MutexGuard<'_, WorldStream> {
        self.world.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn places(&self) -> MutexGuard<'_, Places> {
        self.places.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The number of a client's world stream, by its RPC connection.
    pub fn stream_of(&self, connection: u64) -> u32 {
        self.places().stream_of(connection)
    }

    /// The client loads a world and takes a new stream afterwards: its old one is sent nothing
    /// more.
    pub fn retire(&self, connection: u64) -> Option<Place> {
        self.places().retire(connection)
    }

    /// The client goes on with what [`Streams::retire`] gave.
    pub fn restore(&self, connection: u64, place: Place) {
        self.places().restore(connection, place);
    }

    /// Sends a snapshot to all who listen, and keeps it for who comes next.
    pub fn send(&self, message: WorldMessage) {
        let mut world = self.world();
        world.subscribers.retain(
            |subscriber| match subscriber.queue.try_send(message.clone()) {
                Ok(()) => true,
                Err(TrySendError::Full(_)) => {
                    tracing::warn!(
                        "a client is {BACKLOG} snapshots behind; one was dropped for it"
                    );
                    true
                }
                Err(TrySendError::Disconnected(_)) => false,
            },
        );
        self.newest_tick.store(message.tick, Ordering::Release);
        world.newest = Some(message);
        drop(world);
        self.written.notify_all();
    }

    /// Forgets what greets who comes next.
    pub fn forget(&self) {
        self.world().newest = None;
        self.newest_tick.store(0, Ordering::Release);
    }

    /// Waits until the snapshot of `tick` is on its way to every client that keeps up, so that no
    /// sensor's message overtakes it.
    pub fn await_snapshot(&self, tick: u64) {
        let deadline = Instant::now() + SNAPSHOT_FIRST;
        let mut world = self.world();
        loop {
            let is_behind = |subscriber: &&Subscriber| {
                subscriber.written.load(Ordering::Acquire) < tick
                    && !subscriber.lags.load(Ordering::Acquire)
            };
            let is_sent = self.newest_tick.load(Ordering::Acquire) >= tick;
            if is_sent
                && !world
                    .subscribers
                    .iter()
                    .any(|subscriber| is_behind(&subscriber))
            {
                return;
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                world
                    .subscribers
                    .iter()
                    .filter(is_behind)
                    .for_each(|slow| slow.lags.store(true, Ordering::Release));
                return;
            }
            world = self
                .written
                .wait_timeout(world, left)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
    }

    fn subscribe(&self) -> (Receiver<WorldMessage>, Arc<AtomicU64>, Arc<AtomicBool>) {
        let (queue, receiver) = bounded(BACKLOG);
        let mut world = self.world();
        // It missed what came before, and need not be waited for on its account.
        let written = Arc::new(AtomicU64::new(self.newest_tick.load(Ordering::Acquire)));
        let lags = Arc::new(AtomicBool::new(false));
        if let Some(newest) = &world.newest {
            // Room for one there is.
            let _ = queue.try_send(newest.clone());
        }
        world.subscribers.push(Subscriber {
            queue,
            written: written.clone(),
            lags: lags.clone(),
        });
        (receiver, written, lags)
    }

    fn serve(&self, stream: u32, mut connection: TcpStream) -> std::io::Result<()> {
        let is_retired = self.places().retired(stream);
        let (messages, written, lags) = self.subscribe();
        let served = self.send_all(&mut connection, &messages, &written, &lags, &is_retired);
        // Nobody waits for a client that has gone.
        drop(messages);
        written.store(u64::MAX, Ordering::Release);
        self.written.notify_all();
        served
    }

    fn send_all(
        &self,
        connection: &mut TcpStream,
        messages: &Receiver<WorldMessage>,
        written: &AtomicU64,
        lags: &AtomicBool,
        is_retired: &Retired,
    ) -> std::io::Result<()> {
        loop {
            match messages.recv_timeout(LOOK) {
                Ok(message) => {
                    if places::is_served(is_retired) {
                        send(connection, &message.bytes, &[])?;
                    } else if has_ended(connection)? {
                        return Ok(());
                    }
                    written.store(message.tick, Ordering::Release);
                    if messages.is_empty() {
                        lags.store(false, Ordering::Release);
                    }
                    // Under the lock, so that who has just looked is waiting by now.
                    drop(self.world());
                    self.written.notify_all();
                }
                Err(RecvTimeoutError::Timeout) if has_ended(connection)? => return Ok(()),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Ok(()),
            }
        }
    }
}

/// Accepts clients for ever, each on a thread of its own.
pub fn serve(listener: &TcpListener, streams: &Arc<Streams>, feeds: &Arc<Feeds>) {
    let open = Arc::new(AtomicUsize::new(0));
    for connection in listener.incoming() {
        let Ok(connection) = connection else { continue };
        if open.fetch_add(1, Ordering::AcqRel) >= MAX_CONNECTIONS {
            tracing::warn!("refused a streaming connection: {MAX_CONNECTIONS} are open");
            open.fetch_sub(1, Ordering::AcqRel);
            continue;
        }
        let (streams, feeds, open_here) = (streams.clone(), feeds.clone(), open.clone());
        let spawned = std::thread::Builder::new()
            .name("stream".into())
            .spawn(move || {
                if let Err(error) = serve_one(connection, &streams, &feeds) {
                    tracing::debug!(%error, "a streaming connection ended");
                }
                open_here.fetch_sub(1, Ordering::AcqRel);
            });
        if let Err(error) = spawned {
            tracing::warn!(%error, "cannot start a thread for a streaming connection");
            open.fetch_sub(1, Ordering::AcqRel);
        }
    }
}

fn serve_one(
    mut connection: TcpStream,
    streams: &Streams,
    feeds: &Arc<Feeds>,
) -> std::io::Result<()> {
    connection.set_nodelay(true)?;
    connection.set_read_timeout(Some(HANDSHAKE))?;
    connection.set_write_timeout(Some(WRITE))?;
    let mut id = [0; 4];
    connection.read_exact(&mut id)?;
    match u32::from_le_bytes(id) {
        world if is_world(world) => streams.serve(world, connection),
        sensor => feeds.serve(sensor, connection),
    }
}

/// Length and message, in one system call where the kernel has room.
pub fn send(connection: &mut TcpStream, head: &[u8], body: &[u8]) -> std::io::Result<()> {
    let length = ((head.len() + body.len()) as u32).to_le_bytes();
    let mut pieces = [
        IoSlice::new(&length),
        IoSlice::new(head),
        IoSlice::new(body),
    ];
    let mut pieces = &mut pieces[..];
    IoSlice::advance_slices(&mut pieces, 0);
    while !pieces.is_empty() {
        match connection.write_vectored(pieces) {
            Ok(0) => return Err(std::io::ErrorKind::WriteZero.into()),
            Ok(n) => IoSlice::advance_slices(&mut pieces, n),
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Clients send nothing after the number, so anything that can be read is the end.
pub fn has_ended(connection: &TcpStream) -> std::io::Result<bool> {
    connection.set_nonblocking(true)?;
    let looked = connection.peek(&mut [0; 1]);
    connection.set_nonblocking(false)?;
    Ok(match looked {
        Ok(_) => true,
        Err(error) => error.kind() != std::io::ErrorKind::WouldBlock,
    })
}

/// Closing would make the client come again at once.
pub fn wait_for_end(connection: &TcpStream) -> std::io::Result<()> {
    let forever = Duration::from_secs(3600);
    while !has_ended(connection)? {
        WaitSet::new()
            .wait_beside(&[connection.as_fd()], forever)
            .map_err(std::io::Error::other)?;
    }
    Ok(())
}

/// The 24 bytes that tell a client where a stream is: on the host it dialled, at this port.
pub fn token(stream: u32, port: u16) -> Vec<u8> {
    const TCP: u8 = 1;
    let mut token = vec![0; 24];
    token[0..4].copy_from_slice(&stream.to_le_bytes());
    token[4..6].copy_from_slice(&port.to_le_bytes());
    token[6] = TCP;
    token
}
