//! Rewards and ends, held against what the rules say.

use simd_worlds::{Autoreset, INFO_NAMES, STATE_NAMES, Worlds};

use crate::worlds;

fn info(worlds: &Worlds, k: usize, name: &str) -> f32 {
    let column = INFO_NAMES.iter().position(|known| *known == name).unwrap();
    worlds.outputs().info[k * INFO_NAMES.len() + column]
}

fn state(worlds: &Worlds, k: usize, name: &str) -> f32 {
    let column = STATE_NAMES.iter().position(|known| *known == name).unwrap();
    worlds.outputs().state[k * STATE_NAMES.len() + column]
}

#[test]
fn lane_keeping_pays_speed_less_the_square_of_the_offset() {
    let mut ten = worlds("LaneKeeping", 10, 1, Autoreset::Disabled);
    ten.reset_all(5).unwrap();
    ten.step(&[0.0, 0.3].repeat(10)).unwrap();
    for k in 0..10 {
        let share = state(&ten, k, "speed / 30 m/s") * state(&ten, k, "cos heading")
            / state(&ten, k, "limit / 30 m/s");
        let offset = state(&ten, k, "offset / half lane");
        let expected = 1.0 - (1.0 - share).abs() - 0.3 * offset * offset;
        // The slip angle is in the speed along the lane, but not in the heading.
        let reward = ten.outputs().reward[k];
        assert!((reward - expected).abs() < 0.01, "{reward} {expected}");
    }
}

#[test]
fn leaving_the_lane_ends_the_episode_with_nothing() {
    let mut one = worlds("LaneKeeping", 1, 1, Autoreset::Disabled);
    one.reset_all(2).unwrap();
    let mut last = 0.0;
    for _ in 0..200 {
        last = state(&one, 0, "offset / half lane");
        one.step(&[0.5, 0.2]).unwrap();
        if one.outputs().terminated[0] {
            break;
        }
    }
    assert!(one.outputs().terminated[0] && !one.outputs().truncated[0]);
    assert_eq!(
        (info(&one, 0, "off_lane"), one.outputs().reward[0]),
        (1.0, 0.0)
    );
    assert!(
        last > 0.5 && state(&one, 0, "offset / half lane") > 1.0,
        "{last}"
    );
    let error = one.step(&[0.0; 2]).unwrap_err().to_string();
    assert!(
        error.starts_with("the episode of world 0 has ended"),
        "{error}"
    );
    one.reset(&[true], &[3]).unwrap();
    one.step(&[0.0; 2]).unwrap();
}

/// Goal: each kind of episode ends as its rules say when the ego brakes hard at once, or never.
#[test]
fn who_brakes_at_once_stops_needlessly_and_who_never_does_runs_into_things() {
    let n = 60;
    let mut all = worlds("EmergencyBrake", n, 2, Autoreset::Disabled);
    let mut needless_alone = 0;
    for (pedal, column) in [(-1.0, "needless_stop"), (0.25, "contact")] {
        all.reset_all(100).unwrap();
        let there: Vec<bool> = (0..n)
            .map(|k| state(&all, k, "obstacle there") > 0.5)
            .collect();
        let mut n_found = 0;
        let mut is_done = vec![false; n];
        for _ in 0..240 {
            // Ended worlds are begun anew, so that the others can go on; their rows count no more.
            all.reset(&is_done, &vec![100; n]).unwrap();
            let steer = |k: usize| 1.6 * state(&all, k, "way at 10 m: left / 10 m");
            let actions: Vec<f32> = (0..n).flat_map(|k| [steer(k), pedal]).collect();
            all.step(&actions).unwrap();
            for k in 0..n {
                if is_done[k] || !(all.outputs().terminated[k] || all.outputs().truncated[k]) {
                    continue;
                }
                is_done[k] = true;
                let found = info(&all, k, column) == 1.0;
                n_found += usize::from(found);
                if column == "contact" && found {
                    assert!(there[k] && all.outputs().reward[k] <= 0.0, "world {k}");
                }
                if column == "needless_stop" && !there[k] {
                    assert!(found && all.outputs().reward[k] == -0.5, "world {k}");
                    needless_alone += 1;
                }
            }
        }
        assert!(n_found > n / 5, "{column}: {n_found} of {n}");
    }
    assert!(needless_alone > 5, "{needless_alone}");
}

#[test]
fn the_last_state_is_kept_and_the_next_episode_begins_when_it_should() {
    let actions = [0.6, 0.2];
    let (mut same, mut next) = (
        worlds("LaneKeeping", 1, 1, Autoreset::SameStep),
        worlds("LaneKeeping", 1, 1, Autoreset::NextStep),
    );
    same.reset_all(4).unwrap();
    next.reset_all(4).unwrap();
    for _ in 0..200 {
        same.step(&actions).unwrap();
        next.step(&actions).unwrap();
        assert_eq!(same.outputs().reward, next.outputs().reward);
        assert_eq!(same.outputs().terminated, next.outputs().terminated);
        if same.outputs().terminated[0] {
            break;
        }
        assert_eq!(same.outputs().state, next.outputs().state);
    }
    assert!(same.outputs().has_final[0] && !next.outputs().has_final[0]);
    assert_eq!(same.outputs().final_state, next.outputs().state);
    let begun = same.outputs().state.clone();
    assert_ne!(begun, same.outputs().final_state);
    next.step(&actions).unwrap();
    assert_eq!(
        (next.outputs().state.clone(), next.outputs().reward[0]),
        (begun, 0.0)
    );
    assert!(!next.outputs().terminated[0]);
}
