//! `control/world`: requests as JSON, which the daemon answers between ticks.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use schema_frames::command::{COMMAND_VERSION, REQUEST_MAGIC, RequestHeader};
use schema_frames::limits::{self, MAX_COMMANDS};
use schema_frames::{CommandBatch, CommandReply, ReplyBatch};

use crate::contract::error::BusError;
use crate::contract::names::{CONTROL_WORLD, name_text};
use crate::contract::origin::Origin;
use crate::contract::qos;
use crate::place::complaints::Complaints;
use crate::place::iceoryx_error::other_error;
use crate::place::node::BusNode;
use crate::ports::drain::{Gaps, round};
use crate::ports::requests::{
    AskError, Protocol, RequestClient, RequestServer, WaitingRequest, claimed,
};

/// Why a request got no answer.
#[derive(Debug, thiserror::Error)]
pub enum CommandError {
    /// Nobody serves commands.
    #[error(
        "no simulator answers on domain {domain:?}; start one with `gantry up`, or name its --domain"
    )]
    NoServer {
        /// The domain.
        domain: String,
    },
    /// No answer in time.
    #[error("the simulator did not answer within {} ms; it may be loading a map or have stopped", .waited.as_millis())]
    Timeout {
        /// How long was waited.
        waited: Duration,
    },
    /// The answer cannot be read.
    #[error("the simulator's answer cannot be read ({cause}); rebuild the older of the two")]
    Answer {
        /// What serde says.
        cause: String,
    },
    /// The bus failed.
    #[error(transparent)]
    Bus(#[from] BusError),
}

/// Why a request cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RequestFault {
    /// Its header is of another version.
    #[error(
        "request speaks command version {found}, the simulator {COMMAND_VERSION}; rebuild the older of the two"
    )]
    HeaderVersion {
        /// Its version.
        found: u32,
    },
    /// It has fewer bytes than its header says.
    #[error("request claims {claimed} bytes and has {found}")]
    Length {
        /// Bytes that its header says.
        claimed: u64,
        /// Bytes that it has.
        found: usize,
    },
    /// It is too long to be parsed.
    #[error(
        "request has {found} bytes, at most {} are read; split it",
        qos::MAX_COMMAND_BYTES
    )]
    TooLong {
        /// Bytes that it has.
        found: usize,
    },
    /// It is no batch of commands.
    #[error("{sentence}")]
    Json {
        /// What serde says, as a sentence that is cut if it is long.
        sentence: String,
    },
    /// The batch is of another version.
    #[error("\"v\" is {found}, the simulator speaks {COMMAND_VERSION}")]
    BatchVersion {
        /// Its version.
        found: u32,
    },
    /// It has too many commands.
    #[error("request has {found} commands, at most {MAX_COMMANDS} are run; split it")]
    TooMany {
        /// Commands that it has.
        found: usize,
    },
}

/// Commands to the simulator. An answer is JSON whose first key says for whom it is.
#[derive(Debug)]
pub struct Commands;

impl Protocol for Commands {
    const SERVICE: &'static str = CONTROL_WORLD;
    const MAX_CLIENTS: usize = qos::COMMAND_CLIENTS;
    type Question<'a> = CommandBatch;
    type Fault = RequestFault;

    fn read(header: &RequestHeader, payload: &[u8]) -> Result<CommandBatch, RequestFault> {
        parse(header, payload)
    }

    fn address(client_port: u128, seq: u64) -> Vec<u8> {
        format!("{TO}{client_port:x}-{seq}\",").into_bytes()
    }

    /// The answer with its address in front of its other keys.
    fn addressed(address: Vec<u8>, answer: &[u8]) -> Vec<u8> {
        match answer.strip_prefix(b"{") {
            Some(keys) => [&address, keys].concat(),
            None => answer.to_vec(),
        }
    }

    /// An answer without an address is taken.
    fn delivered<'a>(answer: &'a [u8], address: &[u8]) -> Option<&'a [u8]> {
        (!answer.starts_with(TO.as_bytes()) || answer.starts_with(address)).then_some(answer)
    }
}

/// Beginning of every answer that says for whom it is.
const TO: &str = "{\"to\":\"";

/// The asking end of `control/world`.
#[derive(Debug)]
pub struct CommandClient {
    port: RequestClient<Commands>,
    domain: String,
}

impl CommandClient {
    pub(crate) fn open(node: &BusNode, name: &str) -> Result<CommandClient, BusError> {
        Ok(CommandClient {
            port: RequestClient::open(node, name)?,
            domain: node.domain().into(),
        })
    }

    /// Sends the commands and waits for their replies.
    ///
    /// # Errors
    /// [`CommandError::NoServer`] at once if nobody serves, [`CommandError::Timeout`]. A refused
    /// command is a reply, not an error.
    pub fn request(
        &mut self,
        batch: &CommandBatch,
        timeout: Duration,
    ) -> Result<ReplyBatch, CommandError> {
        let unreadable = |e: serde_json::Error| CommandError::Answer {
            cause: e.to_string(),
        };
        let text = serde_json::to_vec(batch).map_err(unreadable)?;
        let answer = self.request_text(&text, timeout, &mut || true)?;
        serde_json::from_slice(&answer).map_err(unreadable)
    }

    /// As [`CommandClient::request`] for a batch that is JSON already; returns the answer's JSON.
    /// `go_on` is asked at least twenty times a second, and ends the wait with `false`.
    ///
    /// # Errors
    /// As [`CommandClient::request`]; [`CommandError::Timeout`] also after `go_on` said `false`.
    pub fn request_text(
        &mut self,
        text: &[u8],
        timeout: Duration,
        go_on: &mut dyn FnMut() -> bool,
    ) -> Result<Vec<u8>, CommandError> {
        if !self.port.has_server() {
            return Err(CommandError::NoServer {
                domain: self.domain.clone(),
            });
        }
        self.port.ask(text, timeout, go_on).map_err(|e| match e {
            AskError::NoAnswer { waited } => CommandError::Timeout { waited },
            AskError::Bus(error) => CommandError::Bus(error),
        })
    }
}

/// The answering end of `control/world`.
#[derive(Debug)]
pub struct CommandServer {
    port: RequestServer<Commands>,
    gaps: Gaps,
    complaints: Complaints,
    /// Requests that were too many for one turn, or whose client has to wait.
    waiting: Vec<Waiting>,
    /// How many of them wait because their client has to.
    n_held: usize,
    /// Client whose turn it is when not all have one.
    next_client: String,
}

/// A request that has not been read yet.
#[derive(Debug)]
struct Waiting {
    client: String,
    seq: u64,
    asked: WaitingRequest<Commands>,
}

impl Waiting {
    fn read(self) -> Request {
        Request {
            batch: self.asked.read(),
            client: self.client,
            seq: self.seq,
            origin: self.asked.origin.clone(),
            asked: self.asked,
        }
    }
}

/// Which of the requests that wait, in the order of their clients, have their turn: of each client
/// one and what more is short, of all together a bounded sum, beginning with `first`. Returns the
/// client that was left out and comes first the next time, if one was.
fn turn<'w>(waiting: &[(&'w str, u128, usize)], first: &str) -> (Vec<bool>, Option<&'w str>) {
    let begin = waiting.partition_point(|(client, ..)| *client < first);
    let mut is_taken = vec![false; waiting.len()];
    let mut of_client: BTreeMap<u128, usize> = BTreeMap::new();
    let (mut of_all, mut left_out) = (0usize, None);
    for idx in (begin..waiting.len()).chain(0..begin) {
        let (client, port, n_bytes) = waiting[idx];
        // Also an empty one counts.
        let n_bytes = n_bytes.max(1);
        let own = of_client.entry(port).or_default();
        let is_short = *own == 0 || own.saturating_add(n_bytes) <= qos::MAX_TURN_CLIENT_BYTES;
        let has_room = of_all == 0 || of_all.saturating_add(n_bytes) <= qos::MAX_TURN_REQUEST_BYTES;
        if is_short && has_room {
            is_taken[idx] = true;
            *own += n_bytes;
            of_all += n_bytes;
            continue;
        }
        // What comes after it must not overtake it.
        if is_short && *own == 0 && left_out.is_none() {
            left_out = Some(client);
        }
        *own = usize::MAX;
    }
    (is_taken, left_out)
}

/// A request that waits for its answer. If it is dropped unanswered, its client times out.
#[derive(Debug)]
pub struct Request {
    /// Name of the client.
    pub client: String,
    /// The client's count.
    pub seq: u64,
    /// The client's process.
    pub origin: Arc<Origin>,
    /// The commands, or the reason why they cannot be read, to be answered with one refusal.
    pub batch: Result<CommandBatch, RequestFault>,
    asked: WaitingRequest<Commands>,
}

impl Request {
    /// The request as its client wrote it; empty if it is no UTF-8, and then `batch` is an error.
    pub fn text(&self) -> &str {
        std::str::from_utf8(self.asked.bytes().unwrap_or_default()).unwrap_or_default()
    }

    /// Number of the client's port. Several clients may have one name.
    pub fn client_port(&self) -> u128 {
        self.asked.client_port()
    }
}

impl CommandServer {
    pub(crate) fn open(node: &BusNode) -> Result<CommandServer, BusError> {
        Ok(CommandServer {
            port: RequestServer::open(node)?,
            gaps: Gaps::default(),
            complaints: Complaints::default(),
            waiting: Vec::new(),
            n_held: 0,
            next_client: String::new(),
        })
    }

    /// Takes the next request that waits, if any.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn take(&mut self) -> Result<Option<Request>, BusError> {
        if !self.waiting.is_empty() {
            self.n_held = self.n_held.saturating_sub(1);
            return Ok(Some(self.waiting.remove(0).read()));
        }
        Ok(self.receive()?.map(Waiting::read))
    }

    fn receive(&mut self) -> Result<Option<Waiting>, BusError> {
        let Some(asked) = self.port.take()? else {
            return Ok(None);
        };
        let header = asked.header();
        let client = name_text(&header.client);
        let gap = self.gaps.before(asked.client_port(), header.seq);
        let origin = &asked.origin;
        if gap > 0 && self.complaints.count(origin, "flood") {
            tracing::warn!(
                "{origin} floods control/world as {client:?}: {gap} requests were lost, because at most {} of one client wait; wait for each answer before the next request, and put several commands into one. Further losses are not logged",
                qos::COMMAND_ACTIVE
            );
        }
        Ok(Some(Waiting {
            client,
            seq: header.seq,
            asked,
        }))
    }

    /// Takes requests that wait, sorted by (client, seq), which is the order in which they run: of
    /// each client the oldest one and, of up to four, what fits into
    /// [`qos::MAX_TURN_CLIENT_BYTES`]; of all clients together, in turns, what fits into
    /// [`qos::MAX_TURN_REQUEST_BYTES`]. The next call takes what is left, and
    /// [`CommandServer::is_behind`] says whether there is any. The first request of a process that
    /// cannot be read is logged.
    ///
    /// # Errors
    /// As [`CommandServer::take`].
    pub fn take_all(&mut self) -> Result<Vec<Request>, BusError> {
        self.take_all_but(|_| false)
    }

    /// As [`CommandServer::take_all`], but leaves the requests of those clients where they are of
    /// whose ports `is_busy` is true: an earlier one of theirs is still being carried out.
    ///
    /// # Errors
    /// As [`CommandServer::take`].
    pub fn take_all_but(
        &mut self,
        is_busy: impl Fn(u128) -> bool,
    ) -> Result<Vec<Request>, BusError> {
        match round(|| self.receive()) {
            Ok(arrived) => self.waiting.extend(arrived),
            // All that can be held of those who ask is held already.
            Err(BusError::BorrowLimit { .. }) if !self.waiting.is_empty() => {}
            Err(error) => return Err(error),
        }
        self.waiting
            .sort_by(|a, b| (&a.client, a.seq).cmp(&(&b.client, b.seq)));
        let (held, free): (Vec<Waiting>, Vec<Waiting>) = std::mem::take(&mut self.waiting)
            .into_iter()
            .partition(|it| is_busy(it.asked.client_port()));
        self.n_held = held.len();
        let sizes: Vec<(&str, u128, usize)> = free
            .iter()
            .map(|it| {
                (
                    it.client.as_str(),
                    it.asked.client_port(),
                    it.asked.payload().len(),
                )
            })
            .collect();
        let (is_taken, left_out) = turn(&sizes, &self.next_client);
        self.next_client = left_out.unwrap_or_default().to_owned();
        let (mut taken, mut left) = (Vec::new(), held);
        for (request, is_taken) in free.into_iter().zip(is_taken) {
            match is_taken {
                true => taken.push(request),
                false => left.push(request),
            }
        }
        self.waiting = left;
        let requests: Vec<Request> = taken.into_iter().map(Waiting::read).collect();
        for request in &requests {
            if let Err(error) = &request.batch
                && self.complaints.count(&request.origin, "garbage")
            {
                tracing::warn!(
                    "{} sent a request on control/world as {:?} that was refused: {error}; further ones are refused without a line here",
                    request.origin,
                    request.client
                );
            }
        }
        Ok(requests)
    }

    /// Puts a request back that was taken together with one that its client has to wait for.
    pub fn hold(&mut self, request: Request) {
        self.waiting.push(Waiting {
            client: request.client,
            seq: request.seq,
            asked: request.asked,
        });
        self.n_held += 1;
    }

    /// Whether requests wait that were too many for the last [`CommandServer::take_all`]; nobody
    /// wakes the server for them again. Those of clients that have to wait do not count.
    pub fn is_behind(&self) -> bool {
        self.waiting.len() > self.n_held
    }

    /// Answers a request. It is no error if the client has gone. If the answer cannot be sent, a
    /// refusal that says so is sent in its place, so that the client does not wait in vain.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn reply(&self, request: Request, answer: &ReplyBatch) -> Result<(), BusError> {
        let sent = self.send(&request, answer);
        if let Err(error) = &sent {
            let error =
                format!("the commands were run, but their answer could not be sent: {error}");
            self.send(
                &request,
                &ReplyBatch {
                    epoch: answer.epoch.clone(),
                    replies: vec![CommandReply::Refused { error }],
                    ..*answer
                },
            )?;
        }
        sent
    }

    fn send(&self, request: &Request, answer: &ReplyBatch) -> Result<(), BusError> {
        let failed = |e| other_error("answer on", self.port.full_name(), &e);
        let bytes = serde_json::to_vec(answer).map_err(failed)?;
        self.port.send(&request.asked, &bytes)
    }

    /// Requests that could not be read.
    pub fn n_faults(&self) -> u64 {
        self.complaints.n()
    }

    /// Number of clients now.
    pub fn n_clients(&self) -> usize {
        self.port.n_clients()
    }
}

/// Parses a request; any bytes are safe to pass.
fn parse(header: &RequestHeader, payload: &[u8]) -> Result<CommandBatch, RequestFault> {
    if header.magic != REQUEST_MAGIC || header.codec_version != COMMAND_VERSION {
        return Err(RequestFault::HeaderVersion {
            found: header.codec_version,
        });
    }
    let bytes = claimed(header, payload).ok_or(RequestFault::Length {
        claimed: header.payload_bytes,
        found: payload.len(),
    })?;
    if bytes.len() > qos::MAX_COMMAND_BYTES {
        return Err(RequestFault::TooLong { found: bytes.len() });
    }
    let batch: CommandBatch = serde_json::from_slice(bytes).map_err(|e| RequestFault::Json {
        sentence: limits::cut(format!("request is not valid: {e}")),
    })?;
    if batch.v != COMMAND_VERSION {
        return Err(RequestFault::BatchVersion { found: batch.v });
    }
    if batch.commands.len() > MAX_COMMANDS {
        return Err(RequestFault::TooMany {
            found: batch.commands.len(),
        });
    }
    Ok(batch)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn broken_requests_are_told_apart() {
        let fault = |header: &RequestHeader, bytes: &[u8]| match parse(header, bytes) {
            Ok(_) => String::new(),
            Err(fault) => fault.to_string(),
        };
        let mut header: RequestHeader = bytemuck::Zeroable::zeroed();
        assert!(fault(&header, b"{}").contains("version 0"));
        header.magic = REQUEST_MAGIC;
        header.codec_version = COMMAND_VERSION;
        header.payload_bytes = 9;
        assert!(fault(&header, b"{}").contains("claims 9 bytes"));
        header.payload_bytes = 2;
        assert!(fault(&header, b"{}").contains("not valid"));
        let text = br#"{"v":2,"commands":[]}"#;
        header.payload_bytes = text.len() as u64;
        assert!(fault(&header, text).contains("\"v\" is 2"));
        let many = vec![r#"{"do":"ping"}"#; MAX_COMMANDS + 1].join(",");
        let text = format!(r#"{{"v":1,"commands":[{many}]}}"#);
        header.payload_bytes = text.len() as u64;
        let found = fault(&header, text.as_bytes());
        assert!(found.contains("16385 commands, at most 16384"), "{found}");
        let long = format!(r#"{{"v":1,"commands":[],"{}":1}}"#, "x".repeat(1 << 20));
        header.payload_bytes = long.len() as u64;
        let found = fault(&header, long.as_bytes());
        assert!(
            found.len() <= limits::MAX_SENTENCE_BYTES,
            "{} bytes",
            found.len()
        );
    }

    #[test]
    fn an_answer_is_taken_by_whom_it_is_for() {
        let to = Commands::address;
        let is_for = |text: &[u8], own: &[u8]| Commands::delivered(text, own).is_some();
        let answer = ReplyBatch {
            v: COMMAND_VERSION,
            epoch: "9".into(),
            tick: 4,
            replies: vec![CommandReply::Done],
        };
        let bare = serde_json::to_vec(&answer).unwrap();
        let text = Commands::addressed(to(0xab, 1), &bare);
        assert_eq!(serde_json::from_slice::<ReplyBatch>(&text).unwrap(), answer);
        assert!(is_for(&text, &to(0xab, 1)) && is_for(&bare, &to(0xab, 1)));
        assert!(!is_for(&text, &to(0xab, 12)) && !is_for(&text, &to(0xac, 1)));
    }

    #[test]
    fn every_client_has_its_turn_and_no_turn_is_long() {
        const SHARE: usize = qos::MAX_TURN_CLIENT_BYTES;
        const ALL: usize = qos::MAX_TURN_REQUEST_BYTES;
        let turn = |waiting: &[(&'static str, u128, usize)], first| turn(waiting, first);
        assert_eq!(turn(&[], ""), (vec![], None));
        // Small requests of one client run together; a long one is alone.
        let (taken, left) = turn(&[("a", 1, 100), ("a", 1, 0), ("a", 1, 200)], "");
        assert_eq!((taken, left), (vec![true; 3], None));
        let (taken, _) = turn(&[("a", 1, ALL), ("a", 1, 1), ("b", 2, 0)], "");
        assert_eq!(taken, [true, false, false]);
        let (taken, _) = turn(&[("a", 1, SHARE), ("a", 1, 1), ("a", 1, 0)], "");
        assert_eq!(taken, [true, false, false], "the third does not overtake");
        // Two that do not fit into one turn take turns.
        let two = [("a", 1, ALL), ("b", 2, ALL)];
        assert_eq!(turn(&two, ""), (vec![true, false], Some("b")));
        assert_eq!(turn(&two, "b"), (vec![false, true], Some("a")));
    }
}
