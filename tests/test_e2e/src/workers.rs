//! Render workers as processes, and frames of two runs compared.

use std::collections::BTreeMap;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use test_kit::programs::spawn_consumer;
use test_kit::{Process, Sandbox};

/// UUIDs of this machine's GPUs, if it has several and all are equal; else nothing.
fn equal_gpus() -> &'static [String] {
    static UUIDS: OnceLock<Vec<String>> = OnceLock::new();
    UUIDS.get_or_init(|| {
        let sandbox = Sandbox::new("w-adapters");
        let listed = spawn_consumer(&sandbox, "simd", &["--adapters", "--json"]).wait();
        let gpus: Vec<serde_json::Value> = listed
            .expect_code(0)
            .lines
            .iter()
            .filter_map(|line| serde_json::from_str(line).ok())
            .filter(|adapter: &serde_json::Value| adapter["software"] == false)
            .collect();
        let is_equal = |gpu: &serde_json::Value| gpu["name"] == gpus[0]["name"];
        if gpus.len() < 2 || !gpus.iter().all(is_equal) {
            return Vec::new();
        }
        let uuids = gpus
            .iter()
            .map(|gpu| gpu["uuid"].as_str().map(str::to_owned));
        uuids.map(|uuid| uuid.expect("simd lists it")).collect()
    })
}

/// Starts a render worker. Where the machine has several equal GPUs, workers take them by turns.
pub fn worker(sandbox: &Sandbox, name: &str) -> Process {
    static STARTED: AtomicUsize = AtomicUsize::new(0);
    let gpus = equal_gpus();
    let mut args = vec!["--name", name];
    if !gpus.is_empty() {
        let gpu = &gpus[STARTED.fetch_add(1, Ordering::Relaxed) % gpus.len()];
        args.extend(["--adapter", gpu]);
    }
    spawn_consumer(sandbox, "gantry-render", &args)
}

/// As [`worker`], and waits until the simulator has it.
pub fn joined_worker(sandbox: &Sandbox, name: &str) -> Process {
    let mut worker = worker(sandbox, name);
    worker.wait_line("joined");
    worker
}

/// Asserts that two runs have the same frames by topic at every tick.
///
/// # Panics
/// With the first topic and tick that differ.
pub fn assert_same<F: PartialEq>(one: &[BTreeMap<String, F>], other: &[BTreeMap<String, F>]) {
    assert_eq!(one.len(), other.len());
    for (tick, (one, other)) in (1..).zip(one.iter().zip(other)) {
        assert!(one.keys().eq(other.keys()), "other topics at tick {tick}");
        for (topic, frame) in one {
            assert!(*frame == other[topic], "{topic} differs at tick {tick}");
        }
    }
}
