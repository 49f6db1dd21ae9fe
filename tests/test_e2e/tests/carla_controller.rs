//! Cars under the controller of CARLA's own agents, through the stock client.

use test_e2e::carla::{Stage, empty_town};

#[test]
fn cars_follow_their_lanes_at_the_gains_of_carlas_agents() {
    let stage = Stage::new("carlacontroller", &empty_town("Town10HD"));
    stage.run(
        "carla_controller.py",
        &["Town10HD", "Town01", "Town04"],
        &["Town10HD", "Town01", "Town04"],
    );
    stage.end();
}
