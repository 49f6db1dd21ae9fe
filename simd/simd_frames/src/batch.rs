//! A batch: cameras of one size and rate whose images of a tick come as one frame, one image after
//! the other.
//!
//! Its topics are like those of a sensor, with slots in shared memory and on the GPU; the images are
//! drawn once and copied right to their places in them.

use std::rc::Rc;

use launch_spec::TopicBudget;
use schema_frames::document::{BatchCamera, BatchInfo};
use schema_frames::{FrameHeader, Modality};

use crate::rig::Rig;
use crate::sensor::{Model, OpenContext, Role, Sensor};
use crate::topic::{MemoryLife, Topic, TopicSpec};

/// Index of a camera that has ended.
pub const GONE: usize = usize::MAX;

/// Cameras whose images of a tick come as one frame.
pub struct Batch {
    /// Its name.
    pub name: String,
    /// The rig of all batches, whose event says that their frames of a tick are sent.
    pub rig: Rc<Rig>,
    /// One per modality.
    pub topics: Vec<Topic>,
    /// Cameras in the order of their images, each with its rig's and its own name.
    cameras: Vec<(String, String)>,
    /// Where they were among the sensors when they were last looked for.
    found: Vec<usize>,
}

impl Batch {
    /// Opens the topics of a batch of cameras, each named `rig/sensor`. They have memory only while
    /// somebody reads.
    pub fn open(
        context: &OpenContext<'_>,
        rig: &Rc<Rig>,
        name: &str,
        cameras: &[String],
        topics: Vec<TopicBudget>,
    ) -> anyhow::Result<Batch> {
        let open = |topic: TopicBudget| {
            let spec = TopicSpec {
                name: topic.topic,
                modality: topic.modality,
                max_payload_bytes: topic.max_payload_bytes,
                limits: topic.limits,
                remembers: false,
                is_told: false,
                is_away: false,
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
            name: name.to_owned(),
            rig: rig.clone(),
            topics: topics.into_iter().map(open).collect::<Result<_, _>>()?,
            found: vec![GONE; cameras.len()],
            cameras: cameras.iter().map(parted).collect(),
        })
    }

    /// Number of its cameras.
    pub fn n_images(&self) -> usize {
        self.cameras.len()
    }

    /// Whether a sensor of this rig and name is one of its cameras.
    pub fn has(&self, rig: &str, name: &str) -> bool {
        self.cameras.iter().any(|(of, it)| of == rig && it == name)
    }

    /// Whether anybody reads it.
    pub fn is_read(&self) -> bool {
        self.topics.iter().any(|topic| topic.n_readers() > 0)
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
            name: self.name.clone(),
            topics: self.topics.iter().map(Topic::info).collect(),
            cameras: self.cameras.iter().map(camera).collect(),
        }
    }

    /// Name of the camera of an image.
    pub fn camera_name(&self, image_idx: usize) -> String {
        let (rig, name) = &self.cameras[image_idx];
        format!("{rig}/{name}")
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
