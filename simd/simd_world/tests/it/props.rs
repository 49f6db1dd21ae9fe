//! Props: every type can be put down, is solid, is visible, and can be removed.

use std::collections::BTreeMap;

use schema_frames::ActorKind;
use schema_types::{ActorId, Pose};
use sensor_core::SceneAssets;
use simd_world::{MapData, World, WorldOptions, prop_models, vehicle_models};

const TICK_NANOS: u64 = 50_000_000;

fn flat() -> World {
    let mut world = World::new(WorldOptions::default());
    world.load(&MapData::flat(1000.0)).unwrap();
    world
}

fn put(world: &mut World, type_id: &str, pose: Pose, parent: Option<ActorId>) -> ActorId {
    world
        .spawn(type_id, pose, parent, "", &BTreeMap::new())
        .unwrap()
}

#[test]
fn every_prop_can_be_put_down_and_fits_its_box() {
    let mut world = flat();
    let mut assets = SceneAssets::default();
    world.register_meshes(&mut assets);
    let props: Vec<ActorId> = (prop_models().iter().enumerate())
        .map(|(i, model)| {
            put(
                &mut world,
                &model.type_id,
                Pose::from_xyz_yaw(10.0 * i as f64, 0.0, 0.0, 0.0),
                None,
            )
        })
        .collect();
    world.step(TICK_NANOS);
    let mut instances = Vec::new();
    world.dynamic_instances(&mut instances);
    for (prop, model) in props.iter().zip(prop_models()) {
        let record = world.record(*prop).unwrap();
        assert_eq!(
            (record.kind(), record.class, record.speed_mps()),
            (Some(ActorKind::Prop), model.shape.class.0, 0.0)
        );
        let instance = instances
            .iter()
            .find(|instance| instance.actor == *prop)
            .expect("it is seen");
        let place = record.world_from_actor.translation_m;
        for (corners, _) in assets.mesh(instance.mesh).triangles() {
            for corner in corners {
                let p = instance.world_from_mesh * nalgebra::Point3::from(corner.map(f64::from));
                let half = model.shape.half_m;
                let inside = (p.x - place[0]).abs() < half[0] + 0.01
                    && p.y.abs() < half[1] + 0.01
                    && p.z > -0.01
                    && p.z < 2.0 * half[2] + 0.01;
                assert!(inside, "{}: {p}", model.type_id);
            }
        }
    }
    for prop in &props {
        assert_eq!(world.destroy(*prop).unwrap(), [*prop]);
    }
}

#[test]
fn a_car_is_stopped_by_a_container_and_says_so() {
    let mut world = flat();
    let container = put(
        &mut world,
        "static.prop.container",
        Pose::from_xyz_yaw(20.0, 0.0, 0.0, std::f64::consts::FRAC_PI_2),
        None,
    );
    let car = put(
        &mut world,
        "vehicle.tesla.model3",
        Pose::from_xyz_yaw(0.0, 0.0, 0.02, 0.0),
        None,
    );
    let refused = world.spawn(
        "vehicle.audi.tt",
        Pose::from_xyz_yaw(20.0, 0.0, 0.1, 0.0),
        None,
        "",
        &BTreeMap::new(),
    );
    (0..20).for_each(|_| world.step(TICK_NANOS));
    world.set_velocity(car, [12.0, 0.0, 0.0]).unwrap();
    let mut hits = 0;
    for _ in 0..60 {
        world.step(TICK_NANOS);
        hits += world
            .collisions()
            .iter()
            .filter(|hit| hit.actor == car && hit.other == Some(container))
            .count();
    }
    assert!(hits > 0 && refused.is_err());
    let front_m = world.record(car).unwrap().world_from_actor.translation_m[0]
        + vehicle_models()[0].half_m[0];
    assert!(front_m < 20.0 - 1.0, "{front_m}");
    assert_eq!(
        world
            .record(container)
            .unwrap()
            .world_from_actor
            .translation_m,
        [20.0, 0.0, 0.0]
    );
}

#[test]
fn a_prop_rides_on_what_it_is_attached_to_and_can_be_moved() {
    let mut world = flat();
    let car = put(
        &mut world,
        "vehicle.tesla.model3",
        Pose::from_xyz_yaw(0.0, 0.0, 0.02, 0.3),
        None,
    );
    let case = put(
        &mut world,
        "static.prop.travelcase",
        Pose::from_xyz_yaw(0.0, 0.0, 1.6, 0.0),
        Some(car),
    );
    let cone = put(
        &mut world,
        "static.prop.trafficcone01",
        Pose::from_xyz_yaw(9.0, 9.0, 0.0, 0.0),
        None,
    );
    world
        .set_pose(cone, Pose::from_xyz_yaw(5.0, -5.0, 0.0, 1.0))
        .unwrap();
    (0..20).for_each(|_| world.step(TICK_NANOS));
    let expected = world.record(car).unwrap().world_from_actor.isometry()
        * Pose::from_xyz_yaw(0.0, 0.0, 1.6, 0.0).isometry();
    assert_eq!(
        world.record(case).unwrap().world_from_actor,
        Pose::from(expected)
    );
    assert_eq!(
        world.record(cone).unwrap().world_from_actor.translation_m,
        [5.0, -5.0, 0.0]
    );
    assert_eq!(world.destroy(car).unwrap(), [car, case]);
}

/// CARLA's factory of objects always spawns: its scenarios put debris where cars drive and cones
/// into each other.
#[test]
fn nothing_is_in_the_way_of_an_object_but_objects_are_in_the_way_of_cars() {
    let mut world = flat();
    let place = Pose::from_xyz_yaw(0.0, 0.0, 0.0, 0.0);
    put(&mut world, "vehicle.tesla.model3", place, None);
    put(&mut world, "static.prop.dirtdebris01", place, None);
    put(&mut world, "static.prop.dirtdebris01", place, None);
    let over = Pose::from_xyz_yaw(0.0, 20.0, 0.2, 0.0);
    put(&mut world, "static.prop.dirtdebris01", over, None);
    let over = Pose::from_xyz_yaw(0.0, 20.0, 0.0, 0.0);
    put(&mut world, "vehicle.tesla.model3", over, None);
    let aside = Pose::from_xyz_yaw(30.0, 0.0, 0.0, 0.0);
    put(&mut world, "static.prop.container", aside, None);
    let error = world
        .spawn("vehicle.tesla.model3", aside, None, "", &BTreeMap::new())
        .unwrap_err();
    assert!(
        error
            .to_string()
            .contains("would touch static.prop.container"),
        "{error}"
    );
}

/// CARLA's scenarios with a loss of control put debris into the lane, 0.2 m up, and count
/// collisions.
#[test]
fn debris_lets_a_lorry_roll_on() {
    let mut world = flat();
    let on_the_road = |x_m| Pose::from_xyz_yaw(x_m, 0.0, 0.2, 0.0);
    put(
        &mut world,
        "static.prop.dirtdebris01",
        on_the_road(20.0),
        None,
    );
    let place = Pose::from_xyz_yaw(0.0, 0.0, 0.02, 0.0);
    let car = put(&mut world, "vehicle.carlamotors.firetruck", place, None);
    (0..20).for_each(|_| world.step(TICK_NANOS));
    world.set_velocity(car, [12.0, 0.0, 0.0]).unwrap();
    for _ in 0..60 {
        world.step(TICK_NANOS);
        let hits = world.collisions();
        assert!(hits.iter().all(|hit| hit.actor != car), "{hits:?}");
    }
    let x_m = world.record(car).unwrap().world_from_actor.translation_m[0];
    assert!(x_m > 24.0, "{x_m}");
}
