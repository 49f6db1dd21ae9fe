//! The shared memory of a topic and its life: opened, handed to the GPU, grown, given back.
//!
//! A topic of the launch file has its memory as long as the daemon runs. A topic made at run time
//! has it only while somebody reads, because there may be hundreds of such topics.

use std::sync::Arc;

use anyhow::{Context as _, anyhow, bail};
use launch_spec::TopicLimits;
use schema_bus::{Bus, FrameLoan, FramePublisher, FrameService, FrameTopic, mono_now};
use schema_frames::{Modality, SensorKind};
use sensor_gpu::{Gpu, ShmTarget};

use super::import::{self, Transfer};

/// Memory of a topic made at run time outlives its last reader by this much, so that a reader that
/// comes back soon costs nothing.
pub(super) const LINGER_NANOS: u64 = 5_000_000_000;

/// Memory that was refused is asked for again after this long, nanoseconds.
pub(super) const ASK_AGAIN_NANOS: u64 = 1_000_000_000;

/// What writes the frames of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Writer {
    Cpu,
    Gpu,
}

impl Writer {
    /// What writes frames of this modality, if `lidars_on` casts the rays of lidars.
    pub fn of(modality: Modality, lidars_on: Writer) -> Writer {
        match modality.sensor_kind() {
            SensorKind::Camera => Writer::Gpu,
            SensorKind::Lidar => lidars_on,
            _ => Writer::Cpu,
        }
    }
}

/// How long a topic has memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MemoryLife {
    /// As long as the topic exists.
    Lasting,
    /// From its first reader until [`LINGER_NANOS`] after its last.
    OnDemand,
    /// As [`MemoryLife::OnDemand`], but whether there is room is only asked when somebody reads.
    WhileRoom,
}

/// What memory a topic needs.
pub(super) struct MemoryPlan {
    pub modality: Modality,
    pub max_payload_bytes: usize,
    pub limits: TopicLimits,
    pub frames_in_flight: u32,
    pub transfer: Transfer,
    pub writer: Writer,
    pub life: MemoryLife,
    /// Whether another process writes the frames.
    pub is_away: bool,
}

/// A topic with the limits that the launch file gives it.
pub fn limited(usual: FrameTopic, limits: TopicLimits) -> FrameTopic {
    let or = |wish: Option<u32>, usual: usize| wish.map_or(usual, |wish| wish as usize);
    FrameTopic {
        max_readers: or(limits.readers, usual.max_readers),
        buffer: or(limits.buffer, usual.buffer),
        borrowed: or(limits.borrowed, usual.borrowed),
        ..usual
    }
}

/// The writing end of a topic.
enum Outlet {
    /// Readers can find the topic, but it has no memory.
    Idle(FrameService),
    /// The topic has memory, and the GPU's view of it (`None` if the CPU writes the frames).
    Open {
        // The target keeps the publisher, so that whatever is dropped first, the GPU lets go of the
        // memory before it is unmapped.
        target: Option<Arc<ShmTarget>>,
        publisher: Arc<FramePublisher>,
    },
    /// Neither service nor memory: the state during a change, which stays only if reopening fails.
    Closed,
}

/// Memory of one topic.
pub(super) struct TopicMemory {
    outlet: Outlet,
    spec: FrameTopic,
    /// Payload bytes that the open memory was made for; `spec` may already ask for more.
    max_payload_bytes: usize,
    transfer: Transfer,
    writer: Writer,
    life: MemoryLife,
    last_read_nanos: u64,
    /// `CLOCK_MONOTONIC` before which memory that was refused is not asked for again.
    not_before_nanos: u64,
    /// Whether it was refused the last time, which is said once.
    is_refused: bool,
    /// The memory must be made anew, larger.
    outgrown: bool,
    /// Readers elsewhere, on the GPU, need its frames.
    is_needed: bool,
    /// Another process writes the frames, so that there is no memory here.
    is_away: bool,
}

impl TopicMemory {
    /// Opens the service, and the memory if it lasts.
    pub fn open(
        bus: &Bus,
        gpu: Option<&Gpu>,
        name: &str,
        plan: &MemoryPlan,
    ) -> anyhow::Result<Self> {
        let (modality, max_payload_bytes) = (plan.modality, plan.max_payload_bytes);
        let usual = match plan.life {
            MemoryLife::Lasting => FrameTopic::new(modality, max_payload_bytes),
            MemoryLife::OnDemand | MemoryLife::WhileRoom => {
                FrameTopic::of_run_time_sensor(modality, max_payload_bytes)
            }
        };
        let spec = FrameTopic {
            frames_in_flight: plan.frames_in_flight as usize,
            ..limited(usual, plan.limits)
        };
        let service = bus
            .frame_service(name, spec)
            .with_context(|| format!("cannot publish {name:?}"))?;
        if plan.life != MemoryLife::WhileRoom && !plan.is_away {
            check_room(name, &service, 0)?;
        }
        let mut memory = TopicMemory {
            outlet: Outlet::Closed,
            spec,
            max_payload_bytes,
            transfer: plan.transfer,
            writer: plan.writer,
            life: plan.life,
            last_read_nanos: mono_now().0,
            not_before_nanos: 0,
            is_refused: false,
            outgrown: false,
            is_needed: false,
            is_away: plan.is_away,
        };
        memory.outlet = match plan.life {
            _ if plan.is_away => Outlet::Idle(service),
            MemoryLife::OnDemand | MemoryLife::WhileRoom => Outlet::Idle(service),
            MemoryLife::Lasting => memory.open_outlet(service, gpu)?,
        };
        Ok(memory)
    }

    /// Number of readers.
    pub fn n_readers(&self) -> usize {
        match &self.outlet {
            Outlet::Idle(service) => service.n_readers(),
            Outlet::Open { publisher, .. } => publisher.n_readers(),
            Outlet::Closed => 0,
        }
    }

    /// Says whether its frames are needed although it may have no reader of its own.
    pub fn need(&mut self, is_needed: bool) {
        self.is_needed = is_needed;
    }

    /// How long it lasts.
    pub fn life(&self) -> MemoryLife {
        self.life
    }

    /// Most payload bytes of a frame.
    pub fn max_payload_bytes(&self) -> usize {
        self.max_payload_bytes
    }

    /// Where the GPU writes; `None` without memory, or if the CPU writes.
    pub fn target(&self) -> Option<&Arc<ShmTarget>> {
        match &self.outlet {
            Outlet::Open { target, .. } => target.as_ref(),
            _ => None,
        }
    }

    /// A free slot.
    pub fn loan(&self) -> anyhow::Result<FrameLoan> {
        match &self.outlet {
            Outlet::Open { publisher, .. } => Ok(publisher.loan(self.max_payload_bytes)?),
            _ => bail!("the topic has no memory"),
        }
    }

    /// Asks for frames of up to `max_payload_bytes`; less than there is changes nothing.
    pub fn fit(&mut self, max_payload_bytes: usize) {
        if max_payload_bytes > self.max_payload_bytes {
            self.spec.max_payload_bytes = max_payload_bytes;
            self.outgrown = true;
        }
    }

    /// Whether [`TopicMemory::settle`] has something to do.
    pub fn is_unsettled(&mut self, now_nanos: u64) -> bool {
        if self.is_away {
            return matches!(self.outlet, Outlet::Closed) && now_nanos >= self.not_before_nanos;
        }
        if self.outgrown {
            return true;
        }
        if now_nanos < self.not_before_nanos {
            return false;
        }
        if self.life == MemoryLife::Lasting {
            return !matches!(self.outlet, Outlet::Open { .. });
        }
        let is_read = self.is_needed || self.n_readers() > 0;
        if is_read {
            self.last_read_nanos = now_nanos;
        }
        match &self.outlet {
            Outlet::Open { .. } => now_nanos.saturating_sub(self.last_read_nanos) > LINGER_NANOS,
            Outlet::Idle(_) => is_read,
            Outlet::Closed => true,
        }
    }

    /// Opens the memory for the first reader, gives it back after the last, or makes it larger.
    /// No frame may be in flight.
    pub fn settle(&mut self, bus: &Bus, gpu: Option<&Gpu>, name: &str) -> anyhow::Result<()> {
        if self.is_away {
            self.outlet = Outlet::Idle(bus.frame_service(name, self.spec)?);
            return Ok(());
        }
        if std::mem::take(&mut self.outgrown) {
            return self.grow(bus, gpu, name);
        }
        match std::mem::replace(&mut self.outlet, Outlet::Closed) {
            Outlet::Idle(service) => {
                // A second handle, in case that there is no room: readers are waiting.
                self.outlet = Outlet::Idle(bus.frame_service(name, self.spec)?);
                check_room(name, &service, 0)?;
                self.outlet = self.open_outlet(service, gpu)?;
            }
            open @ Outlet::Open { .. } => {
                open.close(gpu);
                self.outlet = Outlet::Idle(bus.frame_service(name, self.spec)?);
            }
            Outlet::Closed => self.outlet = Outlet::Idle(bus.frame_service(name, self.spec)?),
        }
        self.is_refused = false;
        Ok(())
    }

    /// Makes the memory anew in the size that is needed; readers stay connected. If the new size
    /// does not fit, the topic keeps the memory it has, and its frames what fits into that.
    fn grow(&mut self, bus: &Bus, gpu: Option<&Gpu>, name: &str) -> anyhow::Result<()> {
        let (had_bytes, needed_bytes) = (self.max_payload_bytes, self.spec.max_payload_bytes);
        let Err(error) = self.reopen(bus, gpu, name) else {
            return Ok(());
        };
        self.max_payload_bytes = had_bytes;
        self.spec.max_payload_bytes = had_bytes;
        Err(error).with_context(|| {
            format!(
                "frames keep to {had_bytes} bytes, but ticks of this length can need {needed_bytes}"
            )
        })
    }

    fn reopen(&mut self, bus: &Bus, gpu: Option<&Gpu>, name: &str) -> anyhow::Result<()> {
        // A second handle under the same name keeps the service alive during the change.
        let service = bus.frame_service(name, self.spec)?;
        let was_open = matches!(self.outlet, Outlet::Open { .. });
        if was_open {
            // Readers hold on to the old memory for a while; without readers it is free as soon as
            // it is closed.
            let before = FrameTopic {
                max_payload_bytes: self.max_payload_bytes,
                ..self.spec
            };
            let given_back = if self.n_readers() == 0 {
                bus.frame_service(name, before)?.segment_bytes()
            } else {
                0
            };
            check_room(name, &service, given_back)?;
        }
        std::mem::replace(&mut self.outlet, Outlet::Closed).close(gpu);
        self.max_payload_bytes = self.spec.max_payload_bytes;
        self.outlet = if was_open {
            self.open_outlet(service, gpu)?
        } else {
            Outlet::Idle(service)
        };
        Ok(())
    }

    /// Gives the memory back for good, because another process writes the frames from now on. The
    /// service stays. No frame may be in flight.
    pub fn leave(&mut self, bus: &Bus, gpu: Option<&Gpu>, name: &str) -> anyhow::Result<()> {
        self.is_away = true;
        if matches!(self.outlet, Outlet::Open { .. }) {
            // A second handle under the same name keeps the service alive during the change.
            let service = bus.frame_service(name, self.spec)?;
            std::mem::replace(&mut self.outlet, Outlet::Idle(service)).close(gpu);
        }
        Ok(())
    }

    /// The frames are written here again; [`TopicMemory::settle`] makes the memory.
    pub fn come_back(&mut self) {
        self.is_away = false;
        self.last_read_nanos = mono_now().0;
    }

    /// Notes that the memory was refused: it is asked for again after a while. Whether to say so.
    pub fn refuse(&mut self, now_nanos: u64) -> bool {
        self.not_before_nanos = now_nanos.saturating_add(ASK_AGAIN_NANOS);
        !std::mem::replace(&mut self.is_refused, true)
    }

    /// Gives everything back. No frame may be in flight.
    pub fn close(self, gpu: Option<&Gpu>) {
        self.outlet.close(gpu);
    }

    fn open_outlet(&self, service: FrameService, gpu: Option<&Gpu>) -> anyhow::Result<Outlet> {
        let publisher = Arc::new(service.publisher()?);
        publisher.touch()?;
        let segment = publisher.segment()?;
        let target = match self.writer {
            Writer::Cpu => None,
            Writer::Gpu => {
                let publisher = publisher.clone();
                let gpu = gpu.context("this process has no GPU (--no-gpu)")?;
                Some(import::target(gpu, &segment, publisher, self.transfer))
            }
        };
        Ok(Outlet::Open {
            target: target.map(Arc::new),
            publisher,
        })
    }
}

impl Outlet {
    /// Gives the memory back, if there is any, and waits until it is free.
    fn close(self, gpu: Option<&Gpu>) {
        if let Outlet::Open { target, publisher } = self {
            drop(target);
            if let Some(gpu) = gpu {
                gpu.wait_idle();
            }
            drop(publisher);
        }
    }
}

/// Whether the memory of a topic fits into what is free once `given_back` bytes are.
fn check_room(name: &str, service: &FrameService, given_back: u64) -> anyhow::Result<()> {
    schema_bus::check_shared_memory(service.segment_bytes(), given_back)
        .map_err(|short| anyhow!("no room for {name:?}: {short}"))
}
