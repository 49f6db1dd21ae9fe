//! The reading end of results whose bodies are on a GPU.

use std::sync::{Arc, Mutex};

use schema_frames::{
    GPU_PLACE_BYTES, GPU_RESULT_BYTES, GpuPlace, InputRecord, ResultError, ResultHeader, ResultType,
};
use schema_types::MonoTime;

use super::reader::{GpuOffer, GpuSample};
use crate::clock::mono_now;
use crate::error::BusError;
use crate::intake::{Admission, Intake, ReaderCounts, Received};
use crate::node::BusNode;
use crate::origin::Origin;
use crate::qos::Qos;
use crate::result_draft::{Answerable, Answered};
use crate::result_service::ResultService;

/// The reading end of a topic's results on a GPU. It survives its writer.
#[derive(Debug)]
pub struct GpuResultReader {
    intake: Intake<Results>,
}

/// How results are checked.
#[derive(Clone, Debug)]
struct Results {
    topic: Arc<str>,
    /// The type that the topic declares.
    kind: ResultType,
}

impl Admission for Results {
    type Header = ResultHeader;
    type Item = GpuResult;
    type Fault = ResultError;

    fn admit(&self, sample: Received<ResultHeader>) -> Result<(GpuResult, u64, u64), ResultError> {
        // Copied before they are checked, because another process could change them in between.
        let header = sample.user_header().0;
        let payload = sample.payload();
        let mut bytes = [0; GPU_RESULT_BYTES];
        let n_bytes = payload.len().min(GPU_RESULT_BYTES);
        bytes[..n_bytes].copy_from_slice(&payload[..n_bytes]);
        let (found, place) = GpuPlace::of_result(&header, &bytes[..n_bytes])?;
        if found != self.kind {
            return Err(ResultError::OtherType {
                found: found.name(),
                declared: self.kind.name(),
            });
        }
        let inputs = bytes[GPU_PLACE_BYTES..n_bytes].chunks_exact(size_of::<InputRecord>());
        let result = GpuResult {
            kind: found,
            place,
            inputs: inputs
                .take(header.n_inputs as usize)
                .map(bytemuck::pod_read_unaligned)
                .collect(),
            topic: self.topic.clone(),
            taken: mono_now(),
            header,
            _sample: Mutex::new(sample),
        };
        Ok((result, header.writer_epoch, header.seq))
    }

    fn refuse(service: String, writer: Option<Arc<Origin>>, source: ResultError) -> BusError {
        BusError::BadResult {
            service,
            writer,
            source,
        }
    }
}

impl GpuResultReader {
    pub(crate) fn open(
        node: &BusNode,
        topic: &str,
        kind: ResultType,
        offer: &GpuOffer,
    ) -> Result<GpuResultReader, BusError> {
        let [readers, buffer, borrowed] = offer.capacity.map(|n| n.clamp(1, 64));
        let qos = Qos {
            readers,
            buffer,
            borrowed,
            ..Qos::of_results(kind)
        };
        let results = Results {
            topic: topic.into(),
            kind,
        };
        let service = || Ok(ResultService::make_on_gpu(node, topic, kind, &qos)?.slices);
        let intake = match Intake::open(service()?, results.clone()) {
            // Killed readers keep their places until somebody removes them, and there are few.
            Err(BusError::TooManyReaders { .. }) => {
                node.clean_dead_nodes();
                Intake::open(service()?, results)?
            }
            opened => opened?,
        };
        Ok(GpuResultReader { intake })
    }

    /// Name without the domain and without "/gpu".
    pub fn topic(&self) -> &str {
        &self.intake.admission.topic
    }

    /// The type that the topic declares.
    pub fn kind(&self) -> ResultType {
        self.intake.admission.kind
    }

    /// Takes the oldest result that waits, if any.
    ///
    /// # Errors
    /// As [`crate::ResultReader::next`].
    #[expect(
        clippy::should_implement_trait,
        reason = "an iterator would end at the first gap; this is polled"
    )]
    pub fn next(&mut self) -> Result<Option<GpuResult>, BusError> {
        self.intake.next()
    }

    /// Takes the newest result that waits, if any; older ones are dropped and counted as skipped.
    ///
    /// # Errors
    /// As [`crate::ResultReader::next`].
    pub fn latest(&mut self) -> Result<Option<GpuResult>, BusError> {
        self.intake.latest()
    }

    /// Counters since this reader was opened.
    pub fn counts(&self) -> ReaderCounts {
        self.intake.counts()
    }

    /// Whether a writer has the topic open on a GPU.
    pub fn has_writer(&self) -> bool {
        self.intake.has_writer()
    }
}

/// A result on a GPU. While it lives, its slot there is not written to again: whoever has given the
/// GPU work that reads it drops it after that work is done.
#[derive(Debug)]
pub struct GpuResult {
    /// Kept: it is what protects the slot. Nobody locks it; threads may share the result so.
    _sample: Mutex<Received<ResultHeader>>,
    header: ResultHeader,
    kind: ResultType,
    place: GpuPlace,
    inputs: Vec<InputRecord>,
    topic: Arc<str>,
    taken: MonoTime,
}

impl GpuResult {
    /// The header, checked.
    pub fn header(&self) -> &ResultHeader {
        &self.header
    }

    /// Type of the result.
    pub fn kind(&self) -> ResultType {
        self.kind
    }

    /// The frames and results that it answers.
    pub fn inputs(&self) -> &[InputRecord] {
        &self.inputs
    }

    /// When this reader took it.
    pub fn taken(&self) -> MonoTime {
        self.taken
    }
}

impl GpuSample for GpuResult {
    fn topic(&self) -> &str {
        &self.topic
    }

    fn place(&self) -> &GpuPlace {
        &self.place
    }
}

impl Answerable for GpuResult {
    fn answered(&self) -> Answered {
        Answered::by_result(&self.header, &self.topic, self.taken)
    }
}
