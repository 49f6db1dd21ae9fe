//! CARLA's recorder and replayer through the stock client.

use test_e2e::carla::{Stage, empty_town};

#[test]
fn drives_are_recorded_told_about_and_replayed() {
    let stage = Stage::new("carlarec", &empty_town("Town10HD"));
    stage.run(
        "carla_recorder.py",
        &[],
        &["recording", "texts", "replay", "anew"],
    );
    assert!(
        stage
            .sandbox
            .path("data/recordings/carla/drive.log")
            .exists(),
        "recordings stay in the data folder"
    );
    stage.end();
}
