//! A sensor: a passive actor in the world, a schedule, a model and its topics.
//!
//! Because it is an actor, its pose in the snapshot and its pose in its frames are one value.

mod model;
mod stream;

use std::rc::Rc;
use std::sync::Arc;

use launch_cli::wrong_usage;
use launch_spec::TopicLimits;
use schema_bus::{Bus, GpuServer};
use schema_frames::Modality;
use schema_frames::document::TopicInfo;
use schema_types::{ActorId, Pose, SimTime, Tick};
use sensor_core::schedule::Schedule;
use sensor_gpu::Gpu;
use sensor_spec::{LidarScan, SensorSpec};

use crate::rig::Rig;
use crate::topic::{Audience, FrameOptions, MemoryLife, Topic, TopicSpec};
pub use model::Model;
pub use stream::NoiseStream;

/// One sensor.
pub struct Sensor {
    /// Its actor.
    pub actor: ActorId,
    /// Name on its rig.
    pub name: String,
    /// Its rig.
    pub rig: Rc<Rig>,
    /// The rig's entry in the launch file. `None` if a command made the sensor, which then ends
    /// with its episode, and for the spectator.
    pub launch_rig: Option<launch_spec::Rig>,
    /// What was asked for.
    pub spec: SensorSpec,
    /// When it fires.
    pub schedule: Schedule,
    /// One per modality.
    pub topics: Vec<Topic>,
    /// State of its model.
    pub model: Model,
    /// Stream of its noise. It does not depend on which other sensors exist, so that they do not
    /// change this sensor's bytes.
    pub stream: NoiseStream,
    /// The last tick before the sensor was made, from which the ticks of its noise count.
    pub made_at: Tick,
    /// Frames of an event-like sensor so far, read or not.
    pub n_event_frames: u64,
    /// `CLOCK_MONOTONIC` before which it makes no images, because the GPU had no memory for them.
    pub refused_until_nanos: u64,
    /// Whether it was added to an old run.
    pub is_added: bool,
    /// What it is to the run.
    pub role: Role,
    /// Which process makes its frames.
    pub maker: Maker,
    /// How often it began anew: with an episode, or when the world jumped to another state.
    pub n_beginnings: u32,
    /// Actors that its images leave out.
    pub hidden: Vec<ActorId>,
}

/// Which process makes the frames of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Maker {
    /// This one.
    Here,
    /// The render worker of this number.
    Worker(u32),
    /// No process: it is being handed over, or there is neither a GPU nor a worker.
    Nobody,
}

/// What a sensor is to the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// It measures.
    Sensor,
    /// It is what people look at: made only for readers, left out of hashes, with texts in its
    /// image, and its actor is the world's own.
    Spectator,
}

/// Identity of a sensor, before it has a schedule and topics.
pub struct SensorIdentity {
    /// Its rig.
    pub rig: Rc<Rig>,
    /// See [`Sensor::launch_rig`].
    pub launch_rig: Option<launch_spec::Rig>,
    /// Name on the rig; empty if the rig is all that its topics are named after.
    pub name: String,
    /// Its actor.
    pub actor: ActorId,
    /// See [`Sensor::stream`].
    pub stream: NoiseStream,
    /// See [`Sensor::is_added`].
    pub is_added: bool,
    /// See [`Sensor::role`].
    pub role: Role,
}

/// What opening a sensor needs besides the sensor.
pub struct OpenContext<'a> {
    /// Where its topics are published.
    pub bus: &'a Bus,
    /// What renders its views.
    pub gpu: Option<&'a Gpu>,
    /// Where readers ask for frames that stay on the GPU; `None` if they cannot.
    pub server: Option<&'a Arc<GpuServer>>,
    /// How its frames are made.
    pub frames: &'a FrameOptions,
    /// How long its topics have memory.
    pub memory: MemoryLife,
    /// Gives topics their limits.
    pub limits: &'a dyn Fn(&str) -> TopicLimits,
    /// Seed of the run.
    pub seed: u64,
    /// The last tick that was begun.
    pub tick: Tick,
    /// Length of a tick.
    pub period_nanos: u64,
    /// Whether a journal that is run again tells which topics have frames, where that matters.
    pub is_told: bool,
    /// Whether another process makes the images of cameras.
    pub cameras_are_away: bool,
}

impl Sensor {
    /// Opens a sensor's topics and makes its model.
    pub fn open(
        context: &OpenContext<'_>,
        identity: SensorIdentity,
        spec: SensorSpec,
        schedule: Schedule,
    ) -> anyhow::Result<Sensor> {
        let SensorIdentity {
            rig,
            launch_rig,
            name,
            actor,
            stream,
            is_added,
            role,
        } = identity;
        let mut topics = Vec::new();
        let is_camera = matches!(spec, SensorSpec::Camera(_));
        // Rays need no GPU, and with one at hand the colour of such a camera is made beside its labels.
        let has_lens = spec.has_lens();
        if has_lens && context.gpu.is_none() && spec.modalities().contains(&Modality::Rgb) {
            return Err(wrong_usage(format!(
                "sensor {name:?} has rgb through lens.model, which render workers do not make; start the daemon without --no-gpu, or leave rgb out"
            )));
        }
        let is_away = is_camera && !has_lens && (context.cameras_are_away || context.gpu.is_none());
        let tick_secs = context.period_nanos as f64 * 1e-9;
        let vehicle_from_sensor = match launch_rig {
            Some(launch_spec::Rig::Ego | launch_spec::Rig::Other(_)) => {
                spec.mount().vehicle_from_sensor().into()
            }
            Some(launch_spec::Rig::Free(_)) | None => Pose::IDENTITY,
        };
        for modality in spec.modalities() {
            let of_sensor = if name.is_empty() { "" } else { "/" };
            let topic_name = format!("{}{of_sensor}{name}/{}", rig.name, modality.name());
            let topic = TopicSpec {
                limits: (context.limits)(&topic_name),
                name: topic_name,
                modality,
                max_payload_bytes: spec.max_payload_bytes(modality, tick_secs),
                remembers: role == Role::Sensor && spec.remembers(modality),
                is_told: context.is_told && !is_added,
                is_away,
                is_cast: has_lens && modality != Modality::Rgb,
                vehicle_from_sensor,
            };
            topics.push(Topic::open(
                context.bus,
                context.gpu,
                topic,
                context.frames,
                context.memory,
                context.server,
            )?);
        }
        let sensor_id = (stream.number() ^ (stream.number() >> 32)) as u32;
        let shows_overlay = role == Role::Spectator;
        let model = Model::new(&spec, context.seed, sensor_id, shows_overlay);
        Ok(Sensor {
            actor,
            name,
            rig,
            launch_rig,
            spec,
            schedule,
            topics,
            model,
            stream,
            made_at: context.tick,
            n_event_frames: 0,
            refused_until_nanos: 0,
            is_added,
            role,
            maker: if is_away { Maker::Nobody } else { Maker::Here },
            n_beginnings: 0,
            hidden: Vec::new(),
        })
    }

    /// The tick to which its next frame looks back, if rays of it see what moves where it was when
    /// they were fired: that of its last firing, or the tick before for the sweep of one tick.
    pub fn looks_back_to(&self, now: SimTime) -> Option<SimTime> {
        match (&self.spec, self.schedule.last_fired()) {
            _ if !self.model.looks_back() => None,
            (SensorSpec::Lidar(spec), Some(fired)) if spec.scan == LidarScan::Turn => Some(fired),
            _ => Some(now),
        }
    }

    /// Whether it ends with the episode: a command made it.
    pub fn is_of_episode(&self) -> bool {
        self.launch_rig.is_none() && self.role == Role::Sensor
    }

    /// What its topics show.
    pub fn modalities(&self) -> Vec<Modality> {
        self.topics.iter().map(|topic| topic.modality).collect()
    }

    /// What its view makes of that.
    pub fn rendered(&self) -> Vec<Modality> {
        let topics = self.topics.iter().map(|topic| topic.modality);
        topics.filter(|it| self.model.renders(*it)).collect()
    }

    /// Its topics, for `world/actors`.
    pub fn topic_infos(&self) -> Vec<TopicInfo> {
        self.topics.iter().map(Topic::info).collect()
    }

    /// Whether its frames are made for readers alone, if those of sensors are made for `audience`.
    pub fn audience(&self, audience: Audience) -> Audience {
        match self.role {
            Role::Sensor => audience,
            Role::Spectator => Audience::Readers,
        }
    }

    /// Starts over in a new episode: schedule and model as if just made, on a new actor.
    pub fn begin_episode(
        &mut self,
        actor: ActorId,
        tick: Tick,
        made_at: SimTime,
        period_nanos: u64,
    ) {
        (self.actor, self.made_at) = (actor, tick);
        self.schedule = schedule_of(&self.spec, made_at, period_nanos);
        self.n_event_frames = 0;
        self.forget();
    }

    /// Forgets what it saw, because the world jumped to another state.
    pub fn forget(&mut self) {
        self.n_beginnings += 1;
        self.model.reset();
    }

    /// Leaves actors out of its images from now on, and no others; `false` if it is no camera.
    pub fn hide(&mut self, actors: &[ActorId]) -> bool {
        match &mut self.model {
            Model::View(view) => view.hide(actors.iter().copied()),
            Model::Lens(camera) => camera.hide(actors),
            _ => return false,
        }
        self.hidden = actors.to_vec();
        true
    }

    /// Another process makes its frames, or this one does again. What the model saw is forgotten. No
    /// frame may be in flight.
    pub fn hand_over(&mut self, maker: Maker, bus: &Bus, gpu: Option<&Gpu>) {
        if let Some(view) = self.model.view_mut() {
            view.release();
        }
        for topic in &mut self.topics {
            match maker {
                Maker::Here => topic.come_back(),
                _ => topic.leave(bus, gpu),
            }
        }
        self.maker = maker;
    }

    /// Asks for larger memory where a tick of this length can fill a larger frame.
    pub fn fit_topics(&mut self, period_nanos: u64) {
        for topic in &mut self.topics {
            topic.fit(
                self.spec
                    .max_payload_bytes(topic.modality, period_nanos as f64 * 1e-9),
            );
        }
    }
}

/// The rig of this name: that of the sensors which have it already, else a new one.
pub fn shared_rig(sensors: &[Sensor], bus: &Bus, name: &str) -> anyhow::Result<Rc<Rig>> {
    match sensors.iter().find(|sensor| sensor.rig.name == name) {
        Some(sensor) => Ok(sensor.rig.clone()),
        None => Rig::open(bus, name),
    }
}

/// When a sensor of a launch file fires.
pub fn schedule_of(spec: &SensorSpec, made_at: SimTime, period_nanos: u64) -> Schedule {
    match spec.rate_hz() {
        Some(rate_hz) => Schedule::from_rate(made_at, rate_hz, period_nanos),
        None => Schedule::new(made_at, 0),
    }
}
