//! The reading end of results whose bodies are on a GPU.

use std::sync::Arc;

use parking_lot::Mutex;
use schema_frames::{
    GPU_PLACE_BYTES, GPU_RESULT_BYTES, GpuPlace, InputRecord, ResultError, ResultHeader, ResultType,
};
use schema_types::MonoTime;

use super::reader::{GpuOffer, GpuSample, SampleCopy};
use crate::contract::error::BusError;
use crate::contract::origin::Origin;
use crate::contract::qos::Qos;
use crate::place::node::BusNode;
use crate::ports::reader::{Moment, Reader, Received, SampleKind};
use crate::ports::results::draft::{Answerable, Answered};
use crate::ports::results::reader::{bad_result, expect_kind, moment_of};
use crate::ports::results::service::ResultService;
use crate::time::clock::mono_now;

/// Results on a GPU.
#[derive(Debug)]
pub struct GpuResults {
    /// The type that the topic declares.
    kind: ResultType,
}

/// The reading end of a topic's results on a GPU.
pub type GpuResultReader = Reader<GpuResults>;

impl SampleKind for GpuResults {
    type Header = ResultHeader;
    type Sample = GpuResult;
    type Fault = ResultError;

    fn admit(
        &self,
        sample: Received<ResultHeader>,
        topic: &Arc<str>,
    ) -> Result<GpuResult, ResultError> {
        let header = sample.user_header().0;
        let bytes = SampleCopy::<GPU_RESULT_BYTES>::new(sample.payload());
        let (found, place) = GpuPlace::of_result(&header, bytes.get())?;
        expect_kind(found, self.kind)?;
        let inputs = bytes.get()[GPU_PLACE_BYTES..].chunks_exact(size_of::<InputRecord>());
        Ok(GpuResult {
            kind: found,
            place,
            inputs: inputs
                .take(header.n_inputs as usize)
                .map(bytemuck::pod_read_unaligned)
                .collect(),
            topic: topic.clone(),
            taken: mono_now(),
            header,
            _sample: Mutex::new(sample),
        })
    }

    fn moment(result: &GpuResult) -> Moment {
        moment_of(&result.header)
    }

    fn refuse(service: String, writer: Option<Arc<Origin>>, source: ResultError) -> BusError {
        bad_result(service, writer, source)
    }
}

impl Reader<GpuResults> {
    pub(crate) fn open(
        node: &BusNode,
        topic: &str,
        kind: ResultType,
        offer: &GpuOffer,
    ) -> Result<GpuResultReader, BusError> {
        let qos = offer.qos(Qos::of_results(kind));
        let service = || Ok(ResultService::make_on_gpu(node, topic, kind, &qos)?.slices);
        Reader::of_few(node, service, topic, || GpuResults { kind })
    }

    /// The type that the topic declares.
    pub fn kind(&self) -> ResultType {
        self.kind.kind
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
