//! A batch: cameras of one size and rate whose images of a tick come as one frame, one image after
//! the other.
//!
//! Its topics are like those of a sensor, with slots in shared memory and on the GPU; the images are
//! drawn once and copied right to their places in them.

use std::rc::Rc;

use launch_spec::TopicBudget;
use schema_bus::Bus;
use schema_frames::document::{BatchCamera, BatchInfo};
use schema_frames::{FrameHeader, Modality};
use sensor_gpu::Gpu;

use crate::rig::Rig;
use crate::sensor::{Maker, Model, OpenContext, Role, Sensor};
use crate::topic::{Audience, MemoryLife, Topic, TopicSpec};

/// Index of a camera that has ended.
pub const GONE: usize = usize::MAX;

/// What a process needs to make the frames of a batch, besides its cameras.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BatchPlan {
    /// Place among the batches of the launch file.
    pub number: u32,
    /// Its name.
    pub name: String,
    /// Its cameras in the order of their images, each named `rig/sensor`.
    pub cameras: Vec<String>,
    /// Its topics, one per modality.
    pub topics: Vec<TopicBudget>,
}

/// Cameras whose images of a tick come as one frame.
pub struct Batch {
    /// What it was made from.
    pub plan: BatchPlan,
    /// The rig of all batches, whose event says that their frames of a tick are sent.
    pub rig: Rc<Rig>,
    /// One per modality.
    pub topics: Vec<Topic>,
    /// Which process makes its frames: the one that makes those of its cameras.
    pub maker: Maker,
    /// Cameras in the order of their images, each with its rig's and its own name.
    cameras: Vec<(String, String)>,
    /// Where they were among the sensors when they were last looked for.
    found: Vec<usize>,
}

impl Batch {
    /// Opens the topics of a batch. They have memory only while somebody reads.
    pub fn open(
        context: &OpenContext<'_>,
        rig: &Rc<Rig>,
        plan: BatchPlan,
    ) -> anyhow::Result<Batch> {
        let is_away = context.cameras_are_away || context.gpu.is_none();
        let open = |topic: &TopicBudget| {
            let spec = TopicSpec {
                name: topic.topic.clone(),
                modality: topic.modality,
                max_payload_bytes: topic.max_payload_bytes,
                limits: topic.limits,
                remembers: false,
                is_told: false,
                is_away,
                is_cast: false,
                vehicle_from_sensor: schema_types::Pose::IDENTITY,
            };
            Topic::open(
                context.bus,
                context.gpu,
                spec,
                context.frames,
                MemoryLife::OnDemand,
                context.server,
            )
        };
        let parted = |camera: &String| {
            let (rig, name) = camera.split_once('/').unwrap_or((camera, ""));
            (rig.to_owned(), name.to_owned())
        };
        Ok(Batch {
            rig: rig.clone(),
            topics: plan.topics.iter().map(open).collect::<Result<_, _>>()?,
            maker: if is_away { Maker::Nobody } else { Maker::Here },
            found: vec![GONE; plan.cameras.len()],
            cameras: plan.cameras.iter().map(parted).collect(),
            plan,
        })
    }

    /// Number of its cameras.
    pub fn n_images(&self) -> usize {
        self.cameras.len()
    }

    /// Whether a sensor is one of its cameras.
    pub fn has_camera(&self, sensor: &Sensor) -> bool {
        let mut cameras = self.cameras.iter();
        cameras.any(|(rig, name)| is_it(sensor, rig, name))
    }

    /// Whether frames of it are made.
    pub fn is_read(&self) -> bool {
        let mut topics = self.topics.iter();
        topics.any(|topic| topic.is_read(Audience::Readers))
    }

    /// Another process makes its frames, or this one does again. No frame may be in flight.
    pub fn hand_over(&mut self, maker: Maker, bus: &Bus, gpu: Option<&Gpu>) {
        for topic in &mut self.topics {
            match maker {
                Maker::Here => topic.come_back(),
                _ => topic.leave(bus, gpu),
            }
        }
        self.maker = maker;
    }

    /// Entry in `world/info`.
    pub fn info(&self, sensors: &[Sensor]) -> BatchInfo {
        let camera = |(rig, name): &(String, String)| {
            let sensor = sensors.iter().find(|sensor| is_it(sensor, rig, name));
            let view = sensor.and_then(|sensor| match &sensor.model {
                Model::View(view) => Some(view),
                _ => None,
            });
            BatchCamera {
                name: format!("{rig}/{name}"),
                sensor_id: sensor.map_or(0, |sensor| sensor.actor.0),
                intrinsics_px: view.map_or([0.0; 4], |view| view.intrinsics().as_array()),
                lens: view
                    .and_then(|view| view.lens())
                    .map_or([0.0; 4], |lens| lens.as_array()),
            }
        };
        BatchInfo {
            name: self.plan.name.clone(),
            topics: self.topics.iter().map(Topic::info).collect(),
            cameras: self.cameras.iter().map(camera).collect(),
        }
    }

    /// Name of the camera of an image.
    pub fn camera_name(&self, image_idx: usize) -> String {
        self.plan.cameras[image_idx].clone()
    }

    /// Where its cameras are among the sensors, in the order of its images; [`GONE`] for one that has
    /// ended.
    pub fn find(&mut self, sensors: &[Sensor]) -> &[usize] {
        for ((rig, name), found) in self.cameras.iter().zip(&mut self.found) {
            let is_it = |sensor: &Sensor| is_it(sensor, rig, name);
            if !sensors.get(*found).is_some_and(is_it) {
                *found = sensors.iter().position(is_it).unwrap_or(GONE);
            }
        }
        &self.found
    }
}

fn is_it(sensor: &Sensor, rig: &str, name: &str) -> bool {
    sensor.role == Role::Sensor && sensor.name == name && sensor.rig.name == rig
}

/// Header of a frame of several images, of the tick and firing of the frame whose header is given.
pub fn header(
    of_first: &FrameHeader,
    modality: Modality,
    n_images: u32,
    [width_px, height_px]: [u32; 2],
) -> FrameHeader {
    let mut header = FrameHeader {
        tick: of_first.tick,
        sim_nanos: of_first.sim_nanos,
        seq: of_first.seq,
        episode: of_first.episode,
        window_nanos: of_first.window_nanos,
        epoch: of_first.epoch,
        ..FrameHeader::new(modality)
    };
    header.set_batch(n_images, width_px, height_px);
    header
}
