//! The reading end: frames that say where on a GPU their payloads are, and the memory they are in.

use std::os::fd::{AsFd as _, OwnedFd};
use std::sync::{Arc, Mutex};

use nix::errno::Errno;
use schema_frames::{
    FrameError, FrameHeader, GPU_MAGIC, GPU_PLACE_BYTES, GpuAnswer, GpuAsk, GpuPlace, Modality,
    SCHEMA_VERSION,
};
use schema_types::MonoTime;

use super::message::{receive, send};
use crate::clock::mono_now;
use crate::error::BusError;
use crate::gpu_socket::{connect_to, name_of, producers};
use crate::intake::{Admission, Intake, ReaderCounts, Received};
use crate::memory::FrameTopic;
use crate::names;
use crate::node::BusNode;
use crate::origin::Origin;
use crate::reader::Repeats;
use crate::reserve::reserve_as_reader;
use crate::result_draft::{Answerable, Answered};
use crate::service::make;

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

/// Asks one process.
fn ask(
    node: &BusNode,
    producer: u64,
    question: &GpuAsk,
) -> Result<(GpuAnswer, Option<OwnedFd>), String> {
    answer_on(&put(node, producer, question)?)
}

fn gone(error: Errno) -> String {
    format!("the process that writes them does not answer ({error})")
}

/// Puts a question to one process; the answer comes on the connection.
fn put(node: &BusNode, producer: u64, question: &GpuAsk) -> Result<OwnedFd, String> {
    let name = name_of(node.domain(), producer);
    let connection = connect_to(&node.root(), &name).map_err(gone)?;
    send(connection.as_fd(), question, None).map_err(gone)?;
    Ok(connection)
}

fn answer_on(connection: &OwnedFd) -> Result<(GpuAnswer, Option<OwnedFd>), String> {
    let (answer, descriptor) = receive::<GpuAnswer>(connection.as_fd()).map_err(gone)?;
    if answer.magic != GPU_MAGIC || answer.schema_version != SCHEMA_VERSION {
        return Err(format!(
            "their writer speaks schema {}, this program {SCHEMA_VERSION}; rebuild one of them",
            answer.schema_version
        ));
    }
    if answer.status == GpuAnswer::OTHER_SCHEMA {
        return Err(format!(
            "their writer does not understand schema {SCHEMA_VERSION}; rebuild one of the two"
        ));
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
            Err(fault) => why = Some(fault),
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
    let (answer, descriptor) =
        ask(node, producer, &GpuAsk::memory(generation)).map_err(|fault| failed(topic, fault))?;
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

/// The reading end of a topic's frames on a GPU.
#[derive(Debug)]
pub struct GpuFrameReader {
    intake: Intake<Frames>,
    repeats: Repeats,
}

/// How frames are checked.
#[derive(Debug)]
struct Frames {
    topic: Arc<str>,
}

impl Admission for Frames {
    type Header = FrameHeader;
    type Item = GpuFrame;
    type Fault = FrameError;

    fn admit(&self, sample: Received<FrameHeader>) -> Result<(GpuFrame, u64, u64), FrameError> {
        // Copied before they are checked, because another process could change them in between.
        let header = sample.user_header().0;
        let payload = sample.payload();
        let mut bytes = [0; GPU_PLACE_BYTES];
        let n_bytes = payload.len().min(GPU_PLACE_BYTES);
        bytes[..n_bytes].copy_from_slice(&payload[..n_bytes]);
        let place = GpuPlace::read(&header, &bytes[..n_bytes])?;
        let modality = header.modality().ok_or(FrameError::Encoding {
            found: header.encoding,
        })?;
        let frame = GpuFrame {
            modality,
            place,
            topic: self.topic.clone(),
            taken: mono_now(),
            header,
            _sample: Mutex::new(sample),
        };
        Ok((frame, header.epoch, header.seq))
    }

    fn refuse(service: String, writer: Option<Arc<Origin>>, source: FrameError) -> BusError {
        BusError::BadFrame {
            service,
            writer,
            source,
        }
    }
}

impl GpuFrameReader {
    pub(crate) fn open(
        node: &BusNode,
        topic: &str,
        offer: &GpuOffer,
    ) -> Result<GpuFrameReader, BusError> {
        let topic = names::host_topic(topic);
        let modality = names::modality_of(topic).ok_or_else(|| BusError::Name {
            topic: topic.into(),
        })?;
        let [max_readers, buffer, borrowed] = offer.capacity;
        let spec = FrameTopic {
            max_readers: max_readers.clamp(1, 64),
            buffer: buffer.clamp(1, 64),
            borrowed: borrowed.clamp(1, 64),
            ..FrameTopic::on_gpu(1)
        };
        let service = make::<FrameHeader>(node, &names::gpu_topic(topic), &spec.qos(modality))?;
        let frames = Frames {
            topic: topic.into(),
        };
        let intake = match Intake::open(service, frames) {
            // Killed readers keep their places until somebody removes them, and there are few.
            Err(BusError::TooManyReaders { .. }) => {
                node.clean_dead_nodes();
                let frames = Frames {
                    topic: topic.into(),
                };
                let service =
                    make::<FrameHeader>(node, &names::gpu_topic(topic), &spec.qos(modality))?;
                Intake::open(service, frames)?
            }
            opened => opened?,
        };
        reserve_as_reader(node, intake.service())?;
        Ok(GpuFrameReader {
            intake,
            repeats: Repeats::default(),
        })
    }

    /// Name without the domain and without "/gpu".
    pub fn topic(&self) -> &str {
        &self.intake.admission.topic
    }

    /// Takes the oldest frame that waits, if any.
    ///
    /// # Errors
    /// As [`crate::FrameReader::next`].
    #[expect(
        clippy::should_implement_trait,
        reason = "an iterator would end at the first gap; this is polled"
    )]
    pub fn next(&mut self) -> Result<Option<GpuFrame>, BusError> {
        while let Some(frame) = self.intake.next()? {
            if !self.repeats.note(&frame.header) {
                return Ok(Some(frame));
            }
        }
        Ok(None)
    }

    /// Takes the newest frame that waits, if any; older ones are dropped and counted as skipped.
    ///
    /// # Errors
    /// As [`crate::FrameReader::next`].
    pub fn latest(&mut self) -> Result<Option<GpuFrame>, BusError> {
        let newest = self.intake.latest()?;
        Ok(newest.filter(|frame| !self.repeats.note(&frame.header)))
    }

    /// The last frame could not be reached: if it comes again, from another process, it is taken.
    pub fn forget_last(&mut self) {
        self.repeats.forget_last();
    }

    /// Counters since this reader was opened.
    pub fn counts(&self) -> ReaderCounts {
        self.repeats.left_out_of(self.intake.counts())
    }

    /// Whether a writer has memory for the topic.
    pub fn has_writer(&self) -> bool {
        self.intake.has_writer()
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
