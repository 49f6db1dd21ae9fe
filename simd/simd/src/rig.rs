//! Sensors and their topics: from a launch file's tables to publishers in shared memory.
//!
//! A sensor is a passive actor in the world (so its pose in the snapshot and in its frames is one
//! value) plus a schedule and a model.
//! A topic is one modality of it: one publisher whose segment the GPU may have imported.

use std::rc::Rc;
use std::sync::Arc;

use anyhow::{Context as _, anyhow};
use nalgebra::Isometry3;
use schema_bus::{Bus, FrameLoan, FramePublisher, FrameService, FrameTopic, Notifier, mono_now};
use schema_frames::document::TopicInfo;
use schema_frames::{Modality, RadarDetection, SensorKind};
use schema_types::{ActorId, SimTime};
use sensor_camera::{View, ViewSpec};
use sensor_core::imu::BodyMotion;
use sensor_core::lane_marks::Corners;
use sensor_core::schedule::Schedule;
use sensor_gpu::{Gpu, ShmTarget};
use sensor_ray::Lidar;
use sensor_spec::SensorSpec;

use crate::frames::Carrier;
use crate::hash::BytesHash;
use crate::import;

/// All sensors with the same first topic segment; they share one wake-up per tick. Goes with its
/// last sensor.
pub struct Rig {
    /// First segment of its topics.
    pub name: String,
    /// Event `<rig>/tick`.
    pub wake: Notifier,
}

/// One sensor.
pub struct Sensor {
    /// Its actor.
    pub actor: ActorId,
    /// Name on its rig.
    pub name: String,
    /// Its rig.
    pub rig: Rc<Rig>,
    /// Where it belongs in the launch file; `None` if a command made it: then it goes with its
    /// episode.
    pub place: Option<launch_spec::Rig>,
    /// What was asked for.
    pub spec: SensorSpec,
    /// When it fires.
    pub schedule: Schedule,
    /// One per modality.
    pub topics: Vec<Topic>,
    /// Its model's state.
    pub model: Model,
    /// Keeps its noise apart from that of others. Says nothing of who else exists: bytes do not
    /// depend on other sensors.
    pub stream: u64,
    /// Frames of an event-like sensor so far, read or not.
    pub n_event_frames: u64,
}

/// What a sensor remembers between firings.
pub enum Model {
    /// A view of the renderer.
    View(Box<View>),
    /// Lidar: its beam tables, and the pose at its previous firing for motion distortion.
    Lidar {
        /// Beams and memory of the last turn.
        lidar: Box<Lidar>,
        /// Pose at the previous firing.
        previous: Option<Isometry3<f64>>,
        /// Poses at the previous tick and at this one.
        ticks: [Option<Isometry3<f64>>; 2],
    },
    /// Radar: memory of its last detections.
    Radar(Vec<RadarDetection>),
    /// IMU: the motion of the body it sits on.
    Imu(BodyMotion),
    /// GNSS.
    Gnss,
    /// Obstacle detector.
    Obstacle,
    /// Collision detector.
    Collision,
    /// Lane invasion detector: where its carrier's box was at the previous tick.
    LaneInvasion {
        /// Lower corners.
        corners: Option<Corners>,
    },
}

impl Model {
    /// Whether it needs the scene's triangles as rays see them.
    pub fn casts_rays(&self) -> bool {
        matches!(
            self,
            Model::Lidar { .. } | Model::Radar(_) | Model::Obstacle
        )
    }

    /// Takes note of a tick, whether the sensor fires or not.
    pub fn follow(&mut self, carrier: &Carrier) {
        match self {
            Model::Imu(motion) => motion.push(carrier.body),
            Model::Lidar { ticks, .. } => {
                *ticks = [ticks[1], Some(carrier.world_from_sensor.isometry())]
            }
            _ => {}
        }
    }

    /// Forgets everything, as if just made.
    fn reset(&mut self) {
        match self {
            Model::View(view) => view.reset(),
            Model::Lidar {
                lidar,
                previous,
                ticks,
            } => {
                lidar.reset();
                (*previous, *ticks) = (None, [None; 2]);
            }
            Model::Imu(motion) => motion.reset(),
            Model::LaneInvasion { corners } => *corners = None,
            Model::Radar(_) | Model::Gnss | Model::Obstacle | Model::Collision => {}
        }
    }
}

/// The writing end of a topic.
enum Outlet {
    /// Readers can find it, it has no memory.
    Idle(FrameService),
    /// It has memory, and the GPU's view of it (`None` for what the CPU makes).
    Open {
        publisher: FramePublisher,
        target: Option<Arc<ShmTarget>>,
    },
    /// Between the two; seen only if reopening failed.
    Closed,
}

/// One topic.
pub struct Topic {
    /// Name without the domain.
    pub name: String,
    /// What it carries.
    pub modality: Modality,
    /// Most payload bytes of a frame.
    pub max_payload_bytes: usize,
    /// Event of the topic's own name, for readers that want no other frame of the rig.
    pub wake: Notifier,
    /// Frames sent.
    pub n_sent: u64,
    /// Frames lost because no slot was free.
    pub n_dropped: u64,
    /// Events that did not fit into their frame.
    pub n_overflowed: u64,
    outlet: Outlet,
    /// Whether the GPU writes its frames.
    by_gpu: bool,
    spec: FrameTopic,
    /// Memory comes with the first reader and goes [`LINGER_NANOS`] after the last.
    on_demand: bool,
    last_read_nanos: u64,
    /// Memory must be made anew, larger.
    outgrown: bool,
}

/// Memory of a topic made at run time outlives its last reader by this much, so that a reader that
/// comes back soon costs nothing.
const LINGER_NANOS: u64 = 5_000_000_000;

/// What [`Sensor::open`] needs besides the sensor.
#[derive(Clone, Copy, Debug)]
pub struct TopicOptions {
    /// Frames of one topic that may be on the GPU at once.
    pub frames_in_flight: u32,
    /// Copy on the CPU even if the GPU could write in place.
    pub staged: bool,
    /// Whether the GPU casts lidars.
    pub lidars_on_gpu: bool,
    /// Seed of the run.
    pub seed: u64,
    /// Memory only while somebody reads.
    pub on_demand: bool,
    /// Length of a tick.
    pub period_nanos: u64,
}

impl Topic {
    fn open(
        bus: &Bus,
        gpu: &Gpu,
        name: String,
        modality: Modality,
        max_payload_bytes: usize,
        options: &TopicOptions,
    ) -> anyhow::Result<Topic> {
        let usual = if options.on_demand {
            FrameTopic::of_run_time_sensor(modality, max_payload_bytes)
        } else {
            FrameTopic::new(modality, max_payload_bytes)
        };
        let spec = FrameTopic {
            frames_in_flight: options.frames_in_flight as usize,
            ..usual
        };
        let service = bus
            .frame_service(&name, spec)
            .with_context(|| format!("cannot publish {name:?}"))?;
        check_room(&name, &service, 0)?;
        let wake = bus.notifier(&name)?;
        let by_gpu = match modality.sensor_kind() {
            SensorKind::Camera => true,
            SensorKind::Lidar => options.lidars_on_gpu,
            _ => false,
        };
        let outlet = if options.on_demand {
            Outlet::Idle(service)
        } else {
            open_outlet(service, gpu, by_gpu, options.staged)?
        };
        Ok(Topic {
            name,
            modality,
            max_payload_bytes,
            wake,
            n_sent: 0,
            n_dropped: 0,
            n_overflowed: 0,
            by_gpu,
            outlet,
            spec,
            on_demand: options.on_demand,
            last_read_nanos: mono_now().0,
            outgrown: false,
        })
    }

    /// Readers that are there now.
    pub fn n_readers(&self) -> usize {
        match &self.outlet {
            Outlet::Idle(service) => service.n_readers(),
            Outlet::Open { publisher, .. } => publisher.n_readers(),
            Outlet::Closed => 0,
        }
    }

    /// Where the GPU writes; `None` without memory, or if the CPU makes the frames.
    pub fn target(&self) -> Option<&Arc<ShmTarget>> {
        match &self.outlet {
            Outlet::Open { target, .. } => target.as_ref(),
            _ => None,
        }
    }

    /// A slot of its memory.
    pub fn loan(&self) -> Result<FrameLoan, String> {
        match &self.outlet {
            Outlet::Open { publisher, .. } => publisher
                .loan(self.max_payload_bytes)
                .map_err(|error| error.to_string()),
            _ => Err(format!("{:?} has no memory", self.name)),
        }
    }

    /// Whether [`Topic::settle`] has something to do: the memory of a topic made at run time comes
    /// and goes with its readers.
    pub fn is_unsettled(&mut self, now_nanos: u64) -> bool {
        if self.outgrown {
            return true;
        }
        if !self.on_demand {
            return !matches!(self.outlet, Outlet::Open { .. });
        }
        let n_readers = self.n_readers();
        if n_readers > 0 {
            self.last_read_nanos = now_nanos;
        }
        match &self.outlet {
            Outlet::Open { .. } => now_nanos.saturating_sub(self.last_read_nanos) > LINGER_NANOS,
            _ => n_readers > 0,
        }
    }

    /// Opens the memory for the first reader, or gives it back after the last. Nothing may be in
    /// flight.
    pub fn settle(&mut self, bus: &Bus, gpu: &Gpu, staged: bool) -> anyhow::Result<()> {
        if std::mem::take(&mut self.outgrown) {
            return self.grow(bus, gpu, staged);
        }
        self.outlet = match std::mem::replace(&mut self.outlet, Outlet::Closed) {
            Outlet::Idle(service) => open_outlet(service, gpu, self.by_gpu, staged)?,
            Outlet::Open { publisher, target } => {
                close_outlet(publisher, target, gpu);
                Outlet::Idle(bus.frame_service(&self.name, self.spec)?)
            }
            Outlet::Closed => Outlet::Idle(bus.frame_service(&self.name, self.spec)?),
        };
        Ok(())
    }

    /// Makes the memory anew in the size that is needed now; readers stay connected. Where it does
    /// not fit, the topic keeps what it has, and its
    /// frames what goes into that.
    fn grow(&mut self, bus: &Bus, gpu: &Gpu, staged: bool) -> anyhow::Result<()> {
        let (had_bytes, needed_bytes) = (self.max_payload_bytes, self.spec.max_payload_bytes);
        let Err(error) = self.reopen(bus, gpu, staged) else {
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

    fn reopen(&mut self, bus: &Bus, gpu: &Gpu, staged: bool) -> anyhow::Result<()> {
        // Of the same name, so the service itself never goes.
        let service = bus.frame_service(&self.name, self.spec)?;
        let was_open = matches!(self.outlet, Outlet::Open { .. });
        if was_open {
            // Readers hold on to the old memory for a while; without them it is free when it is
            // closed.
            let before = FrameTopic {
                max_payload_bytes: self.max_payload_bytes,
                ..self.spec
            };
            let given_back = if self.n_readers() == 0 {
                bus.frame_service(&self.name, before)?.segment_bytes()
            } else {
                0
            };
            check_room(&self.name, &service, given_back)?;
        }
        let outlet = std::mem::replace(&mut self.outlet, Outlet::Closed);
        if let Outlet::Open { publisher, target } = outlet {
            close_outlet(publisher, target, gpu);
        }
        self.max_payload_bytes = self.spec.max_payload_bytes;
        self.outlet = if was_open {
            open_outlet(service, gpu, self.by_gpu, staged)?
        } else {
            Outlet::Idle(service)
        };
        Ok(())
    }

    /// Gives everything back, memory last. Nothing may be in flight.
    pub fn close(self, gpu: &Gpu) {
        if let Outlet::Open { publisher, target } = self.outlet {
            close_outlet(publisher, target, gpu);
        }
    }
}

/// Whether the memory of a topic fits into what is free once `given_back` bytes are.
fn check_room(name: &str, service: &FrameService, given_back: u64) -> anyhow::Result<()> {
    schema_bus::check_shared_memory(service.segment_bytes(), given_back)
        .map_err(|short| anyhow!("no room for {name:?}: {short}"))
}

fn open_outlet(
    service: FrameService,
    gpu: &Gpu,
    by_gpu: bool,
    staged: bool,
) -> anyhow::Result<Outlet> {
    let publisher = service.publisher()?;
    publisher.touch()?;
    let segment = publisher.segment()?;
    let target = by_gpu.then(|| Arc::new(import::target(gpu, &segment, staged)));
    Ok(Outlet::Open { publisher, target })
}

/// The order matters: the GPU lets go of the memory before its publisher unmaps it.
fn close_outlet(publisher: FramePublisher, target: Option<Arc<ShmTarget>>, gpu: &Gpu) {
    drop(target);
    gpu.wait_idle();
    drop(publisher);
}

impl Sensor {
    /// Opens a sensor's topics and makes its model.
    pub fn open(
        bus: &Bus,
        gpu: &Gpu,
        place: SensorPlace,
        spec: SensorSpec,
        schedule: Schedule,
        options: &TopicOptions,
    ) -> anyhow::Result<Sensor> {
        let mut topics = Vec::new();
        let tick_secs = options.period_nanos as f64 * 1e-9;
        for modality in spec.modalities() {
            let name = format!("{}/{}/{}", place.rig.name, place.name, modality.name());
            topics.push(Topic::open(
                bus,
                gpu,
                name,
                modality,
                spec.max_payload_bytes(modality, tick_secs),
                options,
            )?);
        }
        let model = match &spec {
            SensorSpec::Camera(camera) => Model::View(Box::new(View::new(
                gpu,
                ViewSpec {
                    intrinsics: camera.intrinsics(),
                    dvs: camera.dvs.clone(),
                    optics: camera.optics.clone(),
                    seed: options.seed,
                    sensor_id: (place.stream ^ (place.stream >> 32)) as u32,
                },
            ))),
            SensorSpec::Lidar(lidar) => Model::Lidar {
                lidar: Box::new(Lidar::new(lidar.clone())),
                previous: None,
                ticks: [None; 2],
            },
            SensorSpec::Imu(_) => Model::Imu(BodyMotion::default()),
            SensorSpec::Gnss(_) => Model::Gnss,
            SensorSpec::Radar(_) => Model::Radar(Vec::new()),
            SensorSpec::Obstacle(_) => Model::Obstacle,
            SensorSpec::Collision(_) => Model::Collision,
            SensorSpec::LaneInvasion(_) => Model::LaneInvasion { corners: None },
        };
        let SensorPlace {
            rig,
            place,
            name,
            actor,
            stream,
        } = place;
        Ok(Sensor {
            actor,
            name,
            rig,
            place,
            spec,
            schedule,
            topics,
            model,
            stream,
            n_event_frames: 0,
        })
    }

    /// Its topics, for `world/actors`.
    pub fn topic_infos(&self) -> Vec<TopicInfo> {
        let info = |topic: &Topic| TopicInfo {
            topic: topic.name.clone(),
            modality: topic.modality.name().to_owned(),
        };
        self.topics.iter().map(info).collect()
    }

    /// Starts over in a new episode: schedule and memory as if just made, on a new actor.
    pub fn begin_episode(&mut self, actor: ActorId, made_at: SimTime, period_nanos: u64) {
        self.actor = actor;
        self.schedule = schedule_of(&self.spec, made_at, period_nanos);
        self.n_event_frames = 0;
        self.forget();
    }

    /// Nothing of what was before is remembered: the world went elsewhere.
    pub fn forget(&mut self) {
        self.model.reset();
    }

    /// Marks topics whose memory is too small for ticks of this length.
    pub fn fit_topics(&mut self, period_nanos: u64) {
        for topic in &mut self.topics {
            let needed = self
                .spec
                .max_payload_bytes(topic.modality, period_nanos as f64 * 1e-9);
            if needed > topic.max_payload_bytes {
                topic.spec.max_payload_bytes = needed;
                topic.outgrown = true;
            }
        }
    }
}

/// When a sensor of a launch file fires.
pub fn schedule_of(spec: &SensorSpec, made_at: SimTime, period_nanos: u64) -> Schedule {
    match spec.rate_hz() {
        Some(rate_hz) => Schedule::from_rate(made_at, rate_hz, period_nanos),
        None => Schedule::new(made_at, 0),
    }
}

/// Stream of noise of a sensor that is told apart by `parts`.
pub fn noise_stream(parts: &[&[u8]]) -> u64 {
    parts
        .iter()
        .fold(BytesHash::new(), |hash, part| hash.chunk(part))
        .finish()
}

/// Where a sensor belongs.
#[derive(Clone)]
pub struct SensorPlace {
    /// Its rig.
    pub rig: Rc<Rig>,
    /// The rig's entry in the launch file; `None` for a sensor that a command made.
    pub place: Option<launch_spec::Rig>,
    /// Sensor's name on the rig.
    pub name: String,
    /// Its actor.
    pub actor: ActorId,
    /// Its noise, see [`Sensor::stream`].
    pub stream: u64,
}
