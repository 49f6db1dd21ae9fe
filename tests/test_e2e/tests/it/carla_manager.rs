//! The Traffic Manager as a process of its own, `gantry-drive --serve`, which the stock CARLA client
//! uses as if another client ran it: every call, batches, two clients, repeated runs, a kill and a
//! successor. Without it the client drives by itself.

use test_e2e::carla::{Stage, empty_town, free_port, start_script};
use test_e2e::spawn_consumer;
use test_kit::Process;

/// Starts a manager that clients find at `port`.
fn serve(stage: &Stage, port: &str) -> Process {
    let mut manager = spawn_consumer(&stage.sandbox, "gantry-drive", &["--serve", port]);
    manager.wait_line("listening on");
    manager.wait_line("read the map");
    manager
}

#[test]
fn clients_drive_through_a_manager_that_is_a_process() {
    let stage = Stage::new("carlamanager", &empty_town("Town02"));
    let port = free_port().to_string();
    let manager = serve(&stage, &port);
    for theme in ["calls", "batch", "free", "repeat", "other"] {
        stage.run("carla_manager.py", &[&port, theme], &[theme]);
    }
    // What the client's own manager does, this one does too.
    let themes = ["lights", "paths", "speeds", "hybrid", "fifty"];
    stage.run("carla_traffic.py", &[&port], &themes);
    manager.stop().expect_code(0);
    // The same port again, now in the client's own process.
    stage.run("carla_manager.py", &[&port, "own"], &["own"]);
    stage.end();
}

/// What cars do after a call is what CARLA's reference says of that call.
#[test]
fn methods_act_on_the_road() {
    let stage = Stage::new("carlawatched", &empty_town("Town06"));
    let port = free_port().to_string();
    let manager = serve(&stage, &port);
    let themes = [
        "offsets", "speeds", "gaps", "forced", "random", "auto", "ignored", "signs", "lamps",
        "route", "respawn", "seeds", "dead_end",
    ];
    let args = [&[port.as_str()], &themes[..]].concat();
    stage.run("carla_watched.py", &args, &themes);
    manager.stop().expect_code(0);
    stage.end();
}

/// A killed manager stops neither the world nor the cars: its successor drives on those that were
/// registered, as they were told to.
#[test]
fn a_killed_manager_has_a_successor() {
    let stage = Stage::new("carlamanagerkill", &empty_town("Town02"));
    let port = free_port().to_string();
    let first = serve(&stage, &port);
    stage.run("carla_manager.py", &[&port, "settle"], &["settle"]);
    let rpc = stage.port.to_string();
    let args = [rpc.as_str(), port.as_str(), "witness"];
    let mut witness = start_script(&stage.sandbox, "carla_manager.py", &args);
    witness.wait_line("stepping");
    first.kill9();
    std::fs::write(stage.sandbox.path("gone"), "").expect("the sandbox can be written to");
    witness.wait().expect_code(0);
    let second = serve(&stage, &port);
    stage.run("carla_manager.py", &[&port, "after"], &["after"]);
    let said = second.stop().expect_code(0);
    assert!(said.says("vehicles=5"), "{}", said.lines.join("\n"));
    stage.end();
}

/// The package's client takes an error in the place of the next snapshot once it has noticed that its
/// manager is dead; its tick must not wait for its time-out.
#[test]
fn a_client_goes_on_when_its_manager_is_killed() {
    let stage = Stage::new("carlamanagerlost", &empty_town("Town02"));
    let port = free_port().to_string();
    let manager = serve(&stage, &port);
    let rpc = stage.port.to_string();
    let args = [rpc.as_str(), port.as_str(), "bereaved"];
    let mut client = start_script(&stage.sandbox, "carla_manager.py", &args);
    client.wait_line("stepping");
    manager.kill9();
    std::fs::write(stage.sandbox.path("gone"), "").expect("the sandbox can be written to");
    client.wait().expect_code(0);
    stage.end();
}
