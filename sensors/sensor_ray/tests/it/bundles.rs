//! Whole lidar turns of many shapes on random scenes with moving things, each ray against a loop
//! over every triangle in `f64`.

use crate::common;

use common::{brute_force, cuboid, loose_triangles, moving, random_pose};
use nalgebra::{Isometry3, Point3, Vector3};
use schema_frames::SemanticLidarPoint;
use schema_types::noise::Noise;
use schema_types::{Class, ObjectId};
use sensor_core::{Mesh, SceneAssets, StaticInstance};
use sensor_ray::lidar::azimuth_rad;
use sensor_ray::{Lidar, RayScene, SensorPath};
use sensor_spec::LidarSpec;

type World<'w> = Vec<(Isometry3<f64>, &'w Mesh, ObjectId)>;

/// Rays, hits, and rays that disagree.
#[derive(Default)]
struct Score {
    n_rays: usize,
    n_hits: usize,
    n_wrong: usize,
}

fn check(spec: LidarSpec, scene: &RayScene, world: &World, path: &SensorPath, score: &mut Score) {
    let mut lidar = Lidar::new(spec.clone());
    lidar.scan(scene, path, Noise::new(1, 2, 3), None);
    let mut bytes = vec![0; lidar.payload_bytes()];
    lidar.write(&mut bytes);
    let points: Vec<SemanticLidarPoint> = bytemuck::pod_collect_to_vec(&bytes);
    let mut points = points.iter().peekable();
    for channel in 0..spec.channels {
        for column in 0..spec.columns {
            let (elevation, azimuth) = (spec.elevation_rad(channel), azimuth_rad(&spec, column));
            let ray = Vector3::new(
                elevation.cos() * azimuth.cos(),
                elevation.cos() * azimuth.sin(),
                elevation.sin(),
            );
            let share = (column + 1) as f64 / spec.columns as f64;
            let pose = match spec.motion_distortion {
                true => path
                    .world_from_sensor_start
                    .try_lerp_slerp(&path.world_from_sensor, share, 1e-9)
                    .expect("turned by little"),
                false => path.world_from_sensor,
            };
            let origin: Point3<f64> = pose.translation.vector.into();
            let expected = brute_force(world, &origin, &(pose.rotation * ray), spec.range_m);
            // The next point belongs to this ray if it lies on it.
            let point = points.next_if(|point| {
                let at = Vector3::from(point.hit_in_sensor_m.map(f64::from));
                point.channel as u32 == channel
                    && at.cross(&ray).norm() < 1e-5 * at.norm()
                    && at.dot(&ray) >= 0.0
            });
            let found = point.map(|p| {
                (
                    Vector3::from(p.hit_in_sensor_m.map(f64::from)).norm(),
                    ObjectId(p.object_id),
                    Class(p.class),
                )
            });
            score.n_rays += 1;
            score.n_hits += expected.is_some() as usize;
            score.n_wrong += match (found, expected) {
                (None, None) => 0,
                (Some((found_m, found, class)), Some((expected_m, object, expected_class))) => {
                    ((found_m - expected_m).abs() > 1e-3
                        || (found, class) != (object, expected_class)) as usize
                }
                _ => 1,
            };
        }
    }
    assert!(
        points.next().is_none(),
        "points left over that lie on no ray, or out of order"
    );
}

/// A ray that passes an edge within rounding may differ, so one in ten thousand may disagree.
#[test]
fn turns_of_every_shape_agree_with_brute_force_to_a_millimetre() {
    let mut rng = fastrand::Rng::with_seed(11);
    // Channels, columns, width, top, bottom: dense, sparse, narrow, straight up and down, one ray.
    let shapes = [
        (64, 40, 20.0, 2.0, -24.8),
        (16, 90, 360.0, 15.0, -15.0),
        (3, 7, 360.0, 30.0, -30.0),
        (21, 5, 40.0, 90.0, -90.0),
        (5, 130, 360.0, -85.0, -90.0),
        (1, 1, 360.0, 0.0, 0.0),
        (9, 33, 1.0, 1.0, 0.5),
    ];
    let mut score = Score::default();
    for round in 0..4 {
        let centre = [900.0 * round as f64, -350.0 * round as f64, 10.0];
        let mut assets = SceneAssets::default();
        let loose = assets.add_mesh(loose_triangles(&mut rng, 150, 1));
        let boxes = assets.add_mesh(cuboid(Class::CAR, [2.2, 0.9, 0.7]));
        for i in 0..2 {
            let world_from_mesh = random_pose(&mut rng, centre, 6.0);
            assets.statics.push(StaticInstance {
                mesh: loose,
                world_from_mesh,
                object: ObjectId::scenery(9000 + i),
            });
        }
        let dynamics: Vec<_> = (1..=20)
            .map(|actor| moving(boxes, actor, random_pose(&mut rng, centre, 15.0)))
            .collect();
        let mut scene = RayScene::load(&assets);
        scene.update(&dynamics);
        let mut world: World = assets
            .statics
            .iter()
            .map(|s| (s.world_from_mesh, assets.mesh(s.mesh), s.object))
            .collect();
        world.extend(
            dynamics
                .iter()
                .map(|d| (d.world_from_mesh, assets.mesh(d.mesh), d.actor.into())),
        );
        for (channels, columns, horizontal_fov_deg, upper_fov_deg, lower_fov_deg) in shapes {
            let shape = LidarSpec {
                channels,
                columns,
                horizontal_fov_deg,
                upper_fov_deg,
                lower_fov_deg,
                ..Default::default()
            };
            let spec = LidarSpec {
                semantic: true,
                range_m: 60.0,
                motion_distortion: round % 2 == 1,
                ..shape
            };
            let world_from_sensor = random_pose(&mut rng, centre, 12.0);
            let moved = Isometry3::translation(1.0, -0.4, 0.1)
                * Isometry3::rotation(Vector3::new(0.0, 0.02, 0.05));
            let path = SensorPath {
                world_from_sensor_start: world_from_sensor * moved,
                world_from_sensor,
            };
            check(spec, &scene, &world, &path, &mut score);
        }
    }
    assert!(score.n_hits > 5000, "{} hits", score.n_hits);
    assert!(
        score.n_wrong * 10_000 <= score.n_rays,
        "{} of {} rays disagree",
        score.n_wrong,
        score.n_rays
    );
}
