//! Lidar that sweeps per tick, as CARLA's: its angles, its counts and where its head continues,
//! compared with the published formulas.

use nalgebra::{Isometry3, Point3, Vector3};
use schema_frames::{LidarPoint, SemanticLidarPoint};
use schema_types::noise::Noise;
use schema_types::{Class, ObjectId};
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder, SceneAssets, StaticInstance};
use sensor_ray::{Lidar, RayScene, SensorPath};
use sensor_spec::{LidarScan, LidarSpec};

/// A closed room, so that every ray returns.
fn room() -> RayScene {
    let mut assets = SceneAssets::default();
    let mut builder = MeshBuilder::new("room");
    builder.cuboid(
        Surface::new(Class::WALLS, Material::Matte, [128; 3]),
        [0.0; 3],
        [7.0, 5.0, 4.0],
    );
    let mesh = assets.add_mesh(builder.finish());
    assets.statics.push(StaticInstance {
        mesh,
        world_from_mesh: Isometry3::identity(),
        object: ObjectId::scenery(1),
    });
    RayScene::load(&assets)
}

fn spec() -> LidarSpec {
    LidarSpec {
        scan: LidarScan::Sweep,
        channels: 4,
        points_per_second: 56_000,
        rotation_hz: 10.0,
        upper_fov_deg: 10.0,
        lower_fov_deg: -30.0,
        attenuation_per_m: 0.0,
        ..Default::default()
    }
}

fn fire(lidar: &mut Lidar, scene: &RayScene, tick_nanos: u64) -> Vec<LidarPoint> {
    lidar.turn_head(tick_nanos, u32::MAX);
    lidar.scan(
        scene,
        &SensorPath::still(Isometry3::identity()),
        Noise::new(1, 2, 3),
        None,
    );
    let mut bytes = vec![0; lidar.payload_bytes()];
    lidar.write(&mut bytes);
    bytes
        .chunks_exact(16)
        .map(bytemuck::pod_read_unaligned)
        .collect()
}

fn azimuth_deg(point: &LidarPoint) -> f64 {
    let [x, y, _] = point.hit_in_sensor_m.map(f64::from);
    y.atan2(x).to_degrees()
}

/// CARLA's azimuth of ray `i`, degrees clockwise from x, by its own recurrence.
fn carla_deg(current: f64, step: f64, i: u32, fov: f64) -> f64 {
    (current + step * i as f64) % fov - fov / 2.0
}

fn same_angle(a_deg: f64, b_deg: f64) -> bool {
    let difference = (a_deg - b_deg).rem_euclid(360.0);
    difference.min(360.0 - difference) < 1e-3
}

#[test]
fn rays_follow_carlas_formula_from_tick_to_tick() {
    let scene = room();
    for (fov, rotation_hz, ticks_nanos) in [
        (360.0, 10.0, [50_000_000u64; 5]),
        (120.0, 7.0, [50_000_000; 5]),
        (
            360.0,
            20.0,
            [50_000_000, 33_000_000, 50_000_000, 10_000_000, 71_000_000],
        ),
        (90.0, 30.0, [50_000_000; 5]),
    ] {
        let mut lidar = Lidar::new(LidarSpec {
            horizontal_fov_deg: fov,
            rotation_hz,
            ..spec()
        });
        let mut current = 0.0f64;
        for tick_nanos in ticks_nanos {
            let dt = tick_nanos as f64 * 1e-9;
            let points = fire(&mut lidar, &scene, tick_nanos);
            let n = (56_000.0 * dt / 4.0).round() as u32;
            let sweep = rotation_hz * fov * dt;
            assert_eq!(points.len() as u32, 4 * n);
            for (k, point) in points.iter().enumerate() {
                let (channel, i) = (k as u32 / n, k as u32 % n);
                assert_eq!(point.channel as u32, channel);
                let expected = -carla_deg(current, sweep / n as f64, i, fov);
                assert!(
                    same_angle(azimuth_deg(point), expected),
                    "ray {i}: {} instead of {expected}",
                    azimuth_deg(point)
                );
                let [x, y, z] = point.hit_in_sensor_m.map(f64::from);
                let elevation = z.atan2(x.hypot(y)).to_degrees();
                assert!((elevation - (10.0 - channel as f64 * 40.0 / 3.0)).abs() < 1e-3);
            }
            current = (current + sweep) % fov;
            assert!(
                same_angle(lidar.head_rad().to_degrees(), fov / 2.0 - current),
                "{} {current}",
                lidar.head_rad().to_degrees()
            );
        }
    }
}

#[test]
fn a_turn_in_parts_sees_what_a_turn_at_once_sees() {
    let scene = room();
    let mut parts = Lidar::new(spec());
    let mut whole = Lidar::new(spec());
    let mut collected: Vec<Vec<LidarPoint>> = vec![Vec::new(); 4];
    for _ in 0..4 {
        for point in fire(&mut parts, &scene, 25_000_000) {
            collected[point.channel as usize].push(point);
        }
    }
    let at_once = fire(&mut whole, &scene, 100_000_000);
    let collected: Vec<LidarPoint> = collected.concat();
    assert_eq!(collected.len(), at_once.len());
    for (a, b) in collected.iter().zip(&at_once) {
        let gap = (0..3)
            .map(|k| (a.hit_in_sensor_m[k] - b.hit_in_sensor_m[k]).abs())
            .fold(0.0, f32::max);
        assert!(gap < 1e-4, "{a:?} {b:?}");
    }
}

#[test]
fn a_frame_never_exceeds_its_room_and_a_lidar_too_slow_for_a_point_sends_none() {
    let scene = room();
    let mut lidar = Lidar::new(spec());
    lidar.turn_head(1_000_000_000, 4 * 100 + 3);
    assert_eq!(
        lidar.scan(
            &scene,
            &SensorPath::still(Isometry3::identity()),
            Noise::new(1, 2, 3),
            None
        ),
        400
    );
    assert_eq!(
        fire(
            &mut Lidar::new(LidarSpec {
                points_per_second: 1,
                ..spec()
            }),
            &scene,
            50_000_000
        )
        .len(),
        0
    );
}

#[test]
fn semantic_sweeps_have_the_same_rays() {
    let scene = room();
    let mut lidar = Lidar::new(LidarSpec {
        semantic: true,
        ..spec()
    });
    lidar.turn_head(50_000_000, u32::MAX);
    lidar.scan(
        &scene,
        &SensorPath::still(Isometry3::identity()),
        Noise::new(1, 2, 3),
        None,
    );
    let mut bytes = vec![0; lidar.payload_bytes()];
    lidar.write(&mut bytes);
    let labels: Vec<SemanticLidarPoint> = bytes
        .chunks_exact(24)
        .map(bytemuck::pod_read_unaligned)
        .collect();
    let plain = fire(&mut Lidar::new(spec()), &scene, 50_000_000);
    assert!(
        labels
            .iter()
            .zip(&plain)
            .all(|(a, b)| a.hit_in_sensor_m == b.hit_in_sensor_m && a.class == Class::WALLS.0)
    );
    assert_eq!(labels.len(), plain.len());
}

/// Goal: with motion distortion each ray starts where the sensor was when it was fired; the room's
/// walls stay where they are.
#[test]
fn a_distorted_sweep_moves_the_sensor_along_with_the_head() {
    let scene = room();
    let path = SensorPath {
        world_from_sensor_start: Isometry3::translation(-2.0, 0.0, 0.0),
        world_from_sensor: Isometry3::translation(2.0, 0.0, 0.0),
    };
    let mut lidar = Lidar::new(LidarSpec {
        motion_distortion: true,
        channels: 1,
        upper_fov_deg: 0.0,
        ..spec()
    });
    lidar.turn_head(100_000_000, u32::MAX);
    let n = lidar.scan(&scene, &path, Noise::new(1, 2, 3), None);
    let mut bytes = vec![0; lidar.payload_bytes()];
    lidar.write(&mut bytes);
    let points: Vec<LidarPoint> = bytes
        .chunks_exact(16)
        .map(bytemuck::pod_read_unaligned)
        .collect();
    for (i, point) in points.iter().enumerate() {
        let x = -2.0 + 4.0 * (i as f64 + 1.0) / n as f64;
        let hit = Point3::new(x, 0.0, 0.0) + Vector3::from(point.hit_in_sensor_m.map(f64::from));
        let off = (hit.x.abs() - 7.0).abs().min((hit.y.abs() - 5.0).abs());
        assert!(off < 1e-3, "ray {i} ends at {hit}");
    }
}
