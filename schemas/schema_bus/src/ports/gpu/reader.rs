//! The reading end: frames that say where on a GPU their payloads are, and the memory they are in.

use std::os::fd::{AsFd as _, OwnedFd};
use std::sync::Arc;

use nix::errno::Errno;
use parking_lot::Mutex;
use schema_frames::{
    FrameError, FrameHeader, GPU_MAGIC, GPU_PLACE_BYTES, GpuAnswer, GpuAsk, GpuPlace, Modality,
    SCHEMA_VERSION,
};
use schema_types::MonoTime;

use super::message::{receive, send};
use crate::contract::error::BusError;
use crate::contract::names;
use crate::contract::origin::Origin;
use crate::contract::qos::Qos;
use crate::place::gpu_socket::{connect_to, name_of, producers};
use crate::place::node::BusNode;
use crate::place::service::make;
use crate::ports::frames::pages::reserve_as_reader;
use crate::ports::frames::reader::{bad_frame, moment_of};
use crate::ports::reader::{Moment, Reader, Received, SampleKind};
use crate::ports::results::draft::{Answerable, Answered};
use crate::time::clock::mono_now;

/// A process that keeps a topic on a GPU, and on which one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuOffer {
    /// Number of the process.
    pub producer: u64,
    /// UUID of its GPU.
    pub device_uuid: [u8; 16],
    /// UUID of that GPU's driver.
    pub driver_uuid: [u8; 16],
    /// Whether the memory is a software adapter's, which can be mapped.
    pub is_mappable: bool,
    /// Readers, waiting and held samples of the topic's service.
    pub(super) capacity: [usize; 3],
}

impl GpuOffer {
    /// The capacity of the topic's service on the GPU; `usual` is that of the topic itself.
    pub(super) fn qos(&self, usual: Qos) -> Qos {
        let [readers, buffer, borrowed] = self.capacity.map(|n| n.clamp(1, 64));
        Qos {
            readers,
            buffer,
            borrowed,
            ..usual
        }
    }
}

/// GPU memory of another process.
#[derive(Debug)]
pub struct GpuMemory {
    /// Its descriptor, to be imported into a GPU's driver.
    pub descriptor: OwnedFd,
    /// What the descriptor is: [`GpuAnswer::VULKAN`] or [`GpuAnswer::CUDA`].
    pub handle_kind: u32,
    /// Its length, bytes.
    pub n_bytes: u64,
    /// Its number.
    pub generation: u64,
    /// UUID of the GPU that it is on.
    pub device_uuid: [u8; 16],
    /// Whether it is a software adapter's, which can be mapped.
    pub is_mappable: bool,
}

pub(super) fn failed(topic: &str, fault: impl Into<String>) -> BusError {
    BusError::Gpu {
        topic: topic.into(),
        fault: fault.into(),
    }
}

/// Why a process gives no answer, as a clause.
#[derive(Debug, thiserror::Error)]
enum NoAnswer {
    #[error("the process that writes them does not answer ({0})")]
    Silent(#[from] Errno),
    #[error("their writer speaks schema {0}, this program {SCHEMA_VERSION}; rebuild one of them")]
    OtherSchema(u16),
    #[error("their writer does not understand schema {SCHEMA_VERSION}; rebuild one of the two")]
    NotUnderstood,
}

/// Asks one process.
fn ask(
    node: &BusNode,
    producer: u64,
    question: &GpuAsk,
) -> Result<(GpuAnswer, Option<OwnedFd>), NoAnswer> {
    answer_on(&put(node, producer, question)?)
}

/// Puts a question to one process; the answer comes on the connection.
fn put(node: &BusNode, producer: u64, question: &GpuAsk) -> Result<OwnedFd, NoAnswer> {
    let name = name_of(node.domain(), producer);
    let connection = connect_to(&node.root(), &name)?;
    send(connection.as_fd(), question, None)?;
    Ok(connection)
}

fn answer_on(connection: &OwnedFd) -> Result<(GpuAnswer, Option<OwnedFd>), NoAnswer> {
    let (answer, descriptor) = receive::<GpuAnswer>(connection.as_fd())?;
    if answer.magic != GPU_MAGIC || answer.schema_version != SCHEMA_VERSION {
        return Err(NoAnswer::OtherSchema(answer.schema_version));
    }
    if answer.status == GpuAnswer::OTHER_SCHEMA {
        return Err(NoAnswer::NotUnderstood);
    }
    Ok((answer, descriptor))
}

/// Looks for the process that keeps `topic` on a GPU. From then on it has the topic's GPU service.
pub(crate) fn offer(node: &BusNode, topic: &str) -> Result<GpuOffer, BusError> {
    let topic = names::host_topic(topic);
    let question = GpuAsk::topic(topic).ok_or_else(|| BusError::Name {
        topic: topic.into(),
    })?;
    let (mut why, mut found) = (None, None);
    // All of them are asked, because who decides which frames are made need not write them.
    let asked: Vec<_> = producers(&node.root(), node.domain())
        .into_iter()
        .map(|producer| (producer, put(node, producer, &question)))
        .collect();
    for (producer, connection) in asked {
        match connection.and_then(|connection| answer_on(&connection)) {
            Ok((answer, _)) if answer.status == GpuAnswer::OK => {
                let capacity = [answer.max_readers, answer.buffer, answer.borrowed];
                found.get_or_insert(GpuOffer {
                    producer,
                    device_uuid: answer.device_uuid,
                    driver_uuid: answer.driver_uuid,
                    is_mappable: answer.flags & GpuAnswer::MAPPABLE != 0,
                    capacity: capacity.map(|n| n as usize),
                });
            }
            Ok(_) => {}
            Err(fault) => why = Some(fault.to_string()),
        }
    }
    if let Some(found) = found {
        return Ok(found);
    }
    let fault = why.unwrap_or_else(|| {
        "no process of this domain keeps it on a GPU; cameras and lidars of a simulator can be kept there if its driver exports memory, results of a program that publishes them with a device".into()
    });
    Err(failed(topic, fault))
}

/// Asks a process for the descriptor of a memory.
pub(crate) fn fetch(
    node: &BusNode,
    topic: &str,
    producer: u64,
    generation: u64,
) -> Result<GpuMemory, BusError> {
    let (answer, descriptor) = ask(node, producer, &GpuAsk::memory(generation))
        .map_err(|fault| failed(topic, fault.to_string()))?;
    let descriptor = match (answer.status, descriptor) {
        (GpuAnswer::OK, Some(descriptor)) if answer.generation == generation => descriptor,
        (GpuAnswer::OK, _) => return Err(failed(topic, "their writer's answer has no descriptor")),
        _ => return Err(failed(topic, "their writer has given the memory back")),
    };
    Ok(GpuMemory {
        descriptor,
        handle_kind: answer.handle_kind,
        n_bytes: answer.memory_bytes,
        generation,
        device_uuid: answer.device_uuid,
        is_mappable: answer.flags & GpuAnswer::MAPPABLE != 0,
    })
}

/// Frames on a GPU.
#[derive(Debug)]
pub struct GpuFrames;

/// The reading end of a topic's frames on a GPU.
pub type GpuFrameReader = Reader<GpuFrames>;

/// The bytes of a sample on a GPU, copied before they are checked, because another process could
/// change them in between; `n_bytes` of them are the sample's.
pub(super) struct SampleCopy<const N: usize> {
    bytes: [u8; N],
    n_bytes: usize,
}

impl<const N: usize> SampleCopy<N> {
    pub fn new(payload: &[u8]) -> SampleCopy<N> {
        let n_bytes = payload.len().min(N);
        let mut bytes = [0; N];
        bytes[..n_bytes].copy_from_slice(&payload[..n_bytes]);
        SampleCopy { bytes, n_bytes }
    }

    pub fn get(&self) -> &[u8] {
        &self.bytes[..self.n_bytes]
    }
}

impl SampleKind for GpuFrames {
    type Header = FrameHeader;
    type Sample = GpuFrame;
    type Fault = FrameError;

    const COMES_TWICE: bool = true;

    fn admit(
        &self,
        sample: Received<FrameHeader>,
        topic: &Arc<str>,
    ) -> Result<GpuFrame, FrameError> {
        let header = sample.user_header().0;
        let place = GpuPlace::read(
            &header,
            SampleCopy::<GPU_PLACE_BYTES>::new(sample.payload()).get(),
        )?;
        let modality = header.modality().ok_or(FrameError::Encoding {
            found: header.encoding,
        })?;
        Ok(GpuFrame {
            modality,
            place,
            topic: topic.clone(),
            taken: mono_now(),
            header,
            _sample: Mutex::new(sample),
        })
    }

    fn moment(frame: &GpuFrame) -> Moment {
        moment_of(&frame.header)
    }

    fn refuse(service: String, writer: Option<Arc<Origin>>, source: FrameError) -> BusError {
        bad_frame(service, writer, source)
    }
}

impl Reader<GpuFrames> {
    pub(crate) fn open(
        node: &BusNode,
        topic: &str,
        offer: &GpuOffer,
    ) -> Result<GpuFrameReader, BusError> {
        let topic = names::host_topic(topic);
        let modality = names::modality_of(topic).ok_or_else(|| BusError::Name {
            topic: topic.into(),
        })?;
        let qos = offer.qos(Qos::of(modality));
        let service = || make::<FrameHeader>(node, &names::gpu_topic(topic), &qos);
        let reader = Reader::of_few(node, service, topic, || GpuFrames)?;
        reserve_as_reader(node, reader.service())?;
        Ok(reader)
    }
}

/// A frame on a GPU. While it lives, its slot there is not written to again: whoever has given the
/// GPU work that reads it drops it after that work is done.
#[derive(Debug)]
pub struct GpuFrame {
    /// Kept: it is what protects the slot. Nobody locks it; threads may share the frame so.
    _sample: Mutex<Received<FrameHeader>>,
    header: FrameHeader,
    place: GpuPlace,
    topic: Arc<str>,
    taken: MonoTime,
    modality: Modality,
}

impl GpuFrame {
    /// The header, checked.
    pub fn header(&self) -> &FrameHeader {
        &self.header
    }

    /// Where the payload is, checked but for the length of the memory: see
    /// [`GpuSample::check_memory`].
    pub fn place(&self) -> &GpuPlace {
        &self.place
    }

    /// Its topic without the domain and without "/gpu".
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// When this reader took it.
    pub fn taken(&self) -> MonoTime {
        self.taken
    }

    /// The modality of the payload.
    pub fn modality(&self) -> Modality {
        self.modality
    }
}

/// A sample whose payload is on a GPU.
pub trait GpuSample {
    /// Its topic without the domain and without "/gpu".
    fn topic(&self) -> &str;

    /// Where the payload is, checked but for the length of the memory.
    fn place(&self) -> &GpuPlace;

    /// Whether it is in this memory: a memory of another length would be imported without an error,
    /// and read beyond its end.
    ///
    /// # Errors
    /// [`BusError::Gpu`] for another memory, [`BusError::GpuMemory`] for another length.
    fn check_memory(&self, memory: &GpuMemory) -> Result<(), BusError> {
        let place = self.place();
        if place.generation != memory.generation {
            return Err(failed(self.topic(), "the sample is in another memory"));
        }
        if place.memory_bytes != memory.n_bytes {
            return Err(BusError::GpuMemory {
                topic: self.topic().to_string(),
                fault: format!(
                    "the sample says that its memory has {} bytes, and its writer {}; the writer is broken",
                    place.memory_bytes, memory.n_bytes
                ),
            });
        }
        Ok(())
    }
}

impl GpuSample for GpuFrame {
    fn topic(&self) -> &str {
        &self.topic
    }

    fn place(&self) -> &GpuPlace {
        &self.place
    }
}

impl Answerable for GpuFrame {
    fn answered(&self) -> Answered {
        Answered::by_frame(&self.header, &self.topic, self.taken)
    }
}
