//! Documents on the bus: texts that change rarely (`world/info`, `map`, `actors`, `catalogue`). A
//! late reader receives the latest one.
//!
//! A document is a `[u8]` sample with a [`DocumentHeader`]; its payload is UTF-8: JSON, or
//! OpenDRIVE for `world/map`.

use bytemuck::{Pod, Zeroable};
use schema_types::Pose;
use serde::{Deserialize, Deserializer, Serialize};

use crate::calibration::{Calibration, Readout};

/// "GDOC" read as a little-endian `u32`.
pub const DOCUMENT_MAGIC: u32 = u32::from_le_bytes(*b"GDOC");

/// User header of a document: iceoryx2 type name `GantryDocumentHeader`, 64 bytes.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct DocumentHeader {
    /// [`DOCUMENT_MAGIC`].
    pub magic: u32,
    /// [`crate::SCHEMA_VERSION`].
    pub schema_version: u16,
    /// Zero.
    pub reserved0: u16,
    /// Random number of the daemon's start.
    pub epoch: u64,
    /// Counts changes of this document within the epoch, from 1.
    pub revision: u64,
    /// Bytes of text.
    pub payload_bytes: u64,
    /// Tick from whose end on the text holds; 0 before the first tick.
    pub tick: u64,
    /// Zero.
    pub reserved1: [u8; 24],
}
const _: () = assert!(size_of::<DocumentHeader>() == 64);

/// How ticks are started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepMode {
    /// The daemon starts ticks by its clock.
    #[default]
    FreeRunning,
    /// Each tick waits for a cue (`step`).
    Stepped,
}

/// Weather and time of day; percentages are 0..=100 with CARLA's meaning.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Weather {
    /// Share of the sky that clouds cover, percent.
    pub cloudiness: f32,
    /// Rain, percent.
    pub precipitation: f32,
    /// Puddles, percent.
    pub precipitation_deposits: f32,
    /// Wind, percent.
    pub wind_intensity: f32,
    /// Sun azimuth, degrees counter-clockwise from world x.
    pub sun_azimuth_deg: f32,
    /// Sun altitude, degrees; below 0 is night.
    pub sun_altitude_deg: f32,
    /// Fog, percent.
    pub fog_density: f32,
    /// Distance at which fog starts, metres.
    pub fog_distance_m: f32,
    /// Fall-off of fog with height.
    pub fog_falloff: f32,
    /// Wetness of surfaces, percent.
    pub wetness: f32,
    /// How much fog scatters light, 0 and up.
    pub scattering_intensity: f32,
    /// Haze, pollen and other large particles: the glow round the sun, 0 to 5.
    pub mie_scattering_scale: f32,
    /// Air molecules: blueness of the sky, 0 to 2.
    pub rayleigh_scattering_scale: f32,
    /// Dust in the air, percent.
    pub dust_storm: f32,
}

impl Default for Weather {
    /// A clear afternoon.
    fn default() -> Self {
        Weather {
            cloudiness: 15.0,
            precipitation: 0.0,
            precipitation_deposits: 0.0,
            wind_intensity: 10.0,
            sun_azimuth_deg: 130.0,
            sun_altitude_deg: 42.0,
            fog_density: 0.0,
            fog_distance_m: 0.0,
            fog_falloff: 0.2,
            wetness: 0.0,
            scattering_intensity: 1.0,
            mie_scattering_scale: 0.03,
            rayleigh_scattering_scale: 0.0331,
            dust_storm: 0.0,
        }
    }
}

/// `world/info`: who publishes, and what a reader must know before the first frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorldInfo {
    /// `live` or `replay`.
    pub source: String,
    /// Version of the program that publishes.
    pub version: String,
    /// Random number of the daemon's start, as decimal text (JSON numbers end at 2⁵³).
    pub epoch: String,
    /// Count of map loads, from 1.
    pub episode: u32,
    /// Name of the map.
    pub map: String,
    /// Seed of the run.
    pub seed: u64,
    /// How ticks are started.
    pub mode: StepMode,
    /// Length of a tick.
    pub period_nanos: u64,
    /// Simulated time at which the episode began.
    pub episode_start_nanos: u64,
    /// Names of the lockstep participants.
    pub lockstep: Vec<String>,
    /// Weather in force.
    pub weather: Weather,
    /// GPU adapter that renders, e.g. `llvmpipe (LLVM 15.0.6, 256 bits)`.
    pub adapter: String,
    /// Copies per frame on the way to shared memory: 0 imported, 1 staged.
    pub cpu_copies: u32,
    /// Batches of cameras.
    #[serde(default)]
    pub batches: Vec<BatchInfo>,
    /// Cameras by rising actor. Those that a later version describes are left out.
    #[serde(default, deserialize_with = "known_cameras")]
    pub cameras: Vec<CameraInfo>,
}

/// First segment of the topics of batches, `batch/NAME/MODALITY`.
pub const BATCH_RIG: &str = "batch";

/// Cameras whose images come as one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BatchInfo {
    /// Its name: `fleet`.
    pub name: String,
    /// Its topics.
    pub topics: Vec<TopicInfo>,
    /// Its cameras in the order of their images.
    pub cameras: Vec<BatchCamera>,
}

/// A camera of a batch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BatchCamera {
    /// What its own topics are called but for the modality: `ego/left`.
    pub name: String,
    /// Its actor, whose pose the snapshots have; 0 if it is gone.
    pub sensor_id: u32,
    /// Focal length and principal point `[fx, fy, cx, cy]`, pixels.
    pub intrinsics_px: [f64; 4],
    /// The lens's distortion as in the header of its own frames; all 0 for a pinhole.
    pub lens: [f32; 4],
}

/// A camera of the world, as `world/info` describes it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraInfo {
    /// What its topics are called but for the modality: `ego/front`.
    pub name: String,
    /// Its actor.
    pub sensor_id: u32,
    /// What its pixels show.
    pub calibration: Calibration,
    /// Pose on its carrier (x forward, y left, z up); `None` without one.
    pub mount: Option<PoseText>,
    /// When its rows are exposed.
    #[serde(default)]
    pub readout: Readout,
}

/// Reads the cameras of `world/info`, and leaves out what a later version says of one.
fn known_cameras<'de, D>(from: D) -> Result<Vec<CameraInfo>, D::Error>
where
    D: Deserializer<'de>,
{
    let all = Vec::<serde_json::Value>::deserialize(from)?;
    let known = all.into_iter();
    Ok(known
        .filter_map(|camera| serde_json::from_value(camera).ok())
        .collect())
}

/// Box around a body, in the actor's space.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BodyBox {
    /// Centre in the actor's space, metres.
    pub centre_m: [f32; 3],
    /// Half extents, metres.
    pub half_m: [f32; 3],
}

/// One topic of a sensor.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TopicInfo {
    /// Topic without the domain: `ego/front/rgb`.
    pub topic: String,
    /// Modality name: `rgb`.
    pub modality: String,
}

/// What does not change from tick to tick about an actor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ActorInfo {
    /// Actor id.
    pub id: u32,
    /// Catalogue id, e.g. `vehicle.tesla.model3`.
    pub type_id: String,
    /// `vehicle`, `walker`, `traffic_light`, `traffic_sign`, `prop`, `sensor`, `spectator`.
    pub kind: String,
    /// `ego_vehicle`, `autopilot`, a sensor's name, or empty.
    pub role: String,
    /// Actor it is attached to; 0 if none.
    pub parent_id: u32,
    /// Pose relative to the parent (sensors), `parent_from_actor`.
    pub mount: Option<PoseText>,
    /// Body box; all zero if it has no body.
    pub body_box: BodyBox,
    /// Of traffic lights and signs: box around the places on lanes in front of it, in the actor's
    /// space.
    #[serde(default)]
    pub trigger_box: Option<BodyBox>,
    /// Attributes by name.
    pub attributes: std::collections::BTreeMap<String, String>,
    /// Topics of a sensor.
    pub topics: Vec<TopicInfo>,
}

/// A pose in JSON.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseText {
    /// Position, metres.
    pub translation_m: [f64; 3],
    /// Unit quaternion `[x, y, z, w]`.
    pub rotation_xyzw: [f64; 4],
}

impl From<Pose> for PoseText {
    fn from(pose: Pose) -> Self {
        PoseText {
            translation_m: pose.translation_m,
            rotation_xyzw: pose.rotation_xyzw,
        }
    }
}

impl From<PoseText> for Pose {
    fn from(pose: PoseText) -> Self {
        Pose {
            translation_m: pose.translation_m,
            rotation_xyzw: pose.rotation_xyzw,
        }
    }
}

/// `world/actors`: all actors of the world.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ActorList {
    /// Actors by rising id.
    pub actors: Vec<ActorInfo>,
}

/// A type of actor that can be spawned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CatalogueEntry {
    /// Catalogue id.
    pub type_id: String,
    /// Kind, as in [`ActorInfo::kind`].
    pub kind: String,
    /// Semantic class of its body.
    pub class: u8,
    /// Body box; all zero if it has none.
    pub body_box: BodyBox,
    /// Attributes with their default values.
    pub attributes: std::collections::BTreeMap<String, String>,
    /// Recommended values by attribute; attributes without any are absent.
    #[serde(default)]
    pub recommended: std::collections::BTreeMap<String, Vec<String>>,
}

/// `world/catalogue`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Catalogue {
    /// Entries; `catalogue_idx` of a snapshot record points here.
    pub entries: Vec<CatalogueEntry>,
}

/// `world/spawn_points`: poses at which a vehicle may be spawned, in the map's own order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SpawnPoints {
    /// World poses; launch files count them from 0.
    pub points: Vec<PoseText>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_that_a_later_version_describes_are_left_out() {
        let camera = CameraInfo {
            name: "ego/front".into(),
            sensor_id: 7,
            calibration: Calibration::pinhole([200.0, 200.0, 160.0, 100.0], None, [320, 200])
                .unwrap(),
            mount: None,
            readout: Readout::Global,
        };
        let known = serde_json::to_value(&camera).unwrap();
        let mut other = known.clone();
        other["calibration"]["lens"]["model"] = "heptafocal".into();
        let mut bad = known.clone();
        bad["calibration"]["focal_px"] = serde_json::json!([0.0, 1.0]);
        let all = serde_json::Value::from(vec![other, known, bad]);
        let found = known_cameras(all).unwrap();
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].name, "ego/front");
    }
}
