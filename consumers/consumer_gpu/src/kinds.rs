//! What topics of frames and topics of results do differently on a GPU.

use std::fmt::Debug;
use std::ops::Deref;

use schema_bus::{
    Answerable, Answered, Bus, BusError, Frame, FrameReader, GpuFrame, GpuFrameReader, GpuOffer,
    GpuResult, GpuResultReader, GpuSample, Reader, ResultReader, ResultSample, SampleKind,
};
use schema_frames::{FrameHeader, InputRecord, Modality, ResultHeader, ResultType};
use schema_types::MonoTime;

use crate::error::GpuError;

/// Which of several samples that wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Which {
    /// The oldest.
    Oldest,
    /// The newest.
    Newest,
}

/// Takes a sample.
///
/// # Errors
/// As [`Reader::next`].
pub fn take<S: SampleKind>(
    from: &mut Reader<S>,
    which: Which,
) -> Result<Option<S::Sample>, BusError> {
    match which {
        Which::Oldest => from.next(),
        Which::Newest => from.latest(),
    }
}

/// A kind of topic: its samples on a GPU and in shared memory.
pub trait Kind: Debug + Sized + 'static {
    /// Samples on the GPU.
    type OnGpu: SampleKind<Sample: GpuSample + Answerable + Debug>;
    /// Samples in shared memory.
    type OnHost: SampleKind<Sample: Deref<Target = [u8]>>;
    /// What a sample says of itself, kept when its memory is not.
    type About: Debug;

    /// Opens the topic on the GPU.
    fn open_gpu(bus: &Bus, topic: &str, offer: &GpuOffer) -> Result<Reader<Self::OnGpu>, BusError>;
    /// Opens the topic in shared memory.
    fn open_host(bus: &Bus, topic: &str) -> Result<Reader<Self::OnHost>, GpuError>;
    /// Keeps what a sample says.
    fn about(of: &HostSample<Self>) -> Self::About;
    /// Epoch of its writer, tick and number; in one epoch they only rise.
    fn moment(of: Result<&DeviceSample<Self>, &Self::About>) -> (u64, u64, u64);
    /// Number of who wrote it: another one may be another process.
    fn writer(of: &Self::About) -> u128;
    /// Bytes of the payload on the GPU.
    fn n_bytes(of: Result<&DeviceSample<Self>, &Self::About>) -> u64;
    /// What a result that answers it takes over.
    fn answered(of: &Self::About) -> Answered;
}

/// A sample on the GPU.
pub type DeviceSample<K> = <<K as Kind>::OnGpu as SampleKind>::Sample;
/// A sample in shared memory.
pub type HostSample<K> = <<K as Kind>::OnHost as SampleKind>::Sample;

/// Topics of frames.
#[derive(Debug)]
pub struct Frames;

/// What a frame says of itself.
#[derive(Debug)]
pub struct AboutFrame {
    pub header: FrameHeader,
    pub modality: Modality,
    pub topic: String,
    pub taken: MonoTime,
    answered: Answered,
    writer: u128,
}

impl Kind for Frames {
    type OnGpu = schema_bus::GpuFrames;
    type OnHost = schema_bus::Frames;
    type About = AboutFrame;

    fn open_gpu(bus: &Bus, topic: &str, offer: &GpuOffer) -> Result<GpuFrameReader, BusError> {
        bus.gpu_reader(topic, offer)
    }

    fn open_host(bus: &Bus, topic: &str) -> Result<FrameReader, GpuError> {
        Ok(bus.frame_reader(topic)?)
    }

    fn about(of: &Frame) -> AboutFrame {
        AboutFrame {
            header: *of.header(),
            modality: of.modality(),
            topic: of.topic().to_owned(),
            taken: of.taken(),
            answered: of.answered(),
            writer: of.writer(),
        }
    }

    fn moment(of: Result<&GpuFrame, &AboutFrame>) -> (u64, u64, u64) {
        let header = of.map_or_else(|about| &about.header, GpuFrame::header);
        (header.epoch, header.tick, header.seq)
    }

    fn writer(of: &AboutFrame) -> u128 {
        of.writer
    }

    fn n_bytes(of: Result<&GpuFrame, &AboutFrame>) -> u64 {
        of.map_or_else(
            |about| about.header.payload_bytes,
            |it| it.header().payload_bytes,
        )
    }

    fn answered(of: &AboutFrame) -> Answered {
        of.answered
    }
}

/// Topics of results.
#[derive(Debug)]
pub struct Results;

/// What a result says of itself.
#[derive(Debug)]
pub struct AboutResult {
    pub header: ResultHeader,
    pub kind: ResultType,
    pub inputs: Vec<InputRecord>,
    pub topic: String,
    pub taken: MonoTime,
    answered: Answered,
}

impl Kind for Results {
    type OnGpu = schema_bus::GpuResults;
    type OnHost = schema_bus::Results;
    type About = AboutResult;

    fn open_gpu(bus: &Bus, topic: &str, offer: &GpuOffer) -> Result<GpuResultReader, BusError> {
        match bus.result_kind(topic) {
            Some(kind) => bus.gpu_result_reader(topic, kind, offer),
            // The topic's own error says what it is instead.
            None => Err(bus
                .result_reader(topic)
                .err()
                .unwrap_or(BusError::NoSuchTopic {
                    topic: topic.to_owned(),
                    hint: " any more".into(),
                })),
        }
    }

    fn open_host(bus: &Bus, topic: &str) -> Result<ResultReader, GpuError> {
        let reader = bus.result_reader(topic)?;
        if reader.kind().can_stay_on_gpu() {
            return Ok(reader);
        }
        Err(GpuError::Memory {
            topic: topic.to_owned(),
            fault: format!(
                "its results are of type {}, and only tensors and images are arrays for a GPU; leave the device out",
                reader.kind().name()
            ),
        })
    }

    fn about(of: &ResultSample) -> AboutResult {
        AboutResult {
            header: *of.header(),
            kind: of.kind(),
            inputs: of.inputs().to_vec(),
            topic: of.topic().to_owned(),
            taken: of.taken(),
            answered: of.answered(),
        }
    }

    fn moment(of: Result<&GpuResult, &AboutResult>) -> (u64, u64, u64) {
        let header = of.map_or_else(|about| &about.header, GpuResult::header);
        (header.writer_epoch, header.seq, header.seq)
    }

    fn writer(of: &AboutResult) -> u128 {
        u128::from(of.header.writer_epoch)
    }

    fn n_bytes(of: Result<&GpuResult, &AboutResult>) -> u64 {
        of.map_or_else(|about| about.header.body_bytes, |it| it.header().body_bytes)
    }

    fn answered(of: &AboutResult) -> Answered {
        of.answered
    }
}
