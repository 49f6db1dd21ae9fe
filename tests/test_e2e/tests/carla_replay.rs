//! What a replay does with the world, through the stock client.

use test_e2e::carla::{Stage, empty_town, run_script, start_gateway};
use test_e2e::{assert_nothing_left, start_daemon};
use test_kit::Sandbox;

#[test]
fn replays_hold_vehicles_make_sensors_and_give_everything_back() {
    let sandbox = Sandbox::new("carlareplay");
    let launch =
        "version = 1\n[scenario]\nmap = \"Town10HD\"\nseed = 7\ntick_hz = 20\nvehicles = 0\n";
    let daemon = start_daemon(&sandbox, launch, &[]);
    let (gateway, port, _) = start_gateway(&sandbox);
    run_script(
        &sandbox,
        "carla_replay.py",
        &[&port.to_string()],
        &["text", "ignored", "sensors", "kept", "names"],
    );
    gateway.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn doors_weather_street_lights_physics_and_bones_are_recorded_and_replayed() {
    let stage = Stage::new("carlachanges", &empty_town("Town02"));
    stage.run(
        "carla_recorder_changes.py",
        &[],
        &["changes", "changes replayed"],
    );
    stage.end();
}

#[test]
fn recordings_in_carlas_own_format_are_told_about_and_replayed() {
    let stage = Stage::new("carlalog", &empty_town("Town10HD"));
    stage.run("carla_log.py", &[], &["texts", "replay", "part", "damaged"]);
    stage.end();
}
