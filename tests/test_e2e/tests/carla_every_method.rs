//! Every method of the stock client's main classes, by introspection.

use test_e2e::carla::{Stage, empty_town};

#[test]
fn every_method_answers_in_time_and_without_errors() {
    let stage = Stage::new("carlaevery", &empty_town("Town10HD"));
    let themes = [
        "World",
        "Vehicle",
        "Walker",
        "TrafficLight",
        "TrafficSign",
        "Camera",
        "Radio",
        "Lines",
        "Controller",
        "Spectator",
        "Client",
        "gone",
    ];
    stage.run("carla_every_method.py", &[], &themes);
    stage.end();
}
