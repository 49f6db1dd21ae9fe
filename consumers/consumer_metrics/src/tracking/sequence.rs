//! A sequence of frames, with identities as numbers.

use std::collections::BTreeMap;

use crate::assignment::Pair;

/// Likeness less one rounding error still reaches a threshold.
pub(super) const ROUNDING: f64 = f64::EPSILON;

/// A frame, with identities numbered within its sequence.
#[derive(Clone, Debug)]
pub(super) struct Shown {
    pub(super) truths: Vec<usize>,
    pub(super) results: Vec<usize>,
    /// Pairs that are alike at all; rows and columns are places in `truths` and `results`.
    pub(super) pairs: Vec<Pair>,
}

/// A sequence: identities hold throughout.
#[derive(Clone, Debug, Default)]
pub(super) struct Sequence {
    pub(super) truth_numbers: BTreeMap<u64, usize>,
    pub(super) result_numbers: BTreeMap<u64, usize>,
    /// Numbers that were given, with those of repeated results.
    pub(super) n_results: usize,
    pub(super) frames: Vec<Shown>,
}

impl Sequence {
    /// In how many frames each truth is, and each result.
    pub(super) fn lengths(&self) -> (Vec<u64>, Vec<u64>) {
        let mut truths = vec![0; self.truth_numbers.len()];
        let mut results = vec![0; self.n_results];
        for frame in &self.frames {
            for &truth in &frame.truths {
                truths[truth] += 1;
            }
            for &result in &frame.results {
                results[result] += 1;
            }
        }
        (truths, results)
    }
}
