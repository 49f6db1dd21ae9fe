//! Render workers: the same bytes whoever renders, and no tick lost when one comes, goes, stops or
//! is killed.

use std::collections::BTreeMap;

use nix::sys::signal::Signal;
use schema_bus::{Bus, CommandClient, FrameReader, names};
use schema_frames::document::SpawnPoints;
use schema_frames::{Command, CommandReply, FrameHeader};
use schema_types::Pose;
use test_e2e::workers::{assert_same, joined_worker, worker};
use test_e2e::{
    SMALL_RIG, SMALL_RIG_TOPICS, ask, assert_nothing_left, counter, document, join_bus, reader,
    spawn_consumer, start_daemon,
};
use test_kit::client::{cue, join_lockstep, wait_workers};
use test_kit::{Process, Sandbox, eventually};

/// Cameras of several places, sizes and memories beside the small rig.
const MORE_CAMERAS: &str = r#"
[sensor.left]
kind = "camera"
modalities = ["rgb", "depth", "dvs"]
rate_hz = 20
width_px = 64
height_px = 48
optics.exposure.mode = "histogram"
mount.position_m = [0.6, 0.5, 1.6]
mount.rpy_deg = [0.0, 0.0, 60.0]
[sensor.right]
kind = "camera"
modalities = ["rgb", "instance", "flow"]
rate_hz = 10
width_px = 80
height_px = 48
mount.position_m = [0.6, -0.5, 1.6]
mount.rpy_deg = [0.0, 0.0, -60.0]
[sensor.rear]
kind = "camera"
modalities = ["rgb", "semantic"]
rate_hz = 20
width_px = 64
height_px = 64
mount.position_m = [-1.5, 0.0, 1.6]
mount.rpy_deg = [0.0, 0.0, 180.0]
[sensor.sweep]
kind = "lidar"
scan = "sweep"
rate_hz = 20
rotation_hz = 7
channels = 8
points_per_second = 20000
motion_distortion = true
mount.position_m = [0.0, 0.3, 2.0]
[sensor.turning]
kind = "lidar"
semantic = true
rate_hz = 10
channels = 8
columns = 120
motion_distortion = true
mount.position_m = [0.0, 0.3, 2.0]
"#;

const MORE_TOPICS: [&str; 10] = [
    "ego/sweep/lidar",
    "ego/turning/semantic_lidar",
    "ego/left/rgb",
    "ego/left/depth",
    "ego/left/dvs",
    "ego/right/rgb",
    "ego/right/instance",
    "ego/right/flow",
    "ego/rear/rgb",
    "ego/rear/semantic",
];

/// Workers cast lidars on the processor, so the simulator does, too: a GPU rounds otherwise.
fn rig() -> String {
    format!("{SMALL_RIG}{MORE_CAMERAS}")
        .replace("tick_hz = 20", "tick_hz = 20\nlidars_on = \"cpu\"")
}

fn stepped() -> String {
    rig().replace("tick_hz = 20", "tick_hz = 20\nmode = \"stepped\"")
}

fn topics() -> impl Iterator<Item = &'static str> {
    SMALL_RIG_TOPICS.into_iter().chain(MORE_TOPICS)
}

fn readers(bus: &Bus) -> Vec<FrameReader> {
    topics().map(|topic| reader(bus, topic)).collect()
}

/// Whether a topic of the rig has a frame at a tick.
fn is_due(topic: &str, tick: u64) -> bool {
    let is_slow = ["roof", "labels", "gnss", "right", "turning"];
    let every = if is_slow.iter().any(|part| topic.contains(part)) {
        2
    } else {
        1
    };
    (tick - 1).is_multiple_of(every)
}

/// What the frames of a tick are: their hashed header bytes and payloads, by topic.
type Frames = BTreeMap<String, (Vec<u8>, Vec<u8>, bool)>;

fn frames_of(readers: &mut [FrameReader], tick: u64) -> Frames {
    let mut frames = Frames::new();
    for reader in readers {
        let topic = reader.topic().to_owned();
        if !is_due(&topic, tick) {
            continue;
        }
        let frame = eventually(&format!("{topic} at tick {tick}"), || {
            reader.next().unwrap()
        });
        let header = frame.header();
        assert_eq!(header.tick, tick, "{topic}");
        let is_first = header.flags & FrameHeader::FIRST != 0;
        let bytes = (header.hashed_bytes().to_vec(), frame.to_vec(), is_first);
        frames.insert(topic, bytes);
    }
    frames
}

/// Frames of the first ticks of a run, with what happens before some of them.
fn run(
    name: &str,
    n_workers: usize,
    args: &[&str],
    n_ticks: u64,
    mut before: impl FnMut(u64, &mut CommandClient),
) -> Vec<Frames> {
    let sandbox = Sandbox::new(name);
    let n = n_workers.to_string();
    let args = [&["--await-workers", &n], args].concat();
    let daemon = start_daemon(&sandbox, &stepped(), &args);
    let workers: Vec<Process> = (0..n_workers)
        .map(|idx| worker(&sandbox, &format!("w{idx}")))
        .collect();
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut readers = readers(&bus);
    let mut ticks = Vec::new();
    for tick in 1..=n_ticks {
        before(tick, &mut client);
        assert_eq!(cue(&mut client), tick);
        ticks.push(frames_of(&mut readers, tick));
    }
    let by_workers = counter(&mut client, "sent_by_workers");
    assert_eq!(by_workers > 0, n_workers > 0);
    drop((readers, client, bus));
    for worker in workers {
        worker.stop().expect_code(0);
    }
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
    ticks
}

/// Cars that drive off, scenery hidden, weather, debug shapes, another map: all of it reaches workers.
fn changes(tick: u64, client: &mut CommandClient) {
    let mut must = |text: &str| {
        let command: Command = serde_json::from_str(text).unwrap();
        let answer = ask(client, command);
        assert!(
            !matches!(answer, CommandReply::Refused { .. }),
            "{text}: {answer:?}"
        );
    };
    match tick {
        // Refused for all that is no vehicle.
        2 => (1..400).for_each(|actor_id| {
            let velocity_in_world_mps = [8.0, 6.0, 0.0];
            ask(
                client,
                Command::SetVelocity {
                    actor_id,
                    velocity_in_world_mps,
                },
            );
        }),
        3 => must(r#"{"do":"show_layers","layers":1,"shown":false}"#),
        4 => must(
            r#"{"do":"draw_debug","shapes":[{"draw":{"line":{"from_m":[0,0,0],"to_m":[50,50,5],"width_m":1.0}},"color_rgb":[255,0,0],"life_nanos":null}]}"#,
        ),
        5 => {
            must(r#"{"do":"set_weather","weather":{"cloudiness":80.5,"fog_density":33.3}}"#);
            must(r#"{"do":"show_layers","layers":1,"shown":true}"#);
        }
        7 => must(r#"{"do":"load_map","map":"Town02"}"#),
        _ => {}
    }
}

#[test]
fn bytes_do_not_depend_on_who_renders() {
    let alone = run("w-alone", 0, &[], 6, |_, _| {});
    assert_same(&alone, &run("w-one", 1, &["--no-gpu"], 6, |_, _| {}));
    assert_same(&alone, &run("w-two", 2, &["--no-gpu"], 6, |_, _| {}));
    assert_same(&alone, &run("w-gpu", 2, &[], 6, |_, _| {}));
}

#[test]
fn a_killed_worker_costs_no_tick() {
    let sandbox = Sandbox::new("w-kill");
    let daemon = start_daemon(&sandbox, &stepped(), &["--no-gpu", "--await-workers", "2"]);
    let (one, two) = (worker(&sandbox, "one"), worker(&sandbox, "two"));
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut readers = readers(&bus);
    for tick in 1..=3 {
        cue(&mut client);
        frames_of(&mut readers, tick);
    }
    // In the middle of a tick, as likely as not.
    cue(&mut client);
    one.kill9();
    frames_of(&mut readers, 4);
    for tick in 5..=6 {
        cue(&mut client);
        frames_of(&mut readers, tick);
    }
    assert_eq!(counter(&mut client, "render_workers"), 1);
    // One that comes gets a share of what the other has.
    let three = joined_worker(&sandbox, "three");
    wait_workers(&mut client, 2);
    for tick in 7..=9 {
        cue(&mut client);
        frames_of(&mut readers, tick);
    }
    two.kill9();
    for tick in 10..=11 {
        cue(&mut client);
        frames_of(&mut readers, tick);
    }
    drop((readers, client, bus));
    three.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn the_simulator_s_own_gpu_takes_over_and_gives_away() {
    let sandbox = Sandbox::new("w-own");
    let daemon = start_daemon(&sandbox, &stepped(), &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut readers = readers(&bus);
    let go_on = |client: &mut CommandClient, readers: &mut [FrameReader], ticks| {
        for tick in ticks {
            assert_eq!(cue(client), tick);
            frames_of(readers, tick);
        }
    };
    go_on(&mut client, &mut readers, 1..=2);
    assert_eq!(counter(&mut client, "sent_by_workers"), 0);
    let one = joined_worker(&sandbox, "one");
    wait_workers(&mut client, 1);
    go_on(&mut client, &mut readers, 3..=4);
    eventually("frames of the worker", || {
        (counter(&mut client, "sent_by_workers") > 0).then_some(())
    });
    cue(&mut client);
    one.kill9();
    frames_of(&mut readers, 5);
    go_on(&mut client, &mut readers, 6..=8);
    drop((readers, client, bus));
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

/// A reader finds a writing port only while that is open, so what a port sent whose first and last
/// frame lie between two looks of a reader would never reach it.
#[test]
fn a_frame_stays_for_its_reader_when_its_camera_moves_in_the_same_tick() {
    let sandbox = Sandbox::new("w-again");
    let daemon = start_daemon(&sandbox, &stepped(), &[]);
    let one = joined_worker(&sandbox, "one");
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut readers = readers(&bus);
    wait_workers(&mut client, 1);
    for tick in 1..=3 {
        cue(&mut client);
        frames_of(&mut readers, tick);
    }
    // The worker ends before it has begun the tick, so the simulator makes the frames.
    one.signal(Signal::SIGSTOP);
    cue(&mut client);
    one.kill9();
    let two = joined_worker(&sandbox, "two");
    wait_workers(&mut client, 1);
    frames_of(&mut readers, 4);
    // The next worker gets its share all the same.
    let n_sent = counter(&mut client, "sent_by_workers");
    for tick in 5..=6 {
        cue(&mut client);
        frames_of(&mut readers, tick);
    }
    assert!(counter(&mut client, "sent_by_workers") > n_sent);
    drop((readers, client, bus));
    two.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn frames_that_a_worker_sent_before_its_end_reach_readers_that_had_none_of_it() {
    for ends_by in [Signal::SIGKILL, Signal::SIGTERM] {
        let sandbox = Sandbox::new("w-first");
        let daemon = start_daemon(&sandbox, &stepped(), &[]);
        let bus = join_bus(&sandbox, "test");
        let mut client = bus.command_client("test").unwrap();
        let mut readers = readers(&bus);
        for tick in 1..=2 {
            cue(&mut client);
            frames_of(&mut readers, tick);
        }
        let mut one = joined_worker(&sandbox, "one");
        wait_workers(&mut client, 1);
        cue(&mut client);
        // The answer comes after all frames of the tick.
        eventually("frames of the worker", || {
            (counter(&mut client, "sent_by_workers") > 0).then_some(())
        });
        one.signal(ends_by);
        eventually("the worker ends", || (!one.is_running()).then_some(()));
        wait_workers(&mut client, 0);
        for tick in 3..=4 {
            frames_of(&mut readers, tick);
            cue(&mut client);
        }
        drop((readers, client, bus));
        daemon.stop().expect_code(0);
        assert_nothing_left(&sandbox);
    }
}

#[test]
fn a_worker_that_ends_after_another_map_was_loaded_costs_no_tick() {
    let sandbox = Sandbox::new("w-map");
    let daemon = start_daemon(&sandbox, &stepped(), &[]);
    let one = joined_worker(&sandbox, "one");
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut readers = readers(&bus);
    wait_workers(&mut client, 1);
    for tick in 1..=2 {
        cue(&mut client);
        frames_of(&mut readers, tick);
    }
    assert!(counter(&mut client, "sent_by_workers") > 0);
    let map = "Town02".to_owned();
    assert_eq!(
        ask(&mut client, Command::LoadMap { map }),
        CommandReply::Done
    );
    one.kill9();
    wait_workers(&mut client, 0);
    // Sensors begin anew with the map, at its first tick.
    cue(&mut client);
    for reader in &mut readers {
        let topic = reader.topic().to_owned();
        let frame = eventually(&topic, || reader.next().unwrap());
        assert_eq!(frame.header().tick, 3, "{topic}");
    }
    drop((readers, client, bus));
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn what_commands_change_is_seen_by_workers_too() {
    let args: [&[&str]; 2] = [&[], &["--no-gpu"]];
    let runs = [0, 2].map(|n| run("w-change", n, args[n.min(1)], 8, changes));
    assert_same(&runs[0], &runs[1]);
}

/// In lockstep, a tick begins when all frames of the last one are there, and a killed worker holds
/// up nobody.
#[test]
fn lockstep_goes_on_without_a_killed_worker() {
    let sandbox = Sandbox::new("w-lockstep");
    let args = ["--no-gpu", "--await-workers", "2", "--await-lockstep", "1"];
    let daemon = start_daemon(&sandbox, &rig(), &args);
    let (one, two) = (worker(&sandbox, "one"), worker(&sandbox, "two"));
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut readers = readers(&bus);
    let acks = bus.ack_writer("reader").unwrap();
    let participant = join_lockstep(&mut client, "reader");
    let mut one = Some(one);
    for tick in 1..=8 {
        if tick == 4 {
            one.take().expect("killed once").kill9();
        }
        let frames = frames_of(&mut readers, tick);
        assert!(!frames.is_empty());
        let epoch = readers[0].epoch().expect("a frame came");
        assert!(
            readers
                .iter_mut()
                .all(|reader| reader.next().unwrap().is_none())
        );
        acks.send(participant, epoch, tick).unwrap();
    }
    ask(&mut client, Command::LeaveLockstep { participant });
    drop((readers, acks, client, bus));
    two.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

/// A stopped worker holds up a world that runs freely for a second, not for ever; it gets a share
/// again when it goes on.
#[test]
fn a_world_that_runs_freely_goes_on_without_a_stopped_worker() {
    let sandbox = Sandbox::new("w-stop");
    let mut daemon = start_daemon(&sandbox, &rig(), &["--no-gpu", "--await-workers", "2"]);
    let (one, two) = (worker(&sandbox, "one"), worker(&sandbox, "two"));
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut readers = readers(&bus);
    let mut see_all = |what: &str| {
        for reader in &mut readers {
            let topic = reader.topic().to_owned();
            while reader.next().unwrap().is_some() {}
            for _ in 0..3 {
                eventually(&format!("{topic} {what}"), || reader.next().unwrap());
            }
        }
    };
    see_all("at first");
    one.signal(Signal::SIGSTOP);
    daemon.wait_line("has not answered");
    see_all("without a stopped worker");
    assert_eq!(counter(&mut client, "render_workers"), 1);
    one.signal(Signal::SIGCONT);
    wait_workers(&mut client, 2);
    see_all("with both again");
    drop((readers, client, bus));
    for worker in [one, two] {
        worker.stop().expect_code(0);
    }
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn a_worker_follows_the_next_simulator() {
    let sandbox = Sandbox::new("w-next");
    let daemon = start_daemon(&sandbox, &stepped(), &["--no-gpu", "--await-workers", "1"]);
    let mut one = worker(&sandbox, "one");
    let bus = join_bus(&sandbox, "test");
    let mut camera = reader(&bus, "ego/front/rgb");
    {
        let mut client = bus.command_client("test").unwrap();
        cue(&mut client);
        eventually("a frame", || camera.next().unwrap());
        cue(&mut client);
    }
    daemon.kill9();
    one.wait_line("waiting for the next one");
    let daemon = start_daemon(&sandbox, &stepped(), &["--no-gpu", "--await-workers", "1"]);
    let mut client = bus.command_client("again").unwrap();
    cue(&mut client);
    eventually("a frame of the next simulator", || {
        camera
            .next()
            .unwrap()
            .filter(|frame| frame.header().tick == 1)
    });
    drop((camera, client, bus));
    daemon.stop().expect_code(0);
    one.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn without_gpu_and_worker_only_cameras_are_without_frames() {
    let sandbox = Sandbox::new("w-none");
    let mut daemon = start_daemon(&sandbox, &stepped(), &["--no-gpu"]);
    daemon.wait_line("the cameras have no frames");
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut camera = reader(&bus, "ego/front/depth");
    let [mut lidar, mut imu] = ["ego/roof/lidar", "ego/imu/imu"].map(|topic| reader(&bus, topic));
    for tick in 1..=3 {
        cue(&mut client);
        let frame = eventually("motion", || imu.next().unwrap());
        assert_eq!(frame.header().tick, tick);
    }
    eventually("a lidar on the processor", || lidar.next().unwrap());
    assert!(camera.next().unwrap().is_none());
    let one = joined_worker(&sandbox, "one");
    wait_workers(&mut client, 1);
    cue(&mut client);
    let frame = eventually("an image", || camera.next().unwrap());
    assert_eq!((frame.header().tick, frame.header().seq), (4, 4));
    drop(frame);
    drop((camera, lidar, imu, client, bus));
    // A worker that goes first is lacking again.
    let ended = daemon.stop().expect_code(0);
    one.stop().expect_code(0);
    let n_said = ended
        .lines
        .iter()
        .filter(|line| line.contains("the cameras have no frames"));
    assert_eq!(n_said.count(), 1);
    assert_nothing_left(&sandbox);
}

/// Without a GPU in the simulator the spectator is a worker's too, also while the world stands still.
#[test]
fn a_worker_renders_the_spectator_and_what_is_spawned() {
    let sandbox = Sandbox::new("w-look");
    let daemon = start_daemon(&sandbox, &stepped(), &["--no-gpu", "--await-workers", "1"]);
    let one = worker(&sandbox, "one");
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut spectator = reader(&bus, "spectator/rgb");
    cue(&mut client);
    let frame = eventually("the spectator", || spectator.next().unwrap());
    let (seq, actor_id) = (frame.header().seq, frame.header().sensor_id);
    drop(frame);
    let pose = Pose::from_xyz_yaw(3.0, 4.0, 30.0, 0.5);
    let moved = Command::SetPose {
        actor_id,
        pose: pose.into(),
    };
    assert_eq!(ask(&mut client, moved), CommandReply::Done);
    let frame = eventually("the spectator once more", || spectator.next().unwrap());
    assert_eq!((frame.header().tick, frame.header().seq), (1, seq + 1));
    // A request's long numbers may be read to within a rounding.
    let at_m = frame.header().world_from_sensor.translation_m;
    assert_eq!(at_m, pose.translation_m);
    drop(frame);

    let wish = Command::SpawnSensor {
        type_id: "sensor.camera.depth".into(),
        pose: Pose::from_xyz_yaw(0.0, 0.0, 5.0, 0.0).into(),
        parent_id: None,
        attachment: Default::default(),
        interval_nanos: 0,
        spec: serde_json::from_str(
            r#"{"kind":"camera","width_px":64,"height_px":48,"modalities":["depth"]}"#,
        )
        .unwrap(),
        attributes: Default::default(),
    };
    let CommandReply::Spawned { actor_id, topics } = ask(&mut client, wish) else {
        panic!("a camera is refused")
    };
    let mut depth = reader(&bus, &topics[0]);
    for n in 1..=3 {
        let tick = cue(&mut client);
        let frame = eventually("the spawned camera", || depth.next().unwrap());
        assert_eq!((frame.header().tick, frame.header().seq), (tick, n));
    }
    assert_eq!(
        ask(&mut client, Command::Destroy { actor_id }),
        CommandReply::Done
    );
    cue(&mut client);
    assert!(depth.next().unwrap().is_none());
    drop((depth, spectator, client, bus));
    one.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn what_cannot_be_is_refused_with_a_sentence() {
    let sandbox = Sandbox::new("w-bad");
    let refused = |program: &str, args: &[&str], sentence: &str| {
        let ended = spawn_consumer(&sandbox, program, args)
            .wait()
            .expect_code(2);
        assert!(ended.says(sentence), "{args:?}: {:?}", ended.lines);
    };
    refused("gantry-render", &["--weight", "0"], "is no weight");
    refused("simd", &["--no-gpu", "--hash"], "cannot be used with");
    refused("simd", &["--no-gpu", "--lidars-on", "gpu"], "say cpu");
    let daemon = start_daemon(&sandbox, &stepped(), &["--no-gpu"]);
    let one = joined_worker(&sandbox, "one");
    refused("gantry-render", &["--name", "one"], "has joined under it");
    refused("gantry-render", &["--name", ""], "1 to 64 characters");
    one.stop().expect_code(0);
    daemon.stop().expect_code(0);
    let daemon = start_daemon(&sandbox, &stepped(), &["--hash"]);
    refused("gantry-render", &[], "--hash");
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

/// A rig on the largest town that the repository lays out: 8 km by 8 km.
const LARGE: &str = r#"version = 1
[scenario]
map = "Town13"
seed = 3
tick_hz = 20
lidars_on = "cpu"
mode = "stepped"
[sensor.front]
kind = "camera"
modalities = ["rgb", "depth", "instance"]
rate_hz = 20
width_px = 96
height_px = 64
mount.position_m = [0.6, 0.0, 1.6]
[sensor.rear]
kind = "camera"
modalities = ["semantic"]
rate_hz = 20
width_px = 96
height_px = 64
mount.position_m = [-1.5, 0.0, 1.6]
mount.rpy_deg = [0.0, 0.0, 180.0]
[sensor.roof]
kind = "lidar"
rate_hz = 20
channels = 8
columns = 180
mount.position_m = [0.0, 0.0, 2.0]
"#;

const LARGE_TOPICS: [&str; 5] = [
    "ego/front/rgb",
    "ego/front/depth",
    "ego/front/instance",
    "ego/rear/semantic",
    "ego/roof/lidar",
];

/// Places on roads from one side of a map to the other, about `apart_m` from each other.
fn across(points: &[Pose], apart_m: f64) -> Vec<Pose> {
    let x_of = |pose: &Pose| pose.translation_m[0];
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| x_of(a).total_cmp(&x_of(b)));
    let mut places: Vec<Pose> = Vec::new();
    for pose in sorted {
        if places
            .last()
            .is_none_or(|last| x_of(&pose) - x_of(last) >= apart_m)
        {
            places.push(pose);
        }
    }
    places
}

/// Frames of a way across the large town, a tick at each place; and, of the worker if there is one,
/// how many meshes it had at each change of the scenery.
fn way_across(name: &str, n_workers: usize) -> (Vec<Frames>, Vec<u64>) {
    let sandbox = Sandbox::new(name);
    let n = n_workers.to_string();
    let alone: &[&str] = &["--await-workers", &n];
    let args = if n_workers > 0 {
        [alone, &["--no-gpu"]].concat()
    } else {
        alone.to_vec()
    };
    let daemon = start_daemon(&sandbox, LARGE, &args);
    let mut render = (n_workers > 0)
        .then(|| spawn_consumer(&sandbox, "gantry-render", &["--name", "far", "-v"]));
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let points: SpawnPoints = document(&bus, names::WORLD_SPAWN_POINTS).json().unwrap();
    let points: Vec<Pose> = points.points.into_iter().map(Pose::from).collect();
    let places = across(&points, 300.0);
    let way_m = places.last().unwrap().translation_m[0] - places[0].translation_m[0];
    assert!(way_m > 6000.0, "{way_m}");
    let mut readers: Vec<FrameReader> = LARGE_TOPICS.map(|topic| reader(&bus, topic)).into();
    let (mut ticks, mut ego) = (Vec::new(), None);
    for (tick, pose) in (1..).zip(&places) {
        if let Some(actor_id) = ego {
            let moved = Command::SetPose {
                actor_id,
                pose: (*pose).into(),
            };
            assert_eq!(ask(&mut client, moved), CommandReply::Done);
        }
        assert_eq!(cue(&mut client), tick);
        let mut frames = Frames::new();
        for reader in &mut readers {
            let topic = reader.topic().to_owned();
            let frame = eventually(&format!("{topic} at tick {tick}"), || {
                reader.next().unwrap()
            });
            assert_eq!(frame.header().tick, tick, "{topic}");
            ego = Some(frame.header().parent_id);
            frames.insert(
                topic,
                (
                    frame.header().hashed_bytes().to_vec(),
                    frame.to_vec(),
                    false,
                ),
            );
        }
        ticks.push(frames);
    }
    drop((readers, client, bus));
    let lines = render
        .take()
        .map(|worker| worker.stop().expect_code(0).lines);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
    let count = |line: &String| {
        let (_, rest) = line.split_once("meshes=")?;
        rest.split(|c: char| !c.is_ascii_digit())
            .next()?
            .parse()
            .ok()
    };
    let counts = lines
        .iter()
        .flatten()
        .filter(|line| line.contains("other scenery"));
    (ticks, counts.filter_map(count).collect())
}

/// Tiles of the scenery arrive at a worker and go, and its frames are those of a simulator alone.
#[test]
fn a_worker_follows_the_scenery_of_a_large_town() {
    let (alone, _) = way_across("w-far-alone", 0);
    let (by_worker, counts) = way_across("w-far", 1);
    assert_same(&alone, &by_worker);
    let n = |is_it: fn(&[u64]) -> bool| counts.windows(2).filter(|pair| is_it(pair)).count();
    let (more, fewer) = (n(|pair| pair[1] > pair[0]), n(|pair| pair[1] < pair[0]));
    println!("{} places, meshes: {counts:?}", alone.len());
    assert!(more >= 3 && fewer >= 3, "{counts:?}");
}
