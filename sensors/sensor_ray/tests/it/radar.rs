//! Radar and obstacle detector against closed forms.

use nalgebra::{Isometry3, Point3, Vector3};
use schema_frames::RadarDetection;
use schema_types::noise::Noise;
use schema_types::{ActorId, Class, ObjectId};
use sensor_core::mesh::Surface;
use sensor_core::{DynamicInstance, Material, MeshBuilder, SceneAssets, StaticInstance};
use sensor_ray::{BallFilter, RadarPose, RayScene, radar};
use sensor_spec::RadarSpec;

const WALL_M: f64 = 60.0;

/// A wall 60 m ahead, and a box that can stand before it.
fn scene(box_at: Option<(Isometry3<f64>, Vector3<f64>)>) -> RayScene {
    let mut assets = SceneAssets::default();
    let surface = |class| Surface::new(class, Material::Matte, [128; 3]);
    let mut wall = MeshBuilder::new("wall");
    wall.cuboid(
        surface(Class::WALLS),
        [WALL_M as f32 + 1.0, 0.0, 0.0],
        [1.0, 200.0, 200.0],
    );
    let wall = assets.add_mesh(wall.finish());
    let mut car = MeshBuilder::new("car");
    car.cuboid(surface(Class::CAR), [0.0; 3], [2.0, 1.0, 1.0]);
    let car = assets.add_mesh(car.finish());
    assets.statics.push(StaticInstance {
        mesh: wall,
        world_from_mesh: Isometry3::identity(),
        object: ObjectId::scenery(1),
    });
    let mut scene = RayScene::load(&assets);
    let instance = |(world_from_mesh, velocity_in_world_mps)| DynamicInstance {
        actor: ActorId(9),
        part: 0,
        mesh: car,
        world_from_mesh,
        tint_rgb: [0; 3],
        lamps: 0,
        velocity_in_world_mps,
    };
    scene.update(&box_at.map(instance).into_iter().collect::<Vec<_>>());
    scene
}

fn look(
    scene: &RayScene,
    spec: &RadarSpec,
    pose: RadarPose,
    n_rays: u32,
    tick: u64,
    ignored: Option<ActorId>,
) -> Vec<RadarDetection> {
    let mut found = Vec::new();
    radar::scan(
        spec,
        scene,
        &pose,
        n_rays,
        Noise::new(1, 2, tick),
        ignored,
        &mut found,
    );
    found
}

#[test]
fn a_wall_ahead_closes_in_with_the_cosine_of_the_ray() {
    let pose = RadarPose {
        world_from_sensor: Isometry3::identity(),
        velocity_in_world_mps: Vector3::new(20.0, 0.0, 0.0),
    };
    let found = look(&scene(None), &RadarSpec::default(), pose, 4000, 1, None);
    assert_eq!(found.len(), 4000, "the wall fills the view");
    let (tan_half, mut inner) = (15f64.to_radians().tan(), 0);
    for hit in &found {
        let (azimuth, altitude, depth) = (
            hit.azimuth_rad as f64,
            hit.altitude_rad as f64,
            hit.depth_m as f64,
        );
        let forward = azimuth.cos() * altitude.cos();
        assert!((depth * forward - WALL_M).abs() < 1e-3, "{hit:?}");
        assert!(
            (hit.velocity_mps as f64 + 20.0 * forward).abs() < 1e-4,
            "{hit:?}"
        );
        assert!((hit.cos_incidence as f64 - forward).abs() < 1e-5);
        assert_eq!(
            (hit.object_id, hit.class),
            (ObjectId::scenery(1).0, Class::WALLS.0)
        );
        // The rays fill an ellipse, uniformly in its radius: half of them lie within half of it.
        let radius = (azimuth.tan() / tan_half).hypot(altitude.tan() / azimuth.cos() / tan_half);
        assert!(radius <= 1.0 + 1e-5, "{radius}");
        inner += (radius < 0.5) as u32;
    }
    // Binomial(4000, ½): σ = 32; five of them.
    assert!((1840..2160).contains(&inner), "{inner}");
    assert_eq!(
        found,
        look(&scene(None), &RadarSpec::default(), pose, 4000, 1, None),
        "same key, same rays"
    );
    assert_ne!(
        found,
        look(&scene(None), &RadarSpec::default(), pose, 4000, 2, None)
    );
}

#[test]
fn a_car_ahead_shows_its_speed_relative_to_ours() {
    let spec = RadarSpec {
        horizontal_fov_deg: 2.0,
        vertical_fov_deg: 2.0,
        ..Default::default()
    };
    let ahead = Isometry3::translation(22.0, 0.0, 0.0);
    let scene = scene(Some((ahead, Vector3::new(12.0, 3.0, 0.0))));
    let pose = RadarPose {
        world_from_sensor: Isometry3::identity(),
        velocity_in_world_mps: Vector3::new(20.0, 0.0, 0.0),
    };
    let found = look(&scene, &spec, pose, 100, 1, None);
    assert_eq!(found.len(), 100);
    for hit in &found {
        let (azimuth, altitude) = (hit.azimuth_rad as f64, hit.altitude_rad as f64);
        let along = Vector3::new(
            azimuth.cos() * altitude.cos(),
            azimuth.sin() * altitude.cos(),
            altitude.sin(),
        );
        assert_eq!((hit.object_id, hit.class), (9, Class::CAR.0));
        assert!((hit.depth_m as f64 * along.x - 20.0).abs() < 1e-3);
        assert!(
            (hit.velocity_mps as f64 - Vector3::new(-8.0, 3.0, 0.0).dot(&along)).abs() < 1e-5,
            "{hit:?}"
        );
    }
    assert!(
        look(&scene, &spec, pose, 100, 1, Some(ActorId(9)))
            .iter()
            .all(|hit| hit.class == Class::WALLS.0),
        "its own car is no target"
    );
}

#[test]
fn a_wall_beyond_the_range_is_not_seen_but_rays_to_the_rim_are_longer() {
    let pose = RadarPose {
        world_from_sensor: Isometry3::identity(),
        velocity_in_world_mps: Vector3::zeros(),
    };
    let wide = RadarSpec {
        horizontal_fov_deg: 90.0,
        vertical_fov_deg: 10.0,
        range_m: 59.9,
        ..Default::default()
    };
    assert!(look(&scene(None), &wide, pose, 500, 1, None).is_empty());
    let near = RadarSpec {
        range_m: 60.1,
        ..wide
    };
    let found = look(&scene(None), &near, pose, 500, 1, None);
    assert_eq!(
        found.len(),
        500,
        "the plane of the range lies behind the wall in every direction"
    );
    assert!(found.iter().any(|hit| hit.depth_m > 75.0));
}

#[test]
fn a_ball_stops_its_radius_before_a_wall_and_at_a_cars_edge() {
    let forward = Vector3::x();
    let scene_with = |y: f64| {
        scene(Some((
            Isometry3::translation(22.0, y, 0.0),
            Vector3::zeros(),
        )))
    };
    let all = BallFilter::default();
    let hit = scene(None)
        .move_ball(&Point3::origin(), &forward, 0.5, 100.0, all)
        .unwrap();
    assert!((hit.distance_m - (WALL_M - 0.5)).abs() < 1e-6 && hit.class == Class::WALLS);
    assert!((hit.contact_in_world_m - Point3::new(WALL_M, 0.0, 0.0)).norm() < 1e-6);
    assert!(
        scene(None)
            .move_ball(&Point3::origin(), &forward, 0.5, WALL_M - 0.6, all)
            .is_none(),
        "out of reach"
    );
    let hit = scene_with(0.0)
        .move_ball(&Point3::origin(), &forward, 0.5, 100.0, all)
        .unwrap();
    assert!((hit.distance_m - 19.5).abs() < 1e-6 && hit.object == ObjectId(9));
    // The car's side is 0.3 m beside the ball's way: the ball touches its edge √(0.5² − 0.3²) = 0.4
    // m before.
    let hit = scene_with(1.3)
        .move_ball(&Point3::origin(), &forward, 0.5, 100.0, all)
        .unwrap();
    assert!((hit.distance_m - 19.6).abs() < 1e-6, "{hit:?}");
    assert!(
        scene_with(1.51)
            .move_ball(&Point3::origin(), &forward, 0.5, 50.0, all)
            .is_none(),
        "passes by"
    );
}

#[test]
fn filters_leave_out_the_carrier_and_all_that_is_no_traffic() {
    let scene = scene(Some((
        Isometry3::translation(22.0, 0.0, 0.0),
        Vector3::zeros(),
    )));
    let ball = |filter| scene.move_ball(&Point3::origin(), &Vector3::x(), 0.5, 100.0, filter);
    assert_eq!(
        ball(BallFilter {
            ignored: Some(ActorId(9)),
            only_traffic: false
        })
        .unwrap()
        .class,
        Class::WALLS
    );
    assert_eq!(
        ball(BallFilter {
            ignored: None,
            only_traffic: true
        })
        .unwrap()
        .class,
        Class::CAR
    );
    assert_eq!(
        ball(BallFilter {
            ignored: Some(ActorId(9)),
            only_traffic: true
        }),
        None
    );
    let inside = scene
        .move_ball(
            &Point3::new(22.0, 0.8, 0.0),
            &Vector3::x(),
            0.5,
            100.0,
            BallFilter::default(),
        )
        .unwrap();
    assert_eq!(
        (inside.distance_m, inside.object),
        (0.0, ObjectId(9)),
        "touching where it starts"
    );
}
