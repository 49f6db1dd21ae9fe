//! Actors: spawning, attaching, destroying, bad input, collisions, determinism.

use std::collections::BTreeMap;

use schema_frames::command::{Command, CommandReply};
use schema_frames::{ActorKind, ActorRecord, VehicleControl};
use schema_types::{ActorId, Class, ObjectId, Pose};
use sensor_core::SceneAssets;
use simd_world::{EgoSpawn, MapData, World, WorldOptions};

const TICK_NANOS: u64 = 50_000_000;

fn flat() -> World {
    let mut world = World::new(WorldOptions::default());
    world.load(&MapData::flat(1000.0)).unwrap();
    world
}

fn car_at(world: &mut World, x_m: f64, yaw_rad: f64) -> ActorId {
    world
        .spawn(
            "vehicle.tesla.model3",
            Pose::from_xyz_yaw(x_m, 0.0, 0.1, yaw_rad),
            None,
            "",
            &BTreeMap::new(),
        )
        .unwrap()
}

#[test]
fn occupied_place_is_refused_and_free_again_after_destroy() {
    let mut world = flat();
    let first = car_at(&mut world, 0.0, 0.0);
    let error = world
        .spawn(
            "vehicle.audi.tt",
            Pose::from_xyz_yaw(2.0, 0.5, 0.1, 1.0),
            None,
            "",
            &BTreeMap::new(),
        )
        .unwrap_err()
        .to_string();
    assert_eq!(
        error,
        format!(
            "spawn failed because of collision at spawn position: \"vehicle.audi.tt\" would touch vehicle.tesla.model3 (actor {first})"
        )
    );
    let below = world
        .spawn(
            "vehicle.audi.tt",
            Pose::from_xyz_yaw(50.0, 0.0, -1.0, 0.0),
            None,
            "",
            &BTreeMap::new(),
        )
        .unwrap_err()
        .to_string();
    assert!(below.ends_with("would touch scenery"), "{below}");
    assert_eq!(world.destroy(first).unwrap(), [first]);
    assert!(
        world
            .destroy(first)
            .unwrap_err()
            .to_string()
            .contains("not found")
    );
    let second = world
        .spawn(
            "vehicle.audi.tt",
            Pose::from_xyz_yaw(2.0, 0.5, 0.1, 1.0),
            None,
            "",
            &BTreeMap::new(),
        )
        .unwrap();
    assert!(second > first, "ids are never used again");
    world.step(TICK_NANOS);
    assert!(world.record(first).is_none() && world.record(second).is_some());
}

#[test]
fn sensor_rides_bit_for_bit_and_goes_with_its_parent() {
    let mut world = flat();
    let car = car_at(&mut world, 0.0, 0.7);
    let mount = Pose::from_xyz_yaw(1.5, 0.2, 2.0, 0.3);
    let camera = world
        .spawn(
            "sensor.camera.view",
            mount,
            Some(car),
            "front",
            &BTreeMap::new(),
        )
        .unwrap();
    world
        .set_control(
            car,
            VehicleControl {
                throttle_ratio: 0.7,
                steer_ratio: 0.3,
                ..Default::default()
            },
        )
        .unwrap();
    for _ in 0..60 {
        world.step(TICK_NANOS);
        let expected = world.record(car).unwrap().world_from_actor.isometry() * mount.isometry();
        assert_eq!(
            world.record(camera).unwrap().world_from_actor,
            Pose::from(expected)
        );
        assert_eq!(world.sensor_pose(camera), Some(expected));
    }
    let info = world
        .actor_list()
        .actors
        .into_iter()
        .find(|info| info.id == camera.0)
        .unwrap();
    assert_eq!(
        (info.parent_id, info.role.as_str(), info.kind.as_str()),
        (car.0, "front", "sensor")
    );
    assert_eq!(world.destroy(car).unwrap(), [car, camera]);
    assert!(world.sensor_pose(camera).is_none());
}

#[test]
fn nothing_that_is_not_finite_gets_in() {
    let mut world = flat();
    let car = car_at(&mut world, 0.0, 0.0);
    let nan = f32::NAN;
    world
        .set_control(
            car,
            VehicleControl {
                throttle_ratio: nan,
                steer_ratio: nan,
                brake_ratio: f32::INFINITY,
                ..Default::default()
            },
        )
        .unwrap();
    (0..100).for_each(|_| world.step(TICK_NANOS));
    let record = world.record(car).unwrap();
    assert!(
        record
            .world_from_actor
            .translation_m
            .iter()
            .all(|x| x.is_finite())
            && record.speed_mps() < 0.01
    );
    let mut pose = Pose::IDENTITY;
    pose.translation_m[0] = f64::NAN;
    assert!(matches!(
        world.apply(&Command::SetPose {
            actor_id: car.0,
            pose: pose.into()
        }),
        CommandReply::Refused { .. }
    ));
    assert!(matches!(
        world.apply(&Command::SetVelocity {
            actor_id: car.0,
            velocity_in_world_mps: [f64::NAN; 3]
        }),
        CommandReply::Refused { .. }
    ));
    assert!(
        world
            .spawn("vehicle.tesla.model3", pose, None, "", &BTreeMap::new())
            .is_err()
    );
    assert_eq!(
        world.record(car).unwrap().flags & ActorRecord::QUARANTINED,
        0
    );
}

#[test]
fn refusals_are_sentences() {
    let mut world = flat();
    let car = car_at(&mut world, 0.0, 0.0);
    let spectator = world.spectator();
    let mut check = |command: Command, expected: &str| match world.apply(&command) {
        CommandReply::Refused { error } => assert!(error.contains(expected), "{error}"),
        reply => panic!("{reply:?}"),
    };
    let spawn = |type_id: &str, attributes: &[(&str, &str)]| Command::Spawn {
        type_id: type_id.into(),
        pose: Pose::from_xyz_yaw(100.0, 0.0, 0.3, 0.0).into(),
        parent_id: None,
        role: String::new(),
        attributes: attributes
            .iter()
            .map(|(name, value)| (name.to_string(), value.to_string()))
            .collect(),
    };
    check(
        spawn("vehicle.no.such", &[]),
        "unknown type \"vehicle.no.such\"",
    );
    check(
        spawn("vehicle.audi.tt", &[("color", "1,2")]),
        "must be \"r,g,b\"",
    );
    check(
        spawn("vehicle.audi.tt", &[("wings", "2")]),
        "a vehicle has only",
    );
    check(
        spawn("vehicle.audi.tt", &[("mass_kg", "2")]),
        "it is fixed at",
    );
    check(spawn("traffic.stop", &[]), "belongs to the map");
    check(
        Command::Destroy {
            actor_id: spectator.0,
        },
        "belongs to the map",
    );
    check(
        Command::SetLamps {
            actor_id: 999,
            lamps: 1,
        },
        "actor 999 not found",
    );
    check(
        Command::SetLamps {
            actor_id: spectator.0,
            lamps: 1,
        },
        "needs a vehicle",
    );
    check(
        Command::SetTrafficLight {
            actor_id: car.0,
            state: "red".into(),
        },
        "is not a traffic light",
    );
    check(
        Command::SetTrafficLight {
            actor_id: car.0,
            state: "blue".into(),
        },
        "must be red, yellow, green, off or unknown",
    );
    check(Command::Ping, "for the daemon");
}

/// Solid boxes across the road, each an object of its class: 20 m and 40 m ahead of the origin, and one
/// far behind it, whose triangles come first in the mesh.
fn road_with_boxes() -> MapData {
    let mut map = MapData::flat(1000.0);
    let mut mesh = simd_world::CollisionMesh::default();
    let mut objects = Vec::new();
    let boxes = [
        (Class::TERRAIN, -500.0),
        (Class::POLES, 20.0),
        (Class::WALLS, 40.0),
    ];
    for (idx, (class, x_m)) in boxes.into_iter().enumerate() {
        let id = ObjectId::scenery(idx as u32);
        let base = mesh.vertices_m.len() as u32;
        for corner in 0..8 {
            let side = |bit: u32, half_m: f32| {
                if corner >> bit & 1 == 1 {
                    half_m
                } else {
                    -half_m
                }
            };
            let corner_m = [x_m + side(0, 0.5), side(1, 4.0), side(2, 3.0)];
            mesh.vertices_m.push(corner_m);
        }
        for [a, b, c, d] in [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ] {
            mesh.triangles
                .extend([[a, b, c], [a, c, d]].map(|corners| corners.map(|i| base + i)));
        }
        objects.resize(mesh.triangles.len(), id);
        let pose = Pose::from_xyz_yaw(x_m.into(), 0.0, 0.0, 0.0);
        map.objects.push(simd_town::SceneryObject {
            id,
            class,
            name: format!("box_{idx}"),
            layer: None,
            pose,
            box_pose: pose,
            box_half_m: [0.5, 4.0, 3.0],
        });
    }
    map.collision_objects = vec![Vec::new(), objects];
    map.collision.push(mesh);
    map
}

#[test]
fn a_car_learns_the_class_of_what_it_runs_into() {
    let mut world = World::new(WorldOptions::default());
    world.load(&road_with_boxes()).unwrap();
    let car = car_at(&mut world, 0.0, 0.0);
    (0..20).for_each(|_| world.step(TICK_NANOS));
    // The first blow of a car that is sent off towards the boxes.
    let first_blow = |world: &mut World| {
        world.set_velocity(car, [12.0, 0.0, 0.0]).unwrap();
        (0..100)
            .find_map(|_| {
                world.step(TICK_NANOS);
                world
                    .collisions()
                    .iter()
                    .find(|blow| blow.actor == car)
                    .copied()
            })
            .expect("the car runs into a box")
    };
    let start = world.checkpoint(0);
    let blow = first_blow(&mut world);
    assert_eq!((blow.other, blow.other_class), (None, Class::POLES));
    assert!((blow.point_in_world_m[0] - 19.5).abs() < 0.3, "{blow:?}");
    // Without the first box the triangles of the second have other numbers, also in worlds that are
    // restored: from memory and from bytes.
    let hide = Command::ShowObjects {
        object_ids: vec![ObjectId::scenery(1).0],
        shown: false,
    };
    assert_eq!(world.apply(&hide), CommandReply::Done);
    let bytes = start.to_bytes().unwrap();
    let read = simd_world::Checkpoint::from_bytes(&bytes, &world).unwrap();
    for checkpoint in [&start, &read] {
        world.restore(checkpoint).unwrap();
        let blow = first_blow(&mut world);
        assert_eq!((blow.other, blow.other_class), (None, Class::WALLS));
        assert!((blow.point_in_world_m[0] - 39.5).abs() < 0.3, "{blow:?}");
    }
}

#[test]
fn crash_is_reported_for_both_with_the_momentum_that_changed_hands() {
    let mut world = flat();
    let (left, right) = (
        car_at(&mut world, 0.0, 0.0),
        car_at(&mut world, 12.0, std::f64::consts::PI),
    );
    (0..60).for_each(|_| world.step(TICK_NANOS));
    assert!(world.collisions().is_empty(), "{:?}", world.collisions());
    world.set_velocity(left, [8.0, 0.0, 0.0]).unwrap();
    let mut impulse_ns = 0.0;
    let mut touched = false;
    for _ in 0..60 {
        world.step(TICK_NANOS);
        for hit in world
            .collisions()
            .iter()
            .filter(|hit| hit.actor == right && hit.other == Some(left))
        {
            impulse_ns += hit.impulse_in_world_ns[0];
            assert_eq!(hit.other_class, Class::CAR);
            // The impact is half a length behind the front of the car that was hit, at the height
            // of the bodies.
            let [x, y, z] = hit.point_in_world_m;
            let rear_m = world.record(right).unwrap().world_from_actor.translation_m[0] - 2.396;
            assert!(
                (x - rear_m).abs() < 0.5 && y.abs() < 1.1 && (0.0..1.5).contains(&z),
                "{hit:?}, rear at {rear_m}"
            );
            let back = world
                .collisions()
                .iter()
                .find(|back| back.actor == left && back.other == Some(right))
                .unwrap();
            assert_eq!(
                back.impulse_in_world_ns.map(|x| -x),
                hit.impulse_in_world_ns
            );
        }
        touched |= [left, right]
            .iter()
            .all(|car| world.record(*car).unwrap().flags & ActorRecord::TOUCHED != 0);
    }
    // Between a perfectly plastic and a perfectly elastic hit of equal masses.
    let momentum_ns = 1847.0 * 8.0;
    assert!(
        touched && impulse_ns > 0.45 * momentum_ns && impulse_ns < 1.05 * momentum_ns,
        "{impulse_ns} of {momentum_ns}"
    );
}

#[test]
fn load_begins_an_episode_and_ids_go_on() {
    let mut world = flat();
    let car = car_at(&mut world, 0.0, 0.0);
    let revision = world.actors_revision();
    assert_eq!(world.episode(), 1);
    world.load(&MapData::flat(100.0)).unwrap();
    assert_eq!(world.episode(), 2);
    assert!(
        world.record(car).is_none()
            && world.spectator() > car
            && world.actors_revision() > revision
    );
    let mut broken = MapData::flat(10.0);
    broken.collision[0].triangles.push([0, 1, 9]);
    assert!(
        world
            .load(&broken)
            .unwrap_err()
            .to_string()
            .contains("names corner 9")
    );
    assert_eq!(world.episode(), 2, "the old map stays");
}

/// Twenty vehicles that drive about at random, bump into each other, and get teleported.
fn busy_run(seed: u64) -> Vec<ActorRecord> {
    let mut world = World::new(WorldOptions {
        seed,
        ..Default::default()
    });
    world.load(&MapData::flat(1000.0)).unwrap();
    let scenario = world
        .spawn_scenario(
            Some(EgoSpawn {
                type_id: "vehicle.tesla.model3",
                spawn_idx: 0,
            }),
            19,
        )
        .unwrap();
    assert_eq!(scenario.others.len(), 19);
    let mut all = Vec::new();
    for tick in 0..500u64 {
        for actor in scenario.others.iter().chain(&scenario.ego) {
            let noise = schema_types::noise::Noise::new(seed, actor.0 as u64, tick / 20);
            let control = VehicleControl {
                throttle_ratio: noise.uniform(0) as f32,
                steer_ratio: (noise.uniform(1) * 2.0 - 1.0) as f32,
                brake_ratio: (noise.uniform(2) * 1.5 - 1.0) as f32,
                ..Default::default()
            };
            world.set_control(*actor, control).unwrap();
        }
        world.step(TICK_NANOS);
        all.extend_from_slice(world.snapshot_records());
    }
    all
}

#[test]
fn two_runs_of_twenty_vehicles_are_equal_bit_for_bit() {
    let (first, second) = (busy_run(7), busy_run(7));
    assert_eq!(
        bytemuck::cast_slice::<_, u8>(&first),
        bytemuck::cast_slice::<_, u8>(&second)
    );
    assert_ne!(
        bytemuck::cast_slice::<_, u8>(&first),
        bytemuck::cast_slice::<_, u8>(&busy_run(8))
    );
    assert!(
        first
            .iter()
            .any(|record| record.flags & ActorRecord::TOUCHED != 0),
        "the run is meant to have crashes"
    );
    assert!(
        first
            .iter()
            .all(|record| record.flags & ActorRecord::QUARANTINED == 0)
    );
}

#[test]
fn instances_come_sorted_with_a_body_and_wheels_that_roll() {
    let mut world = flat();
    let car = car_at(&mut world, 0.0, 0.0);
    let bike = world
        .spawn(
            "vehicle.yamaha.yzf",
            Pose::from_xyz_yaw(20.0, 0.0, 0.1, 0.0),
            None,
            "",
            &BTreeMap::new(),
        )
        .unwrap();
    world.register_meshes(&mut SceneAssets::default());
    let mut before = Vec::new();
    let mut after = Vec::new();
    (0..60).for_each(|_| world.step(TICK_NANOS));
    world.set_velocity(car, [1.0, 0.0, 0.0]).unwrap();
    world.dynamic_instances(&mut before);
    world.step(TICK_NANOS);
    world.dynamic_instances(&mut after);
    let keys: Vec<_> = after.iter().map(|instance| instance.key()).collect();
    assert_eq!(
        keys,
        [
            (car.0, 0),
            (car.0, 1),
            (car.0, 2),
            (car.0, 3),
            (car.0, 4),
            (bike.0, 0),
            (bike.0, 1),
            (bike.0, 2)
        ]
    );
    assert_eq!(world.record(car).unwrap().kind(), Some(ActorKind::Vehicle));
    // Rolling without slip: the wheels' angle is the distance over their radius, forwards.
    let way_m = after[0].world_from_mesh.translation.x - before[0].world_from_mesh.translation.x;
    let turn = before[2].world_from_mesh.rotation.inverse() * after[2].world_from_mesh.rotation;
    assert!(
        (turn.scaled_axis().y - way_m / 0.34).abs() < 0.01,
        "{turn} for {way_m} m"
    );
}
