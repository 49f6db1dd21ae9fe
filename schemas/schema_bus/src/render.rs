//! `control/render`: questions of render workers, which the simulator answers between ticks.
//!
//! Questions are JSON, answers are bytes whose meaning follows from the question.

use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::active_request::ActiveRequest;
use iceoryx2::port::client::Client;
use iceoryx2::port::server::Server;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::request_response::PortFactory;

use schema_frames::command::{COMMAND_VERSION, REQUEST_MAGIC, RequestHeader};

use crate::error::BusError;
use crate::event::{Listener, Notifier};
use crate::iceoryx_error::{other_error, receive_error, service_error};
use crate::names::{CONTROL_RENDER, CONTROL_REPLIED, CONTROL_WAKE};
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
/// Longest question, bytes.
const MAX_QUESTION_BYTES: usize = 1 << 20;
/// Bytes of the address in front of an answer: the asker's port and its count.
const ADDRESS_BYTES: usize = 24;

type Questions = PortFactory<Service, [u8], Wire<RequestHeader>, [u8], ()>;

fn questions(node: &BusNode) -> Result<Questions, BusError> {
    let (full, name) = node.service_name(CONTROL_RENDER)?;
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
            .max_clients(qos::RENDERED.publishers)
            .max_servers(qos::COMMAND_SERVERS)
            .max_nodes(qos::MAX_NODES)
            .max_active_requests_per_client(qos::COMMAND_ACTIVE)
            .enable_safe_overflow_for_requests(true)
            .enable_safe_overflow_for_responses(true)
            .open_or_create_with_attributes(&schema_attribute())
            .map_err(|e| service_error("open", &full, &e))
    })
}

/// The asking end.
#[derive(Debug)]
pub struct RenderClient {
    port: Client<Service, [u8], Wire<RequestHeader>, [u8], ()>,
    seq: u64,
    wake: Notifier,
    replied: Listener,
    service: Questions,
}

impl RenderClient {
    pub(crate) fn open(node: &BusNode) -> Result<RenderClient, BusError> {
        let service = questions(node)?;
        let port = service
            .client_builder()
            .initial_max_slice_len(FIRST_SLOT_BYTES)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .create()
            .map_err(|e| other_error("ask", service.name().as_str(), &e))?;
        Ok(RenderClient {
            port,
            seq: 0,
            wake: Notifier::open(node, CONTROL_WAKE)?,
            replied: Listener::open(node, CONTROL_REPLIED)?,
            service,
        })
    }

    /// Whether anybody answers questions.
    pub fn has_server(&self) -> bool {
        self.service.dynamic_config().number_of_servers() > 0
    }

    /// Asks, and waits for the answer; `None` if nobody answers in time, or `go_on`, which is asked
    /// at least twenty times a second, says `false`.
    ///
    /// # Errors
    /// [`BusError::Service`], [`BusError::Memory`].
    pub fn ask(
        &mut self,
        question: &[u8],
        timeout: Duration,
        go_on: &mut dyn FnMut() -> bool,
    ) -> Result<Option<Vec<u8>>, BusError> {
        let start = Instant::now();
        let full = self.service.name().as_str();
        let failed = |e: &dyn std::fmt::Debug| other_error("ask", full, e);
        let loan = self
            .port
            .loan_slice_uninit(question.len())
            .map_err(|e| failed(&e))?;
        let mut request = loan.write_from_slice(question);
        backed(full, request.payload().as_ptr(), question.len())?;
        self.seq += 1;
        request.user_header_mut().0 = RequestHeader {
            magic: REQUEST_MAGIC,
            codec_version: COMMAND_VERSION,
            seq: self.seq,
            payload_bytes: question.len() as u64,
            client: [0; 40],
        };
        self.replied.drain()?;
        let own = address(self.port.id().value(), self.seq);
        let pending = request.send().map_err(|e| failed(&e))?;
        self.wake.notify();
        loop {
            if let Some(answer) = pending.receive().map_err(|e| failed(&e))? {
                match answer.payload().strip_prefix(&own) {
                    Some(bytes) => return Ok(Some(bytes.to_vec())),
                    // For a client that has gone, whose channel this is.
                    None => continue,
                }
            }
            let waited = start.elapsed();
            if waited >= timeout || !go_on() {
                return Ok(None);
            }
            self.replied.wait(LOOK_AGAIN.min(timeout - waited))?;
        }
    }
}

/// The answering end.
#[derive(Debug)]
pub struct RenderServer {
    port: Server<Service, [u8], Wire<RequestHeader>, [u8], ()>,
    replied: Notifier,
    origins: Origins,
    service: Questions,
}

/// A question that waits for its answer. If it is dropped unanswered, its asker gives up.
#[derive(Debug)]
pub struct RenderQuestion {
    /// The asker's process.
    pub origin: Arc<Origin>,
    active: ActiveRequest<Service, [u8], Wire<RequestHeader>, [u8], ()>,
}

impl RenderQuestion {
    /// The question; empty if it claims more than it has, or more than is read.
    pub fn text(&self) -> &[u8] {
        let n_bytes = self.active.user_header().0.payload_bytes as usize;
        let bytes = self.active.payload().get(..n_bytes);
        bytes
            .filter(|bytes| bytes.len() <= MAX_QUESTION_BYTES)
            .unwrap_or_default()
    }
}

impl RenderServer {
    pub(crate) fn open(node: &BusNode) -> Result<RenderServer, BusError> {
        let service = questions(node)?;
        let port = service
            .server_builder()
            .initial_max_slice_len(FIRST_SLOT_BYTES)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .create()
            .map_err(|e| other_error("serve", service.name().as_str(), &e))?;
        Ok(RenderServer {
            port,
            replied: Notifier::open(node, CONTROL_REPLIED)?,
            origins: Origins::default(),
            service,
        })
    }

    /// Takes the next question that waits, if any.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn take(&mut self) -> Result<Option<RenderQuestion>, BusError> {
        let full = self.service.name().as_str();
        let Some(active) = self
            .port
            .receive()
            .map_err(|e| receive_error(full, qos::COMMAND_ACTIVE, e))?
        else {
            return Ok(None);
        };
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
        Ok(Some(RenderQuestion { origin, active }))
    }

    /// Answers a question.
    ///
    /// # Errors
    /// [`BusError::Memory`] if `/dev/shm` has no room for the answer, [`BusError::Service`].
    pub fn answer(&self, question: RenderQuestion, bytes: &[u8]) -> Result<(), BusError> {
        let full = self.service.name().as_str();
        let failed = |e: &dyn std::fmt::Debug| other_error("answer on", full, e);
        let header = question.active.user_header().0;
        let own = address(question.active.origin().value(), header.seq);
        let text = [&own[..], bytes].concat();
        let loan = question
            .active
            .loan_slice_uninit(text.len())
            .map_err(|e| failed(&e))?;
        let response = loan.write_from_slice(&text);
        backed(full, response.payload().as_ptr(), text.len())?;
        match response.send() {
            Err(e) if question.active.is_connected() => return Err(failed(&e)),
            // Without an error, or to a worker that has gone.
            _ => {}
        }
        self.replied.notify();
        Ok(())
    }
}

/// What stands in front of an answer: iceoryx2 gives a new client the channels of one that has gone,
/// with the answers that the other did not wait for.
fn address(client_port: u128, seq: u64) -> [u8; ADDRESS_BYTES] {
    let mut bytes = [0; ADDRESS_BYTES];
    bytes[..16].copy_from_slice(&client_port.to_le_bytes());
    bytes[16..].copy_from_slice(&seq.to_le_bytes());
    bytes
}
