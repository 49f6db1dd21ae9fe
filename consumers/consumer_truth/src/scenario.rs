//! A scenario: one recording as exporters see it before its first tick.

use std::sync::Arc;

use nalgebra::Isometry3;
use schema_frames::{FrameHeader, Modality, SensorKind, WorldInfo};
use schema_types::space::sensor_from_camera;

/// One recording, one rig.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// Name: the file's without its ending, or what the user gave; unique within the export.
    pub name: String,
    /// Number within the export, from 0.
    pub index: u32,
    /// Part of the set, e.g. `train`.
    pub split: String,
    /// Rig whose sensors are exported.
    pub rig: String,
    /// Actor that carries the rig; 0 if it stands free.
    pub carrier_id: u32,
    /// The recording's `world/info`.
    pub info: WorldInfo,
    /// Simulated time of the first snapshot, nanoseconds.
    pub start_nanos: u64,
    /// Simulated time of the last message, nanoseconds.
    pub end_nanos: u64,
    /// Sensors of the rig, by name.
    pub sensors: Vec<Sensor>,
    /// The map as OpenDRIVE text, if the recording has it.
    pub opendrive: Option<Arc<str>>,
}

/// A sensor of the rig.
#[derive(Clone, Debug)]
pub struct Sensor {
    /// Second segment of its topics.
    pub name: String,
    /// What it is.
    pub kind: SensorKind,
    /// Its place on its carrier; on a rig without one, in the world.
    pub carrier_from_sensor: Isometry3<f64>,
    /// Its topics, by modality.
    pub topics: Vec<Topic>,
}

/// A topic of frames.
#[derive(Clone, Debug)]
pub struct Topic {
    /// Full name without the domain, e.g. `ego/front/rgb`.
    pub name: Arc<str>,
    /// Second segment of the name.
    pub sensor: Arc<str>,
    /// What it shows.
    pub modality: Modality,
    /// Header of its first frame.
    pub first: FrameHeader,
}

impl Sensor {
    /// The topic of a modality.
    pub fn topic(&self, modality: Modality) -> Option<&Topic> {
        self.topics.iter().find(|topic| topic.modality == modality)
    }

    /// Whether it has a topic of this modality.
    pub fn has(&self, modality: Modality) -> bool {
        self.topic(modality).is_some()
    }

    /// Pose of the optical axes (x right, y down, z forward) on the carrier.
    pub fn carrier_from_camera(&self) -> Isometry3<f64> {
        self.carrier_from_sensor * sensor_from_camera()
    }

    /// Header of the first frame of its first topic; every sensor has one.
    pub fn first(&self) -> &FrameHeader {
        &self.topics[0].first
    }
}

impl Scenario {
    /// The sensor with this name.
    pub fn sensor(&self, name: &str) -> Option<&Sensor> {
        self.sensors.iter().find(|sensor| sensor.name == name)
    }

    /// Sensors that have this modality, by name.
    pub fn with(&self, modality: Modality) -> impl Iterator<Item = &Sensor> {
        self.sensors
            .iter()
            .filter(move |sensor| sensor.has(modality))
    }

    /// Cameras (sensors with any image or events) in the order that the user asked for, or by name.
    ///
    /// # Errors
    /// [`launch_cli::wrong_usage`] if a name is not a camera of the rig.
    pub fn cameras(&self, asked: &[String]) -> anyhow::Result<Vec<&Sensor>> {
        let all = || {
            self.sensors
                .iter()
                .filter(|sensor| sensor.kind == SensorKind::Camera)
        };
        if asked.is_empty() {
            return Ok(all().collect());
        }
        asked
            .iter()
            .map(|name| {
                all().find(|camera| camera.name == *name).ok_or_else(|| {
                    let names: Vec<_> = all().map(|camera| camera.name.as_str()).collect();
                    launch_cli::wrong_usage(format!(
                        "{} has no camera {name:?} on rig {:?}; it has {}",
                        self.name,
                        self.rig,
                        if names.is_empty() {
                            "none".into()
                        } else {
                            names.join(", ")
                        }
                    ))
                })
            })
            .collect()
    }

    /// The rig's topics as a list for messages.
    pub fn topic_list(&self) -> String {
        let names: Vec<_> = self
            .sensors
            .iter()
            .flat_map(|sensor| &sensor.topics)
            .map(|topic| &*topic.name)
            .collect();
        if names.is_empty() {
            "no frames at all".into()
        } else {
            names.join(", ")
        }
    }
}
