//! A made-up drive: a flat road, a box ahead, every modality. Shared by the examples that show it
//! and that publish it.

#![allow(dead_code, reason = "each example uses its part of it")]

use schema_frames::{
    ActorInfo, ActorKind, ActorList, ActorRecord, BodyBox, DvsEvent, FrameHeader, LidarPoint,
    Modality, SnapshotHeader, VehiclePart,
};
use schema_types::Pose;

/// Length of a tick.
pub const PERIOD_NANOS: u64 = 50_000_000;
const W: u32 = 320;
const H: u32 = 240;
const FOCAL_PX: f64 = 160.0;
const CAMERA_HEIGHT_M: f64 = 1.6;
const MOUNT: [f64; 3] = [1.5, 0.0, CAMERA_HEIGHT_M];

/// What a pixel shows: depth, class, id.
fn cast(u: u32, v: u32, ahead_m: f64) -> (f32, u8, u32) {
    let (x, y) = (
        (u as f64 + 0.5 - W as f64 / 2.0) / FOCAL_PX,
        (v as f64 + 0.5 - H as f64 / 2.0) / FOCAL_PX,
    );
    let (left, up) = (-x * ahead_m, CAMERA_HEIGHT_M - y * ahead_m);
    let ground_m = if y > 0.0 {
        CAMERA_HEIGHT_M / y
    } else {
        f64::INFINITY
    };
    if left.abs() < 1.0 && (0.0..1.5).contains(&up) && ahead_m < ground_m {
        (ahead_m as f32, 14, 8)
    } else if ground_m < 200.0 {
        let side = (-x * ground_m).abs();
        (
            ground_m as f32,
            if side < 4.0 { 1 } else { 10 },
            0x8000_0001 + (side >= 4.0) as u32,
        )
    } else {
        (f32::INFINITY, 11, 0)
    }
}

fn payload(modality: Modality, tick: u64, ahead_m: f64, closing_m: f64) -> Vec<u8> {
    let pixels = || (0..H).flat_map(|v| (0..W).map(move |u| (u, v)));
    match modality {
        Modality::Rgb => pixels()
            .flat_map(|(u, v)| match cast(u, v, ahead_m).1 {
                14 => [40, 40, 200, 255],
                1 => [90, 90, 90, 255],
                10 => [60, 140, 70, 255],
                _ => [235, 190, 130, 255],
            })
            .collect(),
        Modality::Depth => pixels()
            .flat_map(|(u, v)| cast(u, v, ahead_m).0.to_le_bytes())
            .collect(),
        Modality::Semantic => pixels().map(|(u, v)| cast(u, v, ahead_m).1).collect(),
        Modality::Instance => pixels()
            .flat_map(|(u, v)| cast(u, v, ahead_m).2.to_le_bytes())
            .collect(),
        Modality::Flow => pixels()
            .flat_map(|(u, v)| {
                let (depth_m, _, _) = cast(u, v, ahead_m);
                let share = if depth_m.is_finite() {
                    (closing_m as f32 / depth_m).min(0.5)
                } else {
                    0.0
                };
                let flow = [
                    (u as f32 + 0.5 - W as f32 / 2.0) * share,
                    (v as f32 + 0.5 - H as f32 / 2.0) * share,
                ];
                flow.into_iter().flat_map(f32::to_le_bytes)
            })
            .collect(),
        Modality::Dvs => {
            let edge = |u: u32, v: u32| u > 0 && cast(u, v, ahead_m).1 != cast(u - 1, v, ahead_m).1;
            let events: Vec<DvsEvent> = pixels()
                .filter(|(u, v)| edge(*u, *v))
                .map(|(u, v)| DvsEvent {
                    nanos_in_window: 0,
                    x_px: u as u16,
                    y_px: v as u16,
                    object_id: 0,
                    polarity: (u < W / 2) as u8,
                    class: 0,
                    reserved: 0,
                })
                .collect();
            bytemuck::cast_slice(&events).to_vec()
        }
        Modality::Lidar => {
            let ring = |channel: u16| {
                (0..720u32).map(move |step| (channel, step as f64 * std::f64::consts::TAU / 720.0))
            };
            let points: Vec<LidarPoint> = (0..24u16)
                .flat_map(ring)
                .map(|(channel, azimuth)| {
                    let range_m = 4.0 + channel as f64 * 1.5 + (tick as f64 * 0.1).sin();
                    let z = -1.9 + 0.25 * channel as f64 * (azimuth * 3.0).sin().max(0.0);
                    LidarPoint {
                        hit_in_sensor_m: [range_m * azimuth.cos(), range_m * azimuth.sin(), z]
                            .map(|x| x as f32),
                        intensity: 30_000,
                        channel,
                    }
                })
                .collect();
            bytemuck::cast_slice(&points).to_vec()
        }
        _ => Vec::new(),
    }
}

fn frame_at(
    modality: Modality,
    sensor: [f64; 3],
    ego: &Pose,
    tick: u64,
    ahead_m: f64,
) -> (FrameHeader, Vec<u8>) {
    let payload = payload(modality, tick, ahead_m, 0.4);
    let mut header = FrameHeader::new(modality);
    if modality.is_image() {
        header.set_image(W, H);
    } else {
        header.set_list((payload.len() / modality.element_bytes()) as u32);
    }
    (header.tick, header.sim_nanos, header.seq, header.parent_id) =
        (tick, tick * PERIOD_NANOS, tick, 7);
    header.world_from_sensor = (ego.isometry()
        * Pose::from_xyz_yaw(sensor[0], sensor[1], sensor[2], 0.0).isometry())
    .into();
    if modality.sensor_kind() == schema_frames::SensorKind::Camera {
        header.intrinsics_px = [FOCAL_PX, FOCAL_PX, W as f64 / 2.0, H as f64 / 2.0];
    }
    (header, payload)
}

const BODY: BodyBox = BodyBox {
    centre_m: [0.0, 0.0, 0.75],
    half_m: [2.2, 0.95, 0.75],
};

/// Modalities of the drive.
pub const MODALITIES: [Modality; 7] = [
    Modality::Rgb,
    Modality::Depth,
    Modality::Semantic,
    Modality::Instance,
    Modality::Flow,
    Modality::Dvs,
    Modality::Lidar,
];

/// Topic of a modality.
pub fn topic(modality: Modality) -> String {
    format!(
        "ego/{}/{}",
        if modality == Modality::Lidar {
            "roof"
        } else {
            "front"
        },
        modality.name()
    )
}

/// The actors of the sample world.
pub fn actors() -> ActorList {
    let actor = |id: u32, role: &str| ActorInfo {
        id,
        type_id: "vehicle.sample".into(),
        kind: "vehicle".into(),
        role: role.into(),
        parent_id: 0,
        mount: None,
        trigger_box: None,
        body_box: BODY,
        attributes: Default::default(),
        topics: vec![],
    };
    ActorList {
        actors: vec![actor(7, "ego_vehicle"), actor(8, "autopilot")],
    }
}

fn ahead_m(tick: u64) -> f64 {
    14.0 - (tick % 100) as f64 * 0.1
}

fn ego(tick: u64) -> Pose {
    Pose::from_xyz_yaw((tick % 100) as f64 * 0.5, 0.0, 0.0, 0.0)
}

/// The snapshot of a tick.
pub fn snapshot(tick: u64) -> (SnapshotHeader, Vec<ActorRecord>) {
    let other = Pose::from_xyz_yaw(
        ego(tick).translation_m[0] + MOUNT[0] + ahead_m(tick) + BODY.half_m[0] as f64,
        0.0,
        0.0,
        0.0,
    );
    let record = |id: u32, pose: Pose| {
        let mut record = ActorRecord {
            id,
            kind: ActorKind::Vehicle as u16,
            class: 14,
            world_from_actor: pose,
            velocity_in_world_mps: [10.0 + (tick as f64 * 0.2).sin(), 0.0, 0.0],
            half_box_m: BODY.half_m,
            ..bytemuck::Zeroable::zeroed()
        };
        record.set_part(&VehiclePart {
            throttle_ratio: 0.4,
            steer_ratio: (tick as f32 * 0.2).sin() * 0.3,
            brake_ratio: 0.0,
            speed_limit_mps: 13.9,
            ..bytemuck::Zeroable::zeroed()
        });
        record
    };
    let header = SnapshotHeader {
        tick,
        sim_nanos: tick * PERIOD_NANOS,
        ..bytemuck::Zeroable::zeroed()
    };
    (header, vec![record(7, ego(tick)), record(8, other)])
}

/// A frame of a tick.
pub fn frame(modality: Modality, tick: u64) -> (FrameHeader, Vec<u8>) {
    let sensor = if modality == Modality::Lidar {
        [0.0, 0.0, 1.9]
    } else {
        MOUNT
    };
    frame_at(modality, sensor, &ego(tick), tick, ahead_m(tick))
}
