//! A topic's frames on a GPU, whichever way they come there.

use std::sync::Arc;
use std::time::{Duration, Instant};

use schema_bus::{
    Answerable, Answered, Bus, BusError, Frame, FrameReader, GpuFrame, GpuFrameReader, Listener,
    ReaderCounts, names,
};
use schema_frames::{FrameHeader, Modality};

use crate::cuda::{Cuda, Imported, Staged};
use crate::device::{Device, Way, find_way};
use crate::error::GpuError;
use crate::mapping::Mapping;
use crate::release::Releases;
use crate::upload::Uploads;

/// Memories of the writer that stay imported: the one in use, and that of the writer before it,
/// whose frames may still be held.
const MAX_KEPT: usize = 2;

/// The reading end of a topic on a GPU.
#[derive(Debug)]
pub struct GpuTopic {
    port: Port,
    device: Option<Arc<Cuda>>,
    fallback: Option<String>,
    listener: Listener,
    event: String,
}

#[derive(Debug)]
enum Port {
    OnGpu {
        reader: GpuFrameReader,
        memories: Vec<(u64, Arc<Memory>)>,
        releases: Arc<Releases<GpuFrame>>,
    },
    Uploaded {
        reader: FrameReader,
        uploads: Arc<Uploads>,
        releases: Arc<Releases<GivesBack>>,
    },
}

/// Memory of the writer as this process has it.
#[derive(Debug)]
enum Memory {
    Imported(Imported),
    Mapped(Mapping),
}

impl Memory {
    fn address(&self) -> u64 {
        match self {
            Memory::Imported(imported) => imported.address,
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

impl GpuTopic {
    /// Opens `topic` (`ego/front/rgb`) on a device. Where its frames are not made on that device,
    /// they are uploaded to it, and [`GpuTopic::fallback`] says why.
    ///
    /// # Errors
    /// [`GpuError::NoCuda`], [`GpuError::Memory`] if the device cannot be used, those of
    /// [`Bus::frame_reader`].
    pub fn open(bus: &Bus, topic: &str, device: Device) -> Result<GpuTopic, GpuError> {
        let topic = names::host_topic(topic);
        let offered = bus.gpu_offer(topic);
        // Without the topic there is nothing to fall back to.
        if offered.is_err() && !bus.exists(topic) {
            bus.frame_reader(topic)?;
        }
        let offer = offered.as_ref().map_err(ToString::to_string);
        let way = find_way(topic, device, offer)?;
        let on_gpu = |device| -> Result<(Port, String, Option<Arc<Cuda>>), GpuError> {
            let offer = offered.as_ref().map_err(|error| GpuError::Memory {
                topic: topic.into(),
                fault: error.to_string(),
            })?;
            let port = Port::OnGpu {
                reader: bus.gpu_reader(topic, offer)?,
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
                    reader: bus.frame_reader(topic)?,
                    uploads: Uploads::new(cuda.clone()),
                    releases: Releases::new(),
                };
                (port, topic.to_owned(), Some(cuda))
            }
        };
        Ok(GpuTopic {
            port,
            device,
            fallback,
            listener: bus.listener(&event)?,
            event,
        })
    }

    /// Why frames are uploaded instead of staying on the GPU; `None` if they stay.
    pub fn fallback(&self) -> Option<&str> {
        self.fallback.as_deref()
    }

    /// Number of CUDA's device; `None` if frames are mapped.
    pub fn device(&self) -> Option<i32> {
        self.device.as_ref().map(|device| device.ordinal)
    }

    /// Name of the event that announces its frames.
    pub fn event(&self) -> &str {
        &self.event
    }

    /// Takes the oldest frame that waits, if any.
    ///
    /// # Errors
    /// As [`FrameReader::next`], [`GpuError::Cuda`].
    pub fn next(&mut self, bus: &Bus) -> Result<Option<FrameOnGpu>, GpuError> {
        self.take(bus, false)
    }

    /// Takes the newest frame that waits, if any.
    ///
    /// # Errors
    /// As [`GpuTopic::next`].
    pub fn latest(&mut self, bus: &Bus) -> Result<Option<FrameOnGpu>, GpuError> {
        self.take(bus, true)
    }

    /// Waits for the newest frame, at most `timeout`.
    ///
    /// # Errors
    /// As [`GpuTopic::next`].
    pub fn wait(&mut self, bus: &Bus, timeout: Duration) -> Result<Option<FrameOnGpu>, GpuError> {
        let deadline = Instant::now() + timeout;
        loop {
            self.listener.drain()?;
            if let Some(frame) = self.latest(bus)? {
                return Ok(Some(frame));
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
        match &self.port {
            Port::OnGpu { reader, .. } => reader.counts(),
            Port::Uploaded { reader, .. } => reader.counts(),
        }
    }

    /// Whether a process writes it now.
    pub fn has_writer(&self) -> bool {
        match &self.port {
            Port::OnGpu { reader, .. } => reader.has_writer(),
            Port::Uploaded { reader, .. } => reader.has_writer(),
        }
    }

    fn take(&mut self, bus: &Bus, newest: bool) -> Result<Option<FrameOnGpu>, GpuError> {
        match &mut self.port {
            Port::OnGpu {
                reader,
                memories,
                releases,
            } => {
                releases.sweep();
                loop {
                    let taken = if newest {
                        reader.latest()
                    } else {
                        reader.next()
                    };
                    let frame = match taken {
                        // Frames that only wait for the GPU make room.
                        Err(BusError::BorrowLimit { .. }) if releases.wait_for_one() => continue,
                        taken => taken?,
                    };
                    let Some(frame) = frame else {
                        return Ok(None);
                    };
                    let Some(memory) = memory_of(bus, &frame, memories, self.device.as_ref())?
                    else {
                        continue;
                    };
                    return Ok(Some(FrameOnGpu {
                        address: memory.address() + frame.place().offset_bytes,
                        device: self.device.clone(),
                        stream: std::sync::atomic::AtomicU64::new(0),
                        held: Held::Slot {
                            frame: Some(frame),
                            _memory: memory,
                            releases: releases.clone(),
                        },
                    }));
                }
            }
            Port::Uploaded {
                reader,
                uploads,
                releases,
            } => {
                releases.sweep();
                let frame = if newest {
                    reader.latest()?
                } else {
                    reader.next()?
                };
                let Some(frame) = frame else {
                    return Ok(None);
                };
                let staged = uploads.upload(&frame)?;
                Ok(Some(FrameOnGpu {
                    address: staged.address,
                    device: self.device.clone(),
                    stream: std::sync::atomic::AtomicU64::new(0),
                    held: Held::Upload {
                        about: Box::new(About::of(&frame)),
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

/// The memory that a frame is in, which is asked for when it is first met; `None` if its writer has
/// ended, so that the frame cannot be reached any more.
fn memory_of(
    bus: &Bus,
    frame: &GpuFrame,
    memories: &mut Vec<(u64, Arc<Memory>)>,
    device: Option<&Arc<Cuda>>,
) -> Result<Option<Arc<Memory>>, GpuError> {
    let generation = frame.place().generation;
    if let Some((_, memory)) = memories.iter().find(|(known, _)| *known == generation) {
        return Ok(Some(memory.clone()));
    }
    let memory = match bus.gpu_memory(frame) {
        Ok(memory) => memory,
        Err(BusError::GpuMemory { topic, fault }) => {
            return Err(GpuError::Memory { topic, fault });
        }
        Err(error) => {
            tracing::debug!(topic = frame.topic(), %error, "a frame's memory is gone");
            return Ok(None);
        }
    };
    let memory = match device {
        Some(cuda) => Memory::Imported(cuda.import(frame.topic(), memory)?),
        None => {
            let mapped = Mapping::new(&memory.descriptor, memory.n_bytes);
            Memory::Mapped(mapped.map_err(|fault| GpuError::Memory {
                topic: frame.topic().into(),
                fault,
            })?)
        }
    };
    let memory = Arc::new(memory);
    if memories.len() >= MAX_KEPT {
        memories.remove(0);
    }
    memories.push((generation, memory.clone()));
    Ok(Some(memory))
}

/// A frame on a GPU. Its memory stays as it is until this is dropped and the GPU has done what it
/// was given until then.
#[derive(Debug)]
pub struct FrameOnGpu {
    address: u64,
    device: Option<Arc<Cuda>>,
    /// A stream that reads it, for drivers that cannot wait for all.
    stream: std::sync::atomic::AtomicU64,
    held: Held,
}

#[derive(Debug)]
#[expect(
    clippy::large_enum_variant,
    reason = "nearly all are slots, and a box would be one more allocation after waking"
)]
enum Held {
    Slot {
        frame: Option<GpuFrame>,
        _memory: Arc<Memory>,
        releases: Arc<Releases<GpuFrame>>,
    },
    Upload {
        about: Box<About>,
        staged: Option<GivesBack>,
        releases: Arc<Releases<GivesBack>>,
    },
}

/// What a frame says of itself.
#[derive(Debug)]
struct About {
    header: FrameHeader,
    modality: Modality,
    topic: String,
    taken: schema_types::MonoTime,
    answered: Answered,
}

impl About {
    fn of(frame: &Frame) -> About {
        About {
            header: *frame.header(),
            modality: frame.modality(),
            topic: frame.topic().to_owned(),
            taken: frame.taken(),
            answered: frame.answered(),
        }
    }
}

impl FrameOnGpu {
    fn slot(&self) -> Result<&GpuFrame, &About> {
        match &self.held {
            Held::Slot { frame, .. } => Ok(frame.as_ref().expect("taken out by drop only")),
            Held::Upload { about, .. } => Err(about),
        }
    }

    /// Address of its first byte: on the device, or, if it is mapped, in this process.
    pub fn address(&self) -> u64 {
        self.address
    }

    /// Bytes of its payload.
    pub fn n_bytes(&self) -> usize {
        self.header().payload_bytes as usize
    }

    /// Number of CUDA's device; `None` if it is mapped.
    pub fn device(&self) -> Option<i32> {
        self.device.as_ref().map(|device| device.ordinal)
    }

    /// The header, checked.
    pub fn header(&self) -> &FrameHeader {
        self.slot()
            .map_or_else(|about| &about.header, GpuFrame::header)
    }

    /// The modality of the payload.
    pub fn modality(&self) -> Modality {
        self.slot()
            .map_or_else(|about| about.modality, GpuFrame::modality)
    }

    /// Its topic without the domain.
    pub fn topic(&self) -> &str {
        self.slot()
            .map_or_else(|about| about.topic.as_str(), GpuFrame::topic)
    }

    /// When this reader took it.
    pub fn taken(&self) -> schema_types::MonoTime {
        self.slot()
            .map_or_else(|about| about.taken, GpuFrame::taken)
    }

    /// Says that a stream of CUDA, by its address, reads it. Needed for drivers before 12.5 only:
    /// later ones wait for all streams.
    pub fn is_read_by(&self, stream: u64) {
        self.stream
            .store(stream, std::sync::atomic::Ordering::Relaxed);
    }

    /// A copy of its bytes.
    ///
    /// # Errors
    /// [`GpuError::Cuda`].
    pub fn to_bytes(&self) -> Result<Vec<u8>, GpuError> {
        let mut bytes = vec![0; self.n_bytes()];
        match &self.device {
            // SAFETY: the payload lies in memory that this value keeps (checked when it was taken).
            Some(cuda) => unsafe { cuda.read(self.address, &mut bytes)? },
            // SAFETY: as above; it is mapped for reading.
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

impl Answerable for FrameOnGpu {
    fn answered(&self) -> Answered {
        self.slot()
            .map_or_else(|about| about.answered, Answerable::answered)
    }
}

impl Drop for FrameOnGpu {
    fn drop(&mut self) {
        let Some(cuda) = &self.device else {
            return;
        };
        let stream = *self.stream.get_mut();
        let event = cuda.now(stream);
        match &mut self.held {
            Held::Slot {
                frame, releases, ..
            } => {
                if let (Ok(event), Some(frame)) = (event, frame.take()) {
                    releases.push(event, frame);
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
