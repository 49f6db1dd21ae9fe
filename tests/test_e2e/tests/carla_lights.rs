//! Traffic lights, signs and weather through the stock CARLA client.

use test_e2e::carla::{run_script, start_gateway};
use test_e2e::{assert_nothing_left, start_daemon};
use test_kit::Sandbox;

#[test]
fn lights_switch_by_their_times_and_cars_know_before_which_they_stand() {
    let sandbox = Sandbox::new("carlalights");
    let launch = "version = 1\n[scenario]\nmap = \"Town10HD\"\nseed = 7\ntick_hz = 20\nvehicles = 0\n";
    let daemon = start_daemon(&sandbox, launch, &[]);
    let (gateway, port, _) = start_gateway(&sandbox);
    run_script(&sandbox, "carla_lights.py", &[&port.to_string()], &["times", "states", "boxes", "cars", "signs", "weather"]);
    gateway.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
