//! The server: requests in, responses out, one thread per connection, in order of arrival.

use std::io::{self, BufRead as _, BufReader};
use std::net::{IpAddr, Shutdown};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use launch_cli::logging::cut;

pub use crate::connection::Later;

use crate::budget::{Account, Budget, MAX_MESSAGE_BYTES, OverBudget, Share};
use crate::connection::{Incoming, REQUEST_TIMEOUT};
use crate::door::{Door, Guest};
use crate::fields::Wrong;
use crate::message::{self, Request};
use crate::msgpack::{self, DecodeError, Limits};
use crate::seats::{Doing, Seat};

/// Most connections of a server that may be open. Beyond that, the connection that has been idle
/// for longest makes room.
pub const MAX_RPC_CONNECTIONS: usize = 512;
/// Longest wait of an answer for memory that clients hold which read slowly.
const ROOM_TIMEOUT: Duration = Duration::from_secs(10);
/// How often it is looked whether there is some.
const LOOK: Duration = Duration::from_millis(20);
/// Most answers that wait for it, because those that wait take memory, too.
const MAX_WAITING_ANSWERS: usize = 8;
/// What a request may cost that is answered with a refusal whatever it says.
const UNWELCOME: Limits = Limits {
    bytes: 1 << 16,
    values: 1000,
    depth: 32,
};

/// The connection that a request came over.
#[derive(Clone, Debug)]
pub struct Peer {
    /// What the connection owns, and its number.
    pub account: Account,
    /// The request's part of it, for a service that works on the request after it has answered.
    pub request: Arc<Share>,
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
    #[error("{0}")]
    Over(#[from] OverBudget),
}

/// Accepts clients for ever.
pub fn serve<S: Service>(door: Door, service: &Arc<S>) {
    let serving = Serving {
        service: service.clone(),
        budget: Budget::new(MAX_MESSAGE_BYTES),
        n_waiting: AtomicUsize::new(0),
    };
    Arc::new(door).serve(move |guest| {
        let (number, stream) = (guest.seat.number, guest.stream.clone());
        let peer = stream
            .peer_addr()
            .map_or_else(|_| "?".to_owned(), |peer| peer.to_string());
        tracing::debug!(peer, "connected");
        let is_welcome = guest.unwelcome.is_none();
        if let Err(error) = serving.serve_one(guest)
            && let Some(n_unsaid) = serving.budget.may_warn()
        {
            let error = error.to_string();
            tracing::warn!(peer, error = %cut(&error), n_unsaid, "closed an RPC connection");
        }
        // Answers that are held back may still keep the socket.
        let _ = stream.shutdown(Shutdown::Both);
        if is_welcome {
            serving.service.closed(number);
        }
    });
}

/// What all connections of a server share.
struct Serving<S> {
    service: Arc<S>,
    budget: Budget,
    /// Answers that wait for memory.
    n_waiting: AtomicUsize,
}

impl<S: Service> Serving<S> {
    fn serve_one(&self, guest: Guest) -> Result<(), Broken> {
        let Guest {
            stream,
            seat,
            unwelcome,
        } = guest;
        let account = self.budget.account(seat.number);
        let ours = stream.local_addr().ok().map(|address| address.ip());
        let later = Later::of(stream.clone(), seat.pulse.clone());
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
            let mut share = account.share();
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
                let refused = self.service.refused(request.id, &request.method, sentence);
                let _ = later.send(&refused);
                return Ok(());
            }
            seat.pulse.now(Doing::Served);
            let peer = Peer {
                account: account.clone(),
                request: Arc::new(share),
                ours,
                later: later.clone(),
            };
            let (id, method) = (request.id, request.method.clone());
            let served = catch_unwind(AssertUnwindSafe(|| self.service.serve(peer, request)));
            let response = served.unwrap_or_else(|_| {
                // Without a response the client would wait until its time-out.
                let sentence = format!("{} failed, and the server's log says where", cut(&method));
                Ok(self.service.refused(id, &method, &sentence))
            })?;
            // What the service keeps for the client counts, too.
            if account.is_over() {
                return Err(OverBudget::Connection.into());
            }
            let mut share = account.share();
            let response = match self.room(&seat, &mut share, response.len()) {
                Ok(()) => response,
                Err(over @ OverBudget::Connection) => return Err(over.into()),
                Err(over @ OverBudget::Server) => {
                    drop(response);
                    self.service.refused(id, &method, &over.to_string())
                }
            };
            if later.send(&response).is_err() {
                return Ok(());
            }
            seat.pulse.now(Doing::Idle);
        }
    }

    /// Takes memory for an answer. If none is left, waits for a while for that of clients that do
    /// not read theirs, and closes those.
    fn room(&self, seat: &Seat, share: &mut Share, n_bytes: usize) -> Result<(), OverBudget> {
        let full = share.take(n_bytes);
        if full != Err(OverBudget::Server) {
            return full;
        }
        let waiting = self.n_waiting.fetch_add(1, Ordering::AcqRel);
        let until = Instant::now() + ROOM_TIMEOUT;
        let mut found = full;
        while waiting < MAX_WAITING_ANSWERS
            && found == Err(OverBudget::Server)
            && Instant::now() < until
        {
            seat.relieve_stalled();
            std::thread::sleep(LOOK);
            found = share.take(n_bytes);
        }
        self.n_waiting.fetch_sub(1, Ordering::AcqRel);
        if found == Err(OverBudget::Server) {
            seat.relieve_stalled();
        }
        found
    }
}
