//! Rays against a brute-force loop in `f64` on random scenes, and against planes and boxes of known
//! distance.

use crate::common;

use common::{
    brute_force, cuboid, loose_triangles, moving, random_direction, random_pose, surface,
};
use nalgebra::{Isometry3, Point3, Vector3};
use schema_types::{ActorId, Class, ObjectId};
use sensor_core::{MeshBuilder, SceneAssets, StaticInstance};
use sensor_ray::RayScene;

/// Random scenes far from the origin. A ray that passes an edge within rounding may differ, so a few
/// in ten thousand may disagree.
#[test]
fn random_scenes_agree_with_brute_force_to_a_millimetre() {
    let mut rng = fastrand::Rng::with_seed(3);
    let (mut n_hits, mut n_wrong, n_rays) = (0, 0, 12_000);
    for round in 0..6 {
        let centre = [700.0 * round as f64, -450.0 * round as f64, 20.0];
        let mut assets = SceneAssets::default();
        let loose = assets.add_mesh(loose_triangles(&mut rng, 500, 1));
        let boxes = assets.add_mesh(cuboid(Class::CAR, [2.2, 0.9, 0.7]));
        for i in 0..3 {
            let world_from_mesh = random_pose(&mut rng, centre, 6.0);
            assets.statics.push(StaticInstance {
                mesh: loose,
                world_from_mesh,
                object: ObjectId::scenery(9000 + i),
            });
        }
        let dynamics: Vec<_> = (1..=40)
            .map(|actor| moving(boxes, actor, random_pose(&mut rng, centre, 15.0)))
            .collect();
        let mut scene = RayScene::load(&assets);
        scene.update(&dynamics);
        let mut world: Vec<_> = assets
            .statics
            .iter()
            .map(|s| (s.world_from_mesh, assets.mesh(s.mesh), s.object))
            .collect();
        world.extend(
            dynamics
                .iter()
                .map(|d| (d.world_from_mesh, assets.mesh(d.mesh), d.actor.into())),
        );
        for _ in 0..n_rays / 6 {
            let origin = random_pose(&mut rng, centre, 12.0)
                .translation
                .vector
                .into();
            let direction = random_direction(&mut rng);
            let found = scene.cast(&origin, &direction, 60.0);
            let expected = brute_force(&world, &origin, &direction, 60.0);
            n_hits += expected.is_some() as u32;
            let agree = match (&found, &expected) {
                (Some(hit), Some((distance, object, class))) => {
                    (hit.distance_m - distance).abs() <= 1e-3
                        && (hit.object, hit.class) == (*object, *class)
                        && hit.cos_incidence(&direction) >= 0.0
                }
                (None, None) => true,
                _ => false,
            };
            n_wrong += !agree as u32;
        }
    }
    assert!(
        n_hits > n_rays / 2,
        "the scenes are too empty: {n_hits} hits"
    );
    assert!(n_wrong <= 3, "{n_wrong} of {n_rays} rays differ");
}

#[test]
fn a_grazing_ray_on_a_large_ground_is_right_to_a_millimetre() {
    let mut assets = SceneAssets::default();
    let mut builder = MeshBuilder::new("ground");
    builder.quad(
        surface(Class::GROUND),
        [
            [-500., -500., 0.],
            [500., -500., 0.],
            [500., 500., 0.],
            [-500., 500., 0.],
        ],
        [[0.0; 2]; 4],
    );
    let ground = assets.add_mesh(builder.finish());
    let world_from_mesh = Isometry3::translation(4000.0, -3000.0, 12.0);
    assets.statics.push(StaticInstance {
        mesh: ground,
        world_from_mesh,
        object: ObjectId::scenery(1),
    });
    let scene = RayScene::load(&assets);
    for i in 0..1000 {
        let (azimuth, below) = (i as f64 * 0.1, 0.015 + i as f64 * 1e-4);
        let direction = Vector3::new(
            azimuth.cos() * below.cos(),
            azimuth.sin() * below.cos(),
            -below.sin(),
        );
        let hit = scene
            .cast(&Point3::new(4000.1, -3000.2, 14.0), &direction, 200.0)
            .expect("the ground lies below");
        assert!(
            (hit.distance_m - 2.0 / below.sin()).abs() < 1e-3,
            "{} is not {}",
            hit.distance_m,
            2.0 / below.sin()
        );
        assert!((hit.normal_in_world - Vector3::z()).norm() < 1e-12);
        assert_eq!(
            (hit.object, hit.class),
            (ObjectId::scenery(1), Class::GROUND)
        );
    }
}

#[test]
fn no_ray_slips_between_the_triangles_of_a_closed_box() {
    let mut assets = SceneAssets::default();
    let mesh = assets.add_mesh(cuboid(Class::WALLS, [3.0, 2.0, 1.0]));
    assets.statics.push(StaticInstance {
        mesh,
        world_from_mesh: Isometry3::translation(100.0, 100.0, 0.0),
        object: ObjectId::scenery(1),
    });
    let scene = RayScene::load(&assets);
    let mut rng = fastrand::Rng::with_seed(8);
    let origin = Point3::new(100.0, 100.0, 0.0);
    // Aimed at edges, corners and diagonals, where the seams are, and anywhere.
    let seams = (-300..=300).flat_map(|i| {
        let s = i as f64 / 100.0;
        [
            Vector3::new(3.0, 2.0 * s / 3.0, s / 3.0),
            Vector3::new(s, 2.0 * s / 3.0, 1.0),
            Vector3::new(s, 2.0, 1.0),
            Vector3::new(s, -2.0, 0.0),
        ]
    });
    let anywhere = (0..5000).map(|_| random_direction(&mut rng));
    for direction in seams.chain(anywhere) {
        let direction = direction.normalize();
        let slab = (0..3)
            .map(|axis| [3.0, 2.0, 1.0][axis] / direction[axis].abs())
            .fold(f64::INFINITY, f64::min);
        let hit = scene
            .cast(&origin, &direction, 10.0)
            .unwrap_or_else(|| panic!("{direction} slipped out"));
        assert!((hit.distance_m - slab).abs() < 1e-4);
    }
}

#[test]
fn a_moved_and_turned_instance_is_hit_where_it_is_now() {
    let mut assets = SceneAssets::default();
    let mesh = assets.add_mesh(cuboid(Class::TRUCK, [4.0, 1.0, 1.5]));
    let mut scene = RayScene::load(&assets);
    let origin = Point3::new(1000.0, 2000.0, 1.0);
    let forward = Vector3::x();
    assert_eq!(scene.cast(&origin, &forward, 100.0), None);

    let at = |x: f64, yaw: f64| {
        Isometry3::new(Vector3::new(1000.0 + x, 2000.0, 1.0), Vector3::z() * yaw)
    };
    scene.update(&[moving(mesh, 7, at(20.0, 0.0))]);
    let hit = scene
        .cast(&origin, &forward, 100.0)
        .expect("20 m ahead, 4 m long to this side");
    assert!((hit.distance_m - 16.0).abs() < 1e-9);
    assert_eq!(
        (hit.object, hit.class, hit.velocity_in_world_mps.x),
        (ObjectId(7), Class::TRUCK, 7.0)
    );

    scene.update(&[
        moving(mesh, 7, at(30.0, std::f64::consts::FRAC_PI_2)),
        moving(mesh, 8, at(60.0, 0.0)),
    ]);
    let hit = scene
        .cast(&origin, &forward, 100.0)
        .expect("30 m ahead, now across");
    assert!((hit.distance_m - 29.0).abs() < 1e-6, "{}", hit.distance_m);
    assert!((hit.normal_in_world + Vector3::x()).norm() < 1e-9);
    let behind = scene
        .cast_ignoring(&origin, &forward, 100.0, Some(ActorId(7)))
        .expect("the other one");
    assert_eq!(behind.object, ObjectId(8));

    scene.update(&[]);
    assert_eq!(scene.cast(&origin, &forward, 100.0), None);
}

#[test]
fn the_range_limit_is_sharp_and_a_broken_pose_is_left_out() {
    let mut assets = SceneAssets::default();
    let mesh = assets.add_mesh(cuboid(Class::CAR, [1.0; 3]));
    let mut scene = RayScene::load(&assets);
    let broken = Isometry3::translation(f64::NAN, 0.0, 0.0);
    scene.update(&[
        moving(mesh, 1, broken),
        moving(mesh, 2, Isometry3::translation(11.0, 0.0, 0.0)),
    ]);
    let reach = |max_m: f64| {
        scene
            .cast(&Point3::origin(), &Vector3::x(), max_m)
            .map(|hit| hit.object)
    };
    assert_eq!(reach(10.0), Some(ObjectId(2)));
    assert_eq!(reach(9.9999), None);
}
