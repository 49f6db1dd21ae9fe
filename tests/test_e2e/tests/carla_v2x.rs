//! Vehicle-to-everything radio through the stock client.

use test_e2e::carla::{Stage, empty_town};

#[test]
fn stations_hear_each_other_as_the_formulas_say() {
    let stage = Stage::new("carlav2x", &empty_town("Town10HD"));
    stage.run(
        "carla_v2x.py",
        &[],
        &[
            "awareness",
            "range",
            "custom",
            "obstacles",
            "roadside",
            "sentences",
        ],
    );
    let said = stage.end();
    assert!(
        said.says("a custom message has 100 bytes; at most 99 are sent"),
        "{}",
        said.lines.join("\n")
    );
}
