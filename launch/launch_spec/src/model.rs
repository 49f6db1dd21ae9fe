//! What a launch file says, with every default filled in.

use std::collections::BTreeMap;

use schema_frames::StepMode;
use schema_frames::document::Weather;
use sensor_spec::SensorSpec;
use serde::{Deserialize, Serialize};

use crate::batch::Batch;
use crate::process::Process;
use crate::topic::Topic;

/// Name of the rig on the ego vehicle; it exists in every launch file.
pub const EGO_RIG: &str = "ego";

/// A checked launch file.
#[derive(Clone, Debug, PartialEq)]
pub struct Launch {
    /// `[scenario]`: what is simulated.
    pub scenario: Scenario,
    /// `[ego]`: the vehicle that carries the sensors of the rig `ego`.
    pub ego: Ego,
    /// `[spectator]`: the image `spectator/rgb`, which is rendered only while somebody reads it.
    pub spectator: Spectator,
    /// `[rig.NAME]`: what sensors are mounted on. [`EGO_RIG`] is always among them.
    pub rigs: BTreeMap<String, Rig>,
    /// `[sensor.NAME]`, each on one or more rigs.
    pub sensors: BTreeMap<String, Sensor>,
    /// `[batch.NAME]`: cameras of one size and rate whose images of a tick come as one frame.
    pub batches: BTreeMap<String, Batch>,
    /// `[topic."NAME"]`: limits of topics, and the types of topics that processes publish. Names are
    /// without the domain.
    pub topics: BTreeMap<String, Topic>,
    /// `[process.NAME]` in the order of the files: what runs.
    pub processes: Vec<Process>,
}

/// `[scenario]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Scenario {
    /// Town (`Town10HD`), name of an `.xodr` file in the map folder, or path of one.
    pub map: String,
    /// Seed of everything random; 0 to 2⁶³ − 1.
    pub seed: u64,
    /// Ticks per second of simulated time, 0.1 to 1000.
    pub tick_hz: f64,
    /// `free_running`: ticks follow the clock; `stepped`: one tick per cue.
    pub mode: StepMode,
    /// Vehicles besides the ego, role `autopilot`.
    pub vehicles: u32,
    /// Walkers on pavements and crosswalks, role `pedestrian`.
    pub walkers: u32,
    /// Weather at the start.
    pub weather: Weather,
    /// Whether weather acts on lidars: rain, fog and dust absorb their light. CARLA's weather does
    /// not.
    pub weather_effects: bool,
    /// What casts the rays of lidars; `simd --lidars-on` overrides it.
    pub lidars_on: LidarsOn,
    /// Seconds of wall-clock time after which a lockstep participant that lives but is idle is
    /// removed; 0 waits for ever. `--lockstep-timeout` overrides it.
    pub lockstep_timeout_s: f64,
}

/// What casts the rays of lidars. The points differ by rounding only.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LidarsOn {
    /// The GPU that renders if it is a real one with 64-bit numbers in its shaders, else the
    /// processor.
    #[default]
    Auto,
    /// The processor.
    Cpu,
    /// The adapter that renders, a software one too.
    Gpu,
}

impl Default for Scenario {
    fn default() -> Self {
        Scenario {
            map: "Town10HD".into(),
            seed: 1,
            tick_hz: 20.0,
            mode: StepMode::FreeRunning,
            vehicles: 0,
            walkers: 0,
            weather: Weather::default(),
            weather_effects: false,
            lidars_on: LidarsOn::Auto,
            lockstep_timeout_s: 0.0,
        }
    }
}

impl Scenario {
    /// Length of a tick, nanoseconds.
    pub fn period_nanos(&self) -> u64 {
        (1e9 / self.tick_hz).round() as u64
    }

    /// Wait after which an idle lockstep participant is removed, nanoseconds; `None` waits for ever.
    pub fn lockstep_timeout_nanos(&self) -> Option<u64> {
        (self.lockstep_timeout_s > 0.0).then(|| (self.lockstep_timeout_s * 1e9).round() as u64)
    }
}

/// `[ego]`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ego {
    /// Catalogue id of the vehicle, or `none` for a town without one.
    pub type_id: String,
    /// Index into the map's spawn points, modulo their number.
    pub spawn_point: u32,
}

impl Ego {
    /// Whether there is no ego vehicle.
    pub fn is_none(&self) -> bool {
        self.type_id == "none"
    }
}

impl Default for Ego {
    fn default() -> Self {
        Ego {
            type_id: "vehicle.tesla.model3".into(),
            spawn_point: 0,
        }
    }
}

/// `[spectator]`: the camera that `gantry-view --fly` and CARLA's `get_spectator()` move.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Spectator {
    /// Width of its image, pixels.
    pub width_px: u32,
    /// Height of its image, pixels.
    pub height_px: u32,
    /// Horizontal field of view, degrees.
    pub fov_deg: f64,
    /// Images per second of simulated time, 0.1 to 1000; at most one per tick.
    pub rate_hz: f64,
}

impl Default for Spectator {
    fn default() -> Self {
        Spectator {
            width_px: 1280,
            height_px: 720,
            fov_deg: 90.0,
            rate_hz: 20.0,
        }
    }
}

impl Spectator {
    /// The camera.
    pub fn camera(&self) -> sensor_spec::CameraSpec {
        sensor_spec::CameraSpec {
            rate_hz: self.rate_hz,
            width_px: self.width_px,
            height_px: self.height_px,
            fov_deg: self.fov_deg,
            modalities: vec![schema_frames::Modality::Rgb],
            ..Default::default()
        }
    }
}

/// What the sensors of a rig are mounted on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rig {
    /// The ego vehicle.
    Ego,
    /// One of the other vehicles, by index from 0, below [`Scenario::vehicles`].
    Other(u32),
    /// A fixed place in the world.
    Free(FreePose),
}

/// A fixed place in the world: x forward, y left, z up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FreePose {
    /// Metres, world.
    pub position_m: [f64; 3],
    /// Roll, pitch, yaw, degrees; positive pitch looks down, positive yaw turns left.
    pub rpy_deg: [f64; 3],
}

impl FreePose {
    /// The pose as the world takes it.
    pub fn pose(&self) -> schema_types::Pose {
        let mount = sensor_spec::MountSpec {
            position_m: self.position_m,
            rpy_deg: self.rpy_deg,
            ..Default::default()
        };
        mount.pose()
    }
}

/// One `[sensor.NAME]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    /// Rigs that carry it; at least one.
    pub rigs: Vec<String>,
    /// What it measures.
    pub spec: SensorSpec,
}

/// One sensor on one rig: its topics are `<domain>/<rig>/<name>/<modality>`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedSensor<'a> {
    /// Rig, a key of [`Launch::rigs`].
    pub rig: &'a str,
    /// Sensor, a key of [`Launch::sensors`].
    pub name: &'a str,
    /// What it measures.
    pub spec: &'a SensorSpec,
}

impl PlacedSensor<'_> {
    /// What its topics are called but for the modality: `rig/sensor`.
    pub fn full_name(&self) -> String {
        format!("{}/{}", self.rig, self.name)
    }
}

impl Launch {
    /// Every sensor on every rig, by rig (the ego's first, then by name), then by sensor name. Ids
    /// are given in this order.
    pub fn placed_sensors(&self) -> Vec<PlacedSensor<'_>> {
        let mut placed: Vec<_> = self
            .sensors
            .iter()
            .flat_map(|(name, sensor)| {
                sensor.rigs.iter().map(move |rig| PlacedSensor {
                    rig,
                    name,
                    spec: &sensor.spec,
                })
            })
            .collect();
        placed.sort_by_key(|sensor| (sensor.rig != EGO_RIG, sensor.rig, sensor.name));
        placed
    }

    /// The process of this name.
    pub fn process(&self, name: &str) -> Option<&Process> {
        self.processes.iter().find(|process| process.name == name)
    }
}
