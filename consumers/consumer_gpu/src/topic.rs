//! A topic's frames on a GPU, whichever way they come there.

use std::sync::Arc;
use std::time::{Duration, Instant};

use schema_bus::{
    Answerable, Answered, Bus, BusError, Frame, FrameReader, GpuFrame, GpuFrameReader, GpuOffer,
    Listener, ReaderCounts, names,
};
use schema_frames::{FrameHeader, Modality};

use crate::cuda::{Cuda, Imported, Staged};
use crate::device::{Device, Way, find_way};
use crate::error::GpuError;
use crate::mapping::Mapping;
use crate::release::Releases;
use crate::upload::Uploads;
use crate::watch::{LOOK, Watch};

/// Memories of the writer that stay imported: the one in use, and that of the writer before it,
/// whose frames may still be held.
const MAX_KEPT: usize = 2;

/// The reading end of a topic on a GPU. It follows the topic when another process writes it: frames
/// stay on the GPU if that process draws on the same one, and are uploaded otherwise.
#[derive(Debug)]
pub struct GpuTopic {
    topic: String,
    /// The device, by its number once it is known: frames never change it.
    wish: Device,
    opened: Opened,
    listener: Listener,
    watch: Watch,
    /// Port that wrote the last frame that was uploaded.
    writer: Option<u128>,
    /// Epoch, tick and number of the last frame.
    last: Option<(u64, u64, u64)>,
    /// Whether no frame came yet the way that they come now.
    is_switched: bool,
    has_moved: bool,
    /// Counters of the ports before this one.
    counts_before: ReaderCounts,
}

/// A way that frames come.
#[derive(Debug)]
struct Opened {
    port: Port,
    device: Option<Arc<Cuda>>,
    /// Name of the event that announces its frames.
    event: String,
    fallback: Option<String>,
}

/// What a look at a port found.
#[expect(
    clippy::large_enum_variant,
    reason = "it is taken apart at once, and a box would be one more allocation after waking"
)]
enum Taken {
    Frame(FrameOnGpu),
    Nothing,
    /// A frame on another GPU.
    Elsewhere,
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
        let way = find_way(topic, device, told(&offered))?;
        let opened = Opened::open(bus, topic, way, &offered)?;
        let number = opened.device.as_ref().map(|device| device.ordinal);
        Ok(GpuTopic {
            topic: topic.to_owned(),
            wish: number.map_or(device, Device::CudaNumber),
            listener: bus.listener(&opened.event)?,
            opened,
            watch: Watch::new(),
            writer: None,
            last: None,
            is_switched: false,
            has_moved: false,
            counts_before: ReaderCounts::default(),
        })
    }

    /// Why frames are uploaded instead of staying on the GPU; `None` if they stay. That changes when
    /// a process on another GPU writes the topic.
    pub fn fallback(&self) -> Option<&str> {
        self.opened.fallback.as_deref()
    }

    /// Number of CUDA's device; `None` if frames are mapped.
    pub fn device(&self) -> Option<i32> {
        self.opened.device.as_ref().map(|device| device.ordinal)
    }

    /// Name of the event that announces its frames. Whoever waits for it looks at least twice a
    /// second all the same, because a writer that ends announces nothing.
    pub fn event(&self) -> &str {
        &self.opened.event
    }

    /// Whether event and fallback may be others than at the last call.
    pub fn has_moved(&mut self) -> bool {
        std::mem::take(&mut self.has_moved)
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
            self.listener.wait_pending(rest.min(LOOK));
        }
    }

    /// Counters since it was opened.
    pub fn counts(&self) -> ReaderCounts {
        let (now, before) = (self.opened.port.counts(), self.counts_before);
        ReaderCounts {
            taken: now.taken + before.taken,
            skipped: now.skipped + before.skipped,
            lost: now.lost + before.lost,
            refused: now.refused + before.refused,
            restarts: now.restarts + before.restarts,
        }
    }

    /// Whether a process writes it now.
    pub fn has_writer(&self) -> bool {
        match &self.opened.port {
            Port::OnGpu { reader, .. } => reader.has_writer(),
            Port::Uploaded { reader, .. } => reader.has_writer(),
        }
    }

    fn take(&mut self, bus: &Bus, newest: bool) -> Result<Option<FrameOnGpu>, GpuError> {
        loop {
            match self.opened.take(bus, newest)? {
                Taken::Frame(frame) => {
                    self.follow_writer(bus, &frame);
                    if self.is_next(frame.header()) {
                        return Ok(Some(frame));
                    }
                }
                Taken::Elsewhere => {
                    let (way, offered) = self.find_way(bus)?;
                    if matches!(way, Way::Uploaded(..)) {
                        self.switch(bus, way, &offered)?;
                    }
                }
                Taken::Nothing => {
                    self.look_for_writer(bus)?;
                    return Ok(None);
                }
            }
        }
    }

    /// Whether a frame is not one that came another way already; takes note of it then.
    fn is_next(&mut self, header: &FrameHeader) -> bool {
        let FrameHeader {
            epoch, tick, seq, ..
        } = *header;
        if self.is_switched
            && let Some((_, last_tick, last_seq)) = self.last.filter(|last| last.0 == epoch)
        {
            if tick <= last_tick && seq <= last_seq {
                return false;
            }
            self.counts_before.lost += seq.saturating_sub(last_seq + 1);
        }
        self.is_switched = false;
        self.last = Some((epoch, tick, seq));
        true
    }

    /// Finds the way that frames can come now.
    fn find_way(&self, bus: &Bus) -> Result<(Way, Result<GpuOffer, BusError>), GpuError> {
        let offered = bus.gpu_offer(&self.topic);
        let way = find_way(&self.topic, self.wish, told(&offered))?;
        Ok((way, offered))
    }

    /// Lets frames come another way.
    fn switch(
        &mut self,
        bus: &Bus,
        way: Way,
        offered: &Result<GpuOffer, BusError>,
    ) -> Result<(), GpuError> {
        let opened = Opened::open(bus, &self.topic, way, offered)?;
        self.listener = bus.listener(&opened.event)?;
        self.counts_before = self.counts();
        let topic = &self.topic;
        match &opened.fallback {
            Some(why) => tracing::warn!(topic, "frames are uploaded from now on: {why}"),
            None => tracing::info!(topic, "frames stay on the GPU again"),
        }
        self.opened = opened;
        self.watch = Watch::new();
        self.writer = None;
        (self.is_switched, self.has_moved) = (true, true);
        Ok(())
    }

    /// Looks, when frames are uploaded that another process has written than those before, whether
    /// they can stay on the GPU.
    fn follow_writer(&mut self, bus: &Bus, frame: &FrameOnGpu) {
        let Held::Upload { about, .. } = &frame.held else {
            return;
        };
        if self.writer.replace(about.writer) == Some(about.writer) {
            return;
        }
        match self.find_way(bus) {
            Ok((Way::Uploaded(_, why), _)) => self.opened.fallback = Some(why),
            Ok((way, offered)) => {
                // All places of the GPU may be taken; frames are uploaded then as before.
                if let Err(error) = self.switch(bus, way, &offered) {
                    tracing::debug!(topic = self.topic, %error, "frames do not stay on the GPU");
                }
            }
            Err(error) => tracing::debug!(topic = self.topic, %error, "no other way is found"),
        }
    }

    /// Looks, when no frame waits, whether somebody still keeps the topic on the GPU.
    fn look_for_writer(&mut self, bus: &Bus) -> Result<(), GpuError> {
        if !matches!(self.opened.port, Port::OnGpu { .. }) || !self.watch.is_due() {
            return Ok(());
        }
        // Without the topic there is nobody to write it, on whatever way.
        if self.has_writer() || !bus.exists(&self.topic) {
            self.watch.is_there();
            return Ok(());
        }
        let offered = bus.gpu_offer(&self.topic);
        if offered.is_err() && (self.wish == Device::Mapped || !self.watch.is_missing_for_long()) {
            return Ok(());
        }
        let way = find_way(&self.topic, self.wish, told(&offered))?;
        match way {
            Way::Uploaded(..) => self.switch(bus, way, &offered),
            Way::Imported(_) | Way::Mapped => {
                self.watch.is_there();
                Ok(())
            }
        }
    }
}

/// An offer, or the sentence of why there is none.
fn told(offered: &Result<GpuOffer, BusError>) -> Result<&GpuOffer, String> {
    offered.as_ref().map_err(ToString::to_string)
}

impl Port {
    fn counts(&self) -> ReaderCounts {
        match self {
            Port::OnGpu { reader, .. } => reader.counts(),
            Port::Uploaded { reader, .. } => reader.counts(),
        }
    }
}

impl Opened {
    fn open(
        bus: &Bus,
        topic: &str,
        way: Way,
        offered: &Result<GpuOffer, BusError>,
    ) -> Result<Opened, GpuError> {
        let on_gpu = |device| -> Result<Opened, GpuError> {
            let offer = told(offered).map_err(|fault| GpuError::Memory {
                topic: topic.into(),
                fault,
            })?;
            Ok(Opened {
                port: Port::OnGpu {
                    reader: bus.gpu_reader(topic, offer)?,
                    memories: Vec::new(),
                    releases: Releases::new(),
                },
                device,
                event: names::gpu_topic(topic),
                fallback: None,
            })
        };
        match way {
            Way::Imported(cuda) => on_gpu(Some(cuda)),
            Way::Mapped => on_gpu(None),
            Way::Uploaded(cuda, why) => Ok(Opened {
                port: Port::Uploaded {
                    reader: bus.frame_reader(topic)?,
                    uploads: Uploads::new(cuda.clone()),
                    releases: Releases::new(),
                },
                device: Some(cuda),
                event: topic.to_owned(),
                fallback: Some(why),
            }),
        }
    }

    fn take(&mut self, bus: &Bus, newest: bool) -> Result<Taken, GpuError> {
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
                        return Ok(Taken::Nothing);
                    };
                    let memory = match memory_of(bus, &frame, memories, self.device.as_ref())? {
                        Found::Here(memory) => memory,
                        Found::Elsewhere => return Ok(Taken::Elsewhere),
                        Found::Gone => {
                            reader.forget_last();
                            continue;
                        }
                    };
                    return Ok(Taken::Frame(FrameOnGpu {
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
                    return Ok(Taken::Nothing);
                };
                let staged = uploads.upload(&frame)?;
                Ok(Taken::Frame(FrameOnGpu {
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

/// Where the memory of a frame is.
enum Found {
    Here(Arc<Memory>),
    /// On another GPU than the reader's.
    Elsewhere,
    /// Its writer has ended, so that the frame cannot be reached any more.
    Gone,
}

/// The memory that a frame is in, which is asked for when it is first met.
fn memory_of(
    bus: &Bus,
    frame: &GpuFrame,
    memories: &mut Vec<(u64, Arc<Memory>)>,
    device: Option<&Arc<Cuda>>,
) -> Result<Found, GpuError> {
    let generation = frame.place().generation;
    if let Some((_, memory)) = memories.iter().find(|(known, _)| *known == generation) {
        return Ok(Found::Here(memory.clone()));
    }
    let memory = match bus.gpu_memory(frame) {
        Ok(memory) => memory,
        Err(BusError::GpuMemory { topic, fault }) => {
            return Err(GpuError::Memory { topic, fault });
        }
        Err(error) => {
            tracing::debug!(topic = frame.topic(), %error, "a frame's memory is gone");
            return Ok(Found::Gone);
        }
    };
    let is_here = match device {
        Some(cuda) => cuda.uuid == memory.device_uuid,
        None => memory.is_mappable,
    };
    if !is_here {
        return Ok(Found::Elsewhere);
    }
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
    Ok(Found::Here(memory))
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
    /// Port that wrote it.
    writer: u128,
}

impl About {
    fn of(frame: &Frame) -> About {
        About {
            header: *frame.header(),
            modality: frame.modality(),
            topic: frame.topic().to_owned(),
            taken: frame.taken(),
            answered: frame.answered(),
            writer: frame.writer(),
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
