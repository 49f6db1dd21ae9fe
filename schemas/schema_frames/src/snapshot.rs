//! The world after one tick: one fixed-size record per actor on `world/snapshot`.

use bytemuck::{Pod, Zeroable};
use schema_types::Pose;
use serde::{Deserialize, Serialize};

/// "GSNP" read as a little-endian `u32`.
pub const SNAPSHOT_MAGIC: u32 = u32::from_le_bytes(*b"GSNP");

/// User header of a snapshot: iceoryx2 type name `GantrySnapshotHeader`, 128 bytes. The payload is
/// `n_actors` [`ActorRecord`]s by rising id.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SnapshotHeader {
    /// [`SNAPSHOT_MAGIC`].
    pub magic: u32,
    /// [`crate::SCHEMA_VERSION`].
    pub schema_version: u16,
    /// 128.
    pub header_bytes: u16,
    /// Tick this snapshot shows.
    pub tick: u64,
    /// Simulated time, nanoseconds since the daemon started.
    pub sim_nanos: u64,
    /// Simulated time at which the episode began.
    pub episode_start_nanos: u64,
    /// Length of that tick, nanoseconds.
    pub period_nanos: u64,
    /// Count of map loads in this epoch, from 1.
    pub episode: u32,
    /// Records in the payload.
    pub n_actors: u32,
    /// Revision of `world/actors` that lists exactly these actors.
    pub actors_revision: u64,
    /// Bit 0: map or layers changed with this tick. Bit 1: street lights changed. Bit 2: the world
    /// went back to a checkpoint before this tick.
    pub flags: u32,
    /// Zero.
    pub reserved0: u32,
    /// Random number of the daemon's start. From here on nothing takes part in hashes.
    pub epoch: u64,
    /// `CLOCK_MONOTONIC` just before the sample was sent.
    pub published_mono_nanos: u64,
    /// Zero.
    pub reserved1: [u8; 48],
}
const _: () = assert!(size_of::<SnapshotHeader>() == 128);
const _: () = assert!(std::mem::offset_of!(SnapshotHeader, epoch) == 64);

impl SnapshotHeader {
    /// Flag: the map's layers or objects changed before this tick.
    pub const SCENERY_CHANGED: u32 = 1;
    /// Flag: lamps of the scenery changed before this tick.
    pub const LAMPS_CHANGED: u32 = 2;
    /// Flag: the world went back to a checkpoint before this tick, so poses and the episode's time
    /// jump.
    pub const RESTORED: u32 = 4;
}

/// What an actor is.
#[repr(u16)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum ActorKind {
    /// Car, lorry, bus, motorcycle, bicycle.
    Vehicle = 1,
    /// A person on foot.
    Walker = 2,
    /// Traffic light.
    TrafficLight = 3,
    /// Traffic sign.
    TrafficSign = 4,
    /// An object without an engine or a will, such as CARLA's `static.prop.*`.
    Prop = 5,
    /// A sensor.
    Sensor = 6,
    /// The spectator.
    Spectator = 7,
    /// Controller of a walker or another invisible helper.
    Controller = 8,
}

impl ActorKind {
    /// The kind with this number, if there is one.
    pub fn from_code(code: u16) -> Option<Self> {
        use ActorKind::*;
        [
            Vehicle,
            Walker,
            TrafficLight,
            TrafficSign,
            Prop,
            Sensor,
            Spectator,
            Controller,
        ]
        .into_iter()
        .find(|k| *k as u16 == code)
    }
}

/// One actor after the tick. 256 bytes, no padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ActorRecord {
    /// Actor id.
    pub id: u32,
    /// Actor it is attached to; 0 if none.
    pub parent_id: u32,
    /// Index into `world/catalogue`.
    pub catalogue_idx: u32,
    /// [`ActorKind`] number.
    pub kind: u16,
    /// Semantic class.
    pub class: u8,
    /// Zero.
    pub reserved: u8,
    /// Pose of the actor's origin in the world. Vehicles: on the ground between the axles. Walkers:
    /// middle of the body.
    pub world_from_actor: Pose,
    /// Velocity of the origin, m/s.
    pub velocity_in_world_mps: [f64; 3],
    /// Angular velocity, rad/s.
    pub angular_velocity_in_world_radps: [f64; 3],
    /// Finite difference of the velocity over the tick, m/s².
    pub acceleration_in_world_mps2: [f64; 3],
    /// Half extents of the body box, metres; its centre is in `world/actors`.
    pub half_box_m: [f32; 3],
    /// [`ActorRecord::PHYSICS`] and the other flag bits.
    pub flags: u32,
    /// [`VehiclePart`], [`TrafficLightPart`], [`TrafficSignPart`] or [`WalkerPart`] by kind; zero
    /// otherwise.
    pub part: [u8; 96],
}
const _: () = assert!(size_of::<ActorRecord>() == 256 && align_of::<ActorRecord>() == 8);

impl ActorRecord {
    /// Flag: the physics engine moves it.
    pub const PHYSICS: u32 = 1;
    /// Flag: it was quarantined because its state was not finite.
    pub const QUARANTINED: u32 = 2;
    /// Flag: it touched something in this tick.
    pub const TOUCHED: u32 = 4;

    /// The kind; `None` for a number this version does not know.
    pub fn kind(&self) -> Option<ActorKind> {
        ActorKind::from_code(self.kind)
    }

    /// The vehicle's part, if it is a vehicle.
    pub fn vehicle(&self) -> Option<VehiclePart> {
        (self.kind() == Some(ActorKind::Vehicle)).then(|| bytemuck::pod_read_unaligned(&self.part))
    }

    /// The traffic light's part, if it is one.
    pub fn traffic_light(&self) -> Option<TrafficLightPart> {
        (self.kind() == Some(ActorKind::TrafficLight))
            .then(|| bytemuck::pod_read_unaligned(&self.part))
    }

    /// The traffic sign's part, if it is one.
    pub fn traffic_sign(&self) -> Option<TrafficSignPart> {
        (self.kind() == Some(ActorKind::TrafficSign))
            .then(|| bytemuck::pod_read_unaligned(&self.part))
    }

    /// The walker's part, if it is one.
    pub fn walker(&self) -> Option<WalkerPart> {
        (self.kind() == Some(ActorKind::Walker)).then(|| bytemuck::pod_read_unaligned(&self.part))
    }

    /// Stores the part that belongs to the actor's kind.
    pub fn set_part<P: Pod>(&mut self, part: &P) {
        const { assert!(size_of::<P>() == 96) };
        self.part.copy_from_slice(bytemuck::bytes_of(part));
    }

    /// Speed over ground, m/s.
    pub fn speed_mps(&self) -> f64 {
        let [x, y, z] = self.velocity_in_world_mps;
        (x * x + y * y + z * z).sqrt()
    }
}

/// Vehicle part of a record. 96 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct VehiclePart {
    /// Applied control, see [`crate::VehicleControl`].
    pub throttle_ratio: f32,
    /// Applied control; positive to the left.
    pub steer_ratio: f32,
    /// Applied control.
    pub brake_ratio: f32,
    /// Bit 0 hand brake, 1 reverse, 2 manual gear shift; bit 8: it lies on its side or roof; bits
    /// 16–31: four bits per door, front left to rear right, from 0 (shut) to 15 (open).
    pub control_flags: u32,
    /// Gear engaged: −1 reverse, 0 neutral, 1 and up forward.
    pub gear: i32,
    /// Engine speed, rad/s.
    pub engine_radps: f32,
    /// Speed limit here, m/s; 0 if unknown.
    pub speed_limit_mps: f32,
    /// Lamps: 1 position, 2 low beam, 4 high beam, 8 brake, 16 right blinker, 32 left blinker, 64
    /// reverse, 128 fog, 256 interior, 512 and 1024 special.
    pub lamps: u32,
    /// Traffic light whose stop box the vehicle is in; 0 if none.
    pub light_actor_id: u32,
    /// [`LightState`] number of that light; green if none.
    pub light_state: u32,
    /// Angle of the front wheels, radians, positive to the left (mean of both).
    pub wheel_steer_rad: f32,
    /// Wheels touching the ground, one bit each.
    pub wheels_on_ground: u32,
    /// Roll angle of each wheel, radians (front left, front right, rear left, rear right, …).
    pub wheel_spin_rad: [f32; 6],
    /// Suspension travel of each wheel from its rest position, metres, positive is compressed.
    pub wheel_travel_m: [f32; 6],
}
const _: () = assert!(size_of::<VehiclePart>() == 96);

/// State of a traffic light (CARLA's numbers).
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum LightState {
    /// Stop.
    Red = 0,
    /// About to be red.
    Yellow = 1,
    /// Go.
    Green = 2,
    /// Dark.
    Off = 3,
    /// Not known.
    Unknown = 4,
}

impl LightState {
    /// The state with this number; any other is `Unknown`.
    pub fn from_code(code: u32) -> Self {
        use LightState::*;
        [Red, Yellow, Green, Off]
            .into_iter()
            .find(|s| *s as u32 == code)
            .unwrap_or(Unknown)
    }

    /// Lower-case English name, as in commands.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Red => "red",
            Self::Yellow => "yellow",
            Self::Green => "green",
            Self::Off => "off",
            Self::Unknown => "unknown",
        }
    }

    /// The state with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        use LightState::*;
        [Red, Yellow, Green, Off, Unknown]
            .into_iter()
            .find(|s| s.name() == name)
    }
}

/// Traffic-light part of a record. 96 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct TrafficLightPart {
    /// [`LightState`] number.
    pub state: u32,
    /// Bit 0: timers stand still.
    pub flags: u32,
    /// Seconds in the current state.
    pub elapsed_secs: f32,
    /// Length of the green stage, seconds.
    pub green_secs: f32,
    /// Length of the yellow stage, seconds.
    pub yellow_secs: f32,
    /// Length of the all-red stage after it, seconds.
    pub red_secs: f32,
    /// Group (junction) the light belongs to, from 1.
    pub group: u32,
    /// Index within its group.
    pub pole_idx: u32,
    /// OpenDRIVE signal id, UTF-8, padded with zeros.
    pub opendrive_id: [u8; 32],
    /// Zero.
    pub reserved: [u8; 32],
}
const _: () = assert!(size_of::<TrafficLightPart>() == 96);

impl TrafficLightPart {
    /// The OpenDRIVE signal id as text.
    pub fn opendrive_id(&self) -> &str {
        id_text(&self.opendrive_id)
    }
}

/// Traffic-sign part of a record. 96 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct TrafficSignPart {
    /// OpenDRIVE signal id, UTF-8, padded with zeros.
    pub opendrive_id: [u8; 32],
    /// Zero.
    pub reserved: [u8; 64],
}
const _: () = assert!(size_of::<TrafficSignPart>() == 96);

impl TrafficSignPart {
    /// The OpenDRIVE signal id as text.
    pub fn opendrive_id(&self) -> &str {
        id_text(&self.opendrive_id)
    }
}

/// An OpenDRIVE id as records carry it: its first 32 bytes, cut between characters.
pub fn id_bytes(id: &str) -> [u8; 32] {
    let mut n_bytes = id.len().min(32);
    while !id.is_char_boundary(n_bytes) {
        n_bytes -= 1;
    }
    let mut bytes = [0; 32];
    bytes[..n_bytes].copy_from_slice(&id.as_bytes()[..n_bytes]);
    bytes
}

fn id_text(bytes: &[u8; 32]) -> &str {
    let len = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    std::str::from_utf8(&bytes[..len]).unwrap_or("")
}

/// Walker part of a record. 96 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct WalkerPart {
    /// Direction of its control, world.
    pub direction: [f32; 3],
    /// Speed of its control, m/s.
    pub speed_mps: f32,
    /// Phase of the gait, radians.
    pub gait_rad: f32,
    /// [`WalkerPart::JUMP`] and the other flag bits.
    pub flags: u32,
    /// Walking speed that the motion of the limbs shows, m/s.
    pub gait_mps: f32,
    /// Zero.
    pub reserved: [u8; 68],
}
const _: () = assert!(size_of::<WalkerPart>() == 96);

impl WalkerPart {
    /// Flag: asked to jump.
    pub const JUMP: u32 = 1;
    /// Flag: was knocked down and lies.
    pub const DOWN: u32 = 2;
    /// Flag: its feet are off the ground.
    pub const AIRBORNE: u32 = 4;
    /// Flag: sits in a wheelchair.
    pub const SEATED: u32 = 8;
}
