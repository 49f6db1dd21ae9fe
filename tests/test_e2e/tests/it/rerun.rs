//! `gantry-rerun`: recorded runs made again, to the last byte; changed ones, and from which tick
//! they part; runs that go on live; sensors added to old runs; what goes wrong.

use std::path::Path;

use nix::sys::signal::Signal;
use schema_bus::CommandClient;
use schema_frames::command::CheckpointPlace;
use schema_frames::{Command, CommandBatch, CommandReply};
use serde_json::{Value, json};
use test_e2e::carla::{Stage, empty_town, free_port, start_script};
use test_e2e::recording::{gapless, sequences};
use test_e2e::{
    SMALL_RIG, SMALL_RIG_TOPICS, ask, assert_nothing_left, counter, join_bus, spawn_consumer,
    start_daemon,
};
use test_kit::{Ended, PATIENCE, Process, Sandbox, eventually};

/// Everything that fires in every tick or every other one, small; cameras with memory among them.
const RIG: &str = r#"version = 1
[scenario]
map = "Town02"
seed = 3
tick_hz = 20
vehicles = 3
walkers = 4
[sensor.front]
kind = "camera"
modalities = ["rgb", "depth", "semantic", "instance", "flow", "normals", "dvs"]
width_px = 64
height_px = 48
mount.position_m = [0.6, 0.0, 1.6]
[sensor.adapting]
kind = "camera"
modalities = ["rgb"]
width_px = 64
height_px = 48
optics.exposure.mode = "histogram"
mount.position_m = [0.6, 0.0, 1.6]
[sensor.roof]
kind = "lidar"
rate_hz = 10
channels = 8
columns = 90
motion_distortion = true
mount.position_m = [0.0, 0.0, 2.0]
[sensor.labels]
kind = "lidar"
semantic = true
channels = 4
columns = 90
rate_hz = 10
mount.position_m = [0.0, 0.0, 2.0]
[sensor.radar]
kind = "radar"
[sensor.imu]
sensor = "adi/adis16448"
walk_gyro_radps_rts = [1e-4, 1e-4, 1e-4]
bandwidth_accel_hz = 4.0
[sensor.gnss]
kind = "gnss"
rate_hz = 5
datum = "wgs84"
noise_position_stddev_m = [1.0, 1.0]
[sensor.bump]
kind = "collision"
[sensor.lane]
kind = "lane_invasion"
[sensor.ahead]
kind = "obstacle"
"#;

/// A recording that is being made in lockstep, by a daemon that waits for `n` participants.
struct Making {
    daemon: Process,
    recorder: Process,
    client: CommandClient,
}

impl Making {
    fn start(sandbox: &Sandbox, launch: &str, n: usize, more: &[&str]) -> Making {
        let n = n.to_string();
        let data = sandbox.path("data");
        let words = [
            "--unpaced",
            "--await-lockstep",
            &n,
            "--data",
            data.to_str().unwrap(),
        ];
        let daemon = start_daemon(sandbox, launch, &[&words, more].concat());
        let recorder = spawn_consumer(
            sandbox,
            "gantry-record",
            &["--out", "drive.mcap", "--lockstep"],
        );
        let client = join_bus(sandbox, "test").command_client("test").unwrap();
        Making {
            daemon,
            recorder,
            client,
        }
    }

    /// Sends a command; returns the answer and the last tick before it.
    fn at_edge(&mut self, command: Value) -> (CommandReply, u64) {
        let command: Command = serde_json::from_value(command).unwrap();
        let batch = CommandBatch::new(vec![command]);
        let mut answer = self.client.request(&batch, PATIENCE).unwrap();
        let reply = answer.replies.remove(0);
        assert!(!matches!(reply, CommandReply::Refused { .. }), "{reply:?}");
        (reply, answer.tick)
    }

    fn until(&mut self, tick: u64) {
        eventually(&format!("tick {tick}"), || {
            (counter(&mut self.client, "ticks") >= tick).then_some(())
        });
    }

    fn send(&mut self, command: Value) -> CommandReply {
        self.at_edge(command).0
    }

    fn end(self) {
        self.recorder.stop().expect_code(0);
        self.daemon.stop().expect_code(0);
    }
}

fn start_rerun(sandbox: &Sandbox, file: &str, more: &[&str]) -> Process {
    spawn_consumer(sandbox, "gantry-rerun", &[&[file], more].concat())
}

fn rerun(sandbox: &Sandbox, file: &str, more: &[&str]) -> Ended {
    start_rerun(sandbox, file, more).wait()
}

/// The report of a new run, which ends with this exit code.
fn report(sandbox: &Sandbox, file: &str, more: &[&str], code: i32) -> Value {
    let ended = rerun(sandbox, file, &[&["--json"], more].concat()).expect_code(code);
    let line = ended.lines.iter().find(|line| line.starts_with('{'));
    serde_json::from_str(line.expect("a report")).unwrap()
}

/// Asserts that every frame of these topics, and every snapshot, was compared and is equal; returns
/// how many.
fn assert_equal(report: &Value, topics: &[&str]) -> u64 {
    assert_eq!(report["is_equal"], true, "{report:#}");
    let mut n = 0;
    for topic in topics.iter().copied().chain(["world/snapshot"]) {
        let of_topic = &report["topics"][topic];
        let compared = of_topic["compared"].as_u64().unwrap_or(0);
        assert!(compared > 0, "{topic} was not compared: {report:#}");
        assert_eq!(of_topic["equal"], compared, "{topic}");
        n += compared;
    }
    n
}

/// Ticks of the first and last recorded frame of a topic.
fn span_of(sandbox: &Sandbox, topic: &str) -> (u64, u64) {
    let bytes = std::fs::read(sandbox.path("drive.mcap")).unwrap();
    let channel = format!("/{topic}/gantry");
    mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(Result::unwrap)
        .filter(|message| message.channel.topic == channel)
        // Field 1 of gantry.Frame, fixed64.
        .map(|message| u64::from_le_bytes(message.data[1..9].try_into().unwrap()))
        .fold(None, |span: Option<(u64, u64)>, tick| {
            let (first, last) = span.unwrap_or((tick, tick));
            Some((first.min(tick), last.max(tick)))
        })
        .unwrap_or_else(|| panic!("{topic} was not recorded"))
}

fn pose(x: f64, y: f64, z: f64) -> Value {
    json!({"translation_m": [x, y, z], "rotation_xyzw": [0.0, 0.0, 0.09983341664682815, 0.9950041652780258]})
}

#[test]
fn a_drive_with_every_sensor_and_command_comes_again_to_the_last_byte() {
    let sandbox = Sandbox::new("rerun");
    // A map of one's own, which is gone when the run is made again.
    let map = sandbox.path("mine.xodr");
    sandbox
        .spawn("simd", &["--map", "Town01", "--export-map", "mine.xodr"])
        .wait()
        .expect_code(0);
    let mut making = Making::start(&sandbox, RIG, 2, &[]);
    let driver = spawn_consumer(&sandbox, "gantry-drive", &["--lockstep"]);
    making.until(12);
    making.send(json!({"do": "set_weather", "weather": {"precipitation": 71.30000000000001, "sun_altitude_deg": -12.345678901234567}}));
    making.until(20);
    let CommandReply::Spawned { actor_id, .. } = making.send(json!({"do": "spawn",
        "type_id": "vehicle.audi.tt", "pose": pose(0.1, 0.2, 40.0)}))
    else {
        panic!("no car")
    };
    let camera = json!({"do": "spawn_sensor",
        "type_id": "sensor.camera.rgb", "parent_id": actor_id, "pose": pose(-6.0, 0.0, 3.0),
        "spec": {"kind": "camera", "modalities": ["rgb", "dvs"], "width_px": 48, "height_px": 32}});
    let (CommandReply::Spawned { topics, .. }, made) = making.at_edge(camera) else {
        panic!("no camera")
    };
    making.until(34);
    making.send(
        json!({"do": "physics", "actor_id": actor_id, "action": {"act": "add_impulse",
        "impulse_in_world_ns": [1234.5678901234567, -321.1, 900.0]}}),
    );
    making.send(json!({"do": "draw_debug", "shapes": [{"draw": {"line": {"from_m": [0, 0, 0], "to_m": [9, 9, 9],
        "width_m": 0.3}}, "color_rgb": [255, 0, 0], "life_nanos": 400000000}]}));
    making.send(json!({"do": "save_checkpoint", "to": {"name": "here"}}));
    making.send(json!({"do": "save_checkpoint", "to": {"file": "there"}}));
    making.until(44);
    making.send(json!({"do": "restore_checkpoint", "from": {"name": "here"}}));
    making.until(50);
    making.send(
        json!({"do": "configure", "period_nanos": 30000000, "longest_substep_nanos": 5000000}),
    );
    making.until(56);
    ask(
        &mut making.client,
        Command::RestoreCheckpoint {
            from: CheckpointPlace::File("there".into()),
        },
    );
    making.until(62);
    let (_, destroyed) = making.at_edge(json!({"do": "destroy", "actor_id": actor_id}));
    making.until(68);
    making.send(json!({"do": "load_map", "map": map.to_str().unwrap()}));
    making.until(76);
    making.send(json!({"do": "reset"}));
    making.until(84);
    making.recorder.stop().expect_code(0);
    driver.stop().expect_code(0);
    making.daemon.stop().expect_code(0);
    drop(making.client);
    std::fs::remove_file(&map).unwrap();
    std::fs::remove_dir_all(sandbox.path("data")).unwrap();

    let found = report(&sandbox, "drive.mcap", &[], 0);
    for topic in &topics {
        let (first, last) = span_of(&sandbox, topic);
        // The recorder learns of a sensor in its first tick, and has all of its topics before the
        // next one.
        assert!(
            first <= made + 2,
            "{topic} from tick {first} on, made behind {made}"
        );
        // The lockstep holds for a sensor's last frame too, although its publisher goes with it.
        assert_eq!(last, destroyed, "last frame of {topic}");
    }
    let rig: Vec<&str> = [
        "rgb", "depth", "semantic", "instance", "flow", "normals", "dvs",
    ]
    .iter()
    .map(|modality| Box::leak(format!("ego/front/{modality}").into_boxed_str()) as &str)
    .chain([
        "ego/adapting/rgb",
        "ego/roof/lidar",
        "ego/labels/semantic_lidar",
        "ego/radar/radar",
        "ego/imu/imu",
        "ego/gnss/gnss",
    ])
    .chain(topics.iter().map(String::as_str))
    .collect();
    let n = assert_equal(&found, &rig);
    assert!(n > 800, "{n}");
    // Once more, as people see it.
    let text = rerun(&sandbox, "drive.mcap", &[]).expect_code(0);
    assert!(text.says("equal to the last byte"), "{:?}", text.lines);
    assert_nothing_left(&sandbox);
}

/// A short recording of the small rig, and the sandbox that it lies in.
fn short(name: &str, last_tick: u64, act: impl FnOnce(&mut Making)) -> Sandbox {
    let sandbox = Sandbox::new(name);
    let mut making = Making::start(&sandbox, SMALL_RIG, 1, &[]);
    act(&mut making);
    making.until(last_tick);
    making.end();
    sandbox
}

#[test]
fn a_change_is_reported_from_its_tick_on() {
    let sandbox = short("rerun-set", 30, |_| {});
    let rain = "scenario.weather.precipitation=90.0";
    let found = report(&sandbox, "drive.mcap", &["--set", rain], 1);
    assert_eq!(
        found["topics"]["ego/front/rgb"]["first"]["tick"], 1,
        "{found:#}"
    );
    // Rain is seen in colour and felt by nobody.
    for topic in ["world/snapshot", "ego/front/depth", "ego/roof/lidar"] {
        assert!(found["topics"][topic]["first"].is_null(), "{found:#}");
    }
    let command = format!(
        "1s={}",
        json!({"do": "set_weather", "weather": {"precipitation": 90.0}})
    );
    let found = report(&sandbox, "drive.mcap", &["--command", &command], 1);
    assert_eq!(
        found["topics"]["ego/front/rgb"]["first"]["tick"], 21,
        "{found:#}"
    );
    // One more car is seen in the world at once.
    let text = rerun(&sandbox, "drive.mcap", &["--set", "scenario.vehicles=5"]).expect_code(1);
    assert!(
        text.says("the runs part at tick 0") && text.says("world/snapshot"),
        "{:?}",
        text.lines
    );
    let wrong = rerun(&sandbox, "drive.mcap", &["--set", "scenario.vehikles=5"]).expect_code(1);
    assert!(wrong.says("vehikles"), "{:?}", wrong.lines);
    assert_nothing_left(&sandbox);
}

#[test]
fn a_run_is_handed_over_and_lives_on() {
    let sandbox = short("rerun-live", 30, |_| {});
    let mut live = start_rerun(&sandbox, "drive.mcap", &["--until", "1s", "--then", "live"]);
    live.wait_line("the run is yours");
    // It comes first, but on the other stream.
    live.wait_line("ticks 0 to 20");
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let reply = ask(&mut client, Command::SetLampCycle { on: false });
    assert_eq!(reply, CommandReply::Done);
    eventually("ticks beyond the recording", || {
        (counter(&mut client, "ticks") > 35).then_some(())
    });
    live.stop().expect_code(0);
    drop((client, bus));
    assert_nothing_left(&sandbox);
}

#[test]
fn nobody_else_changes_a_run_that_is_made_again() {
    let sandbox = short("rerun-guard", 400, |_| {});
    let mut again = start_rerun(&sandbox, "drive.mcap", &["-v"]);
    again.wait_line("joined lockstep");
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    for command in [
        Command::Reset,
        Command::Step { n: 1 },
        Command::SetLampCycle { on: false },
    ] {
        let CommandReply::Refused { error } = ask(&mut client, command) else {
            panic!("not refused")
        };
        assert!(error.contains("run again from its journal"), "{error}");
    }
    assert!(counter(&mut client, "ticks") < 400, "it is still running");
    drop((client, bus));
    again.wait().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn a_sensor_that_was_not_there_is_added_and_nothing_else_changes() {
    let sandbox = short("rerun-add", 30, |making| {
        making.until(10);
        making.send(
            json!({"do": "spawn", "type_id": "vehicle.audi.tt", "pose": pose(0.0, 0.0, 40.0)}),
        );
    });
    let words = [
        "--sensor",
        "extra={kind=\"lidar\", channels=4, columns=90, rate_hz=20}",
        "--record",
        "more.mcap",
    ];
    assert_equal(
        &report(&sandbox, "drive.mcap", &words, 0),
        &SMALL_RIG_TOPICS,
    );
    let found = sequences(&sandbox.path("more.mcap"));
    let (first, last) = gapless(&found, "/ego/extra/lidar/gantry");
    assert!(first == 1 && last >= 30, "{first} to {last}");
    // The new recording can be run again too, added sensor and all.
    let again = report(&sandbox, "more.mcap", &[], 0);
    assert_equal(
        &again,
        &[&SMALL_RIG_TOPICS[..], &["ego/extra/lidar"]].concat(),
    );
    let taken = rerun(
        &sandbox,
        "drive.mcap",
        &["--sensor", "extra={kind=\"ladar\"}"],
    )
    .expect_code(1);
    assert!(taken.says("ladar"), "{:?}", taken.lines);
    assert_nothing_left(&sandbox);
}

#[test]
fn a_recording_that_began_late_and_free_running_comes_again_too() {
    let sandbox = Sandbox::new("rerun-late");
    let daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut until = |tick: u64| {
        eventually("ticks", || {
            (counter(&mut client, "ticks") >= tick).then_some(())
        });
    };
    until(15);
    let driver = spawn_consumer(&sandbox, "gantry-drive", &[]);
    until(30);
    let recorder = spawn_consumer(&sandbox, "gantry-record", &["--out", "drive.mcap"]);
    eventually("something is recorded", || {
        let part = sandbox.path("drive.mcap.part");
        (std::fs::metadata(part).ok()?.len() > 6_000_000).then_some(())
    });
    // What is lost on the way of a busy machine is no difference.
    let ended = recorder.stop();
    assert!(matches!(ended.code(), 0 | 3), "{:?}", ended.lines);
    driver.stop().expect_code(0);
    daemon.stop().expect_code(0);
    drop((client, bus));
    assert_equal(
        &report(&sandbox, "drive.mcap", &[], 0),
        &["ego/front/rgb", "ego/front/dvs", "ego/imu/imu"],
    );
    assert_nothing_left(&sandbox);
}

#[test]
fn a_drive_of_carla_clients_comes_again_to_the_last_byte() {
    let sandbox = Sandbox::new("rerun-carla");
    // A sensor of its own lets the recorder join the lockstep before the first tick.
    let launch = empty_town("Town02") + "[sensor.imu]\nkind = \"imu\"\n";
    let stage = Stage::with(sandbox, &launch, &["--await-lockstep", "1"]);
    let sandbox = &stage.sandbox;
    let record =
        |out: &str| spawn_consumer(sandbox, "gantry-record", &["--out", out, "--lockstep"]);
    let mut whole = record("whole.mcap");
    whole.wait_line("in lockstep");
    let (port, manager_port) = (stage.port.to_string(), free_port().to_string());
    let middle = sandbox.path("middle");
    let words = [&port, &manager_port, "100", middle.to_str().unwrap()];
    let mut script = start_script(sandbox, "carla_run_again.py", &words);
    script.wait_line("half");
    let mut half = record("half.mcap");
    half.wait_line("in lockstep");
    std::fs::write(&middle, "").unwrap();
    let script = script.wait().expect_code(0);
    assert!(script.says("drive passed"), "{:?}", script.lines);
    half.stop().expect_code(0);
    whole.stop().expect_code(0);
    let sandbox = stage.stop();
    for file in ["whole.mcap", "half.mcap"] {
        let found = report(&sandbox, file, &[], 0);
        let n = assert_equal(&found, &["ego/imu/imu"]);
        let topics = found["topics"].as_object().unwrap();
        let is_compared = |kind: &str| {
            topics.iter().any(|(name, of_topic)| {
                name.starts_with("actor_")
                    && name.ends_with(kind)
                    && of_topic["compared"].as_u64() > Some(10)
            })
        };
        for kind in [
            "/rgb",
            "/dvs",
            "/instance",
            "/lidar",
            "/imu",
            "/gnss",
            "/radar",
        ] {
            assert!(is_compared(kind), "{file}: no {kind} in {found:#}");
        }
        println!("{file}: {n} samples, {} topics", topics.len());
    }
    assert_nothing_left(&sandbox);
}

/// The only child of a process.
fn child_of(process: &Process) -> u32 {
    let pid = process.pid();
    let path = format!("/proc/{pid}/task/{pid}/children");
    eventually("a child", || {
        std::fs::read_to_string(&path)
            .ok()?
            .split_whitespace()
            .next()?
            .parse()
            .ok()
    })
}

#[test]
fn killed_in_the_middle_nothing_is_left() {
    let sandbox = short("rerun-kills", 300, |_| {});
    let mut again = start_rerun(&sandbox, "drive.mcap", &["-v"]);
    again.wait_line("joined lockstep");
    let simulator = child_of(&again);
    let pid = nix::unistd::Pid::from_raw(simulator.cast_signed());
    nix::sys::signal::kill(pid, Signal::SIGKILL).unwrap();
    let ended = again.wait().expect_code(1);
    assert!(ended.says("simd ended after tick"), "{:?}", ended.lines);

    let mut again = start_rerun(&sandbox, "drive.mcap", &["-v"]);
    again.wait_line("joined lockstep");
    again.stop().expect_code(1);

    let mut again = start_rerun(&sandbox, "drive.mcap", &["-v"]);
    again.wait_line("joined lockstep");
    let simulator = child_of(&again);
    again.kill9();
    eventually(
        "the simulator ends with the program that started it",
        || (!Path::new(&format!("/proc/{simulator}")).exists()).then_some(()),
    );
    // What the killed process left is taken back by the next one.
    report(&sandbox, "drive.mcap", &["--until", "0.2s"], 0);
    assert_nothing_left(&sandbox);
}

#[test]
fn what_cannot_be_run_again_says_why() {
    let sandbox = short("rerun-faults", 240, |_| {});
    sandbox.write("empty.mcap", "");
    sandbox.write("foreign.mcap", "no recording at all, only text");
    for (file, why) in [
        ("nowhere.mcap", "nowhere.mcap"),
        ("empty.mcap", "empty"),
        ("foreign.mcap", "foreign.mcap"),
    ] {
        let ended = rerun(&sandbox, file, &[]).expect_code(1);
        assert!(ended.says(why), "{:?}", ended.lines);
    }
    let whole = std::fs::read(sandbox.path("drive.mcap")).unwrap();
    std::fs::write(sandbox.path("cut.mcap"), &whole[..whole.len() * 3 / 4]).unwrap();
    let cut = report(&sandbox, "cut.mcap", &[], 3);
    assert_eq!(cut["is_equal"], true, "{cut:#}");
    assert!(cut["ticks"][1].as_u64() >= Some(10), "{cut:#}");
    let bad = rerun(&sandbox, "drive.mcap", &["--until", "soon"]).expect_code(2);
    assert!(bad.says("it like 12s"), "{:?}", bad.lines);

    // The journal of this run keeps one MiB and is given more.
    let daemon = start_daemon(&sandbox, SMALL_RIG, &["--journal-mb", "1"]);
    let taken = rerun(&sandbox, "drive.mcap", &[]).expect_code(2);
    assert!(taken.says("already has a simulator"), "{:?}", taken.lines);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    // 64 sensors with 32 attributes of 1000 bytes each are two MiB.
    let padding = "x".repeat(1000);
    let attributes: serde_json::Map<_, _> = (0..32)
        .map(|n| (format!("padding{n}"), json!(padding)))
        .collect();
    for _ in 0..64 {
        let spawn = json!({"do": "spawn", "type_id": "sensor.other.v2x", "pose": pose(0.0, 0.0, 1.0),
            "attributes": attributes});
        let spawned = ask(&mut client, serde_json::from_value(spawn).unwrap());
        assert!(
            matches!(spawned, CommandReply::Spawned { .. }),
            "{spawned:?}"
        );
    }
    let mut recorder = spawn_consumer(
        &sandbox,
        "gantry-record",
        &["--out", "late.mcap", "--lockstep"],
    );
    recorder.wait_line("in lockstep");
    let now = counter(&mut client, "ticks");
    eventually("a few ticks", || {
        (counter(&mut client, "ticks") > now + 5).then_some(())
    });
    recorder.stop().expect_code(0);
    drop((client, bus));
    assert!(
        daemon
            .stop()
            .expect_code(0)
            .says("its beginning is forgotten")
    );
    let late = rerun(&sandbox, "late.mcap", &[]).expect_code(1);
    assert!(
        late.says("cannot be run again") && late.says("--journal-mb"),
        "{:?}",
        late.lines
    );
    assert_nothing_left(&sandbox);
}
