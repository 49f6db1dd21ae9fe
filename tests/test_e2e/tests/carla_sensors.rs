//! Sensors through the stock CARLA client: what they see, when they send, who may listen.

use test_e2e::carla::{Stage, empty_town};

#[test]
fn sensors_arrive_for_their_frame_and_show_what_is_there() {
    let stage = Stage::new("carlasensors", &empty_town("Town10HD"));
    let themes = [
        "every kind",
        "pictures",
        "lidars",
        "motion",
        "sensor_tick",
        "listeners",
        "lanes",
        "ahead",
        "boom",
        "free running",
    ];
    stage.run("carla_sensors.py", &[], &themes);
    let ended = stage.end();
    assert!(
        !ended.says("does not take its sensor's messages"),
        "{:?}",
        ended.lines
    );
}

#[test]
fn the_python_package_reads_the_same_frames_without_a_copy() {
    let stage = Stage::new("carlaattach", &empty_town("Town10HD"));
    let themes = ["same frames", "without listening", "choice", "sentences"];
    stage.run("carla_attach.py", &[stage.sandbox.domain()], &themes);
    stage.end();
}

/// What chance decides is the same in every run of a script.
#[test]
fn noise_follows_from_attributes_and_seed_and_not_from_ids_or_the_simulators_age() {
    let stage = Stage::new("carlanoise", &empty_town("Town02"));
    let themes = ["apart", "reload", "neighbours", "again"];
    stage.run("carla_noise.py", &[], &themes);
    stage.end();
}
