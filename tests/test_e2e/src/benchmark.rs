//! A small suite of the perception benchmark, programs for it that go wrong on purpose, and its
//! report.

use std::time::Duration;

use serde_json::Value;
use test_kit::sandbox::repository;
use test_kit::{Process, Sandbox};

use crate::{python_package, venv_program};

/// A benchmark takes a minute here; only a hang reaches this.
pub const BENCH_LIMIT: Duration = Duration::from_secs(1800);

/// Half a second of warm-up and `secs` of an empty street, with ten images a second; a program has
/// `answer_within_s` for each.
pub fn street(secs: f64, answer_within_s: u32) -> String {
    format!(
        r#"version = 1
settle_s = 0.2
warm_up_s = 0.5
secs = {secs:?}
tick_hz = 20
answer_within_s = {answer_within_s}
ready_within_s = 600
[matrix]
maps = ["Town01"]
densities = ["empty"]
[rig.car.sensor.front]
kind = "camera"
rate_hz = 10
width_px = 64
height_px = 48
mount.position_m = [0.6, 0.0, 1.6]
[[task]]
kind = "boxes2d"
sensor = "front"
"#
    )
}

/// A table of the suite with a fake program that behaves as `words` say.
pub fn fake_program(name: &str, words: &[&str], more: &str) -> String {
    let script = repository().join("tests/test_e2e/python/perception_fake.py");
    let words: String = words.iter().map(|word| format!(", {word:?}")).collect();
    format!(
        "[program.{name}]\ncmd = [{:?}, {:?}{words}]\n{more}\nenv = {{ PYTHONPATH = {:?}, PYTHONDONTWRITEBYTECODE = \"1\" }}\n",
        venv_program("python"),
        script,
        python_package(),
    )
}

/// Starts the benchmark with a suite.
pub fn start_bench(sandbox: &Sandbox, suite: &str, words: &[&str]) -> Process {
    sandbox.write("suite.toml", suite);
    let all = [&["perception", "suite.toml", "--cache", "cache"], words].concat();
    sandbox.spawn("gantry-bench", &all)
}

/// The report in a folder.
///
/// # Panics
/// If there is none.
pub fn bench_report(sandbox: &Sandbox, out: &str) -> Value {
    let path = sandbox.path(out).join("report.json");
    let text = std::fs::read_to_string(&path).expect("a report");
    serde_json::from_str(&text).expect("JSON")
}
