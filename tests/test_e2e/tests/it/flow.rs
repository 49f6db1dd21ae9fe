//! Frames from the daemon to a reader in another process: every topic, in order, with the promises
//! of the header.

use schema_bus::names;
use schema_frames::{ActorList, Command, CommandReply, FrameHeader, Modality, StepMode};
use schema_types::Pose;
use test_e2e::{SMALL_RIG, SMALL_RIG_TOPICS, ask, counter, join_bus, reader, start_daemon, step};
use test_kit::{Sandbox, eventually};

fn stepped(text: &str) -> String {
    text.replace("tick_hz = 20", "tick_hz = 20\nmode = \"stepped\"")
}

/// Steps a daemon tick by tick with a reader on every topic; each frame must be the one its
/// schedule promises.
#[test]
fn every_topic_delivers_each_scheduled_frame_with_a_true_header() {
    let sandbox = Sandbox::new("flow");
    let _daemon = start_daemon(&sandbox, &stepped(SMALL_RIG), &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut readers: Vec<_> = SMALL_RIG_TOPICS
        .iter()
        .map(|topic| reader(&bus, topic))
        .collect();
    let mut snapshots = eventually("snapshots", || bus.snapshot_reader().ok());
    for tick in 1..=6u64 {
        assert_eq!(step(&mut client, 1), tick);
        let snapshot = eventually("snapshot", || snapshots.latest().unwrap());
        assert_eq!(snapshot.header().tick, tick);
        assert_eq!(snapshot.header().sim_nanos, tick * 50_000_000);
        for frames in &mut readers {
            let every = if frames.topic().contains("roof")
                || frames.topic().contains("labels")
                || frames.topic().contains("gnss")
            {
                2
            } else {
                1
            };
            let due = (tick - 1).is_multiple_of(every);
            let frame = frames.next().unwrap();
            assert_eq!(frame.is_some(), due, "{} at tick {tick}", frames.topic());
            let Some(frame) = frame else { continue };
            let header = frame.header();
            assert_eq!(
                (header.tick, header.seq),
                (tick, (tick - 1) / every + 1),
                "{}",
                frames.topic()
            );
            assert_eq!(
                header.cpu_copies,
                0,
                "{}: lavapipe imports shared memory",
                frames.topic()
            );
            assert!(
                header.rendered_mono_nanos <= header.published_mono_nanos
                    && header.rendered_mono_nanos > 0
            );
            let record = snapshot
                .actor(header.sensor_id)
                .expect("every sensor is an actor");
            assert_eq!(
                record.world_from_actor, header.world_from_sensor,
                "pose equals the snapshot's bit for bit"
            );
            assert_eq!(record.parent_id, header.parent_id);
            let is_first = header.flags & FrameHeader::FIRST != 0;
            assert_eq!(
                is_first,
                tick == 1 && matches!(frame.modality(), Modality::Flow | Modality::Dvs),
                "{}",
                frames.topic()
            );
        }
    }
}

/// The images show the scene: a road in front of the car, the sky above it, and depth and classes
/// that agree.
#[test]
fn one_view_shows_the_same_world_in_every_modality() {
    let sandbox = Sandbox::new("view");
    let _daemon = start_daemon(&sandbox, &stepped(SMALL_RIG), &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let topics = ["depth", "semantic", "instance"].map(|modality| format!("ego/front/{modality}"));
    let [mut depth, mut semantic, mut instance] = topics.map(|topic| reader(&bus, &topic));
    step(&mut client, 1);
    let (depth, semantic, instance) = (
        depth.next().unwrap().unwrap(),
        semantic.next().unwrap().unwrap(),
        instance.next().unwrap().unwrap(),
    );
    let depth_m: &[f32] = depth.elements().unwrap();
    let ids: &[u32] = instance.elements().unwrap();
    let n_sky = semantic
        .iter()
        .filter(|class| **class == schema_types::Class::SKY.0)
        .count();
    let n_road = semantic
        .iter()
        .filter(|class| **class == schema_types::Class::ROADS.0)
        .count();
    assert!(
        n_sky > 100 && n_road > 500,
        "{n_sky} sky and {n_road} road pixels of {}",
        semantic.len()
    );
    for ((class, depth_m), id) in semantic.iter().zip(depth_m).zip(ids) {
        assert_eq!(
            *class == schema_types::Class::SKY.0,
            depth_m.is_infinite(),
            "sky is what has no depth"
        );
        assert_eq!(
            *id == 0,
            depth_m.is_infinite(),
            "whatever was hit has an id"
        );
        assert!(*depth_m > 0.09, "nothing is nearer than the near plane");
    }
}

/// A snapshot names the revision of `world/actors` that lists its actors; after a spawn both move
/// on together.
#[test]
fn a_snapshot_names_the_list_of_its_actors() {
    let sandbox = Sandbox::new("revision");
    let _daemon = start_daemon(&sandbox, &stepped(SMALL_RIG), &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut snapshots = bus.snapshot_reader().unwrap();
    let mut lists = bus.document_reader(names::WORLD_ACTORS).unwrap();
    let mut list = eventually("the list", || lists.latest().unwrap());
    for tick in 1..=3 {
        if tick == 2 {
            let pose = Pose::from_xyz_yaw(300.0, 300.0, 5.0, 0.0).into();
            let (type_id, role) = ("vehicle.tesla.model3".to_owned(), String::new());
            let reply = ask(
                &mut client,
                Command::Spawn {
                    type_id,
                    pose,
                    parent_id: None,
                    role,
                    attributes: Default::default(),
                },
            );
            assert!(matches!(reply, CommandReply::Spawned { .. }), "{reply:?}");
        }
        step(&mut client, 1);
        let snapshot = eventually("snapshot", || {
            snapshots
                .latest()
                .unwrap()
                .filter(|s| s.header().tick == tick)
        });
        let wanted = snapshot.header().actors_revision;
        if wanted != list.header.revision {
            list = eventually("the list", || lists.latest().unwrap());
        }
        assert_eq!(list.header.revision, wanted);
        let listed = list.json::<ActorList>().unwrap().actors;
        assert!(
            snapshot
                .records()
                .iter()
                .all(|record| listed.iter().any(|actor| actor.id == record.id))
        );
    }
}

#[test]
fn a_late_reader_gets_the_next_frame_and_never_an_old_one() {
    let sandbox = Sandbox::new("late");
    let _daemon = start_daemon(&sandbox, &stepped(SMALL_RIG), &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut early = reader(&bus, "ego/imu/imu");
    step(&mut client, 3);
    let mut late = reader(&bus, "ego/imu/imu");
    assert!(
        late.next().unwrap().is_none(),
        "nothing old greets a reader of frames"
    );
    step(&mut client, 1);
    assert_eq!(
        late.next().unwrap().map(|frame| frame.header().seq),
        Some(4)
    );
    assert_eq!(
        early.latest().unwrap().map(|frame| frame.header().seq),
        Some(4)
    );
}

#[test]
fn what_nobody_reads_is_not_rendered_and_starts_within_a_tick() {
    let sandbox = Sandbox::new("idle");
    let _daemon = start_daemon(&sandbox, &stepped(SMALL_RIG), &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    step(&mut client, 5);
    for name in ["gpu_passes", "gpu_copies", "gpu_submissions", "lidar_turns"] {
        assert_eq!(counter(&mut client, name), 0, "{name}");
    }
    let mut depth = reader(&bus, "ego/front/depth");
    step(&mut client, 1);
    assert_eq!(
        depth.next().unwrap().map(|frame| frame.header().tick),
        Some(6)
    );
    assert_eq!(
        counter(&mut client, "gpu_copies"),
        1,
        "one modality is read, one is copied"
    );
    drop(depth);
    let passes = counter(&mut client, "gpu_passes");
    step(&mut client, 3);
    assert_eq!(counter(&mut client, "gpu_passes"), passes);
}

#[test]
fn a_reader_that_does_not_read_loses_the_oldest_and_sees_the_gap() {
    let sandbox = Sandbox::new("slow");
    let _daemon = start_daemon(&sandbox, &stepped(SMALL_RIG), &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut slow = reader(&bus, "ego/front/semantic");
    step(&mut client, 1);
    assert_eq!(
        slow.next().unwrap().map(|frame| frame.header().seq),
        Some(1)
    );
    step(&mut client, 10);
    let first = slow.next().unwrap().expect("a frame waits");
    assert_eq!(first.header().seq, 10, "the buffer holds two");
    assert_eq!(slow.counts().lost, 8);
}

#[test]
fn commands_change_the_world_between_ticks() {
    let sandbox = Sandbox::new("commands");
    let _daemon = start_daemon(&sandbox, &stepped(SMALL_RIG), &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    assert!(matches!(
        ask(&mut client, Command::Ping),
        CommandReply::Pong { .. }
    ));
    let CommandReply::Refused { error } = ask(&mut client, Command::Destroy { actor_id: 999_999 })
    else {
        panic!("must be refused")
    };
    assert!(error.contains("999999"), "{error}");
    let CommandReply::Refused { error } = ask(
        &mut client,
        Command::Configure {
            mode: None,
            period_nanos: Some(1),
            longest_substep_nanos: None,
        },
    ) else {
        panic!("must be refused")
    };
    assert!(error.contains("period_nanos is 1"), "{error}");
    let CommandReply::Refused { error } = ask(
        &mut client,
        Command::Configure {
            mode: None,
            period_nanos: None,
            longest_substep_nanos: Some(1),
        },
    ) else {
        panic!("must be refused")
    };
    assert!(error.contains("longest_substep_nanos is 1"), "{error}");
    step(&mut client, 2);
    assert_eq!(
        ask(
            &mut client,
            Command::Configure {
                mode: None,
                period_nanos: Some(10_000_000),
                longest_substep_nanos: None
            }
        ),
        CommandReply::Done
    );
    let mut snapshots = bus.snapshot_reader().unwrap();
    step(&mut client, 1);
    let snapshot = eventually("snapshot", || {
        snapshots.latest().unwrap().filter(|s| s.header().tick == 3)
    });
    assert_eq!(
        snapshot.header().sim_nanos,
        110_000_000,
        "two ticks of 50 ms and one of 10"
    );
    assert_eq!(
        ask(
            &mut client,
            Command::Configure {
                mode: Some(StepMode::FreeRunning),
                period_nanos: None,
                longest_substep_nanos: None
            }
        ),
        CommandReply::Done
    );
    eventually("it runs by itself", || {
        (counter(&mut client, "ticks") > 10).then_some(())
    });
}

/// A rig that no processor draws a thousand times a second.
const TOO_MUCH: &str = "version = 1
[scenario]
map = \"Town01\"
seed = 1
tick_hz = 1000
[ego]
type_id = \"vehicle.tesla.model3\"
spawn_point = 0
[sensor.front]
kind = \"camera\"
modalities = [\"rgb\", \"flow\"]
rate_hz = 1000
width_px = 1920
height_px = 1080
[sensor.imu]
kind = \"imu\"
rate_hz = 1000
";

/// With `--keep-up` cameras fire less often where real time is not kept: that is said, their numbers
/// have no gaps, flow tells the time that it covers, and other sensors stay as they are.
#[test]
fn who_wants_to_keep_up_gets_fewer_frames_and_is_told() {
    let sandbox = Sandbox::new("keepup");
    let mut daemon = start_daemon(&sandbox, TOO_MUCH, &["--keep-up"]);
    let bus = join_bus(&sandbox, "test");
    let [mut flow, mut imu] = ["ego/front/flow", "ego/imu/imu"].map(|topic| reader(&bus, topic));
    daemon.wait_line("real time is not kept");
    let mut next = || *eventually("a frame", || flow.next().unwrap()).header();
    // Those in flight were begun before.
    let mut before = (0..8).map(|_| next()).last().expect("eight frames");
    for _ in 0..4 {
        let header = next();
        let n_ticks = header.tick - before.tick;
        assert!(n_ticks >= 2 * (header.seq - before.seq), "{n_ticks} ticks");
        if header.seq == before.seq + 1 {
            assert_eq!(header.window_nanos, n_ticks * 1_000_000);
        }
        before = header;
    }
    let header = *eventually("a frame", || imu.next().unwrap()).header();
    assert_eq!(header.seq, header.tick, "one at every tick");
}

/// `gantry bench tick` sees from outside what a process does in a tick, without reading a topic.
#[test]
fn stages_of_a_tick_are_counted_and_seen_from_outside() {
    let sandbox = Sandbox::new("stages");
    let look = |seconds: &str| {
        let words = ["tick", "--profile", "--for", seconds, "--json", "tick.json"];
        let words = [&words[..], &["--domain", sandbox.domain()]].concat();
        sandbox.spawn("gantry-bench", &words).wait()
    };
    let ended = look("1s").expect_code(1);
    assert!(
        ended.says("start one with `gantry up`"),
        "{:?}",
        ended.lines
    );
    let _daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let bus = join_bus(&sandbox, "test");
    let _rgb = reader(&bus, "ego/front/rgb");
    let ended = look("4s").expect_code(0);
    assert!(ended.says("physics"), "{:?}", ended.lines);
    let text = std::fs::read_to_string(sandbox.path("tick.json")).expect("the report was written");
    let report: serde_json::Value = serde_json::from_str(&text).expect("the report is JSON");
    let number = |value: &serde_json::Value| value.as_f64().expect("a number");
    let n_ticks = number(&report["n_ticks"]);
    let processes = report["processes"].as_array().expect("processes");
    let simd = processes.iter().find(|process| process["name"] == "simd");
    let simd = simd.expect("the simulator is there");
    let stages = simd["stages"].as_array().expect("stages");
    let stage = |name: &str| {
        let found = stages.iter().find(|stage| stage["stage"] == name);
        found.unwrap_or_else(|| panic!("no stage {name} in {stages:?}"))
    };
    for name in ["physics", "snapshot", "record"] {
        // The sums are written ten times a second, so the ticks at both ends may be missing.
        let n_spans = number(&stage(name)["spans"]) * n_ticks;
        assert!(
            (n_spans - n_ticks).abs() <= 8.0,
            "{name}: {n_spans} of {n_ticks}"
        );
    }
    let sum: f64 = stages.iter().map(|stage| number(&stage["cpu_ms"])).sum();
    let whole = number(&simd["cpu_ms"]);
    // The kernel counts whole processes in hundredths of a second.
    assert!(
        (sum - whole).abs() * n_ticks <= 300.0,
        "{sum} of {whole} ms"
    );
}
