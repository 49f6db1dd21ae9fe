//! Makes an .rrd of a made-up drive without any daemon: `cargo run --example view_sample -- OUT.rrd`.
//!
//! A flat road, a box ahead, every modality; for checking layout and colours by eye.

use consumer_view::stage::Stage;
use schema_frames::{
    ActorInfo, ActorKind, ActorList, ActorRecord, BodyBox, DvsEvent, FrameHeader, LidarPoint, Modality, SnapshotHeader, VehiclePart,
};
use schema_types::Pose;

const W: u32 = 320;
const H: u32 = 240;
const FOCAL_PX: f64 = 160.0;
const CAMERA_HEIGHT_M: f64 = 1.6;
const MOUNT: [f64; 3] = [1.5, 0.0, CAMERA_HEIGHT_M];

/// What a pixel shows: depth, class, id.
fn cast(u: u32, v: u32, ahead_m: f64) -> (f32, u8, u32) {
    let (x, y) = ((u as f64 + 0.5 - W as f64 / 2.0) / FOCAL_PX, (v as f64 + 0.5 - H as f64 / 2.0) / FOCAL_PX);
    let (left, up) = (-x * ahead_m, CAMERA_HEIGHT_M - y * ahead_m);
    let ground_m = if y > 0.0 { CAMERA_HEIGHT_M / y } else { f64::INFINITY };
    if left.abs() < 1.0 && (0.0..1.5).contains(&up) && ahead_m < ground_m {
        (ahead_m as f32, 14, 8)
    } else if ground_m < 200.0 {
        let side = (-x * ground_m).abs();
        (ground_m as f32, if side < 4.0 { 1 } else { 10 }, 0x8000_0001 + (side >= 4.0) as u32)
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
        Modality::Depth => pixels().flat_map(|(u, v)| cast(u, v, ahead_m).0.to_le_bytes()).collect(),
        Modality::Semantic => pixels().map(|(u, v)| cast(u, v, ahead_m).1).collect(),
        Modality::Instance => pixels().flat_map(|(u, v)| cast(u, v, ahead_m).2.to_le_bytes()).collect(),
        Modality::Flow => pixels()
            .flat_map(|(u, v)| {
                let (depth_m, _, _) = cast(u, v, ahead_m);
                let share = if depth_m.is_finite() { (closing_m as f32 / depth_m).min(0.5) } else { 0.0 };
                let flow = [(u as f32 + 0.5 - W as f32 / 2.0) * share, (v as f32 + 0.5 - H as f32 / 2.0) * share];
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
            let ring = |channel: u16| (0..720u32).map(move |step| (channel, step as f64 * std::f64::consts::TAU / 720.0));
            let points: Vec<LidarPoint> = (0..24u16)
                .flat_map(ring)
                .map(|(channel, azimuth)| {
                    let range_m = 4.0 + channel as f64 * 1.5 + (tick as f64 * 0.1).sin();
                    let z = -1.9 + 0.25 * channel as f64 * (azimuth * 3.0).sin().max(0.0);
                    LidarPoint {
                        hit_in_sensor_m: [range_m * azimuth.cos(), range_m * azimuth.sin(), z].map(|x| x as f32),
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

fn frame(modality: Modality, sensor: [f64; 3], ego: &Pose, tick: u64, ahead_m: f64) -> (FrameHeader, Vec<u8>) {
    let payload = payload(modality, tick, ahead_m, 0.4);
    let mut header = FrameHeader::new(modality);
    if modality.is_image() {
        header.set_image(W, H);
    } else {
        header.set_list((payload.len() / modality.element_bytes()) as u32);
    }
    (header.tick, header.sim_nanos, header.seq, header.parent_id) = (tick, tick * 50_000_000, tick, 7);
    header.world_from_sensor = (ego.isometry() * Pose::from_xyz_yaw(sensor[0], sensor[1], sensor[2], 0.0).isometry()).into();
    if modality.sensor_kind() == schema_frames::SensorKind::Camera {
        header.intrinsics_px = [FOCAL_PX, FOCAL_PX, W as f64 / 2.0, H as f64 / 2.0];
    }
    (header, payload)
}

fn main() -> anyhow::Result<()> {
    let out = std::env::args().nth(1).unwrap_or_else(|| "sample.rrd".to_string());
    let mut stage = Stage::new(rerun::RecordingStreamBuilder::new("gantry").save(&out)?)?;
    let camera = [Modality::Rgb, Modality::Depth, Modality::Semantic, Modality::Instance, Modality::Flow, Modality::Dvs];
    let topic = |modality: Modality| format!("ego/{}/{}", if modality == Modality::Lidar { "roof" } else { "front" }, modality.name());
    let all: Vec<Modality> = camera.into_iter().chain([Modality::Lidar]).collect();
    let topics: Vec<String> = all.iter().map(|modality| topic(*modality)).collect();
    stage.set_topics(topics.iter().map(String::as_str))?;
    if let Some(map) = std::env::args().nth(2) {
        stage.set_map(&std::fs::read_to_string(map)?)?;
    }
    let body = BodyBox { centre_m: [0.0, 0.0, 0.75], half_m: [2.2, 0.95, 0.75] };
    let actor = |id: u32, role: &str| ActorInfo {
        id,
        type_id: "vehicle.sample".into(),
        kind: "vehicle".into(),
        role: role.into(),
        parent_id: 0,
        mount: None,
        body_box: body,
        attributes: Default::default(),
        topics: vec![],
    };
    stage.set_actors(&ActorList { actors: vec![actor(7, "ego_vehicle"), actor(8, "autopilot")] });
    for tick in 1..=40u64 {
        let (x, ahead_m) = (tick as f64 * 0.5, 14.0 - tick as f64 * 0.1);
        let ego = Pose::from_xyz_yaw(x, 0.0, 0.0, 0.0);
        let other = Pose::from_xyz_yaw(x + MOUNT[0] + ahead_m + body.half_m[0] as f64, 0.0, 0.0, 0.0);
        let record = |id: u32, pose: Pose| {
            let mut record = ActorRecord {
                id,
                kind: ActorKind::Vehicle as u16,
                class: 14,
                world_from_actor: pose,
                velocity_in_world_mps: [10.0 + (tick as f64 * 0.2).sin(), 0.0, 0.0],
                half_box_m: body.half_m,
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
        let records = [record(7, ego), record(8, other)];
        let header = SnapshotHeader { tick, sim_nanos: tick * 50_000_000, ..bytemuck::Zeroable::zeroed() };
        stage.remember(&header, &records);
        stage.show_snapshot(&header, &records)?;
        stage.hurry()?;
        for modality in &all {
            let sensor = if *modality == Modality::Lidar { [0.0, 0.0, 1.9] } else { MOUNT };
            let (header, payload) = frame(*modality, sensor, &ego, tick, ahead_m);
            stage.show_frame(&topic(*modality), &header, &payload, 80_000 + tick * 1000)?;
        }
    }
    stage.flush(std::time::Duration::from_secs(20))?;
    println!("{out}");
    Ok(())
}
