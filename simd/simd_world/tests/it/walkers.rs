//! Walkers: speed, turning, kerbs, walls, jumps, impacts of vehicles, and limbs that follow the
//! distance walked.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::Vector3;
use schema_frames::command::{Command, CommandReply};
use schema_frames::{ActorKind, ActorRecord, PhysicsAction, WalkerControl, WalkerPart};
use schema_types::{ActorId, Class, Pose};
use sensor_core::SceneAssets;
use simd_world::{CollisionMesh, MapData, World, WorldOptions, vehicle_models, walker_models};

const TICK_NANOS: u64 = 50_000_000;
const TICK_SECS: f64 = 0.05;

/// Level ground with a kerb of 0.15 m at x = 10 and a wall of 3 m at x = 20.
fn street() -> World {
    let mut map = MapData::flat(500.0);
    let face = |x: f32, low: f32, high: f32| {
        [
            [x, -50.0, low],
            [x, -50.0, high],
            [x, 50.0, high],
            [x, 50.0, low],
        ]
    };
    let top = [
        [10.0, -50.0, 0.15],
        [20.0, -50.0, 0.15],
        [20.0, 50.0, 0.15],
        [10.0, 50.0, 0.15],
    ];
    for corners in [face(10.0, 0.0, 0.15), top, face(20.0, 0.0, 3.0)] {
        map.collision.push(CollisionMesh {
            vertices_m: corners.to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Default::default()
        });
    }
    let mut world = World::new(WorldOptions::default());
    world.load(&map).unwrap();
    world
}

fn spawn(world: &mut World, type_id: &str, pose: Pose, attributes: &[(&str, &str)]) -> ActorId {
    let attributes: BTreeMap<String, String> = attributes
        .iter()
        .map(|(name, value)| ((*name).to_owned(), (*value).to_owned()))
        .collect();
    world.spawn(type_id, pose, None, "", &attributes).unwrap()
}

fn walker_at(world: &mut World, x_m: f64, y_m: f64) -> ActorId {
    spawn(
        world,
        "walker.pedestrian.0001",
        Pose::from_xyz_yaw(x_m, y_m, 1.0, 0.0),
        &[],
    )
}

fn go(world: &mut World, actor: ActorId, direction: [f32; 3], speed_mps: f32) {
    world
        .control_walker(
            actor,
            WalkerControl {
                direction,
                speed_mps,
                jump: false,
            },
        )
        .unwrap();
}

fn half_m(world: &World, actor: ActorId) -> f64 {
    f64::from(world.record(actor).unwrap().half_box_m[2])
}

fn part(world: &World, actor: ActorId) -> WalkerPart {
    world.record(actor).unwrap().walker().unwrap()
}

#[test]
fn origin_is_the_middle_of_a_body_that_stands_on_the_ground() {
    let mut world = street();
    let low = spawn(
        &mut world,
        "walker.pedestrian.0001",
        Pose::from_xyz_yaw(0.0, 0.0, 0.0, 1.0),
        &[],
    );
    let high = spawn(
        &mut world,
        "walker.pedestrian.0009",
        Pose::from_xyz_yaw(0.0, 3.0, 2.5, 1.0),
        &[],
    );
    let on_kerb = walker_at(&mut world, 15.0, 0.0);
    (0..30).for_each(|_| world.step(TICK_NANOS));
    for (actor, ground_m) in [(low, 0.0), (high, 0.0), (on_kerb, 0.15)] {
        let record = *world.record(actor).unwrap();
        assert_eq!(
            (record.kind(), record.class),
            (Some(ActorKind::Walker), Class::PEDESTRIANS.0)
        );
        assert!(
            (record.world_from_actor.translation_m[2] - ground_m - half_m(&world, actor)).abs()
                < 1e-3,
            "{record:?}"
        );
        assert_eq!((record.speed_mps(), part(&world, actor).flags), (0.0, 0));
    }
    assert!((world.record(low).unwrap().world_from_actor.yaw_rad() - 1.0).abs() < 1e-9);
}

#[test]
fn walks_as_fast_as_asked_and_turns_that_way() {
    let mut world = street();
    let walker = walker_at(&mut world, 0.0, 0.0);
    world.step(TICK_NANOS);
    go(&mut world, walker, [0.0, -2.0, 7.0], 1.4);
    (0..40).for_each(|_| world.step(TICK_NANOS));
    let record = *world.record(walker).unwrap();
    assert!(
        (record.speed_mps() - 1.4).abs() < 1e-3,
        "{}",
        record.speed_mps()
    );
    let at = record.world_from_actor;
    assert!(
        (at.translation_m[1] + 40.0 * TICK_SECS * 1.4).abs() < 1e-3
            && at.translation_m[0].abs() < 1e-6,
        "{at:?}"
    );
    assert!((at.yaw_rad() + FRAC_PI_2).abs() < 1e-6);
    let shown = part(&world, walker);
    assert_eq!((shown.speed_mps, shown.direction), (1.4, [0.0, -2.0, 7.0]));
    // At a steady pace the limbs go through one cycle per stride length.
    let before = part(&world, walker).gait_rad;
    go(&mut world, walker, [0.0, -1.0, 0.0], 1.4);
    let stride_m = walker_models()[0].shape.skeleton().stride_m(1.4);
    (0..20).for_each(|_| world.step(TICK_NANOS));
    let turned = f64::from(part(&world, walker).gait_rad - before).rem_euclid(TAU);
    let expected = (TAU * 20.0 * TICK_SECS * 1.4 / stride_m).rem_euclid(TAU);
    assert!((turned - expected).abs() < 0.02, "{turned} {expected}");
    go(&mut world, walker, [1.0, 0.0, 0.0], 0.0);
    (0..20).for_each(|_| world.step(TICK_NANOS));
    assert_eq!(
        (
            world.record(walker).unwrap().speed_mps(),
            part(&world, walker).gait_mps
        ),
        (0.0, 0.0)
    );
}

#[test]
fn steps_over_a_kerb_and_is_stopped_by_a_wall() {
    let mut world = street();
    let walker = walker_at(&mut world, 8.0, 0.0);
    go(&mut world, walker, [1.0, 0.5, 0.0], 1.5);
    let mut steepest_m = 0.0f64;
    for _ in 0..240 {
        let before = world.record(walker).unwrap().world_from_actor.translation_m[2];
        world.step(TICK_NANOS);
        steepest_m = steepest_m
            .max((world.record(walker).unwrap().world_from_actor.translation_m[2] - before).abs());
    }
    let [x, y, z] = world.record(walker).unwrap().world_from_actor.translation_m;
    let radius_m = walker_models()[0].radius_m();
    assert!(
        (20.0 - radius_m - 0.03..20.0 - radius_m + 0.005).contains(&x),
        "{x}"
    );
    // Along the wall it keeps the part of its speed that points along it.
    let along_mps = 1.5 * 0.5 / 1.25f64.sqrt();
    assert!((y - 240.0 * TICK_SECS * along_mps).abs() < 0.15, "{y}");
    assert!(
        (z - 0.15 - half_m(&world, walker)).abs() < 1e-3 && steepest_m < 0.1,
        "{z} {steepest_m}"
    );
}

#[test]
fn a_jump_is_a_throw() {
    let mut world = street();
    let walker = walker_at(&mut world, 0.0, 0.0);
    (0..10).for_each(|_| world.step(TICK_NANOS));
    let ground_m = world.record(walker).unwrap().world_from_actor.translation_m[2];
    world
        .control_walker(
            walker,
            WalkerControl {
                jump: true,
                ..Default::default()
            },
        )
        .unwrap();
    world.step(10_000_000);
    world
        .control_walker(walker, WalkerControl::default())
        .unwrap();
    let (mut highest_m, mut airborne_secs) = (0.0f64, 0.01f64);
    while part(&world, walker).flags & WalkerPart::AIRBORNE != 0 {
        world.step(10_000_000);
        highest_m = highest_m
            .max(world.record(walker).unwrap().world_from_actor.translation_m[2] - ground_m);
        airborne_secs += 0.01;
    }
    // v²/2g and 2v/g for 5 m/s.
    assert!(
        (highest_m - 25.0 / 19.62).abs() < 0.01 && (airborne_secs - 10.0 / 9.81).abs() < 0.04,
        "{highest_m} {airborne_secs}"
    );
    (0..5).for_each(|_| world.step(TICK_NANOS));
    assert!(
        (world.record(walker).unwrap().world_from_actor.translation_m[2] - ground_m).abs() < 1e-3
    );
}

/// A car that rolls into a walker; returns the impulses on the car, each with the car's speed just
/// before it.
fn run_over(invincible: bool, speed_mps: f64) -> (World, ActorId, ActorId, Vec<([f64; 3], f64)>) {
    let mut world = street();
    let car = spawn(
        &mut world,
        "vehicle.tesla.model3",
        Pose::from_xyz_yaw(-20.0, 0.0, 0.02, 0.0),
        &[],
    );
    let walker = spawn(
        &mut world,
        "walker.pedestrian.0001",
        Pose::from_xyz_yaw(-14.0, 0.0, 1.0, FRAC_PI_2),
        &[("is_invincible", if invincible { "true" } else { "false" })],
    );
    (0..40).for_each(|_| world.step(TICK_NANOS));
    world.set_velocity(car, [speed_mps, 0.0, 0.0]).unwrap();
    let mut impulses = Vec::new();
    for _ in 0..100 {
        let before_mps = world.record(car).unwrap().speed_mps();
        world.step(TICK_NANOS);
        let hits = world
            .collisions()
            .iter()
            .filter(|hit| hit.actor == car && hit.other == Some(walker));
        impulses.extend(hits.map(|hit| (hit.impulse_in_world_ns, before_mps)));
        for hit in world.collisions().iter().filter(|hit| hit.actor == walker) {
            assert_eq!(hit.other, Some(car));
        }
    }
    (world, car, walker, impulses)
}

#[test]
fn a_car_knocks_a_walker_down_and_feels_it() {
    let (mut world, car, walker, impulses) = run_over(false, 8.0);
    let (car_kg, walker_kg) = (vehicle_models()[0].mass_kg, walker_models()[0].mass_kg);
    // The first impact is inelastic: m·M/(m+M)·v.
    let (first, car_mps) = (Vector3::from(impulses[0].0), impulses[0].1);
    let full_ns = car_mps * car_kg * walker_kg / (car_kg + walker_kg);
    assert!(
        car_mps > 4.0
            && (-first.x / full_ns - 1.0).abs() < 0.03
            && first.yz().norm() < 0.05 * full_ns,
        "{first} {full_ns}"
    );
    let record = *world.record(walker).unwrap();
    assert_ne!(part(&world, walker).flags & WalkerPart::DOWN, 0);
    let up = record.world_from_actor.isometry().rotation * Vector3::z();
    assert!(
        up.z.abs() < 0.1 && record.world_from_actor.translation_m[2] < 0.31,
        "{record:?}"
    );
    assert!(
        record
            .world_from_actor
            .translation_m
            .iter()
            .all(|x| x.is_finite())
    );
    assert_eq!(
        world.record(car).unwrap().flags & ActorRecord::QUARANTINED,
        0
    );
    // Setting a pose lets a fallen walker stand up.
    let pose = Pose::from_xyz_yaw(-100.0, 0.0, 1.0, 0.0);
    assert_eq!(
        world.apply(&Command::SetPose {
            actor_id: walker.0,
            pose: pose.into()
        }),
        CommandReply::Done
    );
    (0..20).for_each(|_| world.step(TICK_NANOS));
    assert_eq!(part(&world, walker).flags, 0);
}

#[test]
fn an_invincible_walker_is_only_pushed() {
    let (world, car, walker, impulses) = run_over(true, 5.0);
    assert!(!impulses.is_empty());
    let (at, car_at) = (
        world.record(walker).unwrap().world_from_actor,
        world.record(car).unwrap().world_from_actor,
    );
    assert_eq!(part(&world, walker).flags & WalkerPart::DOWN, 0);
    assert!(at.translation_m[0] > -14.0, "{at:?}");
    // The walker does not stay inside the car.
    let local = car_at.isometry().inverse() * nalgebra::Point3::from(at.translation_m);
    let half = vehicle_models()[0].half_m;
    assert!(
        local.x.abs() > half[0] || local.y.abs() > half[1] - 0.25,
        "{local}"
    );
}

#[test]
fn switches_let_a_walker_hang_in_the_air_and_cars_pass_through_it() {
    let mut world = street();
    let switch = |world: &mut World, walker: ActorId, action: PhysicsAction| {
        assert_eq!(
            world.apply(&Command::Physics {
                actor_id: walker.0,
                action
            }),
            CommandReply::Done
        );
    };
    let car = spawn(
        &mut world,
        "vehicle.tesla.model3",
        Pose::from_xyz_yaw(-20.0, 0.0, 0.02, 0.0),
        &[],
    );
    let ghost = walker_at(&mut world, -14.0, 0.0);
    (0..40).for_each(|_| world.step(TICK_NANOS));
    switch(
        &mut world,
        ghost,
        PhysicsAction::SetCollisions { enabled: false },
    );
    switch(
        &mut world,
        ghost,
        PhysicsAction::SetSimulated { enabled: false },
    );
    let up = Pose::from_xyz_yaw(-14.0, 0.0, 1.4, 0.0);
    assert_eq!(
        world.apply(&Command::SetPose {
            actor_id: ghost.0,
            pose: up.into()
        }),
        CommandReply::Done
    );
    world.set_velocity(car, [8.0, 0.0, 0.0]).unwrap();
    for _ in 0..60 {
        world.step(TICK_NANOS);
        assert!(world.collisions().is_empty());
        assert_eq!(
            world.record(ghost).unwrap().world_from_actor.translation_m,
            up.translation_m
        );
    }
    assert!(
        world.record(car).unwrap().world_from_actor.translation_m[0] > -12.0,
        "the car went past"
    );
    switch(
        &mut world,
        ghost,
        PhysicsAction::SetSimulated { enabled: true },
    );
    (0..40).for_each(|_| world.step(TICK_NANOS));
    assert!(
        (world.record(ghost).unwrap().world_from_actor.translation_m[2] - half_m(&world, ghost))
            .abs()
            < 0.02,
        "it falls again"
    );
}

#[test]
fn a_parked_car_stops_a_walker_without_a_blow() {
    let mut world = street();
    let car = spawn(
        &mut world,
        "vehicle.tesla.model3",
        Pose::from_xyz_yaw(-10.0, 0.0, 0.02, 0.0),
        &[],
    );
    let walker = walker_at(&mut world, -16.0, 0.0);
    (0..40).for_each(|_| world.step(TICK_NANOS));
    go(&mut world, walker, [1.0, 0.0, 0.0], 1.5);
    for _ in 0..100 {
        world.step(TICK_NANOS);
        assert!(world.collisions().is_empty());
    }
    let x = world.record(walker).unwrap().world_from_actor.translation_m[0];
    let front = -10.0 - vehicle_models()[0].half_m[0] - walker_models()[0].radius_m();
    assert!((front - 0.05..front + 0.01).contains(&x), "{x} {front}");
    assert!(world.record(car).unwrap().speed_mps() < 0.01);
}

#[test]
fn who_leads_a_walker_says_where_it_is() {
    let mut world = street();
    let walker = walker_at(&mut world, 0.0, 0.0);
    for i in 0..60 {
        let x = 12.0 + 0.07 * f64::from(i);
        let lead = Command::LeadWalker {
            actor_id: walker.0,
            ground_point_m: [x, 3.0, 0.3],
            yaw_rad: 0.3,
            speed_mps: 1.4,
        };
        assert_eq!(world.apply(&lead), CommandReply::Done);
        world.step(TICK_NANOS);
        let at = world.record(walker).unwrap().world_from_actor.translation_m;
        assert!(
            (at[0] - x).abs() < 1e-6 && (at[2] - 0.15 - half_m(&world, walker)).abs() < 1e-3,
            "{at:?}"
        );
    }
    let record = *world.record(walker).unwrap();
    assert!(
        (record.speed_mps() - 1.4).abs() < 1e-6
            && (part(&world, walker).gait_mps - 1.4).abs() < 1e-6
    );
    // A led walker whose leader is silent stands still.
    (0..20).for_each(|_| world.step(TICK_NANOS));
    assert_eq!(
        (
            world.record(walker).unwrap().speed_mps(),
            part(&world, walker).gait_mps
        ),
        (0.0, 0.0)
    );
}

#[test]
fn limbs_are_parts_of_the_picture() {
    let mut world = street();
    let mut assets = SceneAssets::default();
    world.register_meshes(&mut assets);
    let walker = walker_at(&mut world, 0.0, 0.0);
    let chair = spawn(
        &mut world,
        "walker.pedestrian.0028",
        Pose::from_xyz_yaw(5.0, 0.0, 1.0, 0.0),
        &[("use_wheelchair", "true")],
    );
    (0..20).for_each(|_| world.step(TICK_NANOS));
    let mut instances = Vec::new();
    world.dynamic_instances(&mut instances);
    let count = |actor: ActorId| {
        instances
            .iter()
            .filter(|instance| instance.actor == actor)
            .count()
    };
    assert_eq!((count(walker), count(chair)), (12, 13));
    assert!(
        instances
            .windows(2)
            .all(|pair| pair[0].key() < pair[1].key())
    );
    // The body stands in its box, feet on the ground.
    let record = world.record(walker).unwrap();
    let (mut low, mut high) = ([f64::MAX; 3], [f64::MIN; 3]);
    for instance in instances.iter().filter(|instance| instance.actor == walker) {
        for (corners, vertex) in assets.mesh(instance.mesh).triangles() {
            assert_eq!((vertex.class, vertex.object_id), (Class::PEDESTRIANS.0, 0));
            for corner in corners {
                let p = instance.world_from_mesh * nalgebra::Point3::from(corner.map(f64::from));
                (0..3).for_each(|i| (low[i], high[i]) = (low[i].min(p[i]), high[i].max(p[i])));
            }
        }
    }
    let half = record.half_box_m.map(f64::from);
    assert!(
        low[2].abs() < 0.01 && (high[2] - 2.0 * half[2]).abs() < 0.01,
        "{low:?} {high:?} {half:?}"
    );
    assert!(
        low[1] > -half[1] - 0.01 && high[1] < half[1] + 0.01 && high[0] < half[0] + 0.01,
        "{low:?} {high:?} {half:?}"
    );
}

#[test]
fn refusals_are_sentences() {
    let mut world = street();
    let walker = walker_at(&mut world, 0.0, 0.0);
    let check = |world: &mut World, command: Command, expected: &str| match world.apply(&command) {
        CommandReply::Refused { error } => assert!(error.contains(expected), "{error}"),
        reply => panic!("{reply:?}"),
    };
    let control = |direction, speed_mps| WalkerControl {
        direction,
        speed_mps,
        jump: false,
    };
    let command = |actor_id, control| Command::ControlWalker { actor_id, control };
    check(
        &mut world,
        command(walker.0, control([f32::NAN, 0.0, 0.0], 1.0)),
        "finite direction",
    );
    check(
        &mut world,
        command(walker.0, control([1.0, 0.0, 0.0], 99.0)),
        "0 to 15 m/s",
    );
    check(
        &mut world,
        command(9999, control([1.0, 0.0, 0.0], 1.0)),
        "not found",
    );
    let spectator = world.spectator().0;
    check(
        &mut world,
        command(spectator, control([1.0, 0.0, 0.0], 1.0)),
        "needs a walker",
    );
    let lead = |actor_id, x| Command::LeadWalker {
        actor_id,
        ground_point_m: [x, 0.0, 0.0],
        yaw_rad: 0.0,
        speed_mps: 1.0,
    };
    check(&mut world, lead(walker.0, f64::INFINITY), "must be finite");
    let place = Pose::from_xyz_yaw(30.0, 0.0, 1.0, 0.0);
    let spawn = |type_id: &str, name: &str, value: &str| Command::Spawn {
        type_id: type_id.into(),
        pose: place.into(),
        parent_id: None,
        role: String::new(),
        attributes: BTreeMap::from([(name.to_owned(), value.to_owned())]),
    };
    check(
        &mut world,
        spawn("walker.pedestrian.0001", "age", "elderly"),
        "fixed at",
    );
    check(
        &mut world,
        spawn("walker.pedestrian.0001", "is_invincible", "maybe"),
        "true or false",
    );
    check(
        &mut world,
        spawn("walker.pedestrian.0009", "use_wheelchair", "true"),
        "has only",
    );
    let again = world
        .spawn(
            "walker.pedestrian.0002",
            Pose::from_xyz_yaw(0.1, 0.0, 1.0, 0.0),
            None,
            "",
            &BTreeMap::new(),
        )
        .unwrap_err();
    assert!(
        again
            .to_string()
            .contains("would touch walker.pedestrian.0001"),
        "{again}"
    );
    let in_wall = world
        .spawn(
            "walker.pedestrian.0002",
            Pose::from_xyz_yaw(20.0, 0.0, 1.0, 0.0),
            None,
            "",
            &BTreeMap::new(),
        )
        .unwrap_err();
    assert!(
        in_wall.to_string().contains("would touch scenery"),
        "{in_wall}"
    );
}

#[test]
fn a_crowd_goes_the_same_way_twice() {
    let run = || {
        let mut world = street();
        let walkers: Vec<ActorId> = (0..40)
            .map(|i| {
                let type_id = format!("walker.pedestrian.{:04}", i % 52 + 1);
                spawn(
                    &mut world,
                    &type_id,
                    Pose::from_xyz_yaw(f64::from(i % 8), f64::from(i / 8), 1.2, 0.0),
                    &[],
                )
            })
            .collect();
        for tick in 0..100u32 {
            for (i, walker) in walkers.iter().enumerate() {
                let angle = (tick / 20) as f32 + i as f32;
                go(
                    &mut world,
                    *walker,
                    [angle.cos(), angle.sin(), 0.0],
                    1.0 + 0.05 * i as f32,
                );
            }
            world.step(TICK_NANOS);
        }
        world.snapshot_records().to_vec()
    };
    let (first, second) = (run(), run());
    assert_eq!(
        bytemuck::cast_slice::<_, u8>(&first),
        bytemuck::cast_slice::<_, u8>(&second)
    );
    let walkers: Vec<_> = first
        .iter()
        .filter(|record| record.walker().is_some())
        .collect();
    for (i, a) in walkers.iter().enumerate() {
        assert!(
            a.world_from_actor
                .translation_m
                .iter()
                .all(|x| x.is_finite())
        );
        for b in &walkers[i + 1..] {
            let apart = Vector3::from(a.world_from_actor.translation_m)
                - Vector3::from(b.world_from_actor.translation_m);
            assert!(
                apart.xy().norm() > 0.15,
                "{} and {} stand in each other",
                a.id,
                b.id
            );
        }
    }
}
