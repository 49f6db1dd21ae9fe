//! Vehicles through the stock CARLA client: the catalogue, friction areas, collision impulses,
//! doors.

use test_e2e::carla::{Stage, empty_town};

#[test]
fn vehicles_are_those_of_the_list_and_obey_newton() {
    let stage = Stage::new("carlavehicles", &empty_town("Town06"));
    stage.run(
        "carla_vehicles.py",
        &[],
        &["catalogue", "friction area", "collision impulse", "doors"],
    );
    stage.end();
}
