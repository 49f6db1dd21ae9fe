//! A topic: one modality of a sensor, with its readers, its loans and its counts.

mod import;
mod memory;
mod on_gpu;

use std::sync::Arc;

use launch_spec::TopicLimits;
use schema_bus::{Bus, DeviceLoan, FrameLoan, GpuServer, Notifier, mono_now};
use schema_frames::document::TopicInfo;
use schema_frames::{FrameHeader, Modality, Seal};
use schema_types::Pose;
use sensor_gpu::{Gpu, Place, ShmTarget};

pub use import::{Lent, Transfer};
pub use memory::{MemoryLife, Writer, limited};
pub use on_gpu::{GpuLoan, gpu_server};

use crate::hash::BytesHash;
use memory::{MemoryPlan, TopicMemory};
use on_gpu::{Offering, OnGpu, Options, can_stay};

/// Which topics get frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Audience {
    /// Those that somebody reads.
    Readers,
    /// All of them; a hash of every frame goes to stdout (`--hash`).
    Hash,
}

/// Whether the last frame of a topic was made, and whether the one was that was told last.
#[derive(Clone, Copy, Debug, Default)]
struct Made {
    is_made: bool,
    was_made: bool,
}

/// How the frames of all topics of a run are made.
#[derive(Clone, Debug)]
pub struct FrameOptions {
    /// Frames of one topic that may be on the GPU at once.
    pub frames_in_flight: u32,
    /// How the GPU's frames get into shared memory.
    pub transfer: Transfer,
    /// What casts the rays of lidars.
    pub lidars_on: Writer,
    /// Which topics get frames.
    pub audience: Audience,
    /// What is shown, if programs are scored against this world.
    pub seal: Option<Arc<Seal>>,
}

/// What a topic carries.
pub struct TopicSpec {
    /// Name without the domain.
    pub name: String,
    /// Modality of its frames.
    pub modality: Modality,
    /// Most payload bytes of a frame.
    pub max_payload_bytes: usize,
    /// Limits that the launch file gives it.
    pub limits: TopicLimits,
    /// Whether a frame depends on whether the one before it was made.
    pub remembers: bool,
    /// Whether a journal tells when its frames are made; at first they are not.
    pub is_told: bool,
    /// Whether another process writes its frames.
    pub is_away: bool,
    /// Whether the processor casts the rays of its images.
    pub is_cast: bool,
    /// Mount of its sensor, for sealed headers.
    pub vehicle_from_sensor: Pose,
}

/// How a topic's frames are sealed.
#[derive(Clone, Copy, Debug)]
struct TopicSeal {
    /// Whether it sends frames at all.
    is_shown: bool,
    /// Whether points and events keep the numbers and classes of objects.
    is_exact: bool,
    mount: Pose,
}

/// One topic.
pub struct Topic {
    /// Name without the domain.
    pub name: String,
    /// What it carries.
    pub modality: Modality,
    /// Frames sent and lost so far.
    pub counts: FrameCounts,
    /// Event of the topic's own name, so that its readers wait for no other frame of the rig.
    wake: Notifier,
    memory: TopicMemory,
    /// Its frames that stay on the GPU; `None` where they cannot.
    on_gpu: Option<OnGpu>,
    limits: TopicLimits,
    /// Of a topic whose frames depend on whether the one before was made.
    made: Option<Made>,
    /// What the journal that is run again says about that.
    told: Option<bool>,
    /// Whether the frame of this firing is asked for, if another process decides that.
    asked: Option<bool>,
    seal: Option<TopicSeal>,
}

/// Slots for one image: in shared memory, and on the GPU.
#[derive(Debug, Default)]
pub struct Loans {
    /// For readers of shared memory.
    pub host: Option<FrameLoan>,
    /// For readers on the GPU, with the place that it is to a submission.
    pub gpu: Option<(GpuLoan, Place<'static>)>,
}

impl Loans {
    fn is_empty(&self) -> bool {
        self.host.is_none() && self.gpu.is_none()
    }
}

/// What became of a topic's frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounts {
    /// Frames sent.
    pub n_sent: u64,
    /// Frames lost because no slot was free.
    pub n_dropped: u64,
    /// Events that did not fit into their frame.
    pub n_overflowed: u64,
}

impl FrameCounts {
    /// The sum of both.
    pub fn with(self, other: &FrameCounts) -> FrameCounts {
        FrameCounts {
            n_sent: self.n_sent + other.n_sent,
            n_dropped: self.n_dropped + other.n_dropped,
            n_overflowed: self.n_overflowed + other.n_overflowed,
        }
    }
}

impl TopicSeal {
    fn blanks(&self, modality: Modality) -> bool {
        !self.is_exact && !modality.sealed_bytes().is_empty()
    }
}

impl Topic {
    /// Opens a topic's services, and its memory if that lasts.
    pub fn open(
        bus: &Bus,
        gpu: Option<&Gpu>,
        spec: TopicSpec,
        options: &FrameOptions,
        life: MemoryLife,
        server: Option<&Arc<GpuServer>>,
    ) -> anyhow::Result<Topic> {
        let TopicSpec {
            name,
            modality,
            max_payload_bytes,
            limits,
            remembers,
            is_told,
            is_away,
            is_cast,
            vehicle_from_sensor,
        } = spec;
        let seal = options.seal.as_ref().map(|seal| TopicSeal {
            is_shown: seal.shows(&name),
            is_exact: seal.is_exact(&name),
            mount: schema_frames::sealed::mount(&vehicle_from_sensor),
        });
        let plan = MemoryPlan {
            modality,
            max_payload_bytes,
            limits,
            frames_in_flight: options.frames_in_flight,
            transfer: options.transfer,
            writer: match is_cast {
                true => Writer::Cpu,
                false => Writer::of(modality, options.lidars_on),
            },
            life,
            is_away,
        };
        let memory = TopicMemory::open(bus, gpu, &name, &plan)?;
        let wake = bus.notifier(&name)?;
        // What is blanked is blanked in shared memory.
        let is_blanked = seal.is_some_and(|seal| seal.blanks(modality));
        let can_stay = can_stay(modality) && !is_blanked;
        let on_gpu = server.filter(|_| can_stay).map(|server| {
            let options = Options {
                frames_in_flight: options.frames_in_flight as usize,
                is_away,
            };
            let offering = Offering { bus, gpu, server };
            OnGpu::offer(&offering, &name, max_payload_bytes, limits, options)
        });
        Ok(Topic {
            on_gpu,
            name,
            modality,
            counts: FrameCounts::default(),
            wake,
            memory,
            limits,
            made: remembers.then(Made::default),
            told: (remembers && is_told).then_some(false),
            asked: None,
            seal,
        })
    }

    /// Entry in `world/actors`.
    pub fn info(&self) -> TopicInfo {
        TopicInfo {
            topic: self.name.clone(),
            modality: self.modality.name().to_owned(),
        }
    }

    /// Number of readers, of shared memory and on the GPU.
    pub fn n_readers(&self) -> usize {
        self.memory.n_readers() + self.n_gpu_readers()
    }

    /// Number of readers on the GPU.
    pub fn n_gpu_readers(&self) -> usize {
        self.on_gpu.as_ref().map_or(0, OnGpu::n_readers)
    }

    /// Whether its frames are made.
    pub fn is_read(&self, audience: Audience) -> bool {
        if self.seal.is_some_and(|seal| !seal.is_shown) {
            return false;
        }
        if let Some(asked) = self.asked {
            return asked;
        }
        self.told != Some(false) && (audience == Audience::Hash || self.n_readers() > 0)
    }

    /// Whether its frames may be made at all: a journal may say that they were not.
    pub fn may_make(&self) -> bool {
        self.told != Some(false)
    }

    /// Notes that the image of this firing is made for somebody who reads it elsewhere.
    pub fn note_made(&mut self) {
        if let Some(made) = &mut self.made {
            made.is_made = true;
        }
    }

    /// Whether the frame of this firing is made, as the process decides that owns the world.
    pub fn ask(&mut self, is_made: bool) {
        self.asked = Some(is_made);
    }

    /// Readers decide again.
    pub fn ask_no_more(&mut self) {
        self.asked = None;
    }

    /// Whether the frame of this firing is to be made by the process that writes the topic; notes
    /// the answer as that of a frame which is made here.
    pub fn ask_away(&mut self, audience: Audience) -> bool {
        let is_made = self.is_read(audience);
        if let Some(made) = &mut self.made {
            made.is_made = is_made;
        }
        is_made
    }

    /// Another process writes the frames from now on, on its own GPU too. No frame may be in flight.
    pub fn leave(&mut self, bus: &Bus, gpu: Option<&Gpu>) {
        let on_gpu = self.on_gpu.as_mut();
        let left = on_gpu.map_or(Ok(()), |on_gpu| on_gpu.leave(bus, gpu));
        if let Err(error) = left.and(self.memory.leave(bus, gpu, &self.name)) {
            tracing::warn!(
                topic = self.name,
                error = format!("{error:#}"),
                "a topic could not be handed over"
            );
        }
    }

    /// The frames are written here again.
    pub fn come_back(&mut self) {
        self.memory.come_back();
        if let Some(on_gpu) = &mut self.on_gpu {
            on_gpu.come_back();
        }
    }

    /// Limits and life of its memory, for whoever writes the frames.
    pub fn plan(&self) -> (TopicLimits, MemoryLife) {
        (self.limits, self.memory.life())
    }

    /// Follows what a journal says about its frames; `None` follows readers again.
    pub fn tell(&mut self, is_made: Option<bool>) {
        self.told = self.made.and(is_made);
    }

    /// Where the GPU writes; `None` without memory, or if the CPU makes the frames.
    pub fn target(&self) -> Option<&ShmTarget> {
        self.memory.target().map(|target| &**target)
    }

    /// A slot of this topic for the GPU to write to, and the place that it is to a submission.
    ///
    /// Panics if the CPU makes the topic's frames.
    pub fn lend(&self, loan: FrameLoan) -> (DeviceLoan, Place<'static>) {
        let target = self.memory.target();
        let target = target.expect("topics of the GPU have a target while they have memory");
        import::lend(target, loan, self.max_payload_bytes())
    }

    /// Most payload bytes of a frame.
    pub fn max_payload_bytes(&self) -> usize {
        self.memory.max_payload_bytes()
    }

    /// Most records of a frame that is a list.
    pub fn max_elements(&self) -> u32 {
        (self.max_payload_bytes() / self.modality.element_bytes()) as u32
    }

    /// Whether its frames are made from the last firing on, or no longer, where that matters to
    /// later frames; `None` if that did not change since the last call.
    pub fn take_change(&mut self) -> Option<bool> {
        let made = self.made.as_mut()?;
        (made.is_made != made.was_made).then(|| {
            made.was_made = made.is_made;
            made.is_made
        })
    }

    /// A slot of shared memory if somebody reads, wherever, and one is free; for frames that are
    /// made there first. Without a slot the frame is dropped and counted, and its `seq` is spent.
    pub fn loan_if_read(&mut self, audience: Audience) -> Option<FrameLoan> {
        let loan = self.is_read(audience).then(|| self.loan()).flatten();
        if let Some(made) = &mut self.made {
            made.is_made = loan.is_some();
        }
        loan
    }

    /// Whether the only readers of its frames are on the GPU.
    pub fn is_read_on_gpu_alone(&self, audience: Audience) -> bool {
        audience == Audience::Readers && self.memory.n_readers() == 0 && self.n_gpu_readers() > 0
    }

    /// Slots for a frame that the GPU makes, each where somebody reads.
    pub fn loans_if_read(&mut self, audience: Audience) -> Loans {
        let mut loans = Loans::default();
        if self.is_read(audience) {
            if audience == Audience::Hash || self.memory.n_readers() > 0 {
                loans.host = self.loan();
            }
            loans.gpu = self.loan_on_gpu();
        }
        if let Some(made) = &mut self.made {
            made.is_made = !loans.is_empty();
        }
        loans
    }

    fn loan_on_gpu(&mut self) -> Option<(GpuLoan, Place<'static>)> {
        match self.on_gpu.as_mut()?.loan() {
            Ok(loan) => loan,
            Err(error) => {
                self.drop_frame(&error);
                None
            }
        }
    }

    /// Counts a frame that is not sent, and says why the first time.
    pub fn drop_frame(&mut self, error: &dyn std::fmt::Display) {
        if self.counts.n_dropped == 0 {
            tracing::warn!(topic = self.name, %error, "frame dropped; further drops are only counted");
        }
        self.counts.n_dropped += 1;
    }

    fn loan(&mut self) -> Option<FrameLoan> {
        match self.memory.loan() {
            Ok(loan) => Some(loan),
            Err(error) => {
                self.drop_frame(&error);
                None
            }
        }
    }

    /// Sends a slot on the GPU, which the GPU has filled, and wakes its readers. `is_alone` if the
    /// frame was made nowhere else.
    pub fn send_on_gpu(&mut self, loan: GpuLoan, header: &FrameHeader, is_alone: bool) {
        let Some(on_gpu) = &self.on_gpu else {
            return;
        };
        let mut header = *header;
        if let Some(seal) = &self.seal {
            header.seal(seal.mount);
        }
        match on_gpu.send(loan, &header) {
            Ok(()) => self.counts.n_sent += u64::from(is_alone),
            Err(error) => self.drop_frame(&error),
        }
    }

    /// Sends a filled loan, and before it the same bytes to readers on the GPU: for lists, whose
    /// length is known only now.
    ///
    /// # Errors
    /// The GPU was lost.
    pub fn send_list(
        &mut self,
        gpu: Option<&Gpu>,
        mut loan: FrameLoan,
        header: FrameHeader,
        audience: Audience,
    ) -> anyhow::Result<()> {
        if self.n_gpu_readers() > 0
            && let Some(gpu) = gpu
            && let Some((on_gpu, place)) = self.loan_on_gpu()
        {
            let bytes = &loan.payload_mut()[..header.payload_bytes as usize];
            gpu.upload(&[(place, bytes)])?;
            let uploaded = FrameHeader {
                cpu_copies: header.cpu_copies + 1,
                ..header
            };
            self.send_on_gpu(on_gpu, &uploaded, false);
        }
        self.send(loan, header, audience);
        Ok(())
    }

    /// Sends a filled loan and wakes those who wait for this topic, at once: what is sent after it
    /// would only keep them waiting, and costs no less.
    pub fn send(&mut self, mut loan: FrameLoan, mut header: FrameHeader, audience: Audience) {
        if let Some(seal) = &self.seal {
            header.seal(seal.mount);
            if seal.blanks(self.modality) {
                self.modality
                    .blank(&mut loan.payload_mut()[..header.payload_bytes as usize]);
            }
        }
        *loan.header_mut() = header;
        if audience == Audience::Hash {
            let payload = &loan.payload_mut()[..header.payload_bytes as usize];
            let hash = BytesHash::new()
                .chunk(header.hashed_bytes())
                .chunk(payload)
                .finish();
            println!("{} {} {hash:016x}", header.tick, self.name);
        }
        match loan.send() {
            Ok(_) => {
                self.counts.n_sent += 1;
                self.wake.notify_listeners();
            }
            Err(error) => {
                tracing::warn!(topic = self.name, %error, "frame could not be sent");
                self.counts.n_dropped += 1;
            }
        }
    }

    /// Asks for memory that holds frames of `max_payload_bytes`; [`Topic::settle`] makes it.
    pub fn fit(&mut self, max_payload_bytes: usize) {
        self.memory.fit(max_payload_bytes);
        if let Some(on_gpu) = &mut self.on_gpu {
            on_gpu.fit(max_payload_bytes);
        }
    }

    /// Whether [`Topic::settle`] has something to do.
    pub fn is_unsettled(&mut self, now_nanos: u64) -> bool {
        let is_list = !self.modality.is_image();
        let is_needed = is_list && self.n_gpu_readers() > 0;
        self.memory.need(is_needed);
        let on_gpu = self.on_gpu.as_mut();
        self.memory.is_unsettled(now_nanos)
            | on_gpu.is_some_and(|on_gpu| on_gpu.is_unsettled(now_nanos))
    }

    /// Opens the memory for the first reader, gives it back after the last, or makes it larger.
    /// No frame may be in flight.
    pub fn settle(&mut self, bus: &Bus, gpu: Option<&Gpu>) {
        let now_nanos = mono_now().0;
        // From being asked to having memory there are two steps, which both come before the tick.
        while let Some(on_gpu) = &mut self.on_gpu
            && on_gpu.is_unsettled(now_nanos)
        {
            if let Err(error) = on_gpu.settle(bus, gpu)
                && on_gpu.refuse(now_nanos)
            {
                tracing::warn!(
                    topic = self.name,
                    error = format!("{error:#}"),
                    "a topic has no frames on the GPU; asking again every second"
                );
            }
        }
        if !self.memory.is_unsettled(now_nanos) {
            return;
        }
        if let Err(error) = self.memory.settle(bus, gpu, &self.name)
            && self.memory.refuse(mono_now().0)
        {
            tracing::warn!(
                topic = self.name,
                error = format!("{error:#}"),
                "a topic did not get the memory that it needs, and has no frames until it does; asking again every second"
            );
        }
    }

    /// Gives everything back, memory last. No frame may be in flight.
    pub fn close(self, gpu: Option<&Gpu>) {
        if let Some(on_gpu) = self.on_gpu {
            on_gpu.close(gpu);
        }
        self.memory.close(gpu);
    }
}
