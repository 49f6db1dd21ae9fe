//! Requests and their answers: one port for every service of this kind. A [`Protocol`] says what a
//! service has of its own.
//!
//! iceoryx2 wakes nobody for a request, so a client notifies `control/wake` and the server
//! `control/replied`.

use std::fmt::Debug;
use std::marker::PhantomData;
use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::active_request::ActiveRequest;
use iceoryx2::port::client::Client;
use iceoryx2::port::server::Server;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::request_response::PortFactory;

use schema_frames::command::{COMMAND_VERSION, REQUEST_MAGIC, RequestHeader};

use crate::contract::error::BusError;
use crate::contract::names::{CONTROL_REPLIED, CONTROL_WAKE, name_bytes};
use crate::contract::origin::Origin;
use crate::contract::qos;
use crate::contract::wire::Wire;
use crate::memory::shortage::backed;
use crate::place::event::{Listener, Notifier};
use crate::place::iceoryx_error::{other_error, receive_error, service_error};
use crate::place::node::{BusNode, Service};
use crate::place::origins::Origins;
use crate::place::service::{check_schema, schema_attribute, settle};

/// Bytes of a slot before the segment grows for the first time.
const FIRST_SLOT_BYTES: usize = 4096;
/// Longest delay that a missed wake-up can cause.
const LOOK_AGAIN: Duration = Duration::from_millis(50);

/// What one service of requests has of its own.
pub trait Protocol: Debug {
    /// Name of the service without the domain.
    const SERVICE: &'static str;
    /// Clients at a time.
    const MAX_CLIENTS: usize;
    /// What a request is once it is read.
    type Question<'a>;
    /// Why a request cannot be read.
    type Fault;

    /// Reads a request; any bytes are safe to pass.
    ///
    /// # Errors
    /// The broken rule.
    fn read<'a>(
        header: &RequestHeader,
        payload: &'a [u8],
    ) -> Result<Self::Question<'a>, Self::Fault>;

    /// How an answer begins that is for request `seq` of this client. iceoryx2 gives a new client
    /// the channels of one that has gone, with the answers that the other did not wait for.
    fn address(client_port: u128, seq: u64) -> Vec<u8>;

    /// The answer with its address.
    fn addressed(address: Vec<u8>, answer: &[u8]) -> Vec<u8>;

    /// The answer for who waits for one with this address; `None` if it is another's.
    fn delivered<'a>(answer: &'a [u8], address: &[u8]) -> Option<&'a [u8]>;
}

/// Why a request got no answer.
#[derive(Debug, thiserror::Error)]
pub(crate) enum AskError {
    /// Nobody answered in time, or the asker gave up.
    #[error("no answer came within {} ms", .waited.as_millis())]
    NoAnswer {
        /// How long was waited.
        waited: Duration,
    },
    /// The bus failed.
    #[error(transparent)]
    Bus(#[from] BusError),
}

type Requests = PortFactory<Service, [u8], Wire<RequestHeader>, [u8], ()>;

fn service<P: Protocol>(node: &BusNode) -> Result<Requests, BusError> {
    let (full, name) = node.service_name(P::SERVICE)?;
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
            .max_clients(P::MAX_CLIENTS)
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
pub(crate) struct RequestClient<P: Protocol> {
    port: Client<Service, [u8], Wire<RequestHeader>, [u8], ()>,
    name: [u8; 40],
    seq: u64,
    wake: Notifier,
    replied: Listener,
    service: Requests,
    protocol: PhantomData<P>,
}

impl<P: Protocol> RequestClient<P> {
    /// Opens it under a name, which may be empty.
    pub fn open(node: &BusNode, name: &str) -> Result<RequestClient<P>, BusError> {
        let service = service::<P>(node)?;
        let port = service
            .client_builder()
            .initial_max_slice_len(FIRST_SLOT_BYTES)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .create()
            .map_err(|e| other_error("ask", service.name().as_str(), &e))?;
        Ok(RequestClient {
            port,
            name: name_bytes(name),
            seq: 0,
            wake: Notifier::open(node, CONTROL_WAKE)?,
            replied: Listener::open(node, CONTROL_REPLIED)?,
            service,
            protocol: PhantomData,
        })
    }

    /// Whether anybody answers.
    pub fn has_server(&self) -> bool {
        self.service.dynamic_config().number_of_servers() > 0
    }

    /// Asks, and waits for the answer as long as `go_on`, which is asked at least twenty times a
    /// second, says so.
    pub fn ask(
        &mut self,
        question: &[u8],
        timeout: Duration,
        go_on: &mut dyn FnMut() -> bool,
    ) -> Result<Vec<u8>, AskError> {
        let start = Instant::now();
        let full = self.service.name().as_str();
        let failed = |e: &dyn Debug| other_error("ask", full, e);
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
            client: self.name,
        };
        // A wake-up for an earlier request that timed out must not count for this one.
        self.replied.drain()?;
        let own = P::address(self.port.id().value(), self.seq);
        let pending = request.send().map_err(|e| failed(&e))?;
        self.wake.notify();
        loop {
            if let Some(answer) = pending.receive().map_err(|e| failed(&e))? {
                match P::delivered(answer.payload(), &own) {
                    Some(bytes) => return Ok(bytes.to_vec()),
                    None => continue,
                }
            }
            let waited = start.elapsed();
            if waited >= timeout || !go_on() {
                return Err(AskError::NoAnswer { waited });
            }
            self.replied.wait(LOOK_AGAIN.min(timeout - waited))?;
        }
    }
}

/// The answering end.
#[derive(Debug)]
pub struct RequestServer<P: Protocol> {
    port: Server<Service, [u8], Wire<RequestHeader>, [u8], ()>,
    replied: Notifier,
    origins: Origins,
    service: Requests,
    protocol: PhantomData<P>,
}

/// A request that waits for its answer. If it is dropped unanswered, its client gives up.
#[derive(Debug)]
pub struct WaitingRequest<P: Protocol> {
    /// The client's process.
    pub origin: Arc<Origin>,
    active: ActiveRequest<Service, [u8], Wire<RequestHeader>, [u8], ()>,
    protocol: PhantomData<P>,
}

impl<P: Protocol> WaitingRequest<P> {
    pub(crate) fn header(&self) -> RequestHeader {
        self.active.user_header().0
    }

    /// All bytes, whatever the header says.
    pub(crate) fn payload(&self) -> &[u8] {
        self.active.payload()
    }

    /// The bytes that the header says; `None` if there are fewer.
    pub(crate) fn bytes(&self) -> Option<&[u8]> {
        claimed(&self.header(), self.payload())
    }

    /// Number of the client's port.
    pub(crate) fn client_port(&self) -> u128 {
        self.active.origin().value()
    }

    /// What it asks.
    pub(crate) fn read(&self) -> Result<P::Question<'_>, P::Fault> {
        P::read(&self.header(), self.payload())
    }
}

/// The bytes of a payload that its header says; `None` if there are fewer.
pub(crate) fn claimed<'a>(header: &RequestHeader, payload: &'a [u8]) -> Option<&'a [u8]> {
    let n_bytes = usize::try_from(header.payload_bytes).ok()?;
    payload.get(..n_bytes)
}

impl<P: Protocol> RequestServer<P> {
    pub(crate) fn open(node: &BusNode) -> Result<RequestServer<P>, BusError> {
        let service = service::<P>(node)?;
        let port = service
            .server_builder()
            .initial_max_slice_len(FIRST_SLOT_BYTES)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .create()
            .map_err(|e| other_error("serve", service.name().as_str(), &e))?;
        Ok(RequestServer {
            port,
            replied: Notifier::open(node, CONTROL_REPLIED)?,
            origins: Origins::default(),
            service,
            protocol: PhantomData,
        })
    }

    /// Takes the next request that waits, if any.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn take(&mut self) -> Result<Option<WaitingRequest<P>>, BusError> {
        let full = self.service.name().as_str();
        let received = self.port.receive();
        let received = received.map_err(|e| receive_error(full, qos::COMMAND_ACTIVE, e))?;
        let Some(active) = received else {
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
        Ok(Some(WaitingRequest {
            origin,
            active,
            protocol: PhantomData,
        }))
    }

    /// Answers a request. It is no error if the client has gone.
    pub(crate) fn send(&self, request: &WaitingRequest<P>, answer: &[u8]) -> Result<(), BusError> {
        let full = self.service.name().as_str();
        let failed = |e: &dyn Debug| other_error("answer on", full, e);
        let address = P::address(request.client_port(), request.header().seq);
        let bytes = P::addressed(address, answer);
        let loan = request
            .active
            .loan_slice_uninit(bytes.len())
            .map_err(|e| failed(&e))?;
        let response = loan.write_from_slice(&bytes);
        backed(full, response.payload().as_ptr(), bytes.len())?;
        match response.send() {
            Err(e) if request.active.is_connected() => return Err(failed(&e)),
            // Without an error, or to a client that has gone.
            _ => {}
        }
        self.replied.notify();
        Ok(())
    }

    /// Name of the service.
    pub(crate) fn full_name(&self) -> &str {
        self.service.name().as_str()
    }

    /// Number of clients now.
    pub fn n_clients(&self) -> usize {
        self.service.dynamic_config().number_of_clients()
    }
}
