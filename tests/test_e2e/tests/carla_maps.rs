//! Maps of the map folder and maps from a text, with the stock CARLA client.

use schema_bus::names;
use test_e2e::{assert_nothing_left, document, join_bus, spawn_consumer, start_daemon, venv_program};
use test_kit::Sandbox;
use test_kit::sandbox::repository;

/// No sensors: nothing is rendered.
const LAUNCH: &str = "version = 1\n[scenario]\nmap = \"Town02\"\nseed = 7\ntick_hz = 20\nvehicles = 0\n";

#[test]
fn the_stock_client_lists_loads_and_generates_maps() {
    let sandbox = Sandbox::new("carlamaps");
    let data = sandbox.path("data");
    std::fs::create_dir_all(data.join("maps")).unwrap();
    let daemon = start_daemon(&sandbox, LAUNCH, &["--data", data.to_str().unwrap()]);
    // A town's own text, read back as anybody's file.
    let bus = join_bus(&sandbox, "test");
    let file = data.join("maps/mine.xodr");
    std::fs::write(&file, document(&bus, names::WORLD_MAP).text).unwrap();
    // Outside of the map folder: no client may reach it.
    std::fs::copy(&file, sandbox.path("secret.xodr")).unwrap();
    let mut gateway = spawn_consumer(&sandbox, "gantry-carla", &["--port", "0"]);
    let line = gateway.wait_line("listening on");
    let port = line.split(':').nth(1).unwrap().split(',').next().unwrap().trim().to_owned();
    let script = repository().join("tests/test_e2e/python/carla_maps.py");
    let home = sandbox.path("");
    let env = [("HOME", home.to_str().unwrap()), ("PYTHONDONTWRITEBYTECODE", "1"), ("PYTHONUNBUFFERED", "1")];
    let args = [script.to_str().unwrap(), &port, file.to_str().unwrap()];
    let ended = sandbox.spawn_program("python", &venv_program("python"), &args, &env).wait().expect_code(0);
    for theme in ["listing", "folder", "generating", "refusals"] {
        assert!(ended.says(&format!("{theme} passed")), "{:?}", ended.lines);
    }
    gateway.stop().expect_code(0);
    drop(bus);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
