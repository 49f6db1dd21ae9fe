//! A short slice of the fault laboratory: an episode with a daemon that is killed between sending and
//! waking, one in lockstep, and one of render workers, in which a camera once moved too soon.
//! `./gantry soak --faults` runs it for as long as you like.

use test_e2e::laboratory::{Tally, run_episode};

#[test]
fn a_few_episodes_of_faults_violate_nothing() {
    let mut tally = Tally::default();
    for (seed, n_steps) in [(2, 4), (7, 5), (9014, 12)] {
        let ended = run_episode(seed, n_steps, &mut tally);
        ended.unwrap_or_else(|violation| panic!("{violation}"));
    }
    assert_eq!(tally.total().n_faults, 21);
}
