//! The identity measures: each truth goes with at most one track for the whole sequence.

use std::collections::BTreeMap;

use super::scores::Scores;
use super::sequence::Sequence;
use crate::assignment::{Pair, best_pairs};
use crate::numbers::share;

#[derive(Clone, Debug, Default)]
pub(super) struct Counts {
    n_truths: u64,
    n_results: u64,
    n_right: u64,
}

impl Counts {
    pub(super) fn add(&mut self, sequence: &Sequence, threshold: f64) {
        let mut together: BTreeMap<(usize, usize), u64> = BTreeMap::new();
        for frame in &sequence.frames {
            self.n_truths += frame.truths.len() as u64;
            self.n_results += frame.results.len() as u64;
            for pair in frame.pairs.iter().filter(|pair| pair.worth >= threshold) {
                let identities = (frame.truths[pair.row], frame.results[pair.column]);
                *together.entry(identities).or_default() += 1;
            }
        }
        // Misses and false alarms are fewest where the frames together are most.
        let pairs = together.iter().map(|(&(row, column), &n)| Pair {
            row,
            column,
            worth: n as f64,
        });
        let pairs: Vec<Pair> = pairs.collect();
        let chosen = best_pairs(&pairs).into_iter().map(|at| pairs[at]);
        self.n_right += chosen
            .map(|pair| together[&(pair.row, pair.column)])
            .sum::<u64>();
    }

    pub(super) fn write(&self, scores: &mut Scores) {
        scores.idp = share(self.n_right, self.n_results);
        scores.idr = share(self.n_right, self.n_truths);
        scores.idf1 = share(2 * self.n_right, self.n_truths + self.n_results);
    }
}
