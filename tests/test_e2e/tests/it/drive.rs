//! `gantry-drive` and a daemon without any reader of frames: a simulated minute in lockstep, as fast
//! as the machine can; and three drivers that share the vehicles of one world.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use consumer_kit::Lockstep;
use schema_bus::names;
use schema_frames::{ActorKind, ActorList, ActorRecord};
use schema_roads::RoadMap;
use test_e2e::{counter, document, join_bus, spawn_consumer, start_daemon};
use test_kit::{Process, Sandbox, eventually};

/// 1200 ticks of 50 ms are 60 s, which is longer than a light of a T-junction stays red.
const LAST_TICK: u64 = 1200;
/// A camera that nobody reads: it must cost nothing.
const LAUNCH: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
vehicles = 12
[sensor.front]
kind = "camera"
modalities = ["rgb", "depth"]
rate_hz = 20
width_px = 800
height_px = 600
"#;

#[derive(Clone, Copy, Debug, Default)]
struct Log {
    driven_m: f64,
    worst_offset_m: f64,
    lane_width_m: f64,
    n_touches: u32,
    last: Option<[f64; 3]>,
}

impl Log {
    fn add(&mut self, record: &ActorRecord, map: &RoadMap) {
        let at = record.world_from_actor.translation_m;
        if let Some(last) = self.last.replace(at) {
            self.driven_m += (at[0] - last[0]).hypot(at[1] - last[1]);
        }
        self.n_touches += u32::from(record.flags & ActorRecord::TOUCHED != 0);
        let lane = map
            .nearest(at, |lane| lane.kind.is_drivable())
            .expect("a drivable lane is near");
        if lane.offset_m.abs() > self.worst_offset_m {
            (self.worst_offset_m, self.lane_width_m) = (lane.offset_m.abs(), map.width_m(lane));
        }
    }
}

const PEOPLE: &str = "version = 1\n[scenario]\nmap = \"Town10HD\"\nseed = 7\ntick_hz = 20\nvehicles = 0\n[ego]\ntype_id = \"none\"\n";

/// Where everybody is after each of forty simulated seconds, by actor.
fn stroll() -> BTreeMap<u32, Vec<[f64; 3]>> {
    let sandbox = Sandbox::new("crowd");
    let _daemon = start_daemon(&sandbox, PEOPLE, &["--unpaced", "--await-lockstep", "2"]);
    let bus = join_bus(&sandbox, "test");
    let mut snapshots = eventually("snapshots", || bus.snapshot_reader().ok());
    let wake = bus.listener(names::WORLD_SNAPSHOT).unwrap();
    let gate = Lockstep::join(&bus, "test", Duration::from_secs(60)).unwrap();
    let args = ["--lockstep", "--walkers", "40", "--walkers-crossing", "25"];
    let driver = spawn_consumer(&sandbox, "gantry-drive", &args);
    let mut places: BTreeMap<u32, Vec<[f64; 3]>> = BTreeMap::new();
    let mut next = gate.first_tick();
    while next <= 800 {
        let snapshot = eventually(&format!("snapshot {next}"), || {
            wake.wait(Duration::from_millis(100)).unwrap();
            let newest = snapshots.next().unwrap();
            newest.filter(|snapshot| snapshot.header().tick >= next)
        });
        if next.is_multiple_of(20) {
            for record in snapshot.records() {
                if record.kind() == Some(ActorKind::Walker) {
                    let at = record.world_from_actor.translation_m;
                    places.entry(record.id).or_default().push(at);
                }
            }
        }
        gate.ack(next).unwrap();
        next += 1;
    }
    drop(gate);
    driver.stop().expect_code(0);
    // Nobody is left behind when the process ends.
    eventually("an empty town", || {
        let actors: ActorList = document(&bus, names::WORLD_ACTORS).json().unwrap();
        let is_walker = |actor: &schema_frames::ActorInfo| actor.kind == "walker";
        (!actors.actors.iter().any(is_walker)).then_some(())
    });
    places
}

#[test]
fn one_flag_populates_a_town_and_the_same_seed_does_it_again() {
    let (first, again) = (stroll(), stroll());
    assert_eq!(first.len(), 40);
    for (id, places) in &first {
        let way = |pair: &[[f64; 3]]| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
        let whole_m: f64 = places.windows(2).map(way).sum();
        assert!(whole_m > 10.0, "person {id} went {whole_m} m in 40 s");
        let fastest = places.windows(2).map(way).fold(0.0, f64::max);
        assert!(fastest < 3.0, "person {id} went {fastest} m in a second");
    }
    assert!(first == again, "two runs with the same seed differ");
}

#[test]
fn a_minute_of_traffic_stays_on_its_lanes_and_touches_nothing() {
    let sandbox = Sandbox::new("drive");
    let _daemon = start_daemon(&sandbox, LAUNCH, &["--unpaced", "--await-lockstep", "2"]);
    let bus = join_bus(&sandbox, "test");
    let mut snapshots = eventually("snapshots", || bus.snapshot_reader().ok());
    let wake = bus.listener(names::WORLD_SNAPSHOT).unwrap();
    let map = document(&bus, names::WORLD_MAP);
    let map = RoadMap::parse(&map.text).unwrap();
    let gate = Lockstep::join(&bus, "test", Duration::from_secs(60)).unwrap();
    let mut driver = spawn_consumer(&sandbox, "gantry-drive", &["--lockstep"]);
    let mut logs: BTreeMap<u32, Log> = BTreeMap::new();
    let mut next = gate.first_tick();
    while next <= LAST_TICK {
        let snapshot = eventually(&format!("snapshot {next}"), || {
            wake.wait(Duration::from_millis(100)).unwrap();
            snapshots
                .next()
                .unwrap()
                .filter(|snapshot| snapshot.header().tick >= next)
        });
        assert_eq!(snapshot.header().tick, next, "lockstep loses no snapshot");
        for record in snapshot
            .records()
            .iter()
            .filter(|record| record.kind() == Some(ActorKind::Vehicle))
        {
            logs.entry(record.id).or_default().add(record, &map);
        }
        gate.ack(next).unwrap();
        next += 1;
    }
    drop(gate);
    let actors: ActorList = document(&bus, names::WORLD_ACTORS).json().unwrap();
    let ego = actors
        .actors
        .iter()
        .find(|actor| actor.role == "ego_vehicle")
        .unwrap();
    let log = logs[&ego.id];
    assert!(log.driven_m >= 100.0, "the ego drove {:.0} m", log.driven_m);
    assert_eq!(logs.len(), 13);
    for (id, log) in &logs {
        assert_eq!(log.n_touches, 0, "vehicle {id} touched something: {log:?}");
        assert!(
            log.worst_offset_m < log.lane_width_m / 2.0,
            "vehicle {id} left its lane: {log:?}"
        );
    }
    let n_moved = logs.values().filter(|log| log.driven_m > 20.0).count();
    assert!(n_moved >= 10, "{n_moved} of 13 vehicles moved: {logs:?}");
    assert!(driver.is_running());
    let mut client = bus.command_client("counting").unwrap();
    assert_eq!(
        counter(&mut client, "gpu_submissions"),
        0,
        "nobody reads the camera"
    );
    driver.stop().expect_code(0);
}

/// Without sensors.
const SHARED: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
vehicles = 24
"#;
/// Tick after which one of the drivers is killed, and after which it is started again.
const KILLED: u64 = 240;
const STARTED: u64 = 400;
const END: u64 = 560;
/// Ticks until the others have taken over or given back.
const HANDED_OVER: u64 = 6;

fn share(sandbox: &Sandbox, number: u32) -> Process {
    let share = format!("{number}/3");
    spawn_consumer(sandbox, "gantry-drive", &["--lockstep", "--share", &share])
}

#[test]
fn three_drivers_share_the_vehicles_and_take_over_from_one_that_is_killed() {
    let sandbox = Sandbox::new("shared-drive");
    let _daemon = start_daemon(&sandbox, SHARED, &["--unpaced", "--await-lockstep", "4"]);
    let bus = join_bus(&sandbox, "test");
    let mut snapshots = eventually("snapshots", || bus.snapshot_reader().ok());
    let wake = bus.listener(names::WORLD_SNAPSHOT).unwrap();
    let mut controls = bus.control_reader().unwrap();
    let gate = Lockstep::join(&bus, "test", Duration::from_secs(60)).unwrap();
    let mut first = share(&sandbox, 1);
    let mut second = Some(share(&sandbox, 2));
    let mut third = share(&sandbox, 3);
    // Who sent a control for which vehicle, by the tick that it answers.
    let mut by_tick: BTreeMap<u64, BTreeMap<u32, Vec<String>>> = BTreeMap::new();
    let mut vehicles: BTreeSet<u32> = BTreeSet::new();
    let mut touches = Vec::new();
    let mut driven_m: BTreeMap<u32, (f64, Option<[f64; 3]>)> = BTreeMap::new();
    let begin = gate.first_tick();
    let mut next = begin;
    while next <= END {
        let snapshot = eventually(&format!("snapshot {next}"), || {
            wake.wait(Duration::from_millis(100)).unwrap();
            let is_next = |tick: u64| tick >= next;
            snapshots
                .next()
                .unwrap()
                .filter(|it| is_next(it.header().tick))
        });
        assert_eq!(snapshot.header().tick, next, "lockstep loses no snapshot");
        let records = snapshot.records();
        for record in records
            .iter()
            .filter(|it| it.kind() == Some(ActorKind::Vehicle))
        {
            vehicles.insert(record.id);
            if record.flags & ActorRecord::TOUCHED != 0 {
                touches.push((next, record.id));
            }
            let at = record.world_from_actor.translation_m;
            let (sum, last) = driven_m.entry(record.id).or_default();
            if let Some(last) = last.replace(at) {
                *sum += (at[0] - last[0]).hypot(at[1] - last[1]);
            }
        }
        for batch in controls.drain().unwrap() {
            let of_tick = by_tick.entry(batch.tick).or_default();
            for record in &batch.records {
                of_tick
                    .entry(record.actor_id)
                    .or_default()
                    .push(batch.writer.clone());
            }
        }
        if next == KILLED {
            second.take().unwrap().kill9();
        }
        if next == STARTED {
            let mut again = share(&sandbox, 2);
            again.wait_line("joined lockstep");
            second = Some(again);
        }
        gate.ack(next).unwrap();
        next += 1;
    }
    assert_eq!(vehicles.len(), 25);
    assert!(
        touches.is_empty(),
        "(tick, vehicle) of touches: {touches:?}"
    );
    let driver_of = |tick: u64, id: u32| -> &[String] {
        by_tick
            .get(&tick)
            .and_then(|it| it.get(&id))
            .map_or(&[], Vec::as_slice)
    };
    let name = |number: u32| format!("drive-all-{number}-of-3");
    let owner: BTreeMap<u32, String> = vehicles
        .iter()
        .map(|id| (*id, driver_of(KILLED - 1, *id)[0].clone()))
        .collect();
    for number in 1..=3 {
        assert!(owner.values().any(|it| *it == name(number)), "{owner:?}");
    }
    for tick in begin + 1..END {
        let is_killed = (KILLED..STARTED).contains(&tick);
        let is_between = [KILLED, STARTED]
            .iter()
            .any(|at| (*at..=at + HANDED_OVER).contains(&tick));
        for id in &vehicles {
            let drivers = driver_of(tick, *id);
            let was_of_second = owner[id] == name(2);
            if is_between && was_of_second {
                continue;
            }
            assert_eq!(drivers.len(), 1, "tick {tick}, vehicle {id}: {drivers:?}");
            if is_killed && was_of_second {
                assert_ne!(drivers[0], name(2));
            } else {
                assert_eq!(drivers[0], owner[id], "tick {tick}, vehicle {id}");
            }
        }
    }
    for driver in [&mut first, &mut third] {
        driver.wait_line("drive-all-2-of-3 has fallen silent");
        driver.wait_line("drive-all-2-of-3 is back");
    }
    let n_moved = driven_m.values().filter(|(sum, _)| *sum > 15.0).count();
    assert!(
        n_moved >= 15,
        "{n_moved} of 25 vehicles moved: {driven_m:?}"
    );
    drop(gate);
    for driver in [Some(first), second, Some(third)].into_iter().flatten() {
        driver.stop().expect_code(0);
    }
}
