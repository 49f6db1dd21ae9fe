//! People on foot, through the stock CARLA client and `gantry-carla`, against a real daemon.

use test_e2e::{assert_nothing_left, spawn_consumer, start_daemon, venv_program};
use test_kit::Sandbox;
use test_kit::sandbox::repository;

/// No sensors: nothing is rendered.
const LAUNCH: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
vehicles = 0
"#;

/// The script's "navigation" and "crowd" are for running by hand: some client processes find no place on the mesh that others use.
#[test]
fn the_stock_client_walks() {
    let sandbox = Sandbox::new("carlawalk");
    let daemon = start_daemon(&sandbox, LAUNCH, &[]);
    let mut gateway = spawn_consumer(&sandbox, "gantry-carla", &["--port", "0"]);
    let line = gateway.wait_line("listening on");
    let port = line.split(':').nth(1).unwrap().split(',').next().unwrap().trim().to_owned();
    let script = repository().join("tests/test_e2e/python/carla_walkers.py");
    // The client keeps a cache in its home folder, which must not be the tester's.
    let home = sandbox.path("");
    let env = [("HOME", home.to_str().unwrap()), ("PYTHONDONTWRITEBYTECODE", "1"), ("PYTHONUNBUFFERED", "1")];
    let args = [script.to_str().unwrap(), &port];
    let ended = sandbox.spawn_program("python", &venv_program("python"), &args, &env).wait().expect_code(0);
    for theme in ["blueprints", "control", "collision", "props"] {
        assert!(ended.says(&format!("{theme} passed")), "{:?}", ended.lines);
    }
    gateway.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
