//! Checkpoints through the daemon: in memory, from a file in another process, and the start of the
//! episode.

use std::collections::BTreeMap;

use schema_bus::{Bus, CommandClient, SnapshotReader};
use schema_frames::command::CheckpointPlace;
use schema_frames::{
    ActorKind, ActorRecord, Command, CommandReply, SnapshotHeader, VehicleControl,
};
use test_e2e::{ask, document, join_bus, start_daemon, step};
use test_kit::{Process, Sandbox, eventually};

const LAUNCH: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
mode = "stepped"
vehicles = 12
[sensor.imu]
kind = "imu"
rate_hz = 20
"#;

struct Run {
    daemon: Process,
    client: CommandClient,
    snapshots: SnapshotReader,
    bus: Bus,
}

impl Run {
    fn start(sandbox: &Sandbox) -> Run {
        let data = sandbox.path("data");
        let daemon = start_daemon(sandbox, LAUNCH, &["--data", data.to_str().unwrap()]);
        let bus = join_bus(sandbox, "test");
        let client = bus.command_client("test").unwrap();
        let snapshots = eventually("snapshots", || bus.snapshot_reader().ok());
        Run {
            daemon,
            client,
            snapshots,
            bus,
        }
    }

    fn ask(&mut self, command: Command) -> CommandReply {
        ask(&mut self.client, command)
    }

    /// One tick's header and records.
    fn tick(&mut self) -> (SnapshotHeader, Vec<ActorRecord>) {
        let tick = step(&mut self.client, 1);
        let snapshot = eventually("the tick's snapshot", || {
            self.snapshots
                .next()
                .unwrap()
                .filter(|snapshot| snapshot.header().tick == tick)
        });
        (*snapshot.header(), snapshot.records().to_vec())
    }

    fn ticks(&mut self, n: usize) -> Vec<(SnapshotHeader, Vec<ActorRecord>)> {
        (0..n).map(|_| self.tick()).collect()
    }

    /// Every vehicle drives; each control holds until the next one.
    fn drive_off(&mut self, records: &[ActorRecord]) {
        for (idx, record) in records
            .iter()
            .filter(|record| record.kind() == Some(ActorKind::Vehicle))
            .enumerate()
        {
            let control = VehicleControl {
                throttle_ratio: 0.8,
                steer_ratio: 0.3 * (idx as f32).sin(),
                ..Default::default()
            };
            assert_eq!(
                self.ask(Command::ControlVehicle {
                    actor_id: record.id,
                    control
                }),
                CommandReply::Done
            );
        }
    }
}

fn elapsed(header: &SnapshotHeader) -> u64 {
    header.sim_nanos - header.episode_start_nanos
}

fn assert_same_course(
    a: &[(SnapshotHeader, Vec<ActorRecord>)],
    b: &[(SnapshotHeader, Vec<ActorRecord>)],
) {
    assert_eq!(a.len(), b.len());
    for ((was, records), (is, again)) in a.iter().zip(b) {
        assert_eq!(elapsed(was), elapsed(is));
        let differing = records
            .iter()
            .zip(again)
            .find(|(a, b)| bytemuck::bytes_of(*a) != bytemuck::bytes_of(*b));
        assert_eq!(
            (differing, records.len()),
            (None, again.len()),
            "at tick {} instead of {}",
            is.tick,
            was.tick
        );
    }
}

#[test]
fn runs_go_on_bit_for_bit_from_memory_from_a_file_and_from_the_start() {
    let sandbox = Sandbox::new("checkpoint");
    let mut run = Run::start(&sandbox);
    let first = run.ticks(10);
    run.drive_off(&first[9].1.clone());
    let before = run.ticks(30);
    let place = |name: &str| CheckpointPlace::Name(name.into());
    let file = CheckpointPlace::File("rush_hour".into());
    assert_eq!(
        run.ask(Command::SaveCheckpoint { to: place("here") }),
        CommandReply::Saved {
            path: String::new()
        }
    );
    let CommandReply::Saved { path } = run.ask(Command::SaveCheckpoint { to: file.clone() }) else {
        panic!("not saved")
    };
    assert_eq!(
        std::path::Path::new(&path),
        sandbox.path("data/checkpoints/rush_hour.gckp")
    );
    let course = run.ticks(60);
    let drove = |(a, b): &(&ActorRecord, &ActorRecord)| {
        (0..2).any(|axis| {
            (a.world_from_actor.translation_m[axis] - b.world_from_actor.translation_m[axis]).abs()
                > 0.5
        })
    };
    let n_driving = course[0].1.iter().zip(&course[59].1).filter(drove).count();
    assert!(n_driving >= 8, "only {n_driving} vehicles drive");

    let restored = run.ask(Command::RestoreCheckpoint {
        from: place("here"),
    });
    assert_eq!(restored, CommandReply::Restored { gone: Vec::new() });
    let again = run.ticks(60);
    assert_same_course(&course, &again);
    assert_eq!(again[0].0.tick, course[59].0.tick + 1, "ticks go on");
    assert!(
        again[0].0.sim_nanos > course[59].0.sim_nanos,
        "time goes on"
    );
    let flags: Vec<u32> = again
        .iter()
        .map(|(header, _)| header.flags & SnapshotHeader::RESTORED)
        .collect();
    assert_eq!(
        (flags[0], flags[1..].iter().sum::<u32>()),
        (SnapshotHeader::RESTORED, 0)
    );
    let info: serde_json::Value =
        serde_json::from_str(&document(&run.bus, "world/info").text).unwrap();
    assert_eq!(info["episode_start_nanos"], again[0].0.episode_start_nanos);

    // At the start of the episode no control had been given, so all vehicles stand.
    assert_eq!(
        run.ask(Command::Reset),
        CommandReply::Restored { gone: Vec::new() }
    );
    let start = run.ticks(10);
    assert_same_course(&first, &start);
    run.drive_off(&start[9].1.clone());
    assert_same_course(&before, &run.ticks(30));

    // Another process, which has run for less time than the checkpoint's episode.
    run.daemon.stop().expect_code(0);
    let mut run = Run::start(&sandbox);
    assert_eq!(
        run.ask(Command::RestoreCheckpoint { from: file }),
        CommandReply::Restored { gone: Vec::new() }
    );
    let elsewhere = run.ticks(60);
    assert_same_course(&course, &elsewhere);
    assert_eq!(elsewhere[0].0.tick, 1);
    run.daemon.stop().expect_code(0);
}

#[test]
fn what_cannot_be_restored_is_a_sentence_and_changes_nothing() {
    let sandbox = Sandbox::new("checkpointbad");
    let mut run = Run::start(&sandbox);
    run.ticks(3);
    let mut refused = |command: Command| match run.ask(command) {
        CommandReply::Refused { error } => error,
        other => panic!("{other:?}"),
    };
    let from = |name: &str| Command::RestoreCheckpoint {
        from: CheckpointPlace::File(name.into()),
    };
    let unknown = refused(Command::RestoreCheckpoint {
        from: CheckpointPlace::Name("x".into()),
    });
    assert!(unknown.contains("no checkpoint \"x\""), "{unknown}");
    for name in ["../launch", "/etc/passwd", ".x", "a/b"] {
        assert!(refused(from(name)).contains("cannot be used"));
        assert!(
            refused(Command::SaveCheckpoint {
                to: CheckpointPlace::File(name.into())
            })
            .contains("cannot be used")
        );
    }
    assert!(refused(from("missing")).contains("missing.gckp"));
    std::fs::create_dir_all(sandbox.path("data/checkpoints")).unwrap();
    std::fs::write(sandbox.path("data/checkpoints/foreign.gckp"), b"\x89PNG").unwrap();
    assert!(refused(from("foreign")).contains("not a checkpoint"));
    let saved = run.ask(Command::SaveCheckpoint {
        to: CheckpointPlace::File("cut".into()),
    });
    assert!(matches!(saved, CommandReply::Saved { .. }));
    let path = sandbox.path("data/checkpoints/cut.gckp");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let CommandReply::Refused { error } = run.ask(from("cut")) else {
        panic!("half a file was taken")
    };
    assert!(error.contains("cut off"), "{error}");
    assert!(run.daemon.is_running());
    run.daemon.stop().expect_code(0);
}

/// A restore keeps sensors that were made later, and removes those whose carrier did not exist at
/// the checkpoint.
#[test]
fn sensors_stay_unless_their_vehicle_goes() {
    let sandbox = Sandbox::new("checkpointsensors");
    let mut run = Run::start(&sandbox);
    let records = run.ticks(2).pop().unwrap().1;
    let ego = records
        .iter()
        .find(|record| record.kind() == Some(ActorKind::Vehicle))
        .unwrap()
        .id;
    let pose: schema_frames::document::PoseText =
        schema_types::Pose::from_xyz_yaw(0.0, 0.0, 2.0, 0.0).into();
    let sensor = |parent_id: u32| {
        let serde_json::Value::Object(spec) = serde_json::json!({ "kind": "imu" }) else {
            unreachable!()
        };
        Command::SpawnSensor {
            type_id: "sensor.other.imu".into(),
            pose,
            parent_id: Some(parent_id),
            attachment: Default::default(),
            interval_nanos: 0,
            spec,
            attributes: BTreeMap::new(),
        }
    };
    let made = |reply: CommandReply| match reply {
        CommandReply::Spawned { actor_id, .. } => actor_id,
        other => panic!("{other:?}"),
    };
    let high = schema_types::Pose::from_xyz_yaw(0.0, 0.0, 200.0, 0.0).into();
    let on_ego = made(run.ask(sensor(ego)));
    let late = Command::Spawn {
        type_id: "vehicle.audi.tt".into(),
        pose: high,
        parent_id: None,
        role: String::new(),
        attributes: BTreeMap::new(),
    };
    let car = made(run.ask(late));
    let on_car = made(run.ask(sensor(car)));
    run.ticks(2);
    assert_eq!(
        run.ask(Command::Reset),
        CommandReply::Restored { gone: vec![on_car] }
    );
    let after = run.tick().1;
    let is_there = |id: u32| after.iter().any(|record| record.id == id);
    assert_eq!(
        (
            is_there(ego),
            is_there(on_ego),
            is_there(car),
            is_there(on_car)
        ),
        (true, true, false, false)
    );
    let names: Vec<String> = run
        .bus
        .topics()
        .unwrap()
        .into_iter()
        .map(|topic| topic.name)
        .collect();
    assert!(
        names
            .iter()
            .any(|name| name.contains(&format!("s{on_ego}/")))
            && !names
                .iter()
                .any(|name| name.contains(&format!("s{on_car}/")))
    );
    run.daemon.stop().expect_code(0);
}

/// A file with a right checksum and a time that no clock can hold: the simulator refuses it by name
/// and goes on, with all its clients.
#[test]
fn a_checkpoint_of_no_possible_time_is_refused_and_the_world_goes_on() {
    let sandbox = Sandbox::new("checkpoint-time");
    let mut run = Run::start(&sandbox);
    run.ticks(3);
    let file = CheckpointPlace::File("late".into());
    let saved = run.ask(Command::SaveCheckpoint { to: file.clone() });
    let CommandReply::Saved { path } = saved else {
        panic!("not saved")
    };
    let good = std::fs::read(&path).unwrap();
    for nanos in [u64::MAX, u64::MAX - 150_000_000] {
        let mut late = good.clone();
        // The third word of the head, after magic and version.
        late[24..32].copy_from_slice(&nanos.to_le_bytes());
        test_fuzz::targets::mend_checkpoint(&mut late);
        std::fs::write(&path, &late).unwrap();
        let refused = run.ask(Command::RestoreCheckpoint { from: file.clone() });
        let said = format!("{refused:?}");
        assert!(
            said.contains(&format!("the time since the episode began is {nanos} ns"))
                && said.contains("ten years"),
            "{said}"
        );
        let (header, _) = run.tick();
        assert_eq!(elapsed(&header), header.tick * header.period_nanos);
    }
    std::fs::write(&path, good).unwrap();
    let restored = run.ask(Command::RestoreCheckpoint { from: file });
    assert_eq!(restored, CommandReply::Restored { gone: Vec::new() });
    drop((run.client, run.snapshots, run.bus));
    run.daemon.stop().expect_code(0);
}
