//! `gantry-drive` and a daemon without any reader of frames: a simulated minute in lockstep, as fast
//! as the machine can.

use std::collections::BTreeMap;
use std::time::Duration;

use consumer_kit::Lockstep;
use schema_bus::names;
use schema_frames::{ActorKind, ActorList, ActorRecord};
use schema_roads::RoadMap;
use test_e2e::{counter, document, join_bus, spawn_consumer, start_daemon};
use test_kit::{Sandbox, eventually};

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
