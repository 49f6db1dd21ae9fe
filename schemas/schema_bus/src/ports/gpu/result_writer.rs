//! The writing end of results whose bodies are on a GPU: a service beside the topic's own, whose
//! samples say where a body is. What is in shared memory is the topic as everybody else reads it.
//!
//! The memory on the GPU belongs to whoever uses this: slot i of it is slot i of the service's
//! segment, so what iceoryx2 keeps for a reader is kept on the GPU too.

use iceoryx2::prelude::*;
use parking_lot::Mutex;

use schema_frames::{GPU_PLACE_BYTES, GPU_RESULT_BYTES, GpuPlace, ResultHeader, ResultType};

use super::reader::failed;
use super::server::{GpuDevice, GpuServer, GpuTopic};
use crate::contract::error::{BusError, LoanError};
use crate::contract::names;
use crate::contract::qos::{GPU_FRAME, Qos};
use crate::memory::sizes::{FrameTopic, ResultTopic, result_segment_bytes};
use crate::place::event::Notifier;
use crate::place::node::BusNode;
use crate::place::service::capacity;
use crate::ports::results::draft::ResultDraft;
use crate::ports::results::reader::{bad_result, expect_kind};
use crate::ports::results::service::ResultService;
use crate::ports::results::writer::{ResultLoan, ResultPublisher, writer_name};
use crate::ports::writer::{Loan, Slots, Writer, make_port};
use crate::time::clock::mono_now;

/// Places of a topic's service on a GPU. Each is a slot of the GPU's memory, so they are few.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuPlaces {
    /// Readers at a time.
    pub readers: usize,
    /// Results that wait for a reader.
    pub buffer: usize,
    /// Results that a reader may hold.
    pub borrowed: usize,
}

impl Default for GpuPlaces {
    fn default() -> Self {
        GpuPlaces {
            readers: GPU_FRAME.readers,
            buffer: GPU_FRAME.buffer,
            borrowed: GPU_FRAME.borrowed,
        }
    }
}

/// The writing end of a topic of results that are on a GPU and, while somebody reads them there, in
/// shared memory.
#[derive(Debug)]
pub struct GpuResultPublisher {
    writer: Writer<ResultHeader>,
    wake: Notifier,
    host: ResultPublisher,
    /// Addresses of the segment's slots in the order in which they were first seen.
    seen: Mutex<Vec<usize>>,
    n_slots: usize,
    _offer: GpuTopic,
    server: GpuServer,
}

impl GpuResultPublisher {
    pub(crate) fn open(
        node: &BusNode,
        topic: &str,
        spec: &ResultTopic,
        places: GpuPlaces,
        device: GpuDevice,
    ) -> Result<GpuResultPublisher, BusError> {
        if !spec.kind.can_stay_on_gpu() {
            return Err(BusError::Description {
                topic: topic.into(),
                fault: format!(
                    "results of type {} are no arrays that a GPU could keep; tensors and images are, publish these without a device",
                    spec.kind.name()
                ),
            });
        }
        let server = GpuServer::start(node, device)
            .map_err(|error| failed(topic, format!("its socket cannot be made ({error})")))?;
        // Before the topic: who finds the topic finds its side on the GPU.
        let offer = server.offer(
            topic,
            FrameTopic {
                max_readers: places.readers,
                buffer: places.buffer,
                borrowed: places.borrowed,
                ..FrameTopic::on_gpu(1)
            },
        );
        let host = ResultPublisher::open(node, topic, spec)?;
        let qos = Qos {
            readers: places.readers,
            buffer: places.buffer,
            borrowed: places.borrowed,
            ..Qos::of_results(spec.kind)
        };
        let service = ResultService::make_on_gpu(node, topic, spec.kind, &qos)?.slices;
        // Readers may have kept the service of an earlier writer, which had other capacities.
        let capacity = capacity(&service);
        let slots = Slots {
            payload_bytes: GPU_RESULT_BYTES,
            max_loans: spec.max_loans,
            need_bytes: result_segment_bytes(&capacity, spec.max_loans, GPU_RESULT_BYTES),
            grow: AllocationStrategy::Static,
        };
        let port = make_port(&service, &slots, Some(&writer_name(node)))?;
        Ok(GpuResultPublisher {
            writer: Writer::of(service, port, &slots),
            wake: Notifier::open(node, &names::gpu_topic(topic))?,
            host,
            seen: Mutex::default(),
            n_slots: capacity.slots(spec.max_loans),
            _offer: offer,
            server,
        })
    }

    /// Name without the domain.
    pub fn topic(&self) -> &str {
        self.host.topic()
    }

    /// Type of its results.
    pub fn kind(&self) -> ResultType {
        self.host.kind()
    }

    /// Number of readers on the GPU now.
    pub fn n_gpu_readers(&self) -> usize {
        self.writer.n_readers()
    }

    /// Number of readers in shared memory now.
    pub fn n_host_readers(&self) -> usize {
        self.host.n_readers()
    }

    /// Slots that the memory on the GPU needs.
    pub fn n_slots(&self) -> usize {
        self.n_slots
    }

    /// Who hands out the descriptors of that memory.
    pub fn server(&self) -> &GpuServer {
        &self.server
    }

    /// Loans a slot on the GPU, to be filled there and sent.
    ///
    /// # Errors
    /// [`LoanError::NoFreeSlot`] if all loans are in use.
    pub fn loan(&self) -> Result<GpuResultSlot, LoanError> {
        let topic = self.topic();
        let loan = self
            .writer
            .loan(topic, GPU_RESULT_BYTES, GPU_RESULT_BYTES)?;
        let address = loan.address() as usize;
        let mut seen = self.seen.lock();
        let known = seen.iter().position(|known| *known == address);
        let number = known.unwrap_or_else(|| {
            seen.push(address);
            seen.len() - 1
        });
        if number >= self.n_slots {
            return Err(LoanError::Failed {
                topic: topic.into(),
                cause: format!("the segment has more slots than {}", self.n_slots),
            });
        }
        Ok(GpuResultSlot { loan, number })
    }

    /// Loans a slot of shared memory for the copy of a body; [`ResultLoan::send_as`] sends it.
    ///
    /// # Errors
    /// As [`ResultPublisher::loan`].
    pub fn host_loan(&self, body_bytes: usize) -> Result<ResultLoan, LoanError> {
        self.host.loan(body_bytes)
    }

    /// Gives a draft the number under which it is sent in both places. The number is used up even
    /// if it is sent in none, so that a gap shows the loss.
    pub fn number(&self, draft: &mut ResultDraft) {
        self.host.number(draft);
    }

    /// Sends a slot that the GPU has filled: the body is at `place`, and nobody has to wait for it.
    /// Returns the number of readers on the GPU that received it.
    ///
    /// # Errors
    /// [`BusError::BadResult`] if header, type and place contradict one another,
    /// [`BusError::Memory`], [`BusError::Service`] if iceoryx2 fails.
    pub fn send(
        &self,
        slot: GpuResultSlot,
        place: &GpuPlace,
        draft: &ResultDraft,
    ) -> Result<usize, BusError> {
        let mut loan = slot.loan;
        let full = self.writer.full_name();
        let header = ResultHeader {
            payload_place: ResultHeader::ON_GPU,
            published_mono_nanos: mono_now().0,
            ..*draft.header()
        };
        let mut bytes = [0; GPU_RESULT_BYTES];
        let inputs: &[u8] = bytemuck::cast_slice(draft.inputs());
        bytes[..GPU_PLACE_BYTES].copy_from_slice(bytemuck::bytes_of(place));
        bytes[GPU_PLACE_BYTES..GPU_PLACE_BYTES + inputs.len()].copy_from_slice(inputs);
        let bad = |source| bad_result(full.to_owned(), None, source);
        let (found, _) = GpuPlace::of_result(&header, &bytes).map_err(bad)?;
        expect_kind(found, self.kind()).map_err(bad)?;
        loan.check_pages(full)?;
        *loan.header_mut() = header;
        loan.payload_mut().copy_from_slice(&bytes);
        let n_readers = loan.send("send", full)?;
        self.wake.notify_listeners();
        Ok(n_readers)
    }
}

/// A slot of a topic's memory on the GPU. Send it, or drop it to give it back.
pub struct GpuResultSlot {
    loan: Loan<ResultHeader>,
    number: usize,
}

impl GpuResultSlot {
    /// Its number, from 0, below [`GpuResultPublisher::n_slots`]. Nobody else has it while this
    /// lives.
    pub fn number(&self) -> usize {
        self.number
    }
}

impl std::fmt::Debug for GpuResultSlot {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("GpuResultSlot")
            .field("number", &self.number)
            .finish_non_exhaustive()
    }
}
