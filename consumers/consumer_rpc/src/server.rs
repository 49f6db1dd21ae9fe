//! The server: requests in, responses out, one thread per connection, in order of arrival.

use std::collections::BTreeMap;
use std::io::{self, BufReader, Write as _};
use std::net::{IpAddr, Shutdown, TcpListener, TcpStream};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::fields::Wrong;
use crate::message::{self, Request};
use crate::msgpack::{self, DecodeError, Limits};

/// Most connections that may be open.
const MAX_CONNECTIONS: usize = 256;

/// The connection that a request came over.
#[derive(Clone, Debug)]
pub struct Peer {
    /// Number of the connection; numbers rise and never come back.
    pub number: u64,
    /// Our address, as the client dialled it.
    pub ours: Option<IpAddr>,
    /// Sends responses that [`Service::serve`] held back.
    pub later: Later,
}

/// The writing end of a connection, for responses out of turn: clients tell responses apart by the
/// numbers of their requests, so they may come in any order.
#[derive(Clone, Debug)]
pub struct Later(Arc<Mutex<TcpStream>>);

impl Later {
    /// For a connection.
    pub fn new(connection: TcpStream) -> Later {
        Later(Arc::new(Mutex::new(connection)))
    }

    /// Writes whole responses. Waits for a client that does not read.
    ///
    /// # Errors
    /// If the connection has ended.
    pub fn send(&self, responses: &[u8]) -> io::Result<()> {
        if responses.is_empty() {
            return Ok(());
        }
        let mut connection = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        connection.write_all(responses)
    }
}

/// What a server's methods do.
pub trait Service: Send + Sync + 'static {
    /// Runs a request and returns the bytes of its response; no bytes if the response follows over
    /// [`Peer::later`].
    ///
    /// # Errors
    /// [`Wrong`] ends the connection: what follows could not be understood.
    fn serve(&self, peer: Peer, request: Request) -> Result<Vec<u8>, Wrong>;

    /// Bytes of the response to a request that panicked. Without one the client would wait until its
    /// time-out.
    fn panicked(&self, id: u32, method: &str) -> Vec<u8> {
        message::failure(
            id,
            &format!("{method} failed, and the server's log says where"),
        )
    }

    /// A connection has ended.
    fn closed(&self, _number: u64) {}
}

/// Why a connection ended before its client closed it.
#[derive(Debug, thiserror::Error)]
enum Broken {
    #[error("{0}")]
    Io(#[from] io::Error),
    #[error("{0}")]
    Decode(#[from] DecodeError),
    #[error("{0}")]
    Wrong(#[from] Wrong),
}

/// One open connection.
struct Open {
    connection: TcpStream,
    /// Whether a whole request has arrived.
    has_asked: Arc<AtomicBool>,
}

/// Open connections by number; numbers rise.
type Table = Arc<Mutex<BTreeMap<u64, Open>>>;

fn lock(table: &Table) -> MutexGuard<'_, BTreeMap<u64, Open>> {
    table.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Makes room for one more connection. Clients that connect and never ask anything must not keep
/// others out.
fn make_room(table: &Table) -> bool {
    let mut open = lock(table);
    if open.len() < MAX_CONNECTIONS {
        return true;
    }
    let Some(number) = open
        .iter()
        .find(|(_, one)| !one.has_asked.load(Ordering::Acquire))
        .map(|(number, _)| *number)
    else {
        tracing::warn!("refused an RPC connection: {MAX_CONNECTIONS} are open and in use");
        return false;
    };
    if let Some(silent) = open.remove(&number) {
        tracing::warn!(
            "closed the oldest RPC connection that never asked anything: {MAX_CONNECTIONS} are open"
        );
        // The connection's thread notices and ends.
        let _ = silent.connection.shutdown(Shutdown::Both);
    }
    true
}

/// Accepts clients for ever.
pub fn serve<S: Service>(listener: &TcpListener, service: &Arc<S>) {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    let table = Table::default();
    for connection in listener.incoming() {
        let Ok(connection) = connection else { continue };
        let Ok(other_end) = connection.try_clone() else {
            continue;
        };
        if !make_room(&table) {
            continue;
        }
        let (service, here, has_asked) = (
            service.clone(),
            table.clone(),
            Arc::new(AtomicBool::new(false)),
        );
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        lock(&table).insert(
            number,
            Open {
                connection: other_end,
                has_asked: has_asked.clone(),
            },
        );
        let spawned = std::thread::Builder::new()
            .name("rpc".into())
            .spawn(move || {
                let peer = connection
                    .peer_addr()
                    .map_or_else(|_| "?".to_owned(), |peer| peer.to_string());
                tracing::debug!(peer, "connected");
                if let Err(error) = serve_one(connection, service.as_ref(), number, &has_asked) {
                    tracing::warn!(peer, %error, "closed an RPC connection");
                }
                service.closed(number);
                lock(&here).remove(&number);
            });
        if let Err(error) = spawned {
            tracing::warn!(%error, "cannot start a thread for an RPC connection");
            lock(&table).remove(&number);
        }
    }
}

fn serve_one<S: Service>(
    connection: TcpStream,
    service: &S,
    number: u64,
    has_asked: &AtomicBool,
) -> Result<(), Broken> {
    connection.set_nodelay(true)?;
    let peer = Peer {
        number,
        ours: connection.local_addr().ok().map(|address| address.ip()),
        later: Later::new(connection.try_clone()?),
    };
    let mut reader = BufReader::with_capacity(1 << 16, connection);
    loop {
        let message = match msgpack::read(&mut reader, Limits::default()) {
            Ok(message) => message,
            Err(DecodeError::Closed) => return Ok(()),
            // The client was killed.
            Err(DecodeError::Io(error)) if error.kind() == io::ErrorKind::ConnectionReset => {
                return Ok(());
            }
            Err(error) => return Err(error.into()),
        };
        let request = message::parse(message)?;
        has_asked.store(true, Ordering::Release);
        let (id, method) = (request.id, request.method.clone());
        let response = catch_unwind(AssertUnwindSafe(|| service.serve(peer.clone(), request)))
            .unwrap_or_else(|_| Ok(service.panicked(id, &method)))?;
        if peer.later.send(&response).is_err() {
            return Ok(());
        }
    }
}
