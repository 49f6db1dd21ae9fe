//! `control/world`: requests as JSON, which the daemon answers between ticks.
//!
//! iceoryx2 wakes nobody for a request, so a client notifies `control/wake` and the server
//! `control/replied`.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::active_request::ActiveRequest;
use iceoryx2::port::client::Client;
use iceoryx2::port::server::Server;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::request_response::PortFactory;

use schema_frames::command::{COMMAND_VERSION, REQUEST_MAGIC, RequestHeader};
use schema_frames::limits::{self, MAX_COMMANDS};
use schema_frames::{CommandBatch, CommandReply, ReplyBatch};

use crate::complaints::Complaints;
use crate::control::{name_bytes, name_text};
use crate::drain::{Gaps, round};
use crate::error::BusError;
use crate::event::{Listener, Notifier};
use crate::iceoryx_error::{other_error, receive_error, service_error};
use crate::names::{CONTROL_REPLIED, CONTROL_WAKE, CONTROL_WORLD};
use crate::node::{BusNode, Service};
use crate::origin::Origin;
use crate::origins::Origins;
use crate::qos;
use crate::service::{check_schema, schema_attribute, settle};
use crate::shortage::backed;
use crate::wire::Wire;

/// Bytes of a slot before the segment grows for the first time.
const FIRST_SLOT_BYTES: usize = 4096;
/// Longest delay that a missed wake-up can cause.
const LOOK_AGAIN: Duration = Duration::from_millis(50);

type Commands = PortFactory<Service, [u8], Wire<RequestHeader>, [u8], ()>;

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

fn command_service(node: &BusNode) -> Result<Commands, BusError> {
    let (full, name) = node.service_name(CONTROL_WORLD)?;
    settle(node, || {
        check_schema(
            node,
            &full,
            &name,
            MessagingPattern::RequestResponse,
            "rebuild the older of the two",
        )?;
        node.iceoryx()
            .service_builder(&name)
            .request_response::<[u8], [u8]>()
            .request_user_header::<Wire<RequestHeader>>()
            .max_clients(qos::COMMAND_CLIENTS)
            .max_servers(qos::COMMAND_SERVERS)
            .max_nodes(qos::MAX_NODES)
            .max_active_requests_per_client(qos::COMMAND_ACTIVE)
            .enable_safe_overflow_for_requests(true)
            .enable_safe_overflow_for_responses(true)
            .open_or_create_with_attributes(&schema_attribute())
            .map_err(|e| service_error("open", &full, &e))
    })
}

/// The asking end of `control/world`.
#[derive(Debug)]
pub struct CommandClient {
    port: Client<Service, [u8], Wire<RequestHeader>, [u8], ()>,
    name: [u8; 40],
    seq: u64,
    wake: Notifier,
    replied: Listener,
    domain: String,
    service: Commands,
}

impl CommandClient {
    pub(crate) fn open(node: &BusNode, name: &str) -> Result<CommandClient, BusError> {
        let service = command_service(node)?;
        let port = service
            .client_builder()
            .initial_max_slice_len(FIRST_SLOT_BYTES)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .create()
            .map_err(|e| other_error("ask", service.name().as_str(), &e))?;
        Ok(CommandClient {
            port,
            name: name_bytes(name),
            seq: 0,
            wake: Notifier::open(node, CONTROL_WAKE)?,
            replied: Listener::open(node, CONTROL_REPLIED)?,
            domain: node.domain().into(),
            service,
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
        let start = Instant::now();
        if self.service.dynamic_config().number_of_servers() == 0 {
            return Err(CommandError::NoServer {
                domain: self.domain.clone(),
            });
        }
        let full = self.service.name().as_str();
        let loan = self
            .port
            .loan_slice_uninit(text.len())
            .map_err(|e| other_error("ask", full, &e))?;
        let mut request = loan.write_from_slice(text);
        backed(full, request.payload().as_ptr(), text.len())?;
        self.seq += 1;
        request.user_header_mut().0 = RequestHeader {
            magic: REQUEST_MAGIC,
            codec_version: COMMAND_VERSION,
            seq: self.seq,
            payload_bytes: text.len() as u64,
            client: self.name,
        };
        // A wake-up for an earlier request that timed out must not count for this one.
        self.replied.drain()?;
        let own = to(self.port.id().value(), self.seq);
        let pending = request.send().map_err(|e| other_error("ask", full, &e))?;
        self.wake.notify();
        loop {
            if let Some(answer) = pending
                .receive()
                .map_err(|e| other_error("ask", full, &e))?
            {
                if is_for(answer.payload(), &own) {
                    return Ok(answer.payload().to_vec());
                }
                continue;
            }
            let waited = start.elapsed();
            if waited >= timeout || !go_on() {
                return Err(CommandError::Timeout { waited });
            }
            self.replied.wait(LOOK_AGAIN.min(timeout - waited))?;
        }
    }
}

/// The answering end of `control/world`.
#[derive(Debug)]
pub struct CommandServer {
    port: Server<Service, [u8], Wire<RequestHeader>, [u8], ()>,
    replied: Notifier,
    origins: Origins,
    gaps: Gaps,
    complaints: Complaints,
    /// Requests that were too many for one turn.
    waiting: Vec<Waiting>,
    /// Client whose turn it is when not all have one.
    next_client: String,
    service: Commands,
}

/// A request that has not been read yet.
#[derive(Debug)]
struct Waiting {
    client: String,
    seq: u64,
    /// The client's port.
    port: u128,
    origin: Arc<Origin>,
    active: ActiveRequest<Service, [u8], Wire<RequestHeader>, [u8], ()>,
}

impl Waiting {
    fn read(self) -> Request {
        let header = self.active.user_header().0;
        Request {
            batch: parse(&header, self.active.payload()),
            client: self.client,
            seq: self.seq,
            origin: self.origin,
            active: self.active,
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
    pub batch: Result<CommandBatch, String>,
    active: ActiveRequest<Service, [u8], Wire<RequestHeader>, [u8], ()>,
}

impl Request {
    /// The request as its client wrote it; empty if it is no UTF-8, and then `batch` is an error.
    pub fn text(&self) -> &str {
        let n_bytes = self.active.user_header().0.payload_bytes as usize;
        let bytes = self.active.payload().get(..n_bytes).unwrap_or_default();
        std::str::from_utf8(bytes).unwrap_or_default()
    }
}

impl CommandServer {
    pub(crate) fn open(node: &BusNode) -> Result<CommandServer, BusError> {
        let service = command_service(node)?;
        let port = service
            .server_builder()
            .initial_max_slice_len(FIRST_SLOT_BYTES)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .create()
            .map_err(|e| other_error("serve", service.name().as_str(), &e))?;
        Ok(CommandServer {
            port,
            replied: Notifier::open(node, CONTROL_REPLIED)?,
            origins: Origins::default(),
            gaps: Gaps::default(),
            complaints: Complaints::default(),
            waiting: Vec::new(),
            next_client: String::new(),
            service,
        })
    }

    /// Takes the next request that waits, if any.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn take(&mut self) -> Result<Option<Request>, BusError> {
        if !self.waiting.is_empty() {
            return Ok(Some(self.waiting.remove(0).read()));
        }
        Ok(self.receive()?.map(Waiting::read))
    }

    fn receive(&mut self) -> Result<Option<Waiting>, BusError> {
        let full = self.service.name().as_str();
        let Some(active) = self
            .port
            .receive()
            .map_err(|e| receive_error(full, qos::COMMAND_ACTIVE, e))?
        else {
            return Ok(None);
        };
        let header = active.user_header().0;
        let origin = self.origins.of(active.origin().value(), |see| {
            self.service.dynamic_config().list_clients(|details| {
                see(
                    details.client_id.value(),
                    details.node_id,
                    details.client_name.as_str(),
                );
                CallbackProgression::Continue
            });
        });
        let client = name_text(&header.client);
        let gap = self.gaps.before(active.origin().value(), header.seq);
        if gap > 0 && self.complaints.count(&origin, "flood") {
            tracing::warn!(
                "{origin} floods control/world as {client:?}: {gap} requests were lost, because at most {} of one client wait; wait for each answer before the next request, and put several commands into one. Further losses are not logged",
                qos::COMMAND_ACTIVE
            );
        }
        Ok(Some(Waiting {
            client,
            seq: header.seq,
            port: active.origin().value(),
            origin,
            active,
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
        match round(|| self.receive()) {
            Ok(arrived) => self.waiting.extend(arrived),
            // All that can be held of those who ask is held already.
            Err(BusError::BorrowLimit { .. }) if !self.waiting.is_empty() => {}
            Err(error) => return Err(error),
        }
        self.waiting
            .sort_by(|a, b| (&a.client, a.seq).cmp(&(&b.client, b.seq)));
        let sizes: Vec<(&str, u128, usize)> = self
            .waiting
            .iter()
            .map(|it| (it.client.as_str(), it.port, it.active.payload().len()))
            .collect();
        let (is_taken, left_out) = turn(&sizes, &self.next_client);
        self.next_client = left_out.unwrap_or_default().to_owned();
        let (mut taken, mut left) = (Vec::new(), Vec::new());
        for (request, is_taken) in std::mem::take(&mut self.waiting).into_iter().zip(is_taken) {
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

    /// Whether requests wait that were too many for the last [`CommandServer::take_all`]; nobody
    /// wakes the server for them again.
    pub fn is_behind(&self) -> bool {
        !self.waiting.is_empty()
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
        let full = self.service.name().as_str();
        let failed = |e: &dyn std::fmt::Debug| other_error("answer on", full, e);
        let answer = serde_json::to_vec(answer).map_err(|e| failed(&e))?;
        let text = addressed(&to(request.active.origin().value(), request.seq), &answer);
        let loan = request
            .active
            .loan_slice_uninit(text.len())
            .map_err(|e| failed(&e))?;
        let response = loan.write_from_slice(&text);
        backed(full, response.payload().as_ptr(), text.len())?;
        match response.send() {
            Err(e) if request.active.is_connected() => return Err(failed(&e)),
            // Without an error, or to a client that has gone.
            _ => {}
        }
        self.replied.notify();
        Ok(())
    }

    /// Requests that could not be read.
    pub fn n_faults(&self) -> u64 {
        self.complaints.n()
    }

    /// Number of clients now.
    pub fn n_clients(&self) -> usize {
        self.service.dynamic_config().number_of_clients()
    }
}

/// How an answer begins that is for this request of this client. iceoryx2 gives a new client the
/// channels of one that has gone, with the answers that the other did not wait for.
fn to(client_port: u128, seq: u64) -> String {
    format!("{TO}{client_port:x}-{seq}\",")
}

/// Beginning of every answer that says for whom it is.
const TO: &str = "{\"to\":\"";

/// The answer with its address in front of its other keys.
fn addressed(to: &str, answer: &[u8]) -> Vec<u8> {
    match answer.strip_prefix(b"{") {
        Some(keys) => [to.as_bytes(), keys].concat(),
        None => answer.to_vec(),
    }
}

/// Whether an answer is for who waits for one that begins with `own`. One without an address is
/// taken.
fn is_for(answer: &[u8], own: &str) -> bool {
    !answer.starts_with(TO.as_bytes()) || answer.starts_with(own.as_bytes())
}

/// Parses a request; any bytes are safe to pass.
fn parse(header: &RequestHeader, payload: &[u8]) -> Result<CommandBatch, String> {
    if header.magic != REQUEST_MAGIC || header.codec_version != COMMAND_VERSION {
        return Err(format!(
            "request speaks command version {}, the simulator {COMMAND_VERSION}; rebuild the older of the two",
            header.codec_version
        ));
    }
    let bytes = usize::try_from(header.payload_bytes)
        .ok()
        .and_then(|n| payload.get(..n));
    let bytes = bytes.ok_or_else(|| {
        format!(
            "request claims {} bytes and has {}",
            header.payload_bytes,
            payload.len()
        )
    })?;
    if bytes.len() > qos::MAX_COMMAND_BYTES {
        return Err(format!(
            "request has {} bytes, at most {} are read; split it",
            bytes.len(),
            qos::MAX_COMMAND_BYTES
        ));
    }
    let batch: CommandBatch = serde_json::from_slice(bytes)
        .map_err(|e| limits::cut(format!("request is not valid: {e}")))?;
    if batch.v != COMMAND_VERSION {
        return Err(format!(
            "\"v\" is {}, the simulator speaks {COMMAND_VERSION}",
            batch.v
        ));
    }
    if batch.commands.len() > MAX_COMMANDS {
        return Err(format!(
            "request has {} commands, at most {MAX_COMMANDS} are run; split it",
            batch.commands.len()
        ));
    }
    Ok(batch)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn broken_requests_are_told_apart() {
        let mut header: RequestHeader = bytemuck::Zeroable::zeroed();
        assert!(parse(&header, b"{}").unwrap_err().contains("version 0"));
        header.magic = REQUEST_MAGIC;
        header.codec_version = COMMAND_VERSION;
        header.payload_bytes = 9;
        assert!(
            parse(&header, b"{}")
                .unwrap_err()
                .contains("claims 9 bytes")
        );
        header.payload_bytes = 2;
        assert!(parse(&header, b"{}").unwrap_err().contains("not valid"));
        let text = br#"{"v":2,"commands":[]}"#;
        header.payload_bytes = text.len() as u64;
        assert!(parse(&header, text).unwrap_err().contains("\"v\" is 2"));
        let many = vec![r#"{"do":"ping"}"#; MAX_COMMANDS + 1].join(",");
        let text = format!(r#"{{"v":1,"commands":[{many}]}}"#);
        header.payload_bytes = text.len() as u64;
        let fault = parse(&header, text.as_bytes()).unwrap_err();
        assert!(fault.contains("16385 commands, at most 16384"), "{fault}");
        let long = format!(r#"{{"v":1,"commands":[],"{}":1}}"#, "x".repeat(1 << 20));
        header.payload_bytes = long.len() as u64;
        let fault = parse(&header, long.as_bytes()).unwrap_err();
        assert!(
            fault.len() <= limits::MAX_SENTENCE_BYTES,
            "{} bytes",
            fault.len()
        );
    }

    #[test]
    fn an_answer_is_taken_by_whom_it_is_for() {
        let answer = ReplyBatch {
            v: COMMAND_VERSION,
            epoch: "9".into(),
            tick: 4,
            replies: vec![CommandReply::Done],
        };
        let bare = serde_json::to_vec(&answer).unwrap();
        let text = addressed(&to(0xab, 1), &bare);
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
