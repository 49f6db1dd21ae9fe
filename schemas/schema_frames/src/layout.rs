//! The layouts as data: name, offset and type of every field, for the golden test, `SPEC.md` and
//! readers in other languages.
//!
//! The list repeats field names and types; the compiler checks both, and a test that the fields
//! leave no byte of a struct out.

use schema_types::Pose;

use crate::control::{ControlHeader, VehicleControlRecord};
use crate::{
    AckRecord, ActorRecord, Box2d, Box3d, CollisionEvent, CompleteRecord, DocumentHeader, DvsEvent,
    FrameHeader, GnssSample, GpuAnswer, GpuAsk, GpuPlace, ImuSample, InputRecord, Keypoint,
    KeypointSet, LaneCrossing, LidarPoint, LidarReturn, MaskRecord, ObstacleEvent, Odometry,
    PathPoint, PoseEstimate, RadarDetection, RenderedRecord, ResultHeader, Scalar, SceneFiring,
    SceneHeader, SceneInstance, SceneStroke, SemanticLidarPoint, SnapshotHeader, Track,
    TrafficLightPart, TrafficSignPart, VehiclePart, WalkerPart, command::RequestHeader,
};

/// One field of a struct.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Name in Rust.
    pub name: &'static str,
    /// Type in Rust: `u32`, `[f32; 3]`, `Pose`, …
    pub kind: &'static str,
    /// Offset, bytes.
    pub offset: usize,
    /// Size, bytes.
    pub size: usize,
}

/// One struct of the contract.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Name in Rust.
    pub name: &'static str,
    /// Type name that iceoryx2 compares; `None` for elements of a byte payload.
    pub on_bus: Option<&'static str>,
    /// Size, bytes.
    pub size: usize,
    /// Alignment in Rust, bytes.
    pub align: usize,
    /// Fields by rising offset.
    pub fields: Vec<Field>,
}

macro_rules! layouts {
    ($($name:ident $(as $on_bus:literal)? { $($field:ident: $kind:ty),* $(,)? })*) => {
        /// Every struct of the contract.
        pub fn all() -> Vec<Layout> {
            vec![$(Layout {
                name: stringify!($name),
                on_bus: [$($on_bus,)?].first().copied(),
                size: size_of::<$name>(),
                align: align_of::<$name>(),
                fields: vec![$({
                    // Fails to compile if the type listed is not the field's.
                    let _: fn(&$name) -> &$kind = |it| &it.$field;
                    Field {
                        name: stringify!($field),
                        kind: stringify!($kind),
                        offset: std::mem::offset_of!($name, $field),
                        size: size_of::<$kind>(),
                    }
                }),*],
            }),*]
        }
    };
}

layouts! {
    FrameHeader as "GantryFrameHeader" {
        magic: u32, schema_version: u16, header_bytes: u16, sensor_id: u32, kind: u16, encoding: u16, tick: u64, sim_nanos: u64, seq: u64,
        episode: u32, flags: u32, payload_bytes: u64, width: u32, height: u32, row_stride: u32, element_bytes: u32, window_nanos: u64,
        world_from_sensor: Pose, intrinsics_px: [f64; 4], range_limit_m: f32, azimuth_rad: f32, parent_id: u32, n_channels: u32,
        n_images: u32, optics: u32, epoch: u64, rendered_mono_nanos: u64, published_mono_nanos: u64, cpu_copies: u32, ticks_in_flight: u32,
        payload_place: u32, lens: [f32; 4], reserved1: [u8; 8], calibration_crc: u32,
    }
    GpuPlace {
        producer: u64, generation: u64, offset_bytes: u64, memory_bytes: u64, capacity_bytes: u64, pid: u32, slot: u32, reserved: [u8; 16],
    }
    GpuAsk { magic: u32, schema_version: u16, what: u16, generation: u64, topic: [u8; 240] }
    GpuAnswer {
        magic: u32, schema_version: u16, status: u16, device_uuid: [u8; 16], driver_uuid: [u8; 16], generation: u64, memory_bytes: u64,
        handle_kind: u32, flags: u32, max_readers: u32, buffer: u32, borrowed: u32, reserved: [u8; 52],
    }
    DvsEvent { nanos_in_window: u32, x_px: u16, y_px: u16, object_id: u32, polarity: u8, class: u8, reserved: u16 }
    LidarPoint { hit_in_sensor_m: [f32; 3], intensity: u16, channel: u16 }
    SemanticLidarPoint { hit_in_sensor_m: [f32; 3], cos_incidence: f32, object_id: u32, class: u8, reserved: u8, channel: u16 }
    LidarReturn {
        hit_in_sensor_m: [f32; 3], time_ns: i32, object_id: u32, intensity: u16, ring: u16, reflectivity: u8, returns: u8, class: u8,
        flags: u8, ambient: u16, range_mm_lsb: u16,
    }
    RadarDetection {
        velocity_mps: f32, azimuth_rad: f32, altitude_rad: f32, depth_m: f32, cos_incidence: f32, object_id: u32, class: u8,
        reserved: [u8; 7],
    }
    ImuSample { specific_force_mps2: [f64; 3], angular_velocity_radps: [f64; 3], compass_rad: f64, reserved: [u64; 2] }
    GnssSample { latitude_deg: f64, longitude_deg: f64, altitude_m: f64, reserved: [u64; 2] }
    CollisionEvent {
        other_id: u32, class: u8, reserved: [u8; 3], impulse_in_world_ns: [f64; 3], point_in_world_m: [f64; 3], reserved1: u64,
    }
    LaneCrossing {
        mark: u8, colour: u8, lane_change: u8, lane: i8, width_m: f32, road: u32, nanos_in_window: u32, crossing_in_world_m: [f32; 3],
        reserved: u32,
    }
    ObstacleEvent {
        distance_m: f32, object_id: u32, class: u8, reserved: [u8; 3], contact_in_sensor_m: [f32; 3], reserved1: [u32; 2],
    }
    SnapshotHeader as "GantrySnapshotHeader" {
        magic: u32, schema_version: u16, header_bytes: u16, tick: u64, sim_nanos: u64, episode_start_nanos: u64, period_nanos: u64,
        episode: u32, n_actors: u32, actors_revision: u64, flags: u32, reserved0: u32, epoch: u64, published_mono_nanos: u64,
        reserved1: [u8; 48],
    }
    ActorRecord {
        id: u32, parent_id: u32, catalogue_idx: u32, kind: u16, class: u8, reserved: u8, world_from_actor: Pose,
        velocity_in_world_mps: [f64; 3], angular_velocity_in_world_radps: [f64; 3], acceleration_in_world_mps2: [f64; 3],
        half_box_m: [f32; 3], flags: u32, part: [u8; 96],
    }
    VehiclePart {
        throttle_ratio: f32, steer_ratio: f32, brake_ratio: f32, control_flags: u32, gear: i32, engine_radps: f32, speed_limit_mps: f32,
        lamps: u32, light_actor_id: u32, light_state: u32, wheel_steer_rad: f32, wheels_on_ground: u32, wheel_spin_rad: [f32; 6],
        wheel_travel_m: [f32; 6],
    }
    TrafficLightPart {
        state: u32, flags: u32, elapsed_secs: f32, green_secs: f32, yellow_secs: f32, red_secs: f32, group: u32, pole_idx: u32,
        opendrive_id: [u8; 32], reserved: [u8; 32],
    }
    TrafficSignPart { opendrive_id: [u8; 32], reserved: [u8; 64] }
    WalkerPart { direction: [f32; 3], speed_mps: f32, gait_rad: f32, flags: u32, gait_mps: f32, reserved: [u8; 68] }
    DocumentHeader as "GantryDocumentHeader" {
        magic: u32, schema_version: u16, reserved0: u16, epoch: u64, revision: u64, payload_bytes: u64, tick: u64, reserved1: [u8; 24],
    }
    ControlHeader as "GantryControlHeader" {
        magic: u32, schema_version: u16, reserved0: u16, tick: u64, seq: u64, writer: [u8; 40],
    }
    VehicleControlRecord {
        actor_id: u32, throttle_ratio: f32, steer_ratio: f32, brake_ratio: f32, flags: u32, gear: i32, lamps: u32, reserved: u32,
    }
    AckRecord as "GantryAck" { participant: u32, reserved: u32, epoch: u64, tick: u64, reserved1: u64 }
    CompleteRecord as "GantryComplete" { epoch: u64, tick: u64, reserved: [u64; 2] }
    RequestHeader as "GantryRequestHeader" { magic: u32, codec_version: u32, seq: u64, payload_bytes: u64, client: [u8; 40] }
    Pose { translation_m: [f64; 3], rotation_xyzw: [f64; 4] }
    ResultHeader as "GantryResultHeader" {
        magic: u32, schema_version: u16, header_bytes: u16, result_type: u16, encoding: u16, flags: u32, tick: u64, sim_nanos: u64,
        seq: u64, episode: u32, n_inputs: u32, payload_bytes: u64, body_bytes: u64, width: u32, height: u32, row_stride: u32,
        element_bytes: u32, n_items: u32, n_dims: u32, shape: [u32; 8], world_from_space: Pose, intrinsics_px: [f64; 4], space: u32,
        reserved0: u32, epoch: u64, writer_epoch: u64, origin_mono_nanos: u64, taken_mono_nanos: u64, published_mono_nanos: u64,
        payload_place: u32, reserved1: [u8; 60],
    }
    InputRecord {
        topic: [u8; 200], tick: u64, seq: u64, sim_nanos: u64, epoch: u64, published_mono_nanos: u64, taken_mono_nanos: u64,
        reserved: u64,
    }
    Box2d { min_px: [f32; 2], max_px: [f32; 2], score: f32, class: u32, id: u32, reserved: u32 }
    Box3d {
        pose: Pose, half_m: [f32; 3], velocity_mps: [f32; 3], score: f32, class: u32, id: u32, n_points: u32, reserved: [u32; 2],
    }
    Track {
        id: u32, class: u32, state: u32, flags: u32, score: f32, n_hits: u32, n_missed: u32, age_secs: f32, min_px: [f32; 2],
        max_px: [f32; 2], velocity_pxps: [f32; 2], reserved0: [u32; 2], pose: Pose, half_m: [f32; 3], velocity_mps: [f32; 3],
        yaw_rate_radps: f32, reserved1: u32,
    }
    MaskRecord {
        min_px: [f32; 2], max_px: [f32; 2], score: f32, class: u32, id: u32, first_run: u32, n_runs: u32, reserved: [u32; 3],
    }
    KeypointSet { score: f32, class: u32, id: u32, first_point: u32, n_points: u32, reserved: [u32; 3] }
    Keypoint { at_px: [f32; 2], score: f32, visibility: u32 }
    PoseEstimate { pose: Pose, covariance: [f64; 36] }
    Odometry {
        pose: Pose, pose_covariance: [f64; 36], velocity_mps: [f64; 3], angular_velocity_radps: [f64; 3], twist_covariance: [f64; 36],
    }
    PathPoint {
        pose: Pose, after_secs: f32, speed_mps: f32, acceleration_mps2: f32, curvature_pm: f32, reserved: [u32; 2],
    }
    Scalar { value: f64, name: [u8; 56] }
    SceneHeader as "GantrySceneHeader" {
        magic: u32, schema_version: u16, header_bytes: u16, number: u64, epoch: u64, tick: u64, sim_nanos: u64, period_nanos: u64,
        cameras_version: u64, scenery_version: u64, lidar_extinction_per_m: f64, episode: u32, n_firings: u32, n_instances: u32,
        n_strokes: u32, overlay_bytes: u32, past_bytes: u32, weather: [f32; 14], published_mono_nanos: u64, reserved1: [u8; 32],
    }
    SceneFiring {
        sensor_id: u32, worker: u32, seq: u64, window_nanos: u64, previous_nanos: u64, outputs: u32, parent_id: u32,
        world_from_sensor: Pose, world_from_sensor_start: Pose, turned_nanos: u64,
    }
    SceneInstance {
        world_from_mesh: Pose, velocity_in_world_mps: [f64; 3], actor_id: u32, mesh: u32, lamps: u32, part: u16, tint_rgb: [u8; 3],
        reserved: [u8; 7],
    }
    SceneStroke { from_m: [f64; 3], to_m: [f64; 3], width_m: f32, color_rgb: [u8; 3], reserved: u8 }
    RenderedRecord as "GantryRendered" {
        worker: u32, state: u32, epoch: u64, number: u64, sent_number: u64, n_sent: u64, n_dropped: u64, n_passes: u64,
        scenery_version: u64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_follow_one_another_and_fill_their_struct() {
        for layout in all() {
            let mut end = 0;
            for field in &layout.fields {
                assert_eq!(
                    field.offset, end,
                    "{}.{} leaves a gap",
                    layout.name, field.name
                );
                end += field.size;
            }
            assert_eq!(
                end, layout.size,
                "{} has bytes without a field",
                layout.name
            );
        }
    }
}
