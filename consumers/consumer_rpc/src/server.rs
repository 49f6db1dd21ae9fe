//! The server: requests in, responses out, one thread per connection, in order of arrival.

use std::io::{self, BufRead as _, BufReader};
use std::net::{IpAddr, Shutdown};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Instant;

pub use crate::connection::Later;

use crate::budget::Budget;
use crate::connection::{Incoming, REQUEST_TIMEOUT};
use crate::door::{Door, Guest};
use crate::fields::Wrong;
use crate::message::{self, Request};
use crate::msgpack::{self, DecodeError, Limits};
use crate::seats::Doing;

/// Most connections of a server that may be open. Beyond that, the connection that has been idle
/// for longest makes room.
pub const MAX_RPC_CONNECTIONS: usize = 512;
/// Memory that the requests of all connections of a server may take together, bytes.
pub const MAX_REQUEST_BYTES: usize = 512 << 20;
/// What a request may cost that is answered with a refusal whatever it says.
const UNWELCOME: Limits = Limits {
    bytes: 1 << 16,
    values: 1000,
    depth: 32,
};

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

/// What a server's methods do.
pub trait Service: Send + Sync + 'static {
    /// Runs a request and returns the bytes of its response; no bytes if the response follows over
    /// [`Peer::later`].
    ///
    /// # Errors
    /// [`Wrong`] ends the connection: what follows could not be understood.
    fn serve(&self, peer: Peer, request: Request) -> Result<Vec<u8>, Wrong>;

    /// Bytes of the response to a request that was not run, for the reason that the sentence gives.
    fn refused(&self, id: u32, _method: &str, sentence: &str) -> Vec<u8> {
        message::failure(id, sentence)
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

/// Accepts clients for ever.
pub fn serve<S: Service>(door: Door, service: &Arc<S>) {
    let (service, budget) = (service.clone(), Budget::new(MAX_REQUEST_BYTES));
    Arc::new(door).serve(move |guest| {
        let (number, stream) = (guest.seat.number, guest.stream.clone());
        let peer = stream
            .peer_addr()
            .map_or_else(|_| "?".to_owned(), |peer| peer.to_string());
        tracing::debug!(peer, "connected");
        let is_welcome = guest.unwelcome.is_none();
        if let Err(error) = serve_one(guest, service.as_ref(), &budget) {
            tracing::warn!(peer, %error, "closed an RPC connection");
        }
        // Answers that are held back may still keep the socket.
        let _ = stream.shutdown(Shutdown::Both);
        if is_welcome {
            service.closed(number);
        }
    });
}

fn serve_one<S: Service>(guest: Guest, service: &S, budget: &Budget) -> Result<(), Broken> {
    let Guest {
        stream,
        seat,
        unwelcome,
    } = guest;
    let peer = Peer {
        number: seat.number,
        ours: stream.local_addr().ok().map(|address| address.ip()),
        later: Later::of(stream.clone(), seat.pulse.clone()),
    };
    let limits = match unwelcome {
        None => Limits::default(),
        Some(_) => UNWELCOME,
    };
    let mut reader = BufReader::with_capacity(1 << 16, Incoming::new(stream)?);
    loop {
        match reader.fill_buf() {
            Ok([]) => return Ok(()),
            Ok(_) => {}
            // The client was killed.
            Err(error) if error.kind() == io::ErrorKind::ConnectionReset => return Ok(()),
            Err(error) => return Err(error.into()),
        }
        let mut share = budget.share();
        reader.get_mut().until = Some(Instant::now() + REQUEST_TIMEOUT);
        let message = match msgpack::read_within(&mut reader, limits, &mut share) {
            Ok(message) => message,
            Err(DecodeError::Io(error)) if error.kind() == io::ErrorKind::ConnectionReset => {
                return Ok(());
            }
            Err(error) => return Err(error.into()),
        };
        reader.get_mut().until = None;
        let request = message::parse(message)?;
        if let Some(sentence) = &unwelcome {
            let _ = peer
                .later
                .send(&service.refused(request.id, &request.method, sentence));
            return Ok(());
        }
        seat.pulse.now(Doing::Served);
        let (id, method) = (request.id, request.method.clone());
        let response = catch_unwind(AssertUnwindSafe(|| service.serve(peer.clone(), request)))
            .unwrap_or_else(|_| {
                // Without a response the client would wait until its time-out.
                let sentence = format!("{method} failed, and the server's log says where");
                Ok(service.refused(id, &method, &sentence))
            })?;
        drop(share);
        if peer.later.send(&response).is_err() {
            return Ok(());
        }
        seat.pulse.now(Doing::Idle);
    }
}
