//! What the tests and their child processes share: a rig, a daemon, readers on its GPU, and what the
//! results of a tick are.

#![allow(dead_code, reason = "tests and their children use a part each")]

use std::path::{Path, PathBuf};
use std::process::Command;

use consumer_gpu::{Device, FrameOnGpu, GpuTopic};
use schema_bus::Bus;
use test_kit::sandbox::binary_path;
use test_kit::{Process, Sandbox};

/// Every kind of frame that can stay on the GPU, in steps.
pub const RIG: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
mode = "stepped"
vehicles = 4
[sensor.front]
kind = "camera"
modalities = ["rgb", "depth", "semantic", "instance", "flow", "normals", "dvs"]
rate_hz = 20
width_px = 96
height_px = 64
mount.position_m = [0.6, 0.0, 1.6]
[sensor.side]
kind = "camera"
modalities = ["depth"]
rate_hz = 20
width_px = 96
height_px = 64
mount.position_m = [0.0, 0.9, 1.6]
[sensor.roof]
kind = "lidar"
rate_hz = 20
channels = 8
columns = 180
mount.position_m = [0.0, 0.0, 2.0]
[sensor.labels]
kind = "lidar"
semantic = true
rate_hz = 20
channels = 4
columns = 90
mount.position_m = [0.0, 0.0, 2.0]
[sensor.imu]
kind = "imu"
rate_hz = 20
"#;

/// Two cameras of the rig as one frame.
pub const BATCH: &str = r#"[batch.pair]
cameras = ["ego/front", "ego/side"]
modalities = ["depth"]
"#;

/// The topic that is read through CUDA.
pub const DEPTH_TOPIC: &str = "ego/front/depth";

/// The topic that writers on several GPUs take turns to write.
pub const CARD_TOPIC: &str = "ego/card/semantic";

/// The topic of results.
pub const RESULT_TOPIC: &str = "detector/features";

/// The shape of most results.
pub const RESULT_SHAPE: [u32; 3] = [4, 33, 8];

/// The elements of the result of a tick.
pub fn pattern(tick: u64, n: usize) -> Vec<u8> {
    (0..n).map(|i| (i as u64 * 7 + tick * 13) as u8).collect()
}

/// Bytes of a result of this shape.
pub fn n_bytes(shape: &[u32]) -> usize {
    4 * shape.iter().product::<u32>() as usize
}

/// Starts a simulator.
pub fn start(sandbox: &Sandbox, launch: &str, extra: &[&str]) -> Process {
    let file = sandbox.write("launch.toml", launch);
    let file = file.to_str().expect("sandbox paths are text");
    let mut arguments = vec!["--launch", file, "--domain", sandbox.domain()];
    arguments.extend(extra);
    let mut daemon = sandbox.spawn("simd", &arguments);
    daemon.wait_line("ready");
    daemon
}

/// A reader of the mapped memory.
pub fn on_gpu(bus: &Bus, topic: &str) -> GpuTopic {
    let opened = GpuTopic::open(bus, topic, Device::Mapped);
    opened.unwrap_or_else(|error| panic!("{error}"))
}

/// The oldest frame.
pub fn take(topic: &mut GpuTopic, bus: &Bus) -> Option<FrameOnGpu> {
    topic.next(bus).unwrap_or_else(|error| panic!("{error}"))
}

/// Starts the example `gpu_child` as a process with this role.
pub fn child(sandbox: &Sandbox, role: &str, env: &[(&str, &str)]) -> Process {
    let place = format!(
        "{}|{}|{}",
        sandbox.iceoryx_root().display(),
        sandbox.prefix(),
        sandbox.domain()
    );
    let env = [env, &[("GPU_CHILD", place.as_str())]].concat();
    let program = binary_path("examples/gpu_child");
    sandbox.spawn_program(role, &program, &[role], &env)
}

/// Builds the driver for tests in the sandbox; returns its folder.
pub fn fake_driver(sandbox: &Sandbox) -> PathBuf {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fake_cuda/fake_cuda.c");
    let folder = sandbox.path("fake");
    std::fs::create_dir_all(&folder).expect("the sandbox is this test's own");
    let built = Command::new("cc")
        .args(["-shared", "-fPIC", "-O1", "-o"])
        .arg(folder.join("libcuda.so"))
        .arg(source)
        .status()
        .expect("the C compiler that links Rust programs");
    assert!(built.success());
    folder
}

/// The bus of the parent, in a child.
pub fn parents_bus() -> Bus {
    let place = std::env::var("GPU_CHILD").expect("the parent says where its bus is");
    let parts: Vec<&str> = place.split('|').collect();
    let options = schema_bus::BusOptions {
        iceoryx_root: Some(PathBuf::from(parts[0])),
        prefix: Some(parts[1].to_owned()),
    };
    let bus = Bus::open_with(parts[2], "child", &options);
    bus.unwrap_or_else(|error| panic!("{error}"))
}
