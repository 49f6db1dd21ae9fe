//! Traffic lights, signs and weather through the stock CARLA client.

use test_e2e::carla::{Stage, empty_town};

#[test]
fn lights_switch_by_their_times_and_cars_know_before_which_they_stand() {
    let stage = Stage::new("carlalights", &empty_town("Town10HD"));
    stage.run(
        "carla_lights.py",
        &[],
        &["times", "states", "boxes", "cars", "signs", "weather"],
    );
    stage.end();
}
