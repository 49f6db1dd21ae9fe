//! Lens, blur and rarer calls through the stock CARLA client, against NumPy.

use test_e2e::carla::{Stage, empty_town};

#[test]
fn a_lens_bends_and_blurs_as_its_attributes_say_and_rare_calls_do_what_they_promise() {
    let stage = Stage::new("carlaoptics", &empty_town("Town10HD"));
    let themes = [
        "lens",
        "motion blur",
        "focus",
        "film",
        "ignored vehicles",
        "gravity",
        "bones",
        "radio",
        "riders",
    ];
    stage.run("carla_optics.py", &[], &themes);
    stage.end();
}
