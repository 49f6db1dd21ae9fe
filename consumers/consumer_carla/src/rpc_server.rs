//! The RPC server: msgpack-rpc requests in, responses out, one thread per connection, in order of
//! arrival.

use std::collections::BTreeMap;
use std::io::{BufReader, Write as _};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use crate::gateway::Gateway;
use crate::lock::lock;
use crate::rpc;
use crate::rpc::client_methods;
use crate::wire::msgpack::{self, DecodeError, Limits};
use crate::wire::requests::{Failure, parse, response};

/// Most RPC connections that may be open.
const MAX_CONNECTIONS: usize = 256;

/// One open connection.
struct Open {
    connection: TcpStream,
    /// Whether a whole request has arrived.
    has_asked: Arc<AtomicBool>,
}

/// Open connections by number; numbers rise.
type Table = Arc<Mutex<BTreeMap<u64, Open>>>;

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
pub fn serve(listener: &TcpListener, gateway: &Arc<Gateway>) {
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
        let (gateway, here, has_asked) = (
            gateway.clone(),
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
                if let Err(error) = serve_one(connection, &gateway, number, &has_asked) {
                    tracing::warn!(peer, %error, "closed an RPC connection");
                }
                gateway.closed(number);
                lock(&here).remove(&number);
            });
        if let Err(error) = spawned {
            tracing::warn!(%error, "cannot start a thread for an RPC connection");
            lock(&table).remove(&number);
        }
    }
}

fn serve_one(
    mut connection: TcpStream,
    gateway: &Gateway,
    number: u64,
    has_asked: &AtomicBool,
) -> anyhow::Result<()> {
    connection.set_nodelay(true)?;
    let mut reader = BufReader::with_capacity(1 << 16, connection.try_clone()?);
    loop {
        let message = match msgpack::read(&mut reader, Limits::default()) {
            Ok(message) => message,
            Err(DecodeError::Closed) => return Ok(()),
            // The client was killed.
            Err(DecodeError::Io(error)) if error.kind() == std::io::ErrorKind::ConnectionReset => {
                return Ok(());
            }
            Err(error) => return Err(error.into()),
        };
        let request = parse(message)?;
        has_asked.store(true, Ordering::Release);
        // A panic is answered, too: without an answer the client would wait until its time-out.
        let outcome = catch_unwind(AssertUnwindSafe(|| rpc::serve(gateway, number, &request)))
            .unwrap_or_else(|_| {
                Err(Failure::Refused(format!(
                    "{} failed inside the gateway, whose log says where",
                    request.method
                )))
            });
        match &outcome {
            Err(Failure::Unknown(error)) => tracing::warn!(error, "unknown call"),
            Err(Failure::Refused(error)) if request.is_async => {
                tracing::warn!(
                    method = request.method,
                    error,
                    "refused a call whose answer the client does not read"
                )
            }
            Err(Failure::Refused(error)) => {
                tracing::debug!(method = request.method, error, "refused")
            }
            Ok(_) => {}
        }
        let bytes = response(
            request.id,
            request.is_async || client_methods::is_void(&request.method),
            outcome,
        );
        if connection.write_all(&bytes).is_err() {
            return Ok(());
        }
    }
}
