//! Sensors made and ended by commands while the world runs.

use schema_frames::document::PoseText;
use schema_frames::{Command, CommandReply, Modality};
use schema_types::Pose;
use test_e2e::carla::empty_town;
use test_e2e::{SMALL_RIG, ask, counter, join_bus, reader, start_daemon, step};
use test_kit::{Sandbox, eventually};

fn stepped() -> String {
    SMALL_RIG.replace("tick_hz = 20", "tick_hz = 20\nmode = \"stepped\"")
}

fn wish(parent_id: Option<u32>, interval_nanos: u64, spec: serde_json::Value) -> Command {
    let pose: PoseText = Pose::from_xyz_yaw(0.5, 0.0, 2.0, 0.3).into();
    let serde_json::Value::Object(spec) = spec else {
        panic!("a specification is an object")
    };
    Command::SpawnSensor {
        type_id: "sensor.camera.view".into(),
        pose,
        parent_id,
        attachment: Default::default(),
        interval_nanos,
        spec,
        attributes: Default::default(),
    }
}

/// Two cameras and a lidar are spawned on the ego, read, and destroyed; memory comes with the
/// reader and goes with the sensor.
#[test]
fn spawned_sensors_publish_until_they_are_destroyed() {
    let sandbox = Sandbox::new("spawn");
    let _daemon = start_daemon(&sandbox, &stepped(), &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    step(&mut client, 1);
    let mut imu = reader(&bus, "ego/imu/imu");
    step(&mut client, 1);
    let ego = imu.next().unwrap().unwrap().header().parent_id;
    let camera = serde_json::json!({ "kind": "camera", "width_px": 64, "height_px": 48, "modalities": ["depth", "instance"] });
    let CommandReply::Spawned { actor_id, topics } =
        ask(&mut client, wish(Some(ego), 0, camera.clone()))
    else {
        panic!("must be made")
    };
    assert_eq!(
        topics,
        [
            format!("actor_{ego}/s{actor_id}/depth"),
            format!("actor_{ego}/s{actor_id}/instance")
        ]
    );
    let slow = ask(
        &mut client,
        wish(
            Some(ego),
            100_000_000,
            serde_json::json!({ "kind": "lidar", "channels": 4, "columns": 90 }),
        ),
    );
    let CommandReply::Spawned {
        actor_id: lidar_id,
        topics: lidar_topics,
    } = slow
    else {
        panic!("must be made: {slow:?}")
    };

    let mut depth = reader(&bus, &topics[0]);
    let mut lidar = reader(&bus, &lidar_topics[0]);
    step(&mut client, 1);
    let frame = depth
        .next()
        .unwrap()
        .expect("the first tick after the reader came has its frame");
    assert_eq!(
        (
            frame.modality(),
            frame.header().sensor_id,
            frame.header().parent_id
        ),
        (Modality::Depth, actor_id, ego)
    );
    assert_eq!((frame.header().width, frame.header().cpu_copies), (64, 0));
    let expected = Pose::from_xyz_yaw(0.5, 0.0, 2.0, 0.3);
    let mut snapshots = bus.snapshot_reader().unwrap();
    let snapshot = eventually("the newest snapshot greets", || snapshots.latest().unwrap());
    let mount = snapshot
        .actor(ego)
        .unwrap()
        .world_from_actor
        .isometry()
        .inv_mul(&frame.header().world_from_sensor.isometry());
    assert!((mount.translation.vector - expected.isometry().translation.vector).norm() < 1e-9);
    assert!(lidar.next().unwrap().is_some());
    step(&mut client, 2);
    assert_eq!(
        lidar.latest().unwrap().map(|frame| frame.header().seq),
        Some(2),
        "ten a second"
    );

    let copies = counter(&mut client, "gpu_copies");
    for id in [actor_id, lidar_id] {
        assert_eq!(
            ask(&mut client, Command::Destroy { actor_id: id }),
            CommandReply::Done
        );
    }
    let held = frame.to_vec();
    step(&mut client, 2);
    assert_eq!(*frame, held[..], "a held frame outlives its sensor");
    assert_eq!(
        counter(&mut client, "gpu_copies"),
        copies,
        "an ended sensor costs nothing"
    );
    drop((frame, depth));
    assert!(
        bus.topics()
            .unwrap()
            .iter()
            .all(|topic| topic.name != topics[0]),
        "the topic has gone"
    );
    let snapshot = eventually("the newest snapshot", || snapshots.latest().unwrap());
    assert!(snapshot.actor(actor_id).is_none() && snapshot.actor(lidar_id).is_none());
}

/// A camera that fires once in ten ticks of a world that runs as fast as it can: its frame does not
/// wait for the next one to push it out.
#[test]
fn a_frame_is_sent_after_two_ticks_at_the_latest() {
    let sandbox = Sandbox::new("latency");
    let _daemon = start_daemon(&sandbox, SMALL_RIG, &["--unpaced"]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let rare = serde_json::json!({ "kind": "camera", "width_px": 64, "height_px": 48, "modalities": ["depth"] });
    let CommandReply::Spawned { topics, .. } = ask(&mut client, wish(None, 500_000_000, rare))
    else {
        panic!("must be made")
    };
    let mut depth = reader(&bus, &topics[0]);
    for _ in 0..6 {
        let frame = eventually("a frame", || depth.latest().unwrap());
        assert!(
            frame.header().ticks_in_flight <= 2,
            "sent {} ticks late",
            frame.header().ticks_in_flight
        );
    }
}

/// The daemon's last line counts frames of sensors that commands made, though these have ended.
#[test]
fn the_last_line_counts_the_frames_of_ended_sensors() {
    let sandbox = Sandbox::new("last-line");
    let launch = format!("{}mode = \"stepped\"\n", empty_town("Town02"));
    let daemon = start_daemon(&sandbox, &launch, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let imu = serde_json::json!({ "kind": "imu" });
    let CommandReply::Spawned { actor_id, topics } = ask(&mut client, wish(None, 0, imu)) else {
        panic!("must be made")
    };
    let imu = reader(&bus, &topics[0]);
    step(&mut client, 3);
    assert_eq!(
        ask(&mut client, Command::Destroy { actor_id }),
        CommandReply::Done
    );
    drop(imu);
    let ended = daemon.stop().expect_code(0);
    let last = ended.lines.last().cloned().unwrap_or_default();
    assert!(
        last.contains("ticks=3 frames=3 dropped=0"),
        "{}",
        ended.lines.join("\n")
    );
}

/// A hundred sensors are made and ended, and nothing is left of them.
#[test]
fn sensors_that_come_and_go_leave_nothing() {
    let sandbox = Sandbox::new("churn");
    let daemon = start_daemon(&sandbox, &stepped(), &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    step(&mut client, 1);
    // The daemon looks for dead processes meanwhile, and has folders open for a moment then.
    let files = || {
        let folder = format!("/proc/{}/fd", daemon.pid());
        let n_now = || {
            std::thread::sleep(std::time::Duration::from_millis(5));
            std::fs::read_dir(&folder).unwrap().count()
        };
        (0..20).map(|_| n_now()).min().expect("twenty numbers")
    };
    let before = files();
    for round in 0..100 {
        let camera = serde_json::json!({ "kind": "camera", "width_px": 32, "height_px": 32, "modalities": ["rgb"] });
        let CommandReply::Spawned { actor_id, topics } = ask(&mut client, wish(None, 0, camera))
        else {
            panic!("must be made")
        };
        if round % 10 == 0 {
            let mut rgb = reader(&bus, &topics[0]);
            step(&mut client, 1);
            assert!(rgb.next().unwrap().is_some());
        }
        assert_eq!(
            ask(&mut client, Command::Destroy { actor_id }),
            CommandReply::Done
        );
    }
    step(&mut client, 1);
    assert_eq!(files(), before, "no descriptor stays behind");
}

#[test]
fn a_specification_that_cannot_be_used_is_refused_with_its_reason() {
    let sandbox = Sandbox::new("refuse");
    let _daemon = start_daemon(&sandbox, &stepped(), &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut refusal = |spec: serde_json::Value, parent: Option<u32>| match ask(
        &mut client,
        wish(parent, 0, spec),
    ) {
        CommandReply::Refused { error } => error,
        other => panic!("{other:?}"),
    };
    let error = refusal(serde_json::json!({ "kind": "camera", "width_px": 5 }), None);
    assert!(
        error.contains("width_px is 5, but must be 16 to 4096"),
        "{error}"
    );
    let error = refusal(
        serde_json::json!({ "kind": "camera", "widht_px": 50 }),
        None,
    );
    assert!(error.contains("widht_px"), "{error}");
    let error = refusal(serde_json::json!({ "kind": "camera", "rate_hz": 5 }), None);
    assert!(error.contains("interval_nanos"), "{error}");
    let error = refusal(serde_json::json!({ "kind": "camera" }), Some(987_654));
    assert!(error.contains("987654"), "{error}");
}
