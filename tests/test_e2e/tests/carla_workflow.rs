//! The first steps of a session as CARLA's own guides go about them, with the stock client.

use std::net::TcpListener;

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
fn a_session_from_the_first_connection_to_restored_settings() {
    let sandbox = Sandbox::new("carlaworkflow");
    let daemon = start_daemon(&sandbox, LAUNCH, &[]);
    let (gateway, port, _) = start_gateway(&sandbox);
    let manager_port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port().to_string();
    let themes = ["connection", "settings", "maps", "blueprints", "ego", "sensors", "manual control", "traffic manager", "restoring"];
    run_script(&sandbox, "carla_workflow.py", &[&port.to_string(), &manager_port], &themes);
    gateway.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
