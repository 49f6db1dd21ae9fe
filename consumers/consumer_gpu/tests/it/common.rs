//! What the tests and their child processes share: a rig, a daemon, readers on its GPU, and what the
//! results of a tick are.

#![allow(dead_code, reason = "tests and their children use a part each")]

use std::path::{Path, PathBuf};
use std::process::Command;

use consumer_gpu::{Device, FrameOnGpu, GpuTopic};
use schema_bus::Bus;
use test_kit::sandbox::binary_path;
use test_kit::small_rig::SMALL_RIG;
use test_kit::{Process, Sandbox};

/// A second camera beside the small rig's.
const SIDE: &str = r#"[sensor.side]
kind = "camera"
modalities = ["depth"]
rate_hz = 20
width_px = 96
height_px = 64
mount.position_m = [0.0, 0.9, 1.6]
"#;

/// The small rig in steps, with a second camera and every sensor firing at every tick: every kind of
/// frame that can stay on the GPU.
pub fn gpu_rig() -> String {
    let every_tick = SMALL_RIG.replace("rate_hz = 10", "rate_hz = 20");
    let stepped = every_tick.replace("tick_hz = 20", "tick_hz = 20\nmode = \"stepped\"");
    format!("{stepped}{SIDE}")
}

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
