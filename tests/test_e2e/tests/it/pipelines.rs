//! The worked examples of `docs/how-to/pipelines.md` as processes: lidar, clusters, brake in lockstep, what
//! happens when one of them dies, and people that two Python programs find and follow.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Isometry3, Vector3};
use schema_bus::{Bus, Frame, FrameReader, Snapshot, SnapshotReader};
use schema_frames::{ActorKind, ActorRecord, Box3d, Command, CommandReply, SpawnPoints, Track};
use schema_roads::RoadMap;
use schema_types::{Class, Pose};
use test_e2e::{
    ask, document, join_bus, reader, spawn_consumer, spawn_daemon, start_daemon, step, venv_program,
};
use test_kit::sandbox::binary_path;
use test_kit::{Process, Sandbox, eventually};

const LAUNCH: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 3
tick_hz = 20
[ego]
type_id = "vehicle.tesla.model3"
spawn_point = 0
[sensor.roof]
kind = "lidar"
rate_hz = 20
channels = 32
range_m = 60
mount.position_m = [0.0, 0.0, 2.0]
[sensor.bumper]
kind = "collision"
"#;

/// How far ahead of the car the obstacle stands, from origin to origin, metres.
const OBSTACLE_M: f64 = 45.0;

/// One of the examples of `consumer_kit`, on the sandbox's domain.
fn example(sandbox: &Sandbox, name: &str) -> Process {
    let program = binary_path(&format!("examples/{name}"));
    let env = [("GANTRY_DOMAIN", sandbox.domain())];
    sandbox.spawn_program(name, Path::new(&program), &[], &env)
}

/// Starts the simulator, which waits for two participants, and puts a car in the way. Returns the
/// obstacle's id.
fn start(sandbox: &Sandbox) -> (Process, Bus, u32) {
    let mut daemon = spawn_daemon(sandbox, LAUNCH, &["--await-lockstep", "2", "--unpaced"]);
    daemon.wait_line("ready");
    let bus = join_bus(sandbox, "test");
    let points: SpawnPoints = document(&bus, "world/spawn_points").json().unwrap();
    let start = Pose::from(points.points[0]).isometry();
    let pose = Pose::from(start * Isometry3::translation(OBSTACLE_M, 0.0, 0.5));
    let mut client = bus.command_client("test").unwrap();
    let spawn = Command::Spawn {
        type_id: "vehicle.carlamotors.carlacola".into(),
        pose: pose.into(),
        parent_id: None,
        role: String::new(),
        attributes: Default::default(),
    };
    let CommandReply::Spawned { actor_id, .. } = ask(&mut client, spawn) else {
        panic!("the obstacle was refused")
    };
    (daemon, bus, actor_id)
}

/// The ego vehicle, which is spawned before all others.
fn ego_of(snapshot: &Snapshot) -> Option<ActorRecord> {
    let is_vehicle = |it: &&ActorRecord| it.kind == ActorKind::Vehicle as u16;
    snapshot.records().iter().find(is_vehicle).copied()
}

/// Waits until the ego vehicle has driven and stands again. Returns the ego and `other`, as they
/// are then.
fn wait_until_it_stands(snapshots: &mut SnapshotReader, other: u32) -> (ActorRecord, ActorRecord) {
    let (mut has_driven, mut n_still) = (false, 0);
    eventually("the car has driven and stands again", || {
        let snapshot = snapshots.next().ok()??;
        let ego = ego_of(&snapshot)?;
        let speed = Vector3::from(ego.velocity_in_world_mps).norm();
        has_driven |= speed > 5.0;
        n_still = if speed < 0.05 { n_still + 1 } else { 0 };
        let other = *snapshot.actor(other)?;
        Some((ego, other)).filter(|_| has_driven && n_still > 20)
    })
}

/// Room between the ego's front bumper and the rear of what is ahead of it, metres, from the
/// simulator's own poses and boxes.
fn gap_m(ego: &ActorRecord, other: &ActorRecord) -> f64 {
    let ego_from_world = ego.world_from_actor.isometry().inverse();
    let other_in_ego = ego_from_world * other.world_from_actor.isometry();
    other_in_ego.translation.x - f64::from(ego.half_box_m[0]) - f64::from(other.half_box_m[0])
}

#[test]
fn lidar_clusters_and_a_brake_stop_the_car_before_an_obstacle() {
    let sandbox = Sandbox::new("pipeline");
    let (_daemon, bus, obstacle) = start(&sandbox);
    let mut snapshots = bus.snapshot_reader().unwrap();
    let mut collisions = reader(&bus, "ego/bumper/collision");
    let _clusters = example(&sandbox, "lidar_clusters");
    let _brake = example(&sandbox, "brake");
    let (ego, other) = wait_until_it_stands(&mut snapshots, obstacle);
    let gap = gap_m(&ego, &other);
    // The controller leaves 3 m. The lidar sees the rear of a rounded body some tenths of a metre
    // later than its box begins, and a car that brakes from 1 m/s rolls on a little.
    assert!((1.0..5.0).contains(&gap), "it stopped {gap} m before it");
    assert!(collisions.next().unwrap().is_none(), "it touched something");

    // The boxes name the lidar's frames, and one of them is where the obstacle is.
    let mut boxes = bus.result_reader("clusters/boxes").unwrap();
    let result = eventually("boxes", || boxes.next().unwrap());
    assert_eq!(result.inputs()[0].topic(), "ego/roof/lidar");
    assert_eq!(result.inputs()[0].tick, result.header().tick);
    let rear_m = gap + f64::from(ego.half_box_m[0]);
    let found = result.records::<Box3d>().unwrap();
    let is_obstacle = |found: &&Box3d| {
        let [x, y, _] = found.pose.translation_m;
        (x - f64::from(found.half_m[0]) - rear_m).abs() < 1.0 && y.abs() < 1.5
    };
    assert!(found.iter().any(|it| is_obstacle(&it)), "{found:?}");
}

#[test]
fn when_the_detector_is_killed_the_brake_stops_the_car() {
    let sandbox = Sandbox::new("blind");
    let (mut daemon, bus, obstacle) = start(&sandbox);
    let mut snapshots = bus.snapshot_reader().unwrap();
    let clusters = example(&sandbox, "lidar_clusters");
    let mut brake = example(&sandbox, "brake");
    eventually("the car drives", || {
        let snapshot = snapshots.next().ok()??;
        let ego = ego_of(&snapshot)?;
        (Vector3::from(ego.velocity_in_world_mps).norm() > 5.5).then_some(())
    });
    clusters.kill9();
    daemon.wait_line("clusters");
    brake.wait_line("braking");
    let (ego, other) = wait_until_it_stands(&mut snapshots, obstacle);
    let gap = gap_m(&ego, &other);
    assert!(gap > 1.0, "it stopped {gap} m before it");
}

/// Simulated time for which the car that sees for itself is watched.
const WATCHED_NANOS: u64 = 40_000_000_000;

/// Offset from the middle of the lane, metres, and turn against its direction, radians, where the
/// point lies on a lane outside of junctions; and half the lane's width.
fn place_on_lane(roads: &RoadMap, at: &Pose) -> Option<(f64, f64, f64)> {
    let place = roads.nearest(at.translation_m, |lane| lane.kind.is_drivable())?;
    let lane = roads.lane(place.lane)?;
    let world_from_lane = roads.pose(place)?;
    let forward = (world_from_lane.rotation.inverse() * at.isometry().rotation) * Vector3::x();
    let found = (
        place.offset_m,
        forward.y.atan2(forward.x),
        0.5 * roads.width_m(place),
    );
    lane.junction.is_none().then_some(found)
}

/// A car that knows nothing but what its sensors measure stays on its lane, crosses junctions and
/// touches nothing; the map is this test's alone.
#[test]
fn a_car_that_sees_for_itself_keeps_its_lane() {
    let sandbox = Sandbox::new("perceive");
    let file = test_kit::sandbox::repository().join("launch/perceive.toml");
    let launch = std::fs::read_to_string(file).unwrap() + "[sensor.bumper]\nkind = \"collision\"\n";
    let mut daemon = spawn_daemon(&sandbox, &launch, &["--await-lockstep", "1", "--unpaced"]);
    daemon.wait_line("ready");
    let bus = join_bus(&sandbox, "test");
    let roads = RoadMap::parse(&document(&bus, "world/map").text).unwrap();
    let mut snapshots = bus.snapshot_reader().unwrap();
    let mut collisions = reader(&bus, "ego/bumper/collision");
    let script = test_kit::sandbox::repository()
        .join("consumers/consumer_python/examples/perceive_drive.py");
    let env = [("GANTRY_DOMAIN", sandbox.domain())];
    let script = script.to_str().expect("paths are UTF-8");
    let mut program = sandbox.spawn_program("perceive", &venv_program("python"), &[script], &env);
    let (mut last, mut way_m, mut now_nanos) = (None::<[f64; 3]>, 0.0, 0);
    while now_nanos < WATCHED_NANOS {
        let (ego, nanos) = eventually("the next tick", || {
            assert!(program.is_running(), "{}", program.lines().join("\n"));
            let snapshot = snapshots.next().unwrap()?;
            Some((ego_of(&snapshot)?, snapshot.header().sim_nanos))
        });
        now_nanos = nanos;
        let at = ego.world_from_actor;
        let [x, y, _] = at.translation_m;
        way_m += last.map_or(0.0, |[a, b, _]| (x - a).hypot(y - b));
        last = Some(at.translation_m);
        let half_width_m = f64::from(ego.half_box_m[1]);
        if let Some((offset_m, turn_rad, half_m)) = place_on_lane(&roads, &at) {
            let secs = nanos as f64 * 1e-9;
            assert!(
                offset_m.abs() + half_width_m < half_m + 0.1 && turn_rad.abs() < 0.35,
                "after {secs} s it is {offset_m} m beside the middle of its lane, turned by {turn_rad}"
            );
        }
    }
    assert!(collisions.next().unwrap().is_none(), "it touched something");
    assert!(way_m > 150.0, "it drove {way_m} m");
    for topic in ["perceive/lines", "perceive/obstacles", "perceive/path"] {
        let mut results = bus.result_reader(topic).unwrap();
        let result = eventually("a result", || results.next().unwrap());
        assert!(!result.inputs().is_empty(), "{topic} answers a frame");
    }
}

/// A box in an image: left, top, right, bottom, pixels.
type Rectangle = [f32; 4];

/// The exact boxes of all people in an image, by object id.
fn people_of(semantic: &Frame, instance: &Frame) -> BTreeMap<u32, Rectangle> {
    let width = semantic.header().width as usize;
    let ids = instance.elements::<u32>().expect("ids are u32");
    let mut people: BTreeMap<u32, Rectangle> = BTreeMap::new();
    for (i, id) in ids.iter().enumerate() {
        if semantic[i] == Class::PEDESTRIANS.0 {
            let (x, y) = ((i % width) as f32, (i / width) as f32);
            let [left, top, right, bottom] = people.entry(*id).or_insert([x, y, x, y]);
            (*left, *top) = (left.min(x), top.min(y));
            (*right, *bottom) = (right.max(x + 1.0), bottom.max(y + 1.0));
        }
    }
    people
}

/// Intersection over union.
fn overlap(a: &Rectangle, b: &Rectangle) -> f32 {
    let area = |r: &Rectangle| (r[2] - r[0]).max(0.0) * (r[3] - r[1]).max(0.0);
    let both = area(&[
        a[0].max(b[0]),
        a[1].max(b[1]),
        a[2].min(b[2]),
        a[3].min(b[3]),
    ]);
    both / (area(a) + area(b) - both).max(1.0)
}

#[test]
fn people_are_found_and_followed_by_two_python_programs() {
    let sandbox = Sandbox::new("people");
    let file = test_kit::sandbox::repository().join("launch/people.toml");
    let launch = std::fs::read_to_string(file).unwrap();
    let launch = launch
        .replace("[\"rgb\"]", "[\"rgb\", \"semantic\", \"instance\"]")
        .replace("tick_hz = 10", "tick_hz = 10\nmode = \"stepped\"");
    let mut daemon = start_daemon(&sandbox, &launch, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let _driver = spawn_consumer(&sandbox, "gantry-drive", &["--lockstep"]);
    daemon.wait_line("joined the lockstep");
    let examples = test_kit::sandbox::repository().join("consumers/consumer_python/examples");
    let python = |name: &str| {
        let script = examples.join(name);
        let env = [("GANTRY_DOMAIN", sandbox.domain())];
        sandbox.spawn_program(
            name,
            &venv_program("python"),
            &[script.to_str().unwrap()],
            &env,
        )
    };
    let mut semantic = reader(&bus, "ego/front/semantic");
    let mut instance = reader(&bus, "ego/front/instance");
    let _detector = python("people_detector.py");
    // The tracker waits for boxes no longer than a minute.
    eventually("boxes appear", || {
        bus.result_reader("people/boxes").ok().map(drop)
    });
    let _tracker = python("people_tracker.py");
    let mut tracks = eventually("tracks appear", || bus.result_reader("people/tracks").ok());
    // By then the car stands at a red light, and the next person sets foot on the crossing before it.
    step(&mut client, 140);
    let mut matched: BTreeMap<u32, u32> = BTreeMap::new();
    for _ in 0..40 {
        let tick = step(&mut client, 1);
        let of_tick = |frames: &mut FrameReader| {
            eventually("the tick's image", || {
                frames.next().unwrap().filter(|it| it.header().tick == tick)
            })
        };
        let people = people_of(&of_tick(&mut semantic), &of_tick(&mut instance));
        let result = eventually("the tick's tracks", || {
            tracks.next().unwrap().filter(|it| it.header().tick == tick)
        });
        assert_eq!(result.inputs()[0].topic(), "people/boxes");
        for track in result.records::<Track>().unwrap() {
            let ([left, top], [right, bottom]) = (track.min_px, track.max_px);
            let found = [left, top, right, bottom];
            if people.values().any(|it| overlap(it, &found) > 0.4) {
                *matched.entry(track.id).or_default() += 1;
            }
        }
    }
    // A person takes six seconds over the crossing and keeps one number on the way.
    let longest = matched.values().copied().max().unwrap_or(0);
    assert!(longest >= 20, "ticks by track: {matched:?}");
}
