//! A topic's samples on a GPU, whichever way they come there.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

use schema_bus::{
    Answerable, Answered, Bus, BusError, GpuFrame, GpuResult, GpuSample as _, Listener,
    ReaderCounts, names,
};
use schema_frames::{FrameHeader, GpuAnswer, InputRecord, Modality, ResultHeader, ResultType};
use schema_types::MonoTime;

use crate::cuda::{Cuda, Imported, Staged};
use crate::device::{Device, Way, find_way};
use crate::error::GpuError;
use crate::kinds::{Frames, Kind, Results, Which};
use crate::mapping::Mapping;
use crate::release::Releases;
use crate::shared::{self, SharedRange};
use crate::upload::Uploads;

/// Memories of the writer that stay imported: the one in use, and that of the writer before it,
/// whose samples may still be held.
const MAX_KEPT: usize = 2;

/// The reading end of a topic on a GPU.
#[derive(Debug)]
pub struct Topic<K: Kind> {
    port: Port<K>,
    device: Option<Arc<Cuda>>,
    fallback: Option<String>,
    listener: Listener,
    event: String,
}

/// The reading end of a topic of frames on a GPU.
pub type GpuTopic = Topic<Frames>;
/// The reading end of a topic of results on a GPU.
pub type GpuResults = Topic<Results>;

#[derive(Debug)]
enum Port<K: Kind> {
    OnGpu {
        reader: K::GpuReader,
        memories: Vec<(u64, Arc<Memory>)>,
        releases: Arc<Releases<Slot<K>>>,
    },
    Uploaded {
        reader: K::HostReader,
        uploads: Arc<Uploads>,
        releases: Arc<Releases<GivesBack>>,
    },
}

/// A port, the event that announces its samples, and the device that they are on.
type Opened<K> = (Port<K>, String, Option<Arc<Cuda>>);

/// A sample, and the memory that it is in.
#[derive(Debug)]
struct Slot<K: Kind> {
    sample: K::OnGpu,
    _memory: Arc<Memory>,
}

/// Memory of the writer as this process has it.
#[derive(Debug)]
enum Memory {
    Imported(Imported),
    Shared(SharedRange),
    Mapped(Mapping),
}

impl Memory {
    fn address(&self) -> u64 {
        match self {
            Memory::Imported(imported) => imported.address,
            Memory::Shared(range) => range.address,
            Memory::Mapped(mapping) => mapping.address(),
        }
    }
}

/// Memory of an upload, which goes back when this is dropped.
#[derive(Debug)]
struct GivesBack {
    staged: Option<Staged>,
    uploads: Arc<Uploads>,
}

impl Drop for GivesBack {
    fn drop(&mut self) {
        if let Some(staged) = self.staged.take() {
            self.uploads.give_back(staged);
        }
    }
}

impl<K: Kind> Topic<K> {
    /// Opens `topic` (`ego/front/rgb`) on a device. Where its samples are not made on that device,
    /// they are uploaded to it, and [`Topic::fallback`] says why.
    ///
    /// # Errors
    /// [`GpuError::NoCuda`], [`GpuError::Memory`] if the device cannot be used, those of
    /// [`Bus::frame_reader`] or [`Bus::result_reader`].
    pub fn open(bus: &Bus, topic: &str, device: Device) -> Result<Topic<K>, GpuError> {
        let topic = names::host_topic(topic);
        // Without the topic there is nothing to fall back to.
        if !bus.exists(topic) {
            K::open_host(bus, topic)?;
        }
        let offered = bus.gpu_offer(topic);
        let offer = offered.as_ref().map_err(ToString::to_string);
        let way = find_way(topic, device, offer)?;
        let on_gpu = |device| -> Result<Opened<K>, GpuError> {
            let offer = offered.as_ref().map_err(|error| GpuError::Memory {
                topic: topic.into(),
                fault: error.to_string(),
            })?;
            let port = Port::OnGpu {
                reader: K::open_gpu(bus, topic, offer)?,
                memories: Vec::new(),
                releases: Releases::new(),
            };
            Ok((port, names::gpu_topic(topic), device))
        };
        let mut fallback = None;
        let (port, event, device) = match way {
            Way::Imported(cuda) => on_gpu(Some(cuda))?,
            Way::Mapped => on_gpu(None)?,
            Way::Uploaded(cuda, why) => {
                fallback = Some(why);
                let port = Port::Uploaded {
                    reader: K::open_host(bus, topic)?,
                    uploads: Uploads::new(cuda.clone()),
                    releases: Releases::new(),
                };
                (port, topic.to_owned(), Some(cuda))
            }
        };
        Ok(Topic {
            port,
            device,
            fallback,
            listener: bus.listener(&event)?,
            event,
        })
    }

    /// Why samples are uploaded instead of staying on the GPU; `None` if they stay.
    pub fn fallback(&self) -> Option<&str> {
        self.fallback.as_deref()
    }

    /// Number of CUDA's device; `None` if samples are mapped.
    pub fn device(&self) -> Option<i32> {
        self.device.as_ref().map(|device| device.ordinal)
    }

    /// Name of the event that announces its samples.
    pub fn event(&self) -> &str {
        &self.event
    }

    /// Takes the oldest sample that waits, if any.
    ///
    /// # Errors
    /// As [`schema_bus::FrameReader::next`], [`GpuError::Cuda`].
    pub fn next(&mut self, bus: &Bus) -> Result<Option<OnGpu<K>>, GpuError> {
        self.take(bus, Which::Oldest)
    }

    /// Takes the newest sample that waits, if any.
    ///
    /// # Errors
    /// As [`Topic::next`].
    pub fn latest(&mut self, bus: &Bus) -> Result<Option<OnGpu<K>>, GpuError> {
        self.take(bus, Which::Newest)
    }

    /// Waits for the newest sample, at most `timeout`.
    ///
    /// # Errors
    /// As [`Topic::next`].
    pub fn wait(&mut self, bus: &Bus, timeout: Duration) -> Result<Option<OnGpu<K>>, GpuError> {
        let deadline = Instant::now() + timeout;
        loop {
            self.listener.drain()?;
            if let Some(sample) = self.latest(bus)? {
                return Ok(Some(sample));
            }
            let rest = deadline.saturating_duration_since(Instant::now());
            if rest.is_zero() {
                return Ok(None);
            }
            self.listener.wait_pending(rest);
        }
    }

    /// Counters since it was opened.
    pub fn counts(&self) -> ReaderCounts {
        self.state().0
    }

    /// Whether a process writes it now.
    pub fn has_writer(&self) -> bool {
        self.state().1
    }

    fn state(&self) -> (ReaderCounts, bool) {
        match &self.port {
            Port::OnGpu { reader, .. } => K::state_gpu(reader),
            Port::Uploaded { reader, .. } => K::state_host(reader),
        }
    }

    fn take(&mut self, bus: &Bus, which: Which) -> Result<Option<OnGpu<K>>, GpuError> {
        match &mut self.port {
            Port::OnGpu {
                reader,
                memories,
                releases,
            } => loop {
                let sample = match K::take_gpu(reader, which) {
                    // Samples that only wait for the GPU make room.
                    Err(BusError::BorrowLimit { .. }) if releases.make_room() => continue,
                    taken => taken?,
                };
                let Some(sample) = sample else {
                    // Between two samples, where nobody waits for it.
                    releases.sweep();
                    return Ok(None);
                };
                let Some(memory) = memory_of::<K>(bus, &sample, memories, self.device.as_ref())?
                else {
                    continue;
                };
                return Ok(Some(OnGpu {
                    address: memory.address() + sample.place().offset_bytes,
                    device: self.device.clone(),
                    stream: AtomicU64::new(0),
                    held: Held::Slot {
                        slot: Some(Slot {
                            sample,
                            _memory: memory,
                        }),
                        releases: releases.clone(),
                    },
                }));
            },
            Port::Uploaded {
                reader,
                uploads,
                releases,
            } => {
                let Some(sample) = K::take_host(reader, which)? else {
                    releases.sweep();
                    return Ok(None);
                };
                releases.sweep();
                let staged = uploads.upload(&sample)?;
                Ok(Some(OnGpu {
                    address: staged.address,
                    device: self.device.clone(),
                    stream: AtomicU64::new(0),
                    held: Held::Upload {
                        about: Box::new(K::about(&sample)),
                        staged: Some(GivesBack {
                            staged: Some(staged),
                            uploads: uploads.clone(),
                        }),
                        releases: releases.clone(),
                    },
                }))
            }
        }
    }
}

impl Topic<Results> {
    /// Type of its results; `None` if they are on the GPU and the topic is gone.
    pub fn kind(&self) -> ResultType {
        match &self.port {
            Port::OnGpu { reader, .. } => reader.kind(),
            Port::Uploaded { reader, .. } => reader.kind(),
        }
    }
}

/// The memory that a sample is in, which is asked for when it is first met; `None` if its writer has
/// ended, so that the sample cannot be reached any more.
fn memory_of<K: Kind>(
    bus: &Bus,
    sample: &K::OnGpu,
    memories: &mut Vec<(u64, Arc<Memory>)>,
    device: Option<&Arc<Cuda>>,
) -> Result<Option<Arc<Memory>>, GpuError> {
    let generation = sample.place().generation;
    if let Some((_, memory)) = memories.iter().find(|(known, _)| *known == generation) {
        return Ok(Some(memory.clone()));
    }
    let fault = |fault: String| GpuError::Memory {
        topic: sample.topic().into(),
        fault,
    };
    let memory = match bus.gpu_memory(sample) {
        Ok(memory) => memory,
        Err(BusError::GpuMemory { topic, fault }) => {
            return Err(GpuError::Memory { topic, fault });
        }
        Err(error) => {
            tracing::debug!(topic = sample.topic(), %error, "a sample's memory is gone");
            return Ok(None);
        }
    };
    let n_bytes = memory.n_bytes;
    let memory = match (device, memory.handle_kind) {
        (Some(cuda), GpuAnswer::VULKAN) => Memory::Imported(cuda.import(memory)?),
        (Some(cuda), GpuAnswer::CUDA) => Memory::Shared(shared::import(
            cuda,
            &memory.descriptor,
            usize::try_from(n_bytes).map_err(|_| fault("it is too long".into()))?,
        )?),
        (Some(_), other) => {
            return Err(fault(format!(
                "its descriptor is of kind {other}, and this program imports kinds {} (Vulkan's) and {} (CUDA's)",
                GpuAnswer::VULKAN,
                GpuAnswer::CUDA
            )));
        }
        (None, _) => Memory::Mapped(Mapping::new(&memory.descriptor, n_bytes).map_err(fault)?),
    };
    let memory = Arc::new(memory);
    if memories.len() >= MAX_KEPT {
        memories.remove(0);
    }
    memories.push((generation, memory.clone()));
    Ok(Some(memory))
}

/// A sample on a GPU. Its memory stays as it is until this is dropped and the GPU has done what it
/// was given until then.
#[derive(Debug)]
pub struct OnGpu<K: Kind> {
    address: u64,
    device: Option<Arc<Cuda>>,
    /// A stream that reads it, for drivers that cannot wait for all.
    stream: AtomicU64,
    held: Held<K>,
}

/// A frame on a GPU.
pub type FrameOnGpu = OnGpu<Frames>;
/// A result on a GPU.
pub type ResultOnGpu = OnGpu<Results>;

#[derive(Debug)]
enum Held<K: Kind> {
    Slot {
        slot: Option<Slot<K>>,
        releases: Arc<Releases<Slot<K>>>,
    },
    Upload {
        about: Box<K::About>,
        staged: Option<GivesBack>,
        releases: Arc<Releases<GivesBack>>,
    },
}

impl<K: Kind> OnGpu<K> {
    fn sample(&self) -> Result<&K::OnGpu, &K::About> {
        match &self.held {
            Held::Slot { slot, .. } => Ok(&slot.as_ref().expect("taken out by drop only").sample),
            Held::Upload { about, .. } => Err(about),
        }
    }

    /// Address of its first byte: on the device, or, if it is mapped, in this process.
    pub fn address(&self) -> u64 {
        self.address
    }

    /// Bytes of its payload.
    pub fn n_bytes(&self) -> usize {
        K::n_bytes(self.sample()) as usize
    }

    /// Number of CUDA's device; `None` if it is mapped.
    pub fn device(&self) -> Option<i32> {
        self.device.as_ref().map(|device| device.ordinal)
    }

    /// Says that a stream of CUDA, by its address, reads it. Needed for drivers before 12.5 only:
    /// later ones wait for all streams.
    pub fn is_read_by(&self, stream: u64) {
        self.stream.store(stream, Relaxed);
    }

    /// Whether giving it back waits for the work of all streams, so that nobody has to name his.
    pub fn waits_for_all_streams(&self) -> bool {
        self.device.as_ref().is_none_or(|it| it.sees_all_streams())
    }

    /// A copy of its bytes.
    ///
    /// # Errors
    /// [`GpuError::Cuda`].
    pub fn to_bytes(&self) -> Result<Vec<u8>, GpuError> {
        let mut bytes = vec![0; self.n_bytes()];
        match &self.device {
            // SAFETY: the payload, as long as the header says; this value keeps its memory.
            Some(cuda) => unsafe { cuda.read(self.address, &mut bytes)? },
            // SAFETY: mapped for reading, and kept by this value; the header was checked, and its
            // writer does not write to a slot that a reader holds.
            None => unsafe {
                std::ptr::copy_nonoverlapping(
                    self.address as *const u8,
                    bytes.as_mut_ptr(),
                    bytes.len(),
                );
            },
        }
        Ok(bytes)
    }
}

impl OnGpu<Frames> {
    /// The header, checked.
    pub fn header(&self) -> &FrameHeader {
        self.sample()
            .map_or_else(|about| &about.header, GpuFrame::header)
    }

    /// The modality of the payload.
    pub fn modality(&self) -> Modality {
        self.sample()
            .map_or_else(|about| about.modality, GpuFrame::modality)
    }

    /// Its topic without the domain.
    pub fn topic(&self) -> &str {
        self.sample()
            .map_or_else(|about| about.topic.as_str(), GpuFrame::topic)
    }

    /// When this reader took it.
    pub fn taken(&self) -> MonoTime {
        self.sample()
            .map_or_else(|about| about.taken, GpuFrame::taken)
    }
}

impl OnGpu<Results> {
    /// The header, checked.
    pub fn header(&self) -> &ResultHeader {
        self.sample()
            .map_or_else(|about| &about.header, GpuResult::header)
    }

    /// Type of the result.
    pub fn kind(&self) -> ResultType {
        self.sample()
            .map_or_else(|about| about.kind, GpuResult::kind)
    }

    /// The frames and results that it answers.
    pub fn inputs(&self) -> &[InputRecord] {
        self.sample()
            .map_or_else(|about| &about.inputs, GpuResult::inputs)
    }

    /// Its topic without the domain.
    pub fn topic(&self) -> &str {
        self.sample()
            .map_or_else(|about| about.topic.as_str(), |sample| sample.topic())
    }

    /// When this reader took it.
    pub fn taken(&self) -> MonoTime {
        self.sample()
            .map_or_else(|about| about.taken, GpuResult::taken)
    }
}

impl<K: Kind> Answerable for OnGpu<K> {
    fn answered(&self) -> Answered {
        self.sample().map_or_else(K::answered, Answerable::answered)
    }
}

impl<K: Kind> Drop for OnGpu<K> {
    fn drop(&mut self) {
        let Some(cuda) = &self.device else {
            return;
        };
        let stream = *self.stream.get_mut();
        let event = cuda.now(stream);
        match &mut self.held {
            Held::Slot { slot, releases } => {
                if let (Ok(event), Some(slot)) = (event, slot.take()) {
                    releases.push(event, slot);
                }
            }
            Held::Upload {
                staged, releases, ..
            } => {
                if let (Ok(event), Some(staged)) = (event, staged.take()) {
                    releases.push(event, staged);
                }
            }
        }
    }
}
