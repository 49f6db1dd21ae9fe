//! Sensors and their topics: from a launch file's tables to publishers in shared memory.
//!
//! A sensor is a passive actor in the world (so its pose in the snapshot and in its frames is one value) plus a schedule and a model.
//! A topic is one modality of it: one publisher whose segment the GPU may have imported.

use std::sync::Arc;

use anyhow::Context as _;
use nalgebra::Isometry3;
use schema_bus::{Bus, FramePublisher, FrameTopic, Notifier};
use schema_frames::document::TopicInfo;
use schema_frames::{Modality, SensorKind};
use schema_types::{ActorId, SimTime};
use sensor_camera::{View, ViewSpec};
use sensor_core::imu::BodyMotion;
use sensor_core::schedule::Schedule;
use sensor_gpu::{Gpu, ShmTarget};
use sensor_ray::Lidar;
use sensor_spec::SensorSpec;

use crate::import;

/// All sensors with the same first topic segment; they share one wake-up per tick.
pub struct Rig {
    /// First segment of its topics.
    pub name: String,
    /// Event `<rig>/tick`.
    pub wake: Notifier,
    /// What it is mounted on.
    pub place: launch_spec::Rig,
}

/// One sensor.
pub struct Sensor {
    /// Its actor.
    pub actor: ActorId,
    /// Index into the rigs.
    pub rig_idx: usize,
    /// What was asked for.
    pub spec: SensorSpec,
    /// When it fires.
    pub schedule: Schedule,
    /// One per modality.
    pub topics: Vec<Topic>,
    /// Its model's state.
    pub model: Model,
}

/// What a sensor remembers between firings.
pub enum Model {
    /// A view of the renderer.
    View(Box<View>),
    /// Lidar: its beam tables, and the pose at its previous firing for motion distortion.
    Lidar {
        /// Beams and memory of the last turn.
        lidar: Box<Lidar>,
        /// Pose at the end of the previous turn.
        previous: Option<Isometry3<f64>>,
    },
    /// IMU: the motion of the body it sits on.
    Imu(BodyMotion),
    /// GNSS.
    Gnss,
}

/// One topic.
pub struct Topic {
    /// Name without the domain.
    pub name: String,
    /// What it carries.
    pub modality: Modality,
    /// Where frames go.
    pub publisher: FramePublisher,
    /// Event of the topic's own name, for readers that want no other frame of the rig.
    pub wake: Notifier,
    /// The publisher's segment as the GPU sees it; `None` for what the CPU makes.
    /// Field order matters: the import is dropped before the publisher unmaps its segment only if `close` is used.
    pub target: Option<Arc<ShmTarget>>,
    /// Most payload bytes of a frame.
    pub max_payload_bytes: usize,
    /// Frames sent.
    pub n_sent: u64,
    /// Frames lost because no slot was free.
    pub n_dropped: u64,
    /// Events that did not fit into their frame.
    pub n_overflowed: u64,
}

/// What [`Topic::open`] and [`Sensor::open`] need besides the sensor.
pub struct TopicOptions {
    /// Frames of one topic that may be on the GPU at once.
    pub frames_in_flight: u32,
    /// Copy on the CPU even if the GPU could write in place.
    pub staged: bool,
    /// Seed of the run.
    pub seed: u64,
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
        let spec = FrameTopic { frames_in_flight: options.frames_in_flight as usize, ..FrameTopic::new(modality, max_payload_bytes) };
        let publisher = bus.frame_publisher(&name, spec).with_context(|| format!("cannot publish {name:?}"))?;
        publisher.touch()?;
        let segment = publisher.segment()?;
        let by_gpu = modality.sensor_kind() == SensorKind::Camera;
        let target = by_gpu.then(|| Arc::new(import::target(gpu, &segment, options.staged)));
        let wake = bus.notifier(&name)?;
        Ok(Topic { name, modality, publisher, wake, target, max_payload_bytes, n_sent: 0, n_dropped: 0, n_overflowed: 0 })
    }
}

impl Sensor {
    /// Opens a sensor's topics and makes its model.
    pub fn open(
        bus: &Bus,
        gpu: &Gpu,
        place: SensorPlace<'_>,
        spec: &SensorSpec,
        made_at: SimTime,
        period_nanos: u64,
        options: &TopicOptions,
    ) -> anyhow::Result<Sensor> {
        let mut topics = Vec::new();
        for modality in spec.modalities() {
            let name = format!("{}/{}/{}", place.rig, place.name, modality.name());
            topics.push(Topic::open(bus, gpu, name, modality, spec.max_payload_bytes(modality), options)?);
        }
        let model = match spec {
            SensorSpec::Camera(camera) => Model::View(Box::new(View::new(
                gpu,
                ViewSpec { intrinsics: camera.intrinsics(), dvs: camera.dvs.clone(), seed: options.seed, sensor_id: place.actor.0 },
            ))),
            SensorSpec::Lidar(lidar) => Model::Lidar { lidar: Box::new(Lidar::new(lidar.clone())), previous: None },
            SensorSpec::Imu(_) => Model::Imu(BodyMotion::default()),
            SensorSpec::Gnss(_) => Model::Gnss,
        };
        let schedule = Schedule::from_rate(made_at, spec.rate_hz(), period_nanos);
        Ok(Sensor { actor: place.actor, rig_idx: place.rig_idx, spec: spec.clone(), schedule, topics, model })
    }

    /// Its topics, for `world/actors`.
    pub fn topic_infos(&self) -> Vec<TopicInfo> {
        let info = |topic: &Topic| TopicInfo { topic: topic.name.clone(), modality: topic.modality.name().to_owned() };
        self.topics.iter().map(info).collect()
    }

    /// Starts over in a new episode: schedule and memory as if just made, on a new actor.
    pub fn begin_episode(&mut self, actor: ActorId, made_at: SimTime, period_nanos: u64) {
        self.actor = actor;
        self.schedule = Schedule::from_rate(made_at, self.spec.rate_hz(), period_nanos);
        match &mut self.model {
            Model::View(view) => view.reset(),
            Model::Lidar { previous, .. } => *previous = None,
            Model::Imu(motion) => motion.reset(),
            Model::Gnss => {}
        }
    }
}

/// Where a sensor belongs.
#[derive(Clone, Copy, Debug)]
pub struct SensorPlace<'a> {
    /// Rig's name.
    pub rig: &'a str,
    /// Index of the rig.
    pub rig_idx: usize,
    /// Sensor's name on the rig.
    pub name: &'a str,
    /// Its actor.
    pub actor: ActorId,
}
