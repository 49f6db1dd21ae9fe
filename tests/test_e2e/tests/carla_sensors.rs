//! Sensors through the stock CARLA client: what they see, when they send, who may listen.

use test_e2e::carla::{run_script, start_gateway};
use test_e2e::{assert_nothing_left, start_daemon};
use test_kit::Sandbox;

const LAUNCH: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
vehicles = 0
"#;

#[test]
fn sensors_arrive_for_their_frame_and_show_what_is_there() {
    let sandbox = Sandbox::new("carlasensors");
    let daemon = start_daemon(&sandbox, LAUNCH, &[]);
    let (gateway, port, _) = start_gateway(&sandbox);
    let themes = ["every kind", "pictures", "lidars", "motion", "sensor_tick", "listeners", "lanes", "ahead", "boom", "free running"];
    run_script(&sandbox, "carla_sensors.py", &[&port.to_string()], &themes);
    let ended = gateway.stop().expect_code(0);
    assert!(!ended.says("does not take its sensor's messages"), "{:?}", ended.lines);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn the_python_package_reads_the_same_frames_without_a_copy() {
    let sandbox = Sandbox::new("carlaattach");
    let daemon = start_daemon(&sandbox, LAUNCH, &[]);
    let (gateway, port, _) = start_gateway(&sandbox);
    let themes = ["same frames", "without listening", "choice", "sentences"];
    run_script(&sandbox, "carla_attach.py", &[&port.to_string(), sandbox.domain()], &themes);
    gateway.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
