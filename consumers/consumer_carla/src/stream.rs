//! The streaming server: a client sends a stream's number and is sent that stream's messages, each after its length.

use std::collections::BTreeMap;
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TrySendError, bounded};

/// Stream of the world snapshots.
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

/// A message, shared by all its receivers.
pub type Message = Arc<[u8]>;

#[derive(Debug, Default)]
struct Stream {
    newest: Option<Message>,
    subscribers: Vec<Sender<Message>>,
}

/// All streams.
#[derive(Debug, Default)]
pub struct Streams {
    streams: Mutex<BTreeMap<u32, Stream>>,
    connections: AtomicUsize,
}

impl Streams {
    fn with<R>(&self, id: u32, f: impl FnOnce(&mut Stream) -> R) -> R {
        f(self.streams.lock().unwrap_or_else(PoisonError::into_inner).entry(id).or_default())
    }

    /// Sends a message to all who listen, and keeps it for who comes next.
    pub fn send(&self, id: u32, message: Message) {
        self.with(id, |stream| {
            stream.subscribers.retain(|subscriber| match subscriber.try_send(message.clone()) {
                Ok(()) => true,
                Err(TrySendError::Full(_)) => {
                    tracing::warn!(stream = id, "a client is {BACKLOG} messages behind; one was dropped for it");
                    true
                }
                Err(TrySendError::Disconnected(_)) => false,
            });
            stream.newest = Some(message);
        });
    }

    /// Forgets what greets who comes next.
    pub fn forget(&self, id: u32) {
        self.with(id, |stream| stream.newest = None);
    }

    fn subscribe(&self, id: u32) -> Receiver<Message> {
        let (sender, receiver) = bounded(BACKLOG);
        self.with(id, |stream| {
            if let Some(newest) = &stream.newest {
                // Room for one there is.
                let _ = sender.try_send(newest.clone());
            }
            stream.subscribers.push(sender);
        });
        receiver
    }
}

/// Accepts clients for ever, each on a thread of its own.
pub fn serve(listener: &TcpListener, streams: &Arc<Streams>) {
    for connection in listener.incoming() {
        let Ok(connection) = connection else { continue };
        if streams.connections.fetch_add(1, Ordering::AcqRel) >= MAX_CONNECTIONS {
            tracing::warn!("refused a streaming connection: {MAX_CONNECTIONS} are open");
            streams.connections.fetch_sub(1, Ordering::AcqRel);
            continue;
        }
        let shared = streams.clone();
        let spawned = std::thread::Builder::new().name("stream".into()).spawn(move || {
            if let Err(error) = serve_one(connection, &shared) {
                tracing::debug!(%error, "a streaming connection ended");
            }
            shared.connections.fetch_sub(1, Ordering::AcqRel);
        });
        if let Err(error) = spawned {
            tracing::warn!(%error, "cannot start a thread for a streaming connection");
            streams.connections.fetch_sub(1, Ordering::AcqRel);
        }
    }
}

fn serve_one(mut connection: TcpStream, streams: &Streams) -> std::io::Result<()> {
    connection.set_nodelay(true)?;
    connection.set_read_timeout(Some(HANDSHAKE))?;
    connection.set_write_timeout(Some(WRITE))?;
    let mut id = [0; 4];
    connection.read_exact(&mut id)?;
    let id = u32::from_le_bytes(id);
    if id != WORLD_STREAM {
        // Closing would make the client come again at once, and a queue for any number would let clients fill the memory.
        tracing::debug!(stream = id, "a client waits for a stream that does not exist");
        return wait_for_end(&connection);
    }
    let messages = streams.subscribe(id);
    loop {
        match messages.recv_timeout(LOOK) {
            Ok(message) => send(&mut connection, &message)?,
            Err(RecvTimeoutError::Timeout) if has_ended(&connection)? => return Ok(()),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Ok(()),
        }
    }
}

/// Length and message, in one system call where the kernel has room.
fn send(connection: &mut TcpStream, message: &[u8]) -> std::io::Result<()> {
    let length = (message.len() as u32).to_le_bytes();
    let slices = [std::io::IoSlice::new(&length), std::io::IoSlice::new(message)];
    let written = connection.write_vectored(&slices)?;
    if written < length.len() {
        connection.write_all(&length[written..])?;
    }
    connection.write_all(&message[written.saturating_sub(length.len())..])
}

/// Clients send nothing after the number, so anything that can be read is the end.
fn has_ended(connection: &TcpStream) -> std::io::Result<bool> {
    connection.set_nonblocking(true)?;
    let looked = connection.peek(&mut [0; 1]);
    connection.set_nonblocking(false)?;
    Ok(match looked {
        Ok(n) => n == 0,
        Err(error) => error.kind() != std::io::ErrorKind::WouldBlock,
    })
}

fn wait_for_end(connection: &TcpStream) -> std::io::Result<()> {
    while !has_ended(connection)? {
        std::thread::sleep(LOOK);
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
