//! How vehicles move through the stock CARLA client: physical data, Ackermann control, pushes,
//! switches, telemetry.

use test_e2e::carla::{Stage, empty_town};

#[test]
fn physical_data_and_pushes_do_what_newton_says() {
    let stage = Stage::new("carlaphysics", &empty_town("Town06"));
    let themes = [
        "fields",
        "mass",
        "friction",
        "ackermann",
        "constant velocity",
        "pushes",
        "substeps",
        "long ticks",
        "sticky",
        "no physics",
        "telemetry",
        "two wheels",
        "six wheels",
        "half turn",
        "props",
        "prop in the way",
        "walkers",
    ];
    stage.run("carla_physics.py", &[], &themes);
    stage.end();
}
