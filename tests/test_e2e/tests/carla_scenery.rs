//! What stands in the map through the stock CARLA client: environment objects, layers, boxes,
//! street lights.

use test_e2e::carla::{Stage, empty_town};

#[test]
fn scenery_is_listed_hidden_and_lit_for_every_sensor() {
    let stage = Stage::new("carlascenery", &empty_town("Town02"));
    let themes = [
        "objects",
        "hiding",
        "layers",
        "lights",
        "collisions",
        "lamps_of_before",
    ];
    stage.run("carla_scenery.py", &[], &themes);
    stage.end();
}
