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

/// About one client process in four gets the mesh (the same bytes as the others) and then finds no place on it, for as long as it lives;
/// the cause is not known yet (docs/carla-compatibility.md). Such a process is replaced by another one, in a world of its own.
#[test]
fn the_stock_client_walks() {
    let mut failures = Vec::new();
    while failures.len() < 8 {
        match walk() {
            Ok(()) => return,
            Err(output) => failures.push(output),
        }
    }
    panic!("no client found a place on the navigation mesh:\n{}", failures.join("\n\n"));
}

/// Everything about people; the output of a client that could not use its navigation mesh.
fn walk() -> Result<(), String> {
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
    let ended = sandbox.spawn_program("python", &venv_program("python"), &args, &env).wait();
    let is_lost = ended.says("the navigation mesh does not load");
    let ended = if is_lost { ended.expect_code(1) } else { ended.expect_code(0) };
    let themes = ["blueprints", "control", "collision", "props", "navigation", "crowd"];
    for theme in &themes[..if is_lost { 4 } else { 6 }] {
        assert!(ended.says(&format!("{theme} passed")), "{:?}", ended.lines);
    }
    gateway.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
    if is_lost { Err(ended.lines.join("\n")) } else { Ok(()) }
}
