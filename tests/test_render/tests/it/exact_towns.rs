//! Compares cameras and lidar in every town with a ray caster that shares no code with them, while
//! vehicles and walkers move.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use schema_frames::document::Weather;
use schema_frames::{ActorKind, SemanticLidarPoint, VehicleControl};
use schema_types::ActorId;
use schema_types::noise::Noise;
use sensor_camera::{CameraRenderer, Quality};
use sensor_gpu::{Gpu, GpuOptions};
use sensor_ray::{Lidar, RayScene, SensorPath};
use sensor_spec::{Intrinsics, LidarSpec};
use test_render::Stage;
use test_render::exact::{Errors, check_camera, check_lidar, two_firings};
use test_render::oracle::{Detail, Oracle};

/// Pose of an actor without its roll and pitch.
fn upright(stage: &Stage, actor: ActorId) -> Isometry3<f64> {
    let pose = stage
        .world()
        .record(actor)
        .expect("it lives")
        .world_from_actor
        .isometry();
    let ahead = pose * Vector3::x();
    Isometry3::from_parts(
        pose.translation,
        UnitQuaternion::from_euler_angles(0.0, 0.0, ahead.y.atan2(ahead.x)),
    )
}

/// Behind an actor and above it, looking past it and a little down.
fn behind(
    stage: &Stage,
    actor: ActorId,
    [back_m, left_m, up_m]: [f64; 3],
    pitch_deg: f64,
) -> Isometry3<f64> {
    let turn =
        UnitQuaternion::from_euler_angles(0.01, pitch_deg.to_radians(), -(left_m / back_m).atan());
    upright(stage, actor) * Isometry3::from_parts(Translation3::new(-back_m, left_m, up_m), turn)
}

fn check_town(name: &str) {
    let gpu = Gpu::open(&GpuOptions::default()).unwrap();
    let mut stage = Stage::new(name, 11, 24).unwrap();
    stage.add_walkers(30);
    stage.drive(VehicleControl {
        throttle_ratio: 0.7,
        steer_ratio: 0.05,
        ..VehicleControl::default()
    });
    (0..30).for_each(|_| stage.step());
    let before = stage.scene(Weather::default());
    let (cars, walkers) = (
        stage.actors(ActorKind::Vehicle),
        stage.actors(ActorKind::Walker),
    );
    assert!(
        cars.len() >= 20 && walkers.len() >= 5,
        "{name}: {} vehicles, {} walkers",
        cars.len(),
        walkers.len()
    );
    let looks = [
        (cars[1], [9.0, 1.5, 2.4], 8.0),
        (cars[7], [14.0, -4.0, 6.0], 14.0),
        (cars[13], [5.0, 2.0, 1.2], -3.0),
        (walkers[2], [4.0, 0.8, 0.9], 5.0),
    ];
    let place = |stage: &Stage| {
        looks.map(|(actor, offset, pitch_deg)| behind(stage, actor, offset, pitch_deg))
    };
    let poses_before = place(&stage);
    stage.step();
    let now = stage.scene(Weather::default());
    let poses = place(&stage);
    let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
    let mut all = Errors::default();
    for (k, (before_pose, pose)) in poses_before.into_iter().zip(poses).enumerate() {
        let lens = Intrinsics::from_fov(160, 112, [90f64, 70.0, 110.0, 60.0][k].to_radians());
        let pair = [before_pose, pose];
        let frames = two_firings(&gpu, &mut renderer, lens, [&before, &now], pair);
        let errors = check_camera(&frames, [&before, &now], pair);
        println!("{name} {k}: {errors:#?}");
        assert!(
            errors.is_exact(),
            "{name}, camera {k} at {pose:?}: {errors:#?}"
        );
        assert!(
            errors.n * 4 > errors.n_edges,
            "{name}, camera {k}: hardly anything but edges"
        );
        all.n_moving += errors.n_moving;
        all.n_flowing += errors.n_flowing;
    }
    assert!(
        all.n_moving > 300 && all.n_flowing > 2000,
        "{name}: things move in the pictures: {all:?}"
    );

    let mut rays = RayScene::load(&now.assets);
    rays.update(&now.dynamics);
    for pose in &poses[..2] {
        let spec = LidarSpec {
            semantic: true,
            channels: 12,
            columns: 240,
            range_m: 100.0,
            ..Default::default()
        };
        let mut lidar = Lidar::new(spec.clone());
        lidar.scan(&rays, &SensorPath::still(*pose), Noise::new(1, 2, 3), None);
        let mut bytes = vec![0; lidar.payload_bytes()];
        let n_bytes = lidar.write(&mut bytes);
        let points: Vec<SemanticLidarPoint> = bytemuck::pod_collect_to_vec(&bytes[..n_bytes]);
        let errors = check_lidar(&points, &spec, &now, pose);
        println!("{name}: {errors:?}");
        assert!(
            errors.n_hits > 1000 && errors.n_wrong == 0 && errors.n_labels_off == 0,
            "{name}: {errors:?}"
        );
        assert!(errors.worst_m <= 1e-3, "{name}: {errors:?}");
    }
}

#[test]
fn town01_is_exact() {
    check_town("Town01");
}

#[test]
fn town02_is_exact() {
    check_town("Town02");
}

#[test]
fn town03_is_exact() {
    check_town("Town03");
}

#[test]
fn town04_is_exact() {
    check_town("Town04");
}

#[test]
fn town05_is_exact() {
    check_town("Town05");
}

#[test]
fn town06_is_exact() {
    check_town("Town06");
}

#[test]
fn town07_is_exact() {
    check_town("Town07");
}

#[test]
fn town10hd_is_exact() {
    check_town("Town10HD");
}

/// The ray caster's boxes do not change its results: testing every triangle gives the same.
#[test]
fn the_oracle_misses_no_triangle() {
    let stage = Stage::new("Town02", 11, 10).unwrap();
    let scene = stage.scene(Weather::default());
    let eye = Point3::from(stage.camera(3, 0.0, 0.0, 0.0).translation.vector);
    let oracle = Oracle::of(&scene, Detail::SeenFrom(eye), eye, 60.0);
    assert!(oracle.n_triangles() > 10_000);
    let mut n_met = 0;
    for i in 0..300 {
        let noise = Noise::new(4, 1, i);
        let [x, y, z] = [0, 1, 2].map(|k| 2.0 * noise.uniform(k) - 1.0);
        let direction = Vector3::new(x, y, 0.4 * z);
        let (quick, plain) = (
            oracle.cast(eye, direction, 0.1, false),
            oracle.cast_plainly(eye, direction, 0.1, false),
        );
        assert_eq!(quick.map(|met| met.t), plain.map(|met| met.t), "ray {i}");
        n_met += plain.is_some() as u32;
    }
    assert!(n_met > 150, "{n_met}");
}
