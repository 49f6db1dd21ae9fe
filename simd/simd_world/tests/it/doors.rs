//! Doors of vehicles open at a fixed rate, are visible, and are part of the world's state.

use std::collections::BTreeMap;

use schema_frames::{Command, CommandReply};
use schema_types::{ActorId, Pose};
use sensor_core::SceneAssets;
use simd_world::{Checkpoint, MapData, World, WorldOptions, vehicle_models};

const TICK_NANOS: u64 = 50_000_000;

fn world_with(type_id: &str) -> (World, ActorId) {
    let mut world = World::new(WorldOptions::default());
    world.load(&MapData::flat(100.0)).unwrap();
    world.register_meshes(&mut SceneAssets::default());
    let car = world
        .spawn(
            type_id,
            Pose::from_xyz_yaw(3.0, 4.0, 0.0, 0.7),
            None,
            "",
            &BTreeMap::new(),
        )
        .unwrap();
    (world, car)
}

fn order(world: &mut World, car: ActorId, doors: u8, open: bool) -> CommandReply {
    world.apply(&Command::SetDoors {
        actor_id: car.0,
        doors,
        open,
    })
}

/// Openings of the four doors as the snapshot states them, 0 to 15.
fn openings(world: &World, car: ActorId) -> [u32; 4] {
    let flags = world.record(car).unwrap().vehicle().unwrap().control_flags;
    [0, 1, 2, 3].map(|door| flags >> (16 + 4 * door) & 15)
}

/// (part, mesh, angle about the vertical in the vehicle's space) of every part of the car in the
/// scene.
fn parts(world: &World, car: ActorId) -> Vec<(u16, u32, f64)> {
    let mut instances = Vec::new();
    world.dynamic_instances(&mut instances);
    let world_from_car = world.record(car).unwrap().world_from_actor.isometry();
    let own = instances.iter().filter(|instance| instance.actor == car);
    own.map(|instance| {
        let forward =
            (world_from_car.inverse() * instance.world_from_mesh).rotation * nalgebra::Vector3::x();
        (instance.part, instance.mesh.0, forward.y.atan2(forward.x))
    })
    .collect()
}

#[test]
fn doors_take_their_time_and_are_drawn_where_they_are() {
    let (mut world, car) = world_with("vehicle.dodge.charger_2020");
    world.step(TICK_NANOS);
    let shut = parts(&world, car);
    assert_eq!(
        (openings(&world, car), shut.len()),
        ([0; 4], 5),
        "body and wheels"
    );
    assert_eq!(order(&mut world, car, 1 + 8, true), CommandReply::Done);
    let mut before = 0;
    for tick in 1..=16 {
        world.step(TICK_NANOS);
        let now = openings(&world, car);
        // 0.8 s are 16 ticks; the level is rounded up.
        assert_eq!(
            now,
            [
                (tick * 15u32).div_ceil(16),
                0,
                0,
                (tick * 15u32).div_ceil(16)
            ],
            "tick {tick}"
        );
        assert!(now[0] >= before);
        before = now[0];
    }
    let open = parts(&world, car);
    assert_eq!(open.len(), 9, "body, wheels, four doors");
    assert_ne!(open[0].1, shut[0].1, "the body with openings");
    let angle = |part: u16| open.iter().find(|(number, ..)| *number == part).unwrap().2;
    // Seen from above, a left door swings clockwise and a right one the other way; both are hinged
    // in front.
    assert!(
        angle(16) < -1.0 && angle(19) > 1.0 && angle(17).abs() < 1e-6 && angle(18).abs() < 1e-6
    );
    assert_eq!(order(&mut world, car, 15, false), CommandReply::Done);
    (0..16).for_each(|_| world.step(TICK_NANOS));
    assert_eq!(openings(&world, car), [0; 4]);
    assert_eq!(
        parts(&world, car)
            .iter()
            .map(|part| part.1)
            .collect::<Vec<_>>(),
        shut.iter().map(|part| part.1).collect::<Vec<_>>()
    );
}

#[test]
fn a_checkpoint_keeps_a_door_half_way() {
    let (mut world, car) = world_with("vehicle.mercedes.sprinter");
    order(&mut world, car, 4, true);
    (0..7).for_each(|_| world.step(TICK_NANOS));
    let checkpoint = world.checkpoint(0);
    let bytes = checkpoint.to_bytes().unwrap();
    let finish = |world: &mut World| {
        (0..20).for_each(|_| world.step(TICK_NANOS));
        (openings(world, car), parts(world, car).len())
    };
    let half_way = openings(&world, car);
    assert!((1..15).contains(&half_way[2]));
    assert_eq!(finish(&mut world), ([0, 0, 15, 0], 9));
    order(&mut world, car, 4, false);
    world.step(TICK_NANOS);
    let checkpoint = Checkpoint::from_bytes(&bytes, &world).unwrap();
    world.restore(&checkpoint).unwrap();
    assert_eq!(openings(&world, car), half_way);
    assert_eq!(finish(&mut world), ([0, 0, 15, 0], 9));
}

#[test]
fn who_has_no_such_doors_or_names_none_is_told() {
    let (mut world, car) = world_with("vehicle.tesla.model3");
    let CommandReply::Refused { error } = order(&mut world, car, 1, true) else {
        panic!("accepted")
    };
    assert!(
        error.contains("vehicle.tesla.model3") && error.contains("has_dynamic_doors"),
        "{error}"
    );
    let (mut world, car) = world_with("vehicle.dodge.charger_2020");
    for doors in [0, 16, 255] {
        let CommandReply::Refused { error } = order(&mut world, car, doors, true) else {
            panic!("accepted")
        };
        assert!(error.contains("doors"), "{error}");
    }
    assert!(matches!(
        order(&mut world, ActorId(9999), 1, true),
        CommandReply::Refused { .. }
    ));
}

/// The catalogue states which vehicles have doors that open, and all of those have meshes for them.
#[test]
fn the_catalogue_says_whose_doors_open() {
    let world = World::new(WorldOptions::default());
    let mut n = 0;
    for (entry, model) in world.catalogue().entries.iter().zip(vehicle_models()) {
        assert_eq!(
            entry.attributes["has_dynamic_doors"],
            model.has_dynamic_doors().to_string()
        );
        if model.has_dynamic_doors() {
            n += 1;
            assert_eq!(
                simd_body::door_meshes(&model.shape()).unwrap().doors.len(),
                4,
                "{}",
                model.type_id
            );
        }
    }
    assert!(n >= 7, "{n}");
}
