//! People on foot, through the stock CARLA client and `gantry-carla`, against a real daemon.

use test_e2e::carla::{Stage, empty_town};

#[test]
fn the_stock_client_walks() {
    let stage = Stage::new("carlawalk", &empty_town("Town10HD"));
    stage.run(
        "carla_walkers.py",
        &[],
        &[
            "blueprints",
            "control",
            "collision",
            "bones",
            "props",
            "navigation",
            "crowd",
        ],
    );
    stage.end();
}
