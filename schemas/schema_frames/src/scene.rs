//! `control/scene` and `control/rendered`: what the simulator tells processes that render a share of
//! its cameras, and what they answer.
//!
//! The snapshot does not hold every moving part, so each message has all of them, and the firings
//! that are due. Still scenery and the cameras themselves have versions; whoever lacks one asks on
//! `control/render`.

use bytemuck::{Pod, Zeroable};
use schema_types::Pose;

use crate::Modality;

/// "GSCN" read as a little-endian `u32`.
pub const SCENE_MAGIC: u32 = u32::from_le_bytes(*b"GSCN");

/// Payload of a message on `control/scene`: `n_firings` [`SceneFiring`]s, `n_instances`
/// [`SceneInstance`]s, `n_strokes` [`SceneStroke`]s, `overlay_bytes` bytes of what the spectator alone
/// shows, and `past_bytes` bytes of where parts were at the ticks before, for turning lidars. User header: iceoryx2 type name `GantrySceneHeader`, 192 bytes.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SceneHeader {
    /// [`SCENE_MAGIC`].
    pub magic: u32,
    /// [`crate::SCHEMA_VERSION`].
    pub schema_version: u16,
    /// 192.
    pub header_bytes: u16,
    /// Number of the message in its epoch, from 1. Not every tick has one, and a tick may have
    /// several.
    pub number: u64,
    /// Random number of the simulator's start.
    pub epoch: u64,
    /// The tick.
    pub tick: u64,
    /// Simulated time, nanoseconds.
    pub sim_nanos: u64,
    /// Length of the tick, nanoseconds.
    pub period_nanos: u64,
    /// Version of the list of cameras.
    pub cameras_version: u64,
    /// Version of the still scenery.
    pub scenery_version: u64,
    /// Loss of lidar light in the air, 1/m.
    pub lidar_extinction_per_m: f64,
    /// Count of map loads in this epoch, from 1.
    pub episode: u32,
    /// Number of firings.
    pub n_firings: u32,
    /// Number of moving parts.
    pub n_instances: u32,
    /// Number of strokes.
    pub n_strokes: u32,
    /// Bytes of the overlay.
    pub overlay_bytes: u32,
    /// Bytes of the poses at earlier ticks.
    pub past_bytes: u32,
    /// The weather's numbers in the order of the keys of `world/info`.
    pub weather: [f32; 14],
    /// `CLOCK_MONOTONIC` just before the message was sent.
    pub published_mono_nanos: u64,
    /// Zero.
    pub reserved1: [u8; 32],
}
const _: () = assert!(size_of::<SceneHeader>() == 192);

/// A camera or lidar that fires, or a batch whose frames are made of cameras that fire. 160 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SceneFiring {
    /// Actor id of the sensor; 0 for a batch, of which the fields without a word about it are zero.
    pub sensor_id: u32,
    /// Number of the worker that renders it, also of a batch.
    pub worker: u32,
    /// Number of the firing, from 1.
    pub seq: u64,
    /// Time since the firing before, nanoseconds.
    pub window_nanos: u64,
    /// Simulated time of the firing before, nanoseconds; `u64::MAX` for the first.
    pub previous_nanos: u64,
    /// Frames that are made, also of a batch: bit n stands for the modality of number n.
    pub outputs: u32,
    /// Actor it is mounted on; 0 if free. Of a batch its place among those of `world/info`, from 0.
    pub parent_id: u32,
    /// Pose of the sensor in the world, as in the snapshot.
    pub world_from_sensor: Pose,
    /// Of a lidar: its pose when the turn began; of a camera its pose.
    pub world_from_sensor_start: Pose,
    /// Of a lidar: time for which its head had turned before, nanoseconds.
    pub turned_nanos: u64,
}
const _: () = assert!(size_of::<SceneFiring>() == 160);

impl SceneFiring {
    /// The frames of a batch that a worker makes.
    pub fn of_batch(number: u32, worker: u32, outputs: u32) -> SceneFiring {
        SceneFiring {
            worker,
            outputs,
            parent_id: number,
            ..SceneFiring::zeroed()
        }
    }

    /// Place of the batch among those of `world/info`; `None` for a sensor.
    pub fn batch(&self) -> Option<u32> {
        (self.sensor_id == 0).then_some(self.parent_id)
    }

    /// Bit of [`SceneFiring::outputs`] for a modality.
    pub fn output(modality: Modality) -> u32 {
        1 << (modality as u32)
    }
}

/// A rigid part of an actor. 104 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SceneInstance {
    /// Pose of the mesh in the world.
    pub world_from_mesh: Pose,
    /// Velocity of the mesh's origin, m/s, world.
    pub velocity_in_world_mps: [f64; 3],
    /// Actor it belongs to.
    pub actor_id: u32,
    /// Place of its mesh in the scenery's list.
    pub mesh: u32,
    /// Lamp bits that shine.
    pub lamps: u32,
    /// Part of the actor.
    pub part: u16,
    /// Tint of car paint, sRGB.
    pub tint_rgb: [u8; 3],
    /// Zero.
    pub reserved: [u8; 7],
}
const _: () = assert!(size_of::<SceneInstance>() == 104);

/// A line for debugging. 56 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SceneStroke {
    /// One end, world, metres.
    pub from_m: [f64; 3],
    /// The other end.
    pub to_m: [f64; 3],
    /// Thickness, metres; of the overlay, pixels.
    pub width_m: f32,
    /// sRGB.
    pub color_rgb: [u8; 3],
    /// Zero.
    pub reserved: u8,
}
const _: () = assert!(size_of::<SceneStroke>() == 56);

/// A worker's answer to a message: fixed-size sample on `control/rendered`, type name
/// `GantryRendered`. 64 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct RenderedRecord {
    /// Number of the worker.
    pub worker: u32,
    /// [`RenderedRecord::WORKS`] or another of these numbers.
    pub state: u32,
    /// Epoch of the message.
    pub epoch: u64,
    /// The last message whose list of cameras it has taken over, and whose firings it has begun.
    pub number: u64,
    /// The last message all frames of which, and of those before, are sent.
    pub sent_number: u64,
    /// Frames that it has sent in this epoch.
    pub n_sent: u64,
    /// Frames that it has lost because no slot was free.
    pub n_dropped: u64,
    /// Images that were drawn.
    pub n_passes: u64,
    /// Version of the still scenery that it has; 0 before the first.
    pub scenery_version: u64,
}
const _: () = assert!(size_of::<RenderedRecord>() == 64);

impl RenderedRecord {
    /// It renders.
    pub const WORKS: u32 = 1;
    /// It takes scenery over, which may take long.
    pub const LOADS: u32 = 2;
}
