//! How vehicles move through the stock CARLA client: physical data, Ackermann control, pushes, switches, telemetry.

use test_e2e::carla::{run_script, start_gateway};
use test_e2e::{assert_nothing_left, start_daemon};
use test_kit::Sandbox;

const LAUNCH: &str = r#"version = 1
[scenario]
map = "Town06"
seed = 7
tick_hz = 20
vehicles = 0
"#;

#[test]
fn physical_data_and_pushes_do_what_newton_says() {
    let sandbox = Sandbox::new("carlaphysics");
    let daemon = start_daemon(&sandbox, LAUNCH, &[]);
    let (gateway, port, _) = start_gateway(&sandbox);
    let themes = ["fields", "mass", "friction", "ackermann", "constant velocity", "pushes", "no physics", "telemetry"];
    run_script(&sandbox, "carla_physics.py", &[&port.to_string()], &themes);
    gateway.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
