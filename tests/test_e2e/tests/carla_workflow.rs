//! The first steps of a session as CARLA's own guides go about them, with the stock client.

use test_e2e::carla::{Stage, empty_town, free_port};

#[test]
fn a_session_from_the_first_connection_to_restored_settings() {
    let stage = Stage::new("carlaworkflow", &empty_town("Town10HD"));
    let themes = [
        "connection",
        "settings",
        "maps",
        "layers",
        "generated world",
        "blueprints",
        "ego",
        "sensors",
        "manual control",
        "traffic manager",
        "restoring",
    ];
    stage.run("carla_workflow.py", &[&free_port().to_string()], &themes);
    stage.end();
}
