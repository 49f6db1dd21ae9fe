//! CARLA's recorder and replayer through the stock client.

use test_e2e::carla::{run_script, start_gateway};
use test_e2e::{assert_nothing_left, start_daemon};
use test_kit::Sandbox;

#[test]
fn drives_are_recorded_told_about_and_replayed() {
    let sandbox = Sandbox::new("carlarec");
    let launch = "version = 1\n[scenario]\nmap = \"Town10HD\"\nseed = 7\ntick_hz = 20\nvehicles = 0\n";
    let daemon = start_daemon(&sandbox, launch, &[]);
    let (gateway, port, _) = start_gateway(&sandbox);
    run_script(&sandbox, "carla_recorder.py", &[&port.to_string()], &["recording", "texts", "replay", "anew"]);
    assert!(sandbox.path("data/recordings/carla/drive.log").exists(), "recordings stay in the data folder");
    gateway.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
