//! `control/world`: requests as JSON, which the daemon answers between ticks.
//!
//! iceoryx2 wakes nobody for a request, so a client notifies `control/wake` and the server
//! `control/replied`.

use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::active_request::ActiveRequest;
use iceoryx2::port::client::Client;
use iceoryx2::port::server::Server;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::request_response::PortFactory;

use schema_frames::command::{COMMAND_VERSION, REQUEST_MAGIC, RequestHeader};
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
    settle(|| {
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
        let pending = request.send().map_err(|e| other_error("ask", full, &e))?;
        self.wake.notify();
        loop {
            if let Some(answer) = pending
                .receive()
                .map_err(|e| other_error("ask", full, &e))?
            {
                return Ok(answer.payload().to_vec());
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
    service: Commands,
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
            service,
        })
    }

    /// Takes the next request that waits, if any.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn take(&mut self) -> Result<Option<Request>, BusError> {
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
        Ok(Some(Request {
            client,
            seq: header.seq,
            origin,
            batch: parse(&header, active.payload()),
            active,
        }))
    }

    /// Takes the requests that wait, at most four of each client, sorted by (client, seq), which is
    /// the order in which they run. The next call takes what is left. The first request of a
    /// process that cannot be read is logged.
    ///
    /// # Errors
    /// As [`CommandServer::take`].
    pub fn take_all(&mut self) -> Result<Vec<Request>, BusError> {
        let mut requests = round(|| self.take())?;
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
        requests.sort_by(|a, b| (&a.client, a.seq).cmp(&(&b.client, b.seq)));
        Ok(requests)
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
        let text = serde_json::to_vec(answer).map_err(|e| failed(&e))?;
        let loan = request
            .active
            .loan_slice_uninit(text.len())
            .map_err(|e| failed(&e))?;
        match loan.write_from_slice(&text).send() {
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
    let batch: CommandBatch =
        serde_json::from_slice(bytes).map_err(|e| format!("request is not valid: {e}"))?;
    if batch.v != COMMAND_VERSION {
        return Err(format!(
            "\"v\" is {}, the simulator speaks {COMMAND_VERSION}",
            batch.v
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
    }
}
