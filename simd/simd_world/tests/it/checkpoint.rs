//! A restored world continues bit for bit, also with vehicles in contact. Damaged and foreign bytes
//! are refused with a sentence.

use std::collections::BTreeMap;

use schema_frames::{ActorRecord, Command, CommandReply, VehicleControl};
use schema_types::noise::mix;
use schema_types::{ActorId, Class, Pose};
use simd_world::{
    Checkpoint, Collision, CollisionMesh, EgoSpawn, MAX_EPISODE_NANOS, MapData, World, WorldOptions,
};

const TICK_NANOS: u64 = 50_000_000;

/// A square with a wall between some of the columns, so that there are contacts with scenery too.
fn walled() -> MapData {
    let mut map = MapData::flat(400.0);
    let corner = |y: f32, z: f32| [[0.0, y, z], [1.0, y, z]];
    let [a, b] = corner(-46.0, 0.0);
    let [c, d] = corner(-26.0, 0.0);
    let [e, f] = corner(-46.0, 4.0);
    let [g, h] = corner(-26.0, 4.0);
    map.collision.push(CollisionMesh {
        vertices_m: vec![a, b, c, d, e, f, g, h],
        class: Class::BUILDINGS,
        triangles: vec![
            [0, 4, 6],
            [0, 6, 2],
            [1, 3, 7],
            [1, 7, 5],
            [4, 5, 7],
            [4, 7, 6],
        ],
    });
    map
}

/// Two columns that drive at each other and into the wall.
fn crowd(map: &MapData) -> (World, Vec<ActorId>) {
    let mut world = World::new(WorldOptions::default());
    world.load(map).unwrap();
    let kinds = [
        "vehicle.tesla.model3",
        "vehicle.carlamotors.carlacola",
        "vehicle.audi.tt",
        "vehicle.yamaha.yzf",
        "vehicle.volkswagen.t2",
    ];
    let mut cars = Vec::new();
    for idx in 0..40usize {
        let (row, side) = (idx / 2, if idx % 2 == 0 { 1.0 } else { -1.0 });
        let yaw = if side > 0.0 {
            0.0
        } else {
            std::f64::consts::PI
        };
        let pose = Pose::from_xyz_yaw(
            -12.0 * side + 0.3 * row as f64,
            4.0 * row as f64 - 40.0,
            0.1,
            yaw,
        );
        cars.push(
            world
                .spawn(kinds[idx % kinds.len()], pose, None, "", &BTreeMap::new())
                .unwrap(),
        );
    }
    (world, cars)
}

fn drive(world: &mut World, cars: &[ActorId], tick: u64) {
    for (idx, car) in cars.iter().enumerate() {
        let throttle_ratio = if (tick / 40 + idx as u64).is_multiple_of(5) {
            0.0
        } else {
            0.9
        };
        let steer_ratio = ((tick as f32 * 0.05 + idx as f32).sin()) * 0.4;
        let control = VehicleControl {
            throttle_ratio,
            steer_ratio,
            reverse: tick / 100 % 2 == 1,
            ..VehicleControl::default()
        };
        if world.record(*car).is_some() {
            world.set_control(*car, control).unwrap();
        }
    }
    world.step(TICK_NANOS);
}

/// Records and collisions of `n` ticks.
fn run(
    world: &mut World,
    cars: &[ActorId],
    from: u64,
    n: u64,
) -> Vec<(Vec<ActorRecord>, Vec<Collision>)> {
    (from..from + n)
        .map(|tick| {
            drive(world, cars, tick);
            (
                world.snapshot_records().to_vec(),
                world.collisions().to_vec(),
            )
        })
        .collect()
}

fn assert_same(a: &[(Vec<ActorRecord>, Vec<Collision>)], b: &[(Vec<ActorRecord>, Vec<Collision>)]) {
    for (tick, ((records, collisions), (others, other_collisions))) in a.iter().zip(b).enumerate() {
        let differing = records
            .iter()
            .zip(others)
            .find(|(a, b)| bytemuck::bytes_of(*a) != bytemuck::bytes_of(*b));
        assert_eq!(differing, None, "after {} ticks", tick + 1);
        assert_eq!(
            (records.len(), collisions),
            (others.len(), other_collisions),
            "after {} ticks",
            tick + 1
        );
    }
    assert_eq!(a.len(), b.len());
}

#[test]
fn a_restored_run_goes_on_bit_for_bit_from_memory_and_from_bytes() {
    let map = walled();
    let (mut world, cars) = crowd(&map);
    let before = run(&mut world, &cars, 0, 85);
    let in_contact = before.last().unwrap().1.len();
    assert!(
        in_contact >= 20,
        "only {in_contact} contacts at the moment of saving"
    );
    assert!(
        before
            .last()
            .unwrap()
            .1
            .iter()
            .any(|collision| collision.other.is_none()),
        "nobody leans on the wall"
    );
    let checkpoint = world.checkpoint(85 * TICK_NANOS);
    let bytes = checkpoint.to_bytes().unwrap();
    assert!(
        bytes.len() < 2_000_000,
        "{} bytes: is the map's geometry among them?",
        bytes.len()
    );
    let uninterrupted = run(&mut world, &cars, 85, 500);
    assert!(
        uninterrupted
            .iter()
            .filter(|(_, collisions)| !collisions.is_empty())
            .count()
            > 400
    );
    // What happens in between must leave no trace.
    world.destroy(cars[3]).unwrap();
    assert_eq!(world.restore(&checkpoint).unwrap(), []);
    assert_same(&uninterrupted, &run(&mut world, &cars, 85, 500));
    // Another process with the same map.
    let mut other = World::new(WorldOptions {
        seed: 99,
        ..WorldOptions::default()
    });
    other.load(&map).unwrap();
    let read = Checkpoint::from_bytes(&bytes, &other).unwrap();
    assert_eq!(read.elapsed_nanos(), 85 * TICK_NANOS);
    other.restore(&read).unwrap();
    assert_same(&uninterrupted, &run(&mut other, &cars, 85, 500));
}

#[test]
fn saving_changes_nothing() {
    let map = walled();
    let (mut world, cars) = crowd(&map);
    let plain = run(&mut world, &cars, 0, 300);
    let (mut world, _) = crowd(&map);
    let mut saved = Vec::new();
    for tick in 0..300 {
        saved.extend(run(&mut world, &cars, tick, 1));
        if tick % 7 == 0 {
            world.checkpoint(0).to_bytes().unwrap();
        }
        if tick % 50 == 49 {
            let here = world.checkpoint(0);
            world.restore(&here).unwrap();
        }
    }
    assert_same(&plain, &saved);
}

#[test]
fn a_checkpoint_of_untouched_spawns_and_teleports_is_whole() {
    // Bodies that the engine has not stepped yet are marked as new; the marks must survive.
    let map = walled();
    let (mut world, cars) = crowd(&map);
    world.step(TICK_NANOS);
    world
        .set_pose(cars[0], Pose::from_xyz_yaw(-100.0, 90.0, 1.0, 1.0))
        .unwrap();
    let late = world
        .spawn(
            "vehicle.audi.tt",
            Pose::from_xyz_yaw(-100.0, 100.0, 0.5, 0.0),
            None,
            "",
            &BTreeMap::new(),
        )
        .unwrap();
    let cars = [cars, vec![late]].concat();
    let bytes = world.checkpoint(0).to_bytes().unwrap();
    let uninterrupted = run(&mut world, &cars, 0, 100);
    let mut other = World::new(WorldOptions::default());
    other.load(&map).unwrap();
    let read = Checkpoint::from_bytes(&bytes, &other).unwrap();
    other.restore(&read).unwrap();
    assert_same(&uninterrupted, &run(&mut other, &cars, 0, 100));
}

#[test]
fn lights_weather_and_counters_come_back_and_ids_go_on() {
    let town = simd_town::Town::generate("Town10HD", 3).unwrap();
    let mut world = World::new(WorldOptions::default());
    world.load(&MapData::from(&town)).unwrap();
    let scenario = world
        .spawn_scenario(
            Some(EgoSpawn {
                type_id: "vehicle.tesla.model3",
                spawn_idx: 0,
            }),
            10,
        )
        .unwrap();
    let camera = world
        .spawn(
            "sensor.camera.rgb",
            Pose::IDENTITY,
            scenario.ego,
            "",
            &BTreeMap::new(),
        )
        .unwrap();
    for _ in 0..30 {
        world.step(TICK_NANOS);
    }
    let checkpoint = world.checkpoint(0);
    let records = world.snapshot_records().to_vec();
    let late_camera = world
        .spawn(
            "sensor.camera.rgb",
            Pose::IDENTITY,
            scenario.ego,
            "",
            &BTreeMap::new(),
        )
        .unwrap();
    let late_car = world
        .spawn(
            "vehicle.audi.tt",
            Pose::from_xyz_yaw(0.0, 0.0, 300.0, 0.0),
            None,
            "",
            &BTreeMap::new(),
        )
        .unwrap();
    let on_late_car = world
        .spawn(
            "sensor.camera.rgb",
            Pose::IDENTITY,
            Some(late_car),
            "",
            &BTreeMap::new(),
        )
        .unwrap();
    let weather = schema_frames::document::Weather {
        precipitation: 80.0,
        ..Default::default()
    };
    assert_eq!(
        world.apply(&Command::SetWeather { weather }),
        CommandReply::Done
    );
    for _ in 0..300 {
        world.step(TICK_NANOS);
    }
    let revision = world.actors_revision();
    assert_eq!(
        world.restore(&checkpoint).unwrap(),
        [on_late_car],
        "a sensor goes with the parent that was not there"
    );
    assert!(world.actors_revision() > revision);
    assert_eq!(world.weather().precipitation, 0.0);
    let kept: Vec<_> = world
        .snapshot_records()
        .iter()
        .filter(|record| record.id != late_camera.0)
        .copied()
        .collect();
    assert_eq!(
        bytemuck::cast_slice::<_, u8>(&kept),
        bytemuck::cast_slice::<_, u8>(&records)
    );
    assert!(
        world.record(camera).is_some()
            && world.record(late_camera).is_some()
            && world.record(late_car).is_none()
    );
    let next = world
        .spawn(
            "vehicle.audi.tt",
            Pose::from_xyz_yaw(0.0, 0.0, 300.0, 0.0),
            None,
            "",
            &BTreeMap::new(),
        )
        .unwrap();
    assert!(next > on_late_car, "ids are never used again");
}

#[test]
fn broken_and_foreign_bytes_are_sentences() {
    let map = walled();
    let (mut world, cars) = crowd(&map);
    run(&mut world, &cars, 0, 20);
    let bytes = world.checkpoint(0).to_bytes().unwrap();
    let error = |bytes: &[u8]| {
        Checkpoint::from_bytes(bytes, &world)
            .err()
            .expect("must be refused")
            .to_string()
    };
    assert!(error(b"").contains("not a checkpoint"));
    assert!(error(b"PNG and so on").contains("not a checkpoint"));
    assert!(
        error(&bytes[..30]).contains("cut off"),
        "{}",
        error(&bytes[..30])
    );
    assert!(error(&bytes[..bytes.len() - 1]).contains("cut off"));
    let changed = |at: usize| {
        let mut bytes = bytes.clone();
        bytes[at] ^= 0x10;
        bytes
    };
    assert!(error(&changed(4)).contains("version"));
    assert!(error(&changed(9)).contains("another build"));
    for at in [17, 25, 41] {
        let error = error(&changed(at));
        assert!(error.contains("checksum"), "{at}: {error}");
    }
    let mut rng = fastrand::Rng::with_seed(5);
    for _ in 0..200 {
        assert!(error(&changed(rng.usize(48..bytes.len()))).contains("checksum"));
    }
    let mut elsewhere = World::new(WorldOptions::default());
    elsewhere
        .load(&MapData {
            name: "other".to_owned(),
            ..walled()
        })
        .unwrap();
    let sentence = Checkpoint::from_bytes(&bytes, &elsewhere)
        .err()
        .unwrap()
        .to_string();
    assert_eq!(
        sentence,
        "the checkpoint is of map \"flat\", but \"other\" is loaded; load that map first"
    );
    assert!(elsewhere.restore(&world.checkpoint(0)).is_err());
    let mut moved = walled();
    moved.collision[1].vertices_m[0][0] += 0.001;
    let mut elsewhere = World::new(WorldOptions::default());
    elsewhere.load(&moved).unwrap();
    assert!(
        Checkpoint::from_bytes(&bytes, &elsewhere)
            .err()
            .unwrap()
            .to_string()
            .contains("roads or solid ground differ")
    );
}

/// The checksum of a file, written down a second time.
fn checksum(bytes: &[u8]) -> u64 {
    let hash = |bytes: &[u8]| {
        let mut lanes = [0x243f_6a88_85a3_08d3u64, 0x1319_8a2e_0370_7344];
        for (idx, chunk) in bytes.chunks(8).enumerate() {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            let lane = &mut lanes[idx % 2];
            *lane = mix(*lane ^ u64::from_le_bytes(word));
        }
        mix(mix(lanes[0] ^ bytes.len() as u64) ^ lanes[1])
    };
    mix(hash(&bytes[..40]) ^ mix(hash(&bytes[48..])))
}

/// Bytes whose checksum is right and which nobody wrote: each is refused with a sentence, or is a
/// world that steps.
#[test]
fn crafted_bodies_are_refused_or_run() {
    let mut world = World::new(WorldOptions::default());
    world.load(&MapData::flat(100.0)).unwrap();
    for (kind, x_m) in [
        ("vehicle.tesla.model3", 0.0),
        ("vehicle.yamaha.yzf", 8.0),
        ("walker.pedestrian.0001", 12.0),
        ("static.prop.box01", 16.0),
    ] {
        let pose = Pose::from_xyz_yaw(x_m, 0.0, 0.5, 0.3);
        let none = BTreeMap::new();
        world.spawn(kind, pose, None, "", &none).unwrap();
    }
    (0..5).for_each(|_| world.step(TICK_NANOS));
    let good = world.checkpoint(0).to_bytes().unwrap();
    let stated = u64::from_le_bytes(good[40..48].try_into().unwrap());
    assert_eq!(checksum(&good), stated);
    let mut rng = fastrand::Rng::with_seed(9);
    let mut n_refused = 0;
    for _ in 0..100 {
        let mut bytes = good.clone();
        for _ in 0..rng.usize(1..4) {
            bytes[rng.usize(56..good.len())] = rng.u8(..);
        }
        let sum = checksum(&bytes);
        bytes[40..48].copy_from_slice(&sum.to_le_bytes());
        match Checkpoint::from_bytes(&bytes, &world) {
            Ok(checkpoint) => drop(world.clone().restore(&checkpoint)),
            Err(error) => {
                assert!(error.to_string().contains("damaged"), "{error}");
                n_refused += 1;
            }
        }
    }
    assert!(n_refused > 5, "{n_refused}");
}

/// Values under a right checksum that no world has: each is named, with what is allowed.
#[test]
fn values_beyond_their_limits_are_named() {
    let mut world = World::new(WorldOptions::default());
    world.load(&MapData::flat(100.0)).unwrap();
    let pose = Pose::from_xyz_yaw(0.0, 0.0, 0.5, 0.3);
    let spawned = world.spawn("vehicle.tesla.model3", pose, None, "", &BTreeMap::new());
    let car = spawned.unwrap();
    world.step(TICK_NANOS);
    let good = world.checkpoint(TICK_NANOS).to_bytes().unwrap();
    let error = |mut bytes: Vec<u8>| {
        let sum = checksum(&bytes);
        bytes[40..48].copy_from_slice(&sum.to_le_bytes());
        let read = Checkpoint::from_bytes(&bytes, &world);
        read.err().expect("must be refused").to_string()
    };
    // The time since the episode began is the third word of the head.
    for nanos in [u64::MAX, u64::MAX / 2, MAX_EPISODE_NANOS + 1] {
        let mut late = good.clone();
        late[24..32].copy_from_slice(&nanos.to_le_bytes());
        assert_eq!(
            error(late),
            format!(
                "the checkpoint says that the time since the episode began is {nanos} ns, but it must be at most {MAX_EPISODE_NANOS} ns (ten years); the file is damaged"
            )
        );
    }
    // The id of the next actor follows from the car's, which was the last: both as varints of one
    // byte. It stands right before the first id of added sensors, 2^30.
    let next = (car.0 + 1) as u8;
    let counts = [next, 0x80, 0x80, 0x80, 0x80, 0x04];
    let at: Vec<usize> = (48..good.len() - counts.len())
        .filter(|at| good[*at..].starts_with(&counts))
        .collect();
    let [at] = at[..] else {
        panic!("the counts are at {at:?}")
    };
    let mut used_up = good.clone();
    used_up.splice(at..=at, [0xff, 0xff, 0xff, 0xff, 0x0f]);
    let body_bytes = (used_up.len() - 48) as u64;
    used_up[32..40].copy_from_slice(&body_bytes.to_le_bytes());
    assert_eq!(
        error(used_up),
        "the checkpoint says that the id of the next actor is 4294967295, but it must be at most 536870912; the file is damaged"
    );
    let mut reused = good.clone();
    reused[at] = car.0 as u8;
    assert!(error(reused).contains("the id of an actor is"));
}
