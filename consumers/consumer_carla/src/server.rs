//! The RPC server: msgpack-rpc requests in, responses out, one thread per connection, in order of
//! arrival.

use std::collections::BTreeMap;
use std::io::{BufReader, Write as _};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use crate::fields::Fields;
use crate::gateway::{Answer, Failure, Gateway, lock};
use crate::list;
use crate::msgpack::{self, DecodeError, Limits, Value};

/// Open RPC connections.
const MAX_CONNECTIONS: usize = 256;

/// A request of msgpack-rpc.
#[derive(Debug, PartialEq)]
pub struct Request {
    /// Comes back in the response.
    pub id: u32,
    /// Method.
    pub method: String,
    /// Whether the client throws the answer away.
    pub is_async: bool,
    /// Arguments, without the metadata.
    pub args: Vec<Value>,
}

/// Reads a request out of a message.
///
/// # Errors
/// A sentence; the connection is then of no further use.
pub fn parse(message: Value) -> Result<Request, String> {
    let Value::Array(items) = message else {
        return Err(format!(
            "a request is {}, but must be a list",
            message.kind()
        ));
    };
    let mut fields = Fields::new("a request", &items);
    let kind = fields.uint(u64::MAX)?;
    if kind != 0 {
        return Err(format!(
            "a message is of type {kind}, but clients send only requests, type 0"
        ));
    }
    let (id, method, params) = (fields.u32()?, fields.text()?.to_owned(), fields.list()?);
    let mut params = Fields::new("the parameters", params);
    let is_async = params.fields("the metadata")?.bool()?;
    let args = match items.into_iter().nth(3) {
        Some(Value::Array(mut params)) => params.split_off(1),
        _ => Vec::new(),
    };
    Ok(Request {
        id,
        method,
        is_async,
        args,
    })
}

/// Bytes of a response.
pub fn response(id: u32, is_void: bool, outcome: Result<Answer, Failure>) -> Vec<u8> {
    let ok = |result: Value| list![1u32, id, Value::Nil, result];
    let message = match outcome {
        Ok(Answer::Value(value)) => ok(list![list![1u32, value]]),
        Ok(Answer::Void) => ok(list![list![false]]),
        Ok(Answer::Bare(value)) => ok(value),
        Err(Failure::Refused(error)) if is_void => ok(list![list![true, list![error]]]),
        Err(Failure::Refused(error)) => ok(list![list![0u32, list![error]]]),
        Err(Failure::Unknown(error)) => list![1u32, id, error, Value::Nil],
    };
    let mut bytes = Vec::new();
    msgpack::write(&mut bytes, &message);
    bytes
}

/// One open connection.
struct Open {
    connection: TcpStream,
    /// Whether a whole request has come.
    has_asked: Arc<AtomicBool>,
}

/// Open connections by number, which rises.
type Table = Arc<Mutex<BTreeMap<u64, Open>>>;

/// Makes room for one more. Who connects and never asks anything must not keep others out.
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
        // It ends with its thread.
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
                    tracing::warn!(peer, error, "closed an RPC connection");
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
) -> Result<(), String> {
    connection
        .set_nodelay(true)
        .map_err(|error| error.to_string())?;
    let mut reader = BufReader::with_capacity(
        1 << 16,
        connection.try_clone().map_err(|error| error.to_string())?,
    );
    loop {
        let message = match msgpack::read(&mut reader, Limits::default()) {
            Ok(message) => message,
            Err(DecodeError::Closed) => return Ok(()),
            // A client that was killed.
            Err(DecodeError::Io(error)) if error.kind() == std::io::ErrorKind::ConnectionReset => {
                return Ok(());
            }
            Err(error) => return Err(error.to_string()),
        };
        let request = parse(message)?;
        has_asked.store(true, Ordering::Release);
        // Without an answer the client would wait until its time-out.
        let outcome = catch_unwind(AssertUnwindSafe(|| gateway.call(number, &request)))
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
            request.is_async || crate::rpc::catalogue::is_void(&request.method),
            outcome,
        );
        if connection.write_all(&bytes).is_err() {
            return Ok(());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_loses_its_metadata() {
        let request = parse(list![0u32, 5u32, "destroy_actor", list![list![true], 9u32]]).unwrap();
        assert_eq!(
            request,
            Request {
                id: 5,
                method: "destroy_actor".into(),
                is_async: true,
                args: vec![Value::UInt(9)]
            }
        );
    }

    /// Seeded: every shape of list around a request is a request or a sentence.
    #[test]
    fn odd_requests_are_sentences() {
        let mut rng = fastrand::Rng::with_seed(4);
        let mut odd = || match rng.u8(0..6) {
            0 => Value::Nil,
            1 => Value::UInt(rng.u64(..)),
            2 => Value::from("tick_cue"),
            3 => list![list![false]],
            4 => list![],
            _ => Value::Bool(true),
        };
        for n in 0..20_000 {
            let message = Value::Array((0..n % 6).map(|_| odd()).collect());
            if let Err(error) = parse(message) {
                assert!(error.contains(' '), "{error}");
            }
        }
    }

    #[test]
    fn outcomes_have_the_documented_shapes() {
        let read =
            |bytes: Vec<u8>| msgpack::read(&mut bytes.as_slice(), Limits::default()).unwrap();
        let refused = || Err(Failure::Refused("no".into()));
        assert_eq!(
            read(response(1, false, Ok(Answer::Value(7u32.into())))),
            list![1u32, 1u32, Value::Nil, list![list![1u32, 7u32]]]
        );
        assert_eq!(
            read(response(1, true, Ok(Answer::Void))),
            list![1u32, 1u32, Value::Nil, list![list![false]]]
        );
        assert_eq!(
            read(response(1, false, refused())),
            list![1u32, 1u32, Value::Nil, list![list![0u32, list!["no"]]]]
        );
        assert_eq!(
            read(response(1, true, refused())),
            list![1u32, 1u32, Value::Nil, list![list![true, list!["no"]]]]
        );
        assert_eq!(
            read(response(1, true, Err(Failure::Unknown("x".into())))),
            list![1u32, 1u32, "x", Value::Nil]
        );
    }
}
