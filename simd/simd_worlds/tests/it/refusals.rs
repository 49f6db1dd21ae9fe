//! What cannot be is a sentence, and no world has moved.

use std::sync::Arc;

use simd_worlds::{Autoreset, Course, Task, Worlds};

use crate::{course, worlds};

#[test]
fn an_action_that_is_no_number_names_its_world_and_index() {
    let mut four = worlds("LaneKeeping", 4, 1, Autoreset::SameStep);
    four.reset_all(1).unwrap();
    let before = four.outputs().clone();
    for (value, text) in [(f32::NAN, "NaN"), (f32::INFINITY, "inf")] {
        let mut actions = [0.0; 8];
        actions[5] = value;
        let error = four.step(&actions).unwrap_err().to_string();
        let expected = format!("action 1 (accelerate) of world 2 is {text}; it must be");
        assert!(error.starts_with(&expected), "{error}");
    }
    assert_eq!(*four.outputs(), before);
}

#[test]
fn calls_that_cannot_be_are_sentences() {
    let refused = |result: Result<(), simd_worlds::WorldsError>| result.unwrap_err().to_string();
    let mut two = worlds("LaneKeeping", 2, 1, Autoreset::Disabled);
    assert!(refused(two.step(&[0.0; 4])).starts_with("world 0 was never reset"));
    assert!(refused(two.fork(1, &[0])).starts_with("world 1 was never reset"));
    two.reset_all(1).unwrap();
    assert!(refused(two.step(&[0.0; 3])).starts_with("the actions has 3 values, but 4"));
    assert!(refused(two.fork(0, &[2])).starts_with("there is no world 2; there are 0 to 1"));
    assert!(refused(two.reset(&[true], &[1, 2])).starts_with("the mask has 1 values, but 2"));
    for (n, n_threads) in [(0, 1), (1, 0), (70_000, 1)] {
        assert!(Worlds::new(course("LaneKeeping"), n, n_threads, Autoreset::Disabled).is_err());
    }
}

/// A task that no file could hold makes every start impossible, which is a panic in the world.
#[test]
fn a_panic_of_the_simulator_is_a_sentence_that_names_the_world() {
    let mut task = Task::built_in("LaneKeeping").unwrap();
    task.start.heading_rad = f64::NAN;
    let course = Arc::new(Course::new(task, 1).unwrap());
    for n_threads in [1, 2] {
        let course = course.clone();
        let mut worlds = Worlds::new(course, 12, n_threads, Autoreset::SameStep).unwrap();
        let mask: Vec<bool> = (0..12).map(|k| k >= 5).collect();
        let error = worlds.reset(&mask, &[1; 12]).unwrap_err().to_string();
        let expected = "the simulator broke down in world 5: the actor was made";
        assert!(error.starts_with(expected), "{error}");
        for refused in [worlds.reset_all(1), worlds.fork(0, &[1])] {
            let error = refused.unwrap_err().to_string();
            assert!(error.contains("make new ones"), "{error}");
        }
    }
}

#[test]
fn tasks_that_cannot_be_are_sentences() {
    let error = Task::built_in("Parking").unwrap_err().to_string();
    assert!(error.contains("LaneKeeping, EmergencyBrake"), "{error}");
    let text = include_str!("../../tasks/lane_keeping.toml");
    for (from, to, expected) in [
        (
            "tick_ms = 50",
            "tick_ms = 0",
            "tick_ms is 0, allowed is 1 to 200",
        ),
        (
            "offset_ratio = 0.4",
            "offset_ratio = nan",
            "start.offset_ratio is NaN",
        ),
        ("[3.0, 15.0]", "[3.0, 2.0]", "start.speed_mps[1] is 2"),
        ("tick_ms = 50", "tick_mms = 50", "tick_mms"),
    ] {
        let error = Task::from_toml(&text.replace(from, to))
            .unwrap_err()
            .to_string();
        assert!(error.contains(expected), "{error}");
    }
    let brake = include_str!("../../tasks/emergency_brake.toml");
    for (town, expected) in [
        ("Town02", "has no straight way of"),
        ("Atlantis", "Atlantis"),
    ] {
        let task = Task::from_toml(&brake.replace("Town06", town)).unwrap();
        let error = Course::new(task, 1).err().unwrap().to_string();
        assert!(error.contains(expected), "{error}");
    }
}
