//! A world among many is, to the byte, the world that has its seed and actions alone.

use std::collections::BTreeSet;

use simd_world::World;
use simd_worlds::{Autoreset, STATE_NAMES, Worlds};

use crate::{action, worlds};

const N: usize = 257;
const N_STEPS: u64 = 30;

/// Everything that can be seen of one world.
fn bytes_of(worlds: &Worlds, k: usize) -> Vec<u8> {
    let out = worlds.outputs();
    let row = |values: &[f32], n: usize| -> Vec<u8> {
        bytemuck::cast_slice(&values[k * n..(k + 1) * n]).to_vec()
    };
    let mut all = row(&out.state, STATE_NAMES.len());
    all.extend(row(&out.info, simd_worlds::INFO_NAMES.len()));
    all.extend(row(&out.reward, 1));
    all.extend([u8::from(out.terminated[k]), u8::from(out.truncated[k])]);
    all.extend([u8::from(out.has_final[k])]);
    if out.has_final[k] {
        all.extend(row(&out.final_state, STATE_NAMES.len()));
    }
    all.extend(records(worlds.world(k).unwrap()));
    all
}

fn records(world: &World) -> &[u8] {
    bytemuck::cast_slice(world.snapshot_records())
}

/// Steps all worlds; world k acts by its own lot, whose number is `who[k]`.
fn step(worlds: &mut Worlds, who: &[u64], at: u64) {
    let all: Vec<f32> = who.iter().flat_map(|k| action(*k, at)).collect();
    worlds.step(&all).unwrap();
}

#[test]
fn neighbours_forks_resets_and_threads_change_no_byte() {
    for (task, watched) in [
        ("LaneKeeping", [0, 100, 256]),
        ("EmergencyBrake", [1, 128, 255]),
    ] {
        let mut expected = Vec::new();
        for k in watched {
            let mut one = worlds(task, 1, 1, Autoreset::SameStep);
            one.reset_all(50 + k as u64).unwrap();
            let mut seen = vec![bytes_of(&one, 0)];
            for at in 0..N_STEPS {
                step(&mut one, &[k as u64], at);
                seen.push(bytes_of(&one, 0));
            }
            expected.push(seen);
        }
        for n_threads in [1, 2, 5] {
            let mut many = worlds(task, N, n_threads, Autoreset::SameStep);
            many.reset_all(50).unwrap();
            let who: Vec<u64> = (0..N as u64).collect();
            for at in 0..=N_STEPS {
                for (k, seen) in watched.iter().zip(&expected) {
                    let same = bytes_of(&many, *k) == seen[at as usize];
                    assert!(same, "{task}: world {k}, {n_threads} threads, step {at}");
                }
                if at == N_STEPS {
                    break;
                }
                // What happens to others between the steps.
                let mut mask = vec![false; N];
                mask[(7 * at as usize + 3) % 90 + 2] = true;
                many.reset(&mask, &vec![at; N]).unwrap();
                many.fork(watched[1], &[(11 * at as usize) % 90 + 130])
                    .unwrap();
                step(&mut many, &who, at);
            }
        }
    }
}

#[test]
fn a_fork_goes_on_as_its_source_does() {
    let mut many = worlds("EmergencyBrake", 6, 2, Autoreset::SameStep);
    many.reset_all(3).unwrap();
    for at in 0..10 {
        step(&mut many, &[0, 1, 2, 3, 4, 5], at);
    }
    many.fork(2, &[0, 4, 5]).unwrap();
    for at in 10..40 {
        let ends = |k: usize| many.outputs().terminated[k];
        assert!(!ends(2), "the episode must be long enough for this test");
        for k in [0, 4, 5] {
            assert_eq!(bytes_of(&many, k), bytes_of(&many, 2), "world {k} at {at}");
        }
        step(&mut many, &[2, 1, 2, 3, 2, 2], at);
    }
    step(&mut many, &[7, 1, 2, 3, 2, 2], 40);
    assert_ne!(bytes_of(&many, 0), bytes_of(&many, 2));
}

#[test]
fn the_world_of_a_member_is_an_ordinary_world() {
    let mut one = worlds("LaneKeeping", 1, 1, Autoreset::SameStep);
    one.reset_all(12).unwrap();
    let mut alone = one.world(0).unwrap().clone();
    let ego = alone.actor_with_role("ego_vehicle").unwrap();
    for at in 0..20 {
        let [steer_ratio, pedal] = action(0, at);
        step(&mut one, &[0], at);
        assert!(!one.outputs().terminated[0]);
        let control = schema_frames::VehicleControl {
            throttle_ratio: pedal.max(0.0),
            brake_ratio: (-pedal).max(0.0),
            steer_ratio,
            ..Default::default()
        };
        alone.set_control(ego, control).unwrap();
        alone.step(50_000_000);
        assert!(
            records(&alone) == records(one.world(0).unwrap()),
            "step {at}"
        );
    }
}

#[test]
fn ten_thousand_resets_begin_in_ten_thousand_ways() {
    for task in ["LaneKeeping", "EmergencyBrake"] {
        let mut many = worlds(task, 100, 2, Autoreset::SameStep);
        let mut starts = BTreeSet::new();
        for round in 0..100 {
            many.reset_all(1000 + 100 * round).unwrap();
            let rows = many.outputs().state.chunks(STATE_NAMES.len());
            starts.extend(rows.map(|row| row.iter().map(|x| x.to_bits()).collect::<Vec<_>>()));
        }
        assert!(
            starts.len() >= 9900,
            "{task}: {} distinct starts",
            starts.len()
        );
    }
}

#[test]
fn beginning_others_anew_brings_no_reward_and_no_end() {
    let mut three = worlds("LaneKeeping", 3, 1, Autoreset::Disabled);
    three.reset_all(5).unwrap();
    step(&mut three, &[0, 1, 2], 0);
    let before = three.outputs().clone();
    assert!(before.reward.iter().all(|reward| *reward != 0.0));
    // World 1 leaves its lane at full lock, and stays ended.
    let mut n_steps = 0;
    while !three.outputs().terminated[1] {
        three.step(&[0.0, 0.2, 1.0, 1.0, 0.0, 0.2]).unwrap();
        n_steps += 1;
        assert!(n_steps < 400, "nobody leaves a lane");
    }
    let before = three.outputs().clone();
    three.reset(&[true, false, false], &[77, 0, 0]).unwrap();
    let after = three.outputs();
    assert_eq!(after.reward, [0.0; 3]);
    assert_eq!(
        (&after.terminated, &after.truncated),
        (&vec![false; 3], &vec![false; 3])
    );
    let columns = STATE_NAMES.len();
    assert_eq!(after.state[columns..], before.state[columns..]);
    assert_ne!(after.state[..columns], before.state[..columns]);
    let refused = three.step(&[0.0; 6]).unwrap_err().to_string();
    assert!(refused.contains("world 1"), "{refused}");
}

#[test]
fn a_reset_without_a_seed_begins_the_episode_that_an_end_would_begin() {
    let mut automatic = worlds("EmergencyBrake", 2, 1, Autoreset::SameStep);
    let mut by_hand = worlds("EmergencyBrake", 2, 1, Autoreset::Disabled);
    let refused = by_hand.begin_next(&[false, true]).unwrap_err().to_string();
    assert!(refused.starts_with("world 1 was never reset"), "{refused}");
    automatic.reset_all(8).unwrap();
    by_hand.reset_all(8).unwrap();
    let mut n_ended = 0;
    for _ in 0..600 {
        automatic.step(&[0.0, -1.0, 0.0, -1.0]).unwrap();
        by_hand.step(&[0.0, -1.0, 0.0, -1.0]).unwrap();
        let out = by_hand.outputs();
        let ended: Vec<bool> = (0..2)
            .map(|k| out.terminated[k] || out.truncated[k])
            .collect();
        n_ended += ended.iter().filter(|ended| **ended).count();
        assert_eq!(ended, automatic.outputs().has_final);
        if ended.contains(&true) {
            by_hand.begin_next(&ended).unwrap();
            assert_eq!(by_hand.outputs().reward, [0.0; 2]);
        }
        for k in 0..2 {
            let [a, b] = [&automatic, &by_hand].map(|worlds| records(worlds.world(k).unwrap()));
            assert!(a == b, "world {k}");
        }
    }
    assert!(n_ended > 4, "{n_ended} episodes ended");
}
