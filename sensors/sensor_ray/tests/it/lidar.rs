//! Whole turns of the lidar in a room whose walls are known, and its losses against their
//! distributions.

use nalgebra::{Isometry3, Vector3};
use schema_frames::{LidarPoint, LidarReturn, SemanticLidarPoint};
use schema_types::noise::Noise;
use schema_types::{ActorId, Class, ObjectId};
use sensor_core::mesh::Surface;
use sensor_core::{DynamicInstance, Material, MeshBuilder, SceneAssets, StaticInstance};
use sensor_ray::RayScene;
use sensor_ray::lidar::{Lidar, SensorPath, azimuth_rad};
use sensor_spec::LidarSpec;

/// A room of 40 × 30 × 8 m about the origin, seen from within.
const HALF_M: [f32; 3] = [20.0, 15.0, 4.0];

fn room() -> RayScene {
    let mut builder = MeshBuilder::new("room");
    builder.cuboid(
        Surface::new(Class::WALLS, Material::Matte, [128; 3]),
        [0.0; 3],
        HALF_M,
    );
    let mut assets = SceneAssets::default();
    let mesh = assets.add_mesh(builder.finish());
    assets.statics.push(StaticInstance {
        mesh,
        world_from_mesh: Isometry3::identity(),
        object: ObjectId::scenery(5),
    });
    RayScene::load(&assets)
}

/// Distance from a point to the room's walls.
fn to_wall_m(origin: &Vector3<f64>, direction: &Vector3<f64>) -> f64 {
    let along = |axis: usize| {
        (HALF_M[axis] as f64 * direction[axis].signum() - origin[axis]) / direction[axis]
    };
    (0..3)
        .filter(|axis| direction[*axis] != 0.0)
        .map(along)
        .fold(f64::INFINITY, f64::min)
}

fn spec() -> LidarSpec {
    LidarSpec {
        channels: 13,
        columns: 90,
        attenuation_per_m: 0.02,
        ..Default::default()
    }
}

fn turn(lidar: &mut Lidar, scene: &RayScene, path: &SensorPath, tick: u64) -> Vec<LidarPoint> {
    let n = lidar.scan(scene, path, Noise::new(1, 2, tick), None);
    let mut bytes = vec![0; lidar.payload_bytes()];
    assert_eq!(
        lidar.write(&mut bytes),
        n as usize * size_of::<LidarPoint>()
    );
    bytemuck::pod_collect_to_vec(&bytes)
}

fn ray(spec: &LidarSpec, channel: u32, column: u32) -> Vector3<f64> {
    let (elevation, azimuth) = (spec.elevation_rad(channel), azimuth_rad(spec, column));
    Vector3::new(
        elevation.cos() * azimuth.cos(),
        elevation.cos() * azimuth.sin(),
        elevation.sin(),
    )
}

#[test]
fn every_point_of_a_tilted_lidar_lies_on_the_wall_its_beam_meets() {
    let (scene, spec) = (room(), spec());
    let pose = Isometry3::new(Vector3::new(3.0, -2.0, 0.5), Vector3::new(0.1, -0.2, 1.0));
    let points = turn(
        &mut Lidar::new(spec.clone()),
        &scene,
        &SensorPath::still(pose),
        1,
    );
    assert_eq!(points.len(), 13 * 90, "a closed room returns every beam");
    for (i, point) in points.iter().enumerate() {
        let (channel, column) = (i as u32 / 90, i as u32 % 90);
        let direction = ray(&spec, channel, column);
        let distance = to_wall_m(&pose.translation.vector, &(pose.rotation * direction));
        let found = Vector3::from(point.hit_in_sensor_m).cast::<f64>();
        assert_eq!(
            point.channel as u32, channel,
            "channel after channel, 0 on top"
        );
        assert!(
            (found - direction * distance).norm() < 1e-4,
            "channel {channel} column {column}"
        );
        let intensity = (-0.02 * distance).exp() * 65535.0;
        assert!((point.intensity as f64 - intensity).abs() < 1.0);
    }
}

#[test]
fn channel_0_is_the_top_and_the_last_column_looks_straight_back() {
    let spec = LidarSpec {
        channels: 3,
        columns: 8,
        upper_fov_deg: 10.0,
        lower_fov_deg: -30.0,
        ..Default::default()
    };
    let points = turn(
        &mut Lidar::new(spec.clone()),
        &room(),
        &SensorPath::still(Isometry3::identity()),
        1,
    );
    let elevation = |p: &LidarPoint| {
        (p.hit_in_sensor_m[2] as f64 / Vector3::from(p.hit_in_sensor_m).cast::<f64>().norm())
            .asin()
            .to_degrees()
    };
    let azimuth = |p: &LidarPoint| {
        (p.hit_in_sensor_m[1] as f64)
            .atan2(p.hit_in_sensor_m[0] as f64)
            .to_degrees()
    };
    for (i, expected) in [10.0, -10.0, -30.0].into_iter().enumerate() {
        assert!((elevation(&points[8 * i]) - expected).abs() < 1e-4);
    }
    for (i, expected) in [-135.0, -90.0, -45.0, 0.0, 45.0, 90.0, 135.0]
        .into_iter()
        .enumerate()
    {
        assert!(
            (azimuth(&points[i]) - expected).abs() < 1e-4,
            "azimuth rises"
        );
    }
    assert!((azimuth(&points[7]).abs() - 180.0).abs() < 1e-4);
}

#[test]
fn what_lies_beyond_the_range_returns_nothing() {
    let spec = LidarSpec {
        range_m: 16.0,
        ..spec()
    };
    let pose = SensorPath::still(Isometry3::identity());
    let points = turn(&mut Lidar::new(spec.clone()), &room(), &pose, 1);
    let expected = (0..13 * 90)
        .filter(|i| to_wall_m(&Vector3::zeros(), &ray(&spec, i / 90, i % 90)) <= 16.0)
        .count();
    assert_eq!(points.len(), expected);
    assert!(expected < 13 * 90);
}

#[test]
fn semantic_points_carry_class_object_and_incidence() {
    let (spec, pose) = (
        LidarSpec {
            semantic: true,
            dropoff_general_ratio: 0.9,
            ..spec()
        },
        Isometry3::translation(0.0, 0.0, 0.5),
    );
    let mut lidar = Lidar::new(spec.clone());
    assert_eq!(
        lidar.scan(&room(), &SensorPath::still(pose), Noise::new(1, 2, 3), None),
        13 * 90,
        "a semantic lidar loses nothing"
    );
    let mut bytes = vec![0; lidar.payload_bytes()];
    assert_eq!(
        lidar.write(&mut bytes),
        13 * 90 * size_of::<SemanticLidarPoint>()
    );
    let points: Vec<SemanticLidarPoint> = bytemuck::pod_collect_to_vec(&bytes);
    for (i, point) in points.iter().enumerate() {
        let direction = ray(&spec, i as u32 / 90, i as u32 % 90);
        let hit = Vector3::from(point.hit_in_sensor_m).cast::<f64>() + Vector3::new(0.0, 0.0, 0.5);
        let (axis, _) = (0..3)
            .map(|axis| (axis, (hit[axis].abs() - HALF_M[axis] as f64).abs()))
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap();
        assert_eq!(
            (point.class, point.object_id),
            (Class::WALLS.0, ObjectId::scenery(5).0)
        );
        assert!((point.cos_incidence as f64 - direction[axis].abs()).abs() < 1e-5);
    }
}

#[test]
fn general_drop_off_and_intensity_drop_off_lose_the_asked_shares() {
    let scene = room();
    let path = SensorPath::still(Isometry3::identity());
    let n_rays = 13.0 * 900.0;
    let count = |spec: LidarSpec| turn(&mut Lidar::new(spec), &scene, &path, 1).len() as f64;
    let base = LidarSpec {
        columns: 900,
        ..spec()
    };
    // Binomial spread: √(n p q) = 54; five of them.
    assert!(
        (count(LidarSpec {
            dropoff_general_ratio: 0.45,
            ..base.clone()
        }) - 0.55 * n_rays)
            .abs()
            < 270.0
    );
    assert_eq!(
        count(LidarSpec {
            dropoff_general_ratio: 1.0,
            ..base.clone()
        }),
        0.0
    );
    // Limit 1, zero 0.4: a return of intensity I is kept with probability 0.6 + 0.4 I.
    let lossy = LidarSpec {
        dropoff_intensity_limit: 1.0,
        dropoff_zero_intensity_ratio: 0.4,
        ..base.clone()
    };
    let intensity =
        |i: u32| (-0.02 * to_wall_m(&Vector3::zeros(), &ray(&base, i / 900, i % 900))).exp();
    let expected: f64 = (0..13 * 900).map(|i| 0.6 + 0.4 * intensity(i)).sum();
    assert!((count(lossy) - expected).abs() < 270.0);
    assert_eq!(
        count(LidarSpec {
            dropoff_intensity_limit: 0.5,
            dropoff_zero_intensity_ratio: 0.0,
            ..base
        }),
        n_rays,
        "zero 0 keeps all"
    );
}

#[test]
fn range_noise_spreads_along_the_beam_only_and_repeats_with_its_key() {
    let (scene, path) = (room(), SensorPath::still(Isometry3::identity()));
    let spec = LidarSpec {
        noise_range_stddev_m: 0.1,
        columns: 900,
        range_m: 1000.0,
        ..spec()
    };
    let mut lidar = Lidar::new(spec.clone());
    let points = turn(&mut lidar, &scene, &path, 1);
    assert_eq!(points, turn(&mut lidar, &scene, &path, 1));
    assert_ne!(points, turn(&mut lidar, &scene, &path, 2));
    let (mut sum, mut squares) = (0.0, 0.0);
    for (i, point) in points.iter().enumerate() {
        let direction = ray(&spec, i as u32 / 900, i as u32 % 900);
        let hit = Vector3::from(point.hit_in_sensor_m).cast::<f64>();
        assert!(hit.cross(&direction).norm() < 1e-4);
        let error = hit.dot(&direction) - to_wall_m(&Vector3::zeros(), &direction);
        sum += error;
        squares += error * error;
    }
    let n = points.len() as f64;
    // Standard errors: 0.1/√n = 0.0009 of the mean, 0.65 % of the standard deviation; five of each.
    assert!((sum / n).abs() < 0.0047 && ((squares / n).sqrt() / 0.1 - 1.0).abs() < 0.033);
}

#[test]
fn motion_distortion_moves_the_sensor_along_its_path() {
    let (scene, spec) = (
        room(),
        LidarSpec {
            motion_distortion: true,
            ..spec()
        },
    );
    let path = SensorPath {
        world_from_sensor_start: Isometry3::translation(-2.0, 0.0, 0.0),
        world_from_sensor: Isometry3::new(Vector3::new(2.0, 1.0, 0.0), Vector3::z() * 0.3),
    };
    let points = turn(&mut Lidar::new(spec.clone()), &scene, &path, 1);
    for (i, point) in points.iter().enumerate() {
        let (channel, column) = (i as u32 / 90, i as u32 % 90);
        let share = (column + 1) as f64 / 90.0;
        let at = Isometry3::new(
            Vector3::new(-2.0 + 4.0 * share, share, 0.0),
            Vector3::z() * 0.3 * share,
        );
        let direction = ray(&spec, channel, column);
        let distance = to_wall_m(&at.translation.vector, &(at.rotation * direction));
        assert!(
            (Vector3::from(point.hit_in_sensor_m).cast::<f64>() - direction * distance).norm()
                < 1e-4,
            "column {column}"
        );
    }
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let mut assets = SceneAssets::default();
    let mut rng = fastrand::Rng::with_seed(4);
    let mut builder = MeshBuilder::new("clutter");
    for i in 0..3000u32 {
        let mut at = |scale: f32| (rng.f32() - 0.5) * scale;
        let centre = [at(60.0), at(60.0), at(10.0)];
        builder.cuboid(
            Surface::new(Class((i % 29) as u8), Material::Matte, [9; 3]).of(ObjectId::scenery(i)),
            centre,
            [0.4; 3],
        );
    }
    let mesh = assets.add_mesh(builder.finish());
    assets.statics.push(StaticInstance {
        mesh,
        world_from_mesh: Isometry3::identity(),
        object: ObjectId::scenery(0),
    });
    let dynamics: Vec<_> = (1..60)
        .map(|actor| DynamicInstance {
            actor: ActorId(actor),
            part: 0,
            mesh,
            world_from_mesh: Isometry3::translation(actor as f64 * 0.01, 0.0, 0.0),
            tint_rgb: [0; 3],
            lamps: 0,
            velocity_in_world_mps: Vector3::zeros(),
        })
        .collect();
    let spec = LidarSpec {
        noise_range_stddev_m: 0.02,
        dropoff_general_ratio: 0.3,
        channels: 30,
        columns: 333,
        ..Default::default()
    };
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let mut scene = RayScene::load(&assets);
            scene.update(&dynamics);
            turn(
                &mut Lidar::new(spec.clone()),
                &scene,
                &SensorPath::still(Isometry3::identity()),
                9,
            )
        })
    };
    let one = run(1);
    assert!(one.len() > 1000);
    assert_eq!(one, run(2));
    assert_eq!(one, run(2));
}

/// The middle channel fires 10 ms after the others, so a column lasts 10 ms, and the sensor moves 10 m
/// in the 100 ms of a turn.
#[test]
fn a_column_of_a_sold_lidar_is_seen_from_the_middle_of_its_firings() {
    let spec = LidarSpec {
        returns: true,
        channels: 3,
        columns: 2,
        elevations_deg: vec![0.0],
        fire_offsets_ns: vec![0.0, 1e7, 0.0],
        motion_distortion: true,
        ..Default::default()
    };
    let path = SensorPath {
        world_from_sensor_start: Isometry3::identity(),
        world_from_sensor: Isometry3::translation(10.0, 0.0, 0.0),
    };
    let mut lidar = Lidar::new(spec);
    lidar.set_window(100_000_000);
    assert_eq!(lidar.scan(&room(), &path, Noise::new(1, 2, 1), None), 6);
    let mut bytes = vec![0; lidar.payload_bytes()];
    lidar.write(&mut bytes);
    let points: Vec<LidarReturn> = bytemuck::pod_collect_to_vec(&bytes);
    // The first column looks ahead, the last one back; their middles are 55 ms and 5 ms before the end.
    for (point, hit_m, time_ns) in [
        (points[0], 20.0 - 4.5, -60_000_000),
        (points[1], -20.0 - 9.5, -10_000_000),
    ] {
        assert_eq!((point.time_ns, point.ring), (time_ns, 0));
        assert!((f64::from(point.hit_in_sensor_m[0]) - hit_m).abs() < 1e-4);
    }
    assert_eq!((points[3].time_ns, points[3].ring), (0, 1));
}

#[test]
fn a_head_that_turns_clockwise_ends_on_the_right() {
    for (clockwise, head_deg) in [(false, 45.0_f64), (true, -45.0)] {
        let spec = LidarSpec {
            channels: 1,
            columns: 3,
            upper_fov_deg: 0.0,
            horizontal_fov_deg: 90.0,
            clockwise,
            ..spec()
        };
        let mut lidar = Lidar::new(spec);
        let path = SensorPath::still(Isometry3::identity());
        let points = turn(&mut lidar, &room(), &path, 1);
        assert!((lidar.head_rad().to_degrees() - head_deg).abs() < 1e-12);
        let [x, y, _] = points[2].hit_in_sensor_m;
        assert!((f64::from(y).atan2(f64::from(x)).to_degrees() - head_deg).abs() < 1e-4);
    }
}
