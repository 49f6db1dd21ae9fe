//! HOTA: detection and association at 19 thresholds of likeness.

use std::collections::BTreeMap;

use super::scores::Scores;
use super::sequence::{ROUNDING, Sequence};
use crate::assignment::{Pair, best_pairs};
use crate::numbers::share;

const N_THRESHOLDS: usize = 19;

fn threshold(at: usize) -> f64 {
    0.05 * (at + 1) as f64
}

/// Sums over sequences, at each threshold.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    n_found: u64,
    likeness: f64,
    /// Association accuracy, recall and precision, each summed over what was found.
    association: [f64; 3],
}

#[derive(Clone, Debug, Default)]
pub(super) struct Sums {
    at: [Sum; N_THRESHOLDS],
    n_truths: u64,
    n_results: u64,
}

impl Sums {
    pub(super) fn add(&mut self, sequence: &Sequence) {
        let (truth_lengths, result_lengths) = sequence.lengths();
        self.n_truths += truth_lengths.iter().sum::<u64>();
        self.n_results += result_lengths.iter().sum::<u64>();
        let alignment = alignment(sequence, &truth_lengths, &result_lengths);
        let mut n_matched = vec![BTreeMap::<(usize, usize), u64>::new(); N_THRESHOLDS];
        for frame in &sequence.frames {
            let identities = |pair: &Pair| (frame.truths[pair.row], frame.results[pair.column]);
            let weighted = frame.pairs.iter().map(|pair| Pair {
                worth: pair.worth * alignment[&identities(pair)],
                ..*pair
            });
            let weighted: Vec<Pair> = weighted.collect();
            for pair in best_pairs(&weighted).into_iter().map(|at| &frame.pairs[at]) {
                for (at, sum) in self.at.iter_mut().enumerate() {
                    if pair.worth >= threshold(at) - ROUNDING {
                        sum.n_found += 1;
                        sum.likeness += pair.worth;
                        *n_matched[at].entry(identities(pair)).or_default() += 1;
                    }
                }
            }
        }
        for (sum, n_matched) in self.at.iter_mut().zip(n_matched) {
            for ((truth, result), n) in n_matched {
                let (n_truth, n_result) = (truth_lengths[truth], result_lengths[result]);
                let wholes = [n_truth + n_result - n, n_truth, n_result];
                for (sum, whole) in sum.association.iter_mut().zip(wholes) {
                    *sum += (n * n) as f64 / whole as f64;
                }
            }
        }
    }

    pub(super) fn write(&self, scores: &mut Scores) {
        scores.n_truths = self.n_truths;
        scores.n_results = self.n_results;
        if self.n_truths + self.n_results == 0 {
            return;
        }
        let mean = |of: &dyn Fn(&Sum) -> f64| {
            Some(self.at.iter().map(of).sum::<f64>() / N_THRESHOLDS as f64)
        };
        let found = |sum: &Sum, whole: u64| share(sum.n_found, whole).unwrap_or(0.0);
        let det_a = |sum: &Sum| found(sum, self.n_truths + self.n_results - sum.n_found);
        let associated =
            |sum: &Sum, which: usize| sum.association[which] / sum.n_found.max(1) as f64;
        let hota = |sum: &Sum| (det_a(sum) * associated(sum, 0)).sqrt();
        scores.hota = mean(&hota);
        scores.hota_at = self.at.iter().map(hota).collect();
        scores.det_a = mean(&det_a);
        scores.det_re = mean(&|sum| found(sum, self.n_truths));
        scores.det_pr = mean(&|sum| found(sum, self.n_results));
        scores.ass_a = mean(&|sum| associated(sum, 0));
        scores.ass_re = mean(&|sum| associated(sum, 1));
        scores.ass_pr = mean(&|sum| associated(sum, 2));
        // TrackEval counts a threshold that nothing reaches as exact.
        let likeness = |sum: &Sum| {
            if sum.n_found == 0 {
                1.0
            } else {
                sum.likeness / sum.n_found as f64
            }
        };
        scores.loc_a = mean(&likeness).filter(|_| self.at[0].n_found > 0);
    }
}

/// How well each truth and each result go together over the whole sequence, before anything is
/// assigned.
fn alignment(
    sequence: &Sequence,
    truth_lengths: &[u64],
    result_lengths: &[u64],
) -> BTreeMap<(usize, usize), f64> {
    let mut alignment = BTreeMap::new();
    for frame in &sequence.frames {
        let mut of_truths = vec![0.0; frame.truths.len()];
        let mut of_results = vec![0.0; frame.results.len()];
        for pair in &frame.pairs {
            of_truths[pair.row] += pair.worth;
            of_results[pair.column] += pair.worth;
        }
        for pair in &frame.pairs {
            let identities = (frame.truths[pair.row], frame.results[pair.column]);
            let whole = of_truths[pair.row] + of_results[pair.column] - pair.worth;
            *alignment.entry(identities).or_insert(0.0) += pair.worth / whole;
        }
    }
    for ((truth, result), shared) in &mut alignment {
        *shared /= (truth_lengths[*truth] + result_lengths[*result]) as f64 - *shared;
    }
    alignment
}
