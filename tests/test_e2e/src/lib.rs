//! What the end-to-end tests share: a daemon in a sandbox, and the test itself as a reader on the
//! same private bus.

#![forbid(unsafe_code)]

pub mod carla;
pub mod recording;

use std::path::PathBuf;
use std::time::Duration;

use schema_bus::{Bus, BusOptions, CommandClient, Document, FrameReader};
use schema_frames::{Command, CommandBatch, CommandReply};
use test_kit::{Process, Sandbox, eventually};

/// A small rig with every kind of sensor: pictures of 96×64 keep software rendering cheap.
pub const SMALL_RIG: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
vehicles = 4
[sensor.front]
kind = "camera"
modalities = ["rgb", "depth", "semantic", "instance", "flow", "normals", "dvs"]
rate_hz = 20
width_px = 96
height_px = 64
mount.position_m = [0.6, 0.0, 1.6]
[sensor.roof]
kind = "lidar"
rate_hz = 10
channels = 8
columns = 180
mount.position_m = [0.0, 0.0, 2.0]
[sensor.labels]
kind = "lidar"
semantic = true
rate_hz = 10
channels = 4
columns = 90
mount.position_m = [0.0, 0.0, 2.0]
[sensor.imu]
kind = "imu"
rate_hz = 20
[sensor.gnss]
kind = "gnss"
rate_hz = 10
"#;

/// Topics of [`SMALL_RIG`].
pub const SMALL_RIG_TOPICS: [&str; 11] = [
    "ego/front/rgb",
    "ego/front/depth",
    "ego/front/semantic",
    "ego/front/instance",
    "ego/front/flow",
    "ego/front/normals",
    "ego/front/dvs",
    "ego/roof/lidar",
    "ego/labels/semantic_lidar",
    "ego/imu/imu",
    "ego/gnss/gnss",
];

/// Starts `simd` with a launch text and waits until it is ready.
pub fn start_daemon(sandbox: &Sandbox, launch: &str, extra: &[&str]) -> Process {
    let mut daemon = spawn_daemon(sandbox, launch, extra);
    daemon.wait_line("ready");
    daemon
}

/// Starts `simd` with a launch text.
pub fn spawn_daemon(sandbox: &Sandbox, launch: &str, extra: &[&str]) -> Process {
    let file = sandbox.write("launch.toml", launch);
    let file = file.to_str().expect("sandbox paths are text");
    let mut args = vec!["--launch", file, "--domain", sandbox.domain()];
    args.extend(extra);
    sandbox.spawn("simd", &args)
}

/// Starts one of the consumers on the sandbox's domain.
pub fn spawn_consumer(sandbox: &Sandbox, binary: &str, args: &[&str]) -> Process {
    sandbox.spawn(binary, &[args, &["--domain", sandbox.domain()]].concat())
}

/// Waits until a topic has `n` readers.
pub fn wait_readers(bus: &Bus, topic: &str, n: usize) {
    eventually(&format!("{topic} has {n} readers"), || {
        bus.topics()
            .ok()?
            .iter()
            .find(|found| found.name == topic && found.subscribers >= n)
            .map(drop)
    });
}

/// A program of the repository's own Python environment.
///
/// # Panics
/// With the command that makes the environment, if it is not there.
pub fn venv_program(name: &str) -> PathBuf {
    let program = test_kit::sandbox::repository().join(".venv/bin").join(name);
    assert!(
        program.exists(),
        "{} is missing: run ./gantry test, which makes the Python environment .venv",
        program.display()
    );
    program
}

/// Asserts that nothing of a sandbox is left in shared memory once the dead are cleaned away.
pub fn assert_nothing_left(sandbox: &Sandbox) {
    let bus = join_bus(sandbox, "cleaner");
    bus.clean_dead_nodes();
    drop(bus);
    assert_eq!(sandbox.leftovers(), Vec::<String>::new());
}

/// This process on the sandbox's bus.
pub fn join_bus(sandbox: &Sandbox, name: &str) -> Bus {
    let options = BusOptions {
        iceoryx_root: Some(sandbox.path("iox")),
        prefix: Some(sandbox.prefix().to_owned()),
    };
    Bus::open_with(sandbox.domain(), name, &options).unwrap_or_else(|error| panic!("{error}"))
}

/// A reader of a topic that appears sooner or later.
pub fn reader(bus: &Bus, topic: &str) -> FrameReader {
    eventually(&format!("topic {topic} appears"), || {
        bus.frame_reader(topic).ok()
    })
}

/// The newest revision of a document.
pub fn document(bus: &Bus, name: &str) -> Document {
    let mut reader = eventually(&format!("document {name} appears"), || {
        bus.document_reader(name).ok()
    });
    eventually(&format!("document {name} arrives"), || {
        reader.latest().unwrap_or_else(|error| panic!("{error}"))
    })
}

/// Sends one command and returns its answer.
pub fn ask(client: &mut CommandClient, command: Command) -> CommandReply {
    let answer = client
        .request(&CommandBatch::new(vec![command]), Duration::from_secs(60))
        .unwrap_or_else(|error| panic!("{error}"));
    answer
        .replies
        .into_iter()
        .next()
        .expect("one answer per command")
}

/// Value of one of the daemon's counters.
pub fn counter(client: &mut CommandClient, name: &str) -> u64 {
    match ask(client, Command::Counters) {
        CommandReply::Counters { counters } => *counters
            .get(name)
            .unwrap_or_else(|| panic!("no counter {name:?} in {counters:?}")),
        other => panic!("{other:?}"),
    }
}

/// Cues `n` ticks and waits until they are done.
pub fn step(client: &mut CommandClient, n: u64) -> u64 {
    let CommandReply::Stepping { last_tick } = ask(client, Command::Step { n }) else {
        panic!("step was refused")
    };
    eventually(&format!("tick {last_tick} is done"), || {
        (counter(client, "ticks") >= last_tick).then_some(last_tick)
    })
}
