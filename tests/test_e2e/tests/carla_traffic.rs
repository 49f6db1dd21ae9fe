//! The client's own Traffic Manager: it obeys lights, paths, speeds, drives near cars and moves far
//! ones, and fifty cars touch nothing.
//! With `GANTRY_SOAK=1` fifty cars drive ten minutes stepped and ten minutes free.

use test_e2e::carla::{Stage, empty_town, free_port, run_script};

#[test]
fn fifty_cars_drive_without_touching_anything() {
    let stage = Stage::new("carlatraffic", &empty_town("Town10HD"));
    let manager_port = free_port().to_string();
    stage.run(
        "carla_traffic.py",
        &[&manager_port],
        &["lights", "paths", "speeds", "hybrid", "fifty"],
    );
    if std::env::var_os("GANTRY_SOAK").is_some() {
        for mode in ["sync", "async"] {
            let (port, manager_port) = (stage.port.to_string(), free_port().to_string());
            let args = [&port, &manager_port, mode, "600"];
            let drive = run_script(&stage.sandbox, "carla_traffic.py", &args, &[mode]);
            println!("{}", drive.lines.join("\n"));
        }
    }
    stage.end();
}

/// The manager's thread shares a connection with the script and may be anywhere in its work when the
/// script spawns, destroys or loads a world.
#[test]
fn a_traffic_manager_bears_births_deaths_and_other_worlds() {
    let stage = Stage::new("carlamanagers", &empty_town("Town10HD"));
    let manager_port = free_port().to_string();
    stage.run(
        "carla_managers.py",
        &[&manager_port],
        &["newborn", "free worlds", "stepped worlds", "all"],
    );
    stage.end();
}
