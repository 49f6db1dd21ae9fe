//! What stands in the map through the stock CARLA client: environment objects, layers, boxes, street lights.

use test_e2e::carla::{run_script, start_gateway};
use test_e2e::{assert_nothing_left, start_daemon};
use test_kit::Sandbox;

const LAUNCH: &str = r#"version = 1
[scenario]
map = "Town02"
seed = 7
tick_hz = 20
vehicles = 0
"#;

#[test]
fn scenery_is_listed_hidden_and_lit_for_every_sensor() {
    let sandbox = Sandbox::new("carlascenery");
    let daemon = start_daemon(&sandbox, LAUNCH, &[]);
    let (gateway, port, _) = start_gateway(&sandbox);
    let themes = ["objects", "hiding", "layers", "lights", "collisions"];
    run_script(&sandbox, "carla_scenery.py", &[&port.to_string()], &themes);
    gateway.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
