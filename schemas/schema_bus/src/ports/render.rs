//! `control/render`: questions of render workers, which the simulator answers between ticks.
//!
//! Questions are JSON, answers are bytes whose meaning follows from the question.

use std::convert::Infallible;
use std::time::Duration;

use schema_frames::command::RequestHeader;

use crate::contract::error::BusError;
use crate::contract::names::CONTROL_RENDER;
use crate::contract::qos;
use crate::place::node::BusNode;
use crate::ports::requests::{
    AskError, Protocol, RequestClient, RequestServer, WaitingRequest, claimed,
};

/// Longest question, bytes.
const MAX_QUESTION_BYTES: usize = 1 << 20;

/// Questions of render workers. An answer begins with 24 bytes of address: the asker's port and its
/// count.
#[derive(Debug)]
pub struct Questions;

impl Protocol for Questions {
    const SERVICE: &'static str = CONTROL_RENDER;
    const MAX_CLIENTS: usize = qos::RENDERED.publishers;
    type Question<'a> = &'a [u8];
    type Fault = Infallible;

    /// Empty if it claims more than it has, or more than is read.
    fn read<'a>(header: &RequestHeader, payload: &'a [u8]) -> Result<&'a [u8], Infallible> {
        let bytes = claimed(header, payload);
        let short = bytes.filter(|bytes| bytes.len() <= MAX_QUESTION_BYTES);
        Ok(short.unwrap_or_default())
    }

    fn address(client_port: u128, seq: u64) -> Vec<u8> {
        [&client_port.to_le_bytes()[..], &seq.to_le_bytes()].concat()
    }

    fn addressed(address: Vec<u8>, answer: &[u8]) -> Vec<u8> {
        [&address, answer].concat()
    }

    fn delivered<'a>(answer: &'a [u8], address: &[u8]) -> Option<&'a [u8]> {
        answer.strip_prefix(address)
    }
}

/// The asking end.
#[derive(Debug)]
pub struct RenderClient(RequestClient<Questions>);

impl RenderClient {
    pub(crate) fn open(node: &BusNode) -> Result<RenderClient, BusError> {
        Ok(RenderClient(RequestClient::open(node, "")?))
    }

    /// Whether anybody answers questions.
    pub fn has_server(&self) -> bool {
        self.0.has_server()
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
        match self.0.ask(question, timeout, go_on) {
            Ok(answer) => Ok(Some(answer)),
            Err(AskError::NoAnswer { .. }) => Ok(None),
            Err(AskError::Bus(error)) => Err(error),
        }
    }
}

/// The answering end.
pub type RenderServer = RequestServer<Questions>;

/// A question that waits for its answer. If it is dropped unanswered, its asker gives up.
pub type RenderQuestion = WaitingRequest<Questions>;

impl WaitingRequest<Questions> {
    /// The question; empty if it claims more than it has, or more than is read.
    pub fn text(&self) -> &[u8] {
        match self.read() {
            Ok(bytes) => bytes,
            Err(never) => match never {},
        }
    }
}

impl RequestServer<Questions> {
    /// Answers a question.
    ///
    /// # Errors
    /// [`BusError::Memory`] if `/dev/shm` has no room for the answer, [`BusError::Service`].
    pub fn answer(&self, question: RenderQuestion, bytes: &[u8]) -> Result<(), BusError> {
        self.send(&question, bytes)
    }
}
