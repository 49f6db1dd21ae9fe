//! A topic's frames that stay on the GPU: the service beside the topic's own, its memory on the
//! device, and its slots.
//!
//! Slot i of that memory is slot i of the service's segment, so what iceoryx2 keeps for a reader is
//! kept on the GPU too. The memory is there from the first reader until a while after the last.
//!
//! Of a topic that another process writes the service alone is kept, so that its readers are counted
//! by the process that decides which frames are made.

#![expect(
    unsafe_code,
    reason = "places in memory of the device are promises about who has them"
)]

use std::sync::Arc;

use anyhow::{Context as _, bail};
use launch_spec::TopicLimits;
use schema_bus::{
    Bus, FrameLoan, FramePublisher, FrameService, FrameTopic, GpuDevice, GpuServer, Notifier,
    SharedMemory, mono_now, names,
};
use schema_frames::{FrameHeader, GpuAnswer, GpuPlace, Modality, SensorKind};
use sensor_gpu::{Gpu, Place, ShmTarget};

use super::memory::{ASK_AGAIN_NANOS, LINGER_NANOS};

/// Slots begin at multiples of this, bytes: what every GPU reads fastest.
const SLOT_ALIGN_BYTES: usize = 256;

/// The topic's side on the GPU.
pub(super) struct OnGpu {
    topic: String,
    spec: FrameTopic,
    max_payload_bytes: usize,
    offer: schema_bus::GpuTopic,
    server: Arc<GpuServer>,
    /// Whether this process's GPU hands out memory.
    can_export: bool,
    /// Another process writes the frames, on a GPU or not.
    is_away: bool,
    state: State,
    last_read_nanos: u64,
    not_before_nanos: u64,
    is_refused: bool,
}

enum State {
    /// Nobody asked for it.
    Unasked,
    /// Readers can find it, but it has no memory.
    Idle(FrameService, Notifier),
    /// It has memory.
    Open(Open),
}

struct Open {
    publisher: FramePublisher,
    wake: Notifier,
    target: Arc<ShmTarget>,
    memory: SharedMemory,
    slot_bytes: usize,
    /// Offsets of the segment's slots in the order in which they were first seen.
    slots: Vec<usize>,
}

/// How its frames are made.
pub(super) struct Options {
    pub frames_in_flight: usize,
    /// Whether another process writes them.
    pub is_away: bool,
}

/// A slot of a topic's on the GPU: the sample that will tell of it, and where it is.
#[derive(Debug)]
pub struct GpuLoan {
    loan: FrameLoan,
    place: GpuPlace,
}

/// Whether frames of a modality can stay on the GPU: images, and lists that are worth it.
pub fn can_stay(modality: Modality) -> bool {
    matches!(
        modality.sensor_kind(),
        SensorKind::Camera | SensorKind::Lidar
    )
}

/// Where frames that stay on a GPU are offered.
pub struct Offering<'a> {
    /// Where readers look for topics.
    pub bus: &'a Bus,
    /// The GPU; `None` if another process has it.
    pub gpu: Option<&'a Gpu>,
    /// Where readers ask for memory.
    pub server: &'a Arc<GpuServer>,
}

impl OnGpu {
    /// Lets readers ask for a topic.
    pub fn offer(
        offering: &Offering<'_>,
        topic: &str,
        max_payload_bytes: usize,
        limits: TopicLimits,
        options: Options,
    ) -> OnGpu {
        let Offering { bus, gpu, server } = *offering;
        let usual = FrameTopic::on_gpu(options.frames_in_flight);
        let spec = FrameTopic {
            max_readers: limits.gpu_readers.map_or(usual.max_readers, |n| n as usize),
            ..usual
        };
        let can_export = gpu.is_some_and(Gpu::can_export);
        let offer = server.offer(topic, spec);
        offer.set_here(can_export && !options.is_away);
        // Readers of an earlier run, or of the process that wrote it before, keep the service.
        if limits.gpu || bus.exists(&names::gpu_topic(topic)) {
            offer.want();
        }
        OnGpu {
            topic: topic.to_owned(),
            spec,
            max_payload_bytes,
            offer,
            server: server.clone(),
            can_export,
            is_away: options.is_away,
            state: State::Unasked,
            last_read_nanos: 0,
            not_before_nanos: 0,
            is_refused: false,
        }
    }

    /// Number of readers that can have frames.
    pub fn n_readers(&self) -> usize {
        match &self.state {
            _ if !self.can_export && !self.is_away => 0,
            State::Unasked => 0,
            State::Idle(service, _) => service.n_readers(),
            State::Open(open) => open.publisher.n_readers(),
        }
    }

    /// Asks for slots of more bytes.
    pub fn fit(&mut self, max_payload_bytes: usize) {
        self.max_payload_bytes = self.max_payload_bytes.max(max_payload_bytes);
    }

    /// Whether [`OnGpu::settle`] has something to do.
    pub fn is_unsettled(&mut self, now_nanos: u64) -> bool {
        let n_readers = self.n_readers();
        if n_readers > 0 {
            self.last_read_nanos = now_nanos;
        }
        if now_nanos < self.not_before_nanos {
            return false;
        }
        match &self.state {
            State::Unasked => self.offer.is_wanted(),
            State::Idle(..) => n_readers > 0 && !self.is_away,
            State::Open(open) => {
                open.slot_bytes < self.max_payload_bytes
                    || now_nanos.saturating_sub(self.last_read_nanos) > LINGER_NANOS
            }
        }
    }

    /// Makes the service when it is first asked for, the memory for the first reader or for longer
    /// frames, and gives memory back after the last reader. No frame may be in flight.
    pub fn settle(&mut self, bus: &Bus, gpu: Option<&Gpu>) -> anyhow::Result<()> {
        let name = names::gpu_topic(&self.topic);
        let service =
            || -> anyhow::Result<FrameService> { Ok(bus.frame_service(&name, self.spec)?) };
        let gpu_of = || gpu.context("this process has no GPU (--no-gpu)");
        self.state = match std::mem::replace(&mut self.state, State::Unasked) {
            State::Unasked => State::Idle(service()?, bus.notifier(&name)?),
            State::Idle(idle, wake) => {
                // A second handle, in case that there is no memory: readers are waiting.
                let second = service()?;
                match gpu_of().and_then(|gpu| self.open(idle, gpu)) {
                    Ok((publisher, target, memory, slot_bytes)) => State::Open(Open {
                        publisher,
                        wake,
                        target,
                        memory,
                        slot_bytes,
                        slots: Vec::new(),
                    }),
                    Err(error) => {
                        self.state = State::Idle(second, wake);
                        return Err(error);
                    }
                }
            }
            State::Open(open) => {
                // The service lives on while its memory is given back or made anew.
                let idle = service()?;
                let wake = open.close(gpu_of()?);
                State::Idle(idle, wake)
            }
        };
        self.is_refused = false;
        Ok(())
    }

    /// Another process writes the frames from now on: gives the memory back, and sends readers that
    /// ask to that process. The service stays. No frame may be in flight.
    pub fn leave(&mut self, bus: &Bus, gpu: Option<&Gpu>) -> anyhow::Result<()> {
        self.is_away = true;
        self.offer.set_here(false);
        match self.state {
            State::Open(_) => self.settle(bus, gpu),
            State::Unasked | State::Idle(..) => Ok(()),
        }
    }

    /// The frames are written here again; [`OnGpu::settle`] makes the memory.
    pub fn come_back(&mut self) {
        self.is_away = false;
        self.offer.set_here(self.can_export);
        self.last_read_nanos = mono_now().0;
    }

    fn open(
        &self,
        service: FrameService,
        gpu: &Gpu,
    ) -> anyhow::Result<(FramePublisher, Arc<ShmTarget>, SharedMemory, usize)> {
        let slot_bytes = self
            .max_payload_bytes
            .max(4)
            .next_multiple_of(SLOT_ALIGN_BYTES);
        let n_bytes = (slot_bytes * self.spec.n_slots()) as u64;
        let exported = ShmTarget::export(gpu, n_bytes).with_context(|| {
            format!(
                "no room on the GPU for {} frames of {:?}, {} MiB",
                self.spec.n_slots(),
                self.topic,
                n_bytes.div_ceil(1 << 20)
            )
        })?;
        let memory = self.server.share(
            exported.descriptor,
            exported.memory_bytes,
            GpuAnswer::VULKAN,
        )?;
        let publisher = service.publisher()?;
        // From now on loans know their offsets.
        publisher.segment()?;
        Ok((publisher, Arc::new(exported.target), memory, slot_bytes))
    }

    /// Notes that the memory was refused: it is asked for again after a while. Whether to say so.
    pub fn refuse(&mut self, now_nanos: u64) -> bool {
        self.not_before_nanos = now_nanos.saturating_add(ASK_AGAIN_NANOS);
        !std::mem::replace(&mut self.is_refused, true)
    }

    /// A free slot, if somebody reads; the first is the sample, the second where the GPU writes.
    pub fn loan(&mut self) -> anyhow::Result<Option<(GpuLoan, Place<'static>)>> {
        let State::Open(open) = &mut self.state else {
            return Ok(None);
        };
        if open.publisher.n_readers() == 0 {
            return Ok(None);
        }
        let loan = open.publisher.loan(self.spec.max_payload_bytes)?;
        let offset = loan
            .offset_in_segment()
            .context("the segment was asked for when it was opened")?;
        let slot = open.slot_of(offset);
        if slot >= self.spec.n_slots() {
            bail!(
                "the segment has more slots than the {} that it was made with",
                self.spec.n_slots()
            );
        }
        let begin = slot * open.slot_bytes;
        // SAFETY: the range is the slot of a loan, which no other loan has, and which no reader
        // holds: iceoryx2 gives a slot out again only when everybody has given it back. `GpuLoan`
        // keeps the loan until the submission was waited for.
        let place = unsafe { open.target.place(begin, open.slot_bytes) };
        let told = GpuPlace {
            producer: open.memory.producer(),
            generation: open.memory.generation(),
            offset_bytes: begin as u64,
            memory_bytes: open.memory.n_bytes(),
            capacity_bytes: open.slot_bytes as u64,
            pid: std::process::id(),
            slot: slot as u32,
            reserved: [0; 16],
        };
        Ok(Some((GpuLoan { loan, place: told }, place)))
    }

    /// Sends a slot that the GPU has filled, with the header of the topic's own frame.
    pub fn send(&self, loan: GpuLoan, header: &FrameHeader) -> anyhow::Result<()> {
        let GpuLoan { mut loan, place } = loan;
        loan.put_on_gpu(header, &place);
        loan.send()?;
        if let State::Open(open) = &self.state {
            open.wake.notify_listeners();
        }
        Ok(())
    }

    /// Gives everything back. No frame may be in flight.
    pub fn close(self, gpu: Option<&Gpu>) {
        if let (State::Open(open), Some(gpu)) = (self.state, gpu) {
            open.close(gpu);
        }
    }
}

/// Answers readers that ask for frames on the GPU, and hears what they ask for where this process has
/// none to give; `None` if the socket cannot be made.
pub fn gpu_server(bus: &Bus, gpu: Option<&Gpu>) -> Option<Arc<GpuServer>> {
    if gpu.is_some_and(|gpu| !gpu.can_export()) {
        tracing::info!("frames do not stay on the GPU: its driver lacks VK_KHR_external_memory_fd");
    }
    let device = gpu.filter(|gpu| gpu.can_export()).map(|gpu| {
        let ids = gpu.ids();
        GpuDevice {
            device_uuid: ids.device,
            driver_uuid: ids.driver,
            is_mappable: gpu.is_software(),
        }
    });
    match bus.gpu_server(device.unwrap_or_default()) {
        Ok(server) => Some(Arc::new(server)),
        Err(error) => {
            tracing::warn!(%error, "frames do not stay on a GPU: the socket of their readers cannot be made");
            None
        }
    }
}

impl Open {
    fn slot_of(&mut self, offset: usize) -> usize {
        let known = self.slots.iter().position(|known| *known == offset);
        known.unwrap_or_else(|| {
            self.slots.push(offset);
            self.slots.len() - 1
        })
    }

    /// Readers that have imported the memory keep it until they let go of it.
    fn close(self, gpu: &Gpu) -> Notifier {
        drop(self.memory);
        drop(self.target);
        gpu.wait_idle();
        drop(self.publisher);
        self.wake
    }
}
