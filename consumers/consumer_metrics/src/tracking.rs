//! Tracks: HOTA (Luiten et al., 2021), CLEAR MOT (Bernardin and Stiefelhagen, 2008) and the
//! identity measures (Ristani et al., 2016), as the public code of TrackEval computes them.
//!
//! How alike a truth and a result are is given, 0 to 1: the overlap of boxes, or how near centres
//! are. HOTA is the mean over 19 thresholds of it, 0.05, 0.10 … 0.95; CLEAR and identity use one.
//! In each frame the truths that are ignored take part in one assignment of largest likeness, and
//! results that fall to them are taken out with them, as MOTChallenge does with its distractors.
//! Identities hold within a sequence; the sequences' counts are added, and HOTA's association is
//! weighted with what was found in each.

mod clear;
mod hota;
mod identity;
mod scores;
mod sequence;

use std::collections::BTreeSet;

use crate::assignment::{Pair, best_pairs};
use crate::sequences::Sequences;
use crate::sizes::{SizesDiffer, same};
pub use scores::Scores;
use sequence::{ROUNDING, Sequence, Shown};

/// Overlap (intersection over union) of boxes in an image (left, top, right, bottom; pixels), as
/// [`Frame::similarity`] wants it.
#[must_use]
pub fn iou_similarity(truths: &[[f64; 4]], results: &[[f64; 4]]) -> Vec<f64> {
    all_pairs(truths, results, iou)
}

/// Intersection over union of two rectangles (left, top, right, bottom); 0 if neither has an area.
#[must_use]
pub fn iou(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    let area = |it: &[f64; 4]| (it[2] - it[0]).max(0.0) * (it[3] - it[1]).max(0.0);
    let shared = area(&[
        a[0].max(b[0]),
        a[1].max(b[1]),
        a[2].min(b[2]),
        a[3].min(b[3]),
    ]);
    let union = area(a) + area(b) - shared;
    if union > 0.0 { shared / union } else { 0.0 }
}

/// How near centres are, as [`Frame::similarity`] wants it: 1 at the same place, 0 from
/// `zero_at_m` on. With `zero_at_m` 4 and a threshold of 0.5 centres within 2 m match.
#[must_use]
pub fn centre_similarity(truths: &[[f64; 3]], results: &[[f64; 3]], zero_at_m: f64) -> Vec<f64> {
    all_pairs(truths, results, |truth, result| {
        let square: f64 = truth.iter().zip(result).map(|(a, b)| (a - b).powi(2)).sum();
        (1.0 - square.sqrt() / zero_at_m).max(0.0)
    })
}

fn all_pairs<T>(truths: &[T], results: &[T], of: impl Fn(&T, &T) -> f64) -> Vec<f64> {
    let of_truth = |truth| results.iter().map(move |result| (truth, result));
    let pairs = truths.iter().flat_map(of_truth);
    pairs.map(|(truth, result)| of(truth, result)).collect()
}

/// What a frame shows and what was said about it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Frame<'a> {
    /// Identities of the objects.
    pub truths: &'a [u64],
    /// Which of them are ignored; empty: none.
    pub ignored: &'a [bool],
    /// Identities of the tracks. One that is there twice counts once as itself, and otherwise as a
    /// track of its own.
    pub results: &'a [u64],
    /// How alike each truth and each result are, 0 to 1: `[truth * results.len() + result]`. What
    /// is not a number is not alike.
    pub similarity: &'a [f64],
}

/// What is scored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Likeness from which truth and result can match, for all but HOTA.
    pub threshold: f64,
}

impl Default for Settings {
    /// 0.5, as MOTChallenge has it.
    fn default() -> Self {
        Self { threshold: 0.5 }
    }
}

/// Keeps what is alike, frame by frame: about 32 bytes for each pair.
#[derive(Clone, Debug)]
pub struct Collector {
    settings: Settings,
    sequences: Sequences<Sequence>,
    n_ignored: u64,
}

impl Collector {
    /// Nothing added yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            sequences: Sequences::default(),
            n_ignored: 0,
        }
    }

    /// Adds the next frame of the sequence.
    ///
    /// # Errors
    ///
    /// [`SizesDiffer`] if the lengths do not fit; nothing is added then.
    pub fn add(&mut self, frame: Frame<'_>) -> Result<(), SizesDiffer> {
        let n_results = frame.results.len();
        let n_pairs = frame.truths.len() * n_results;
        same("the table of likeness", n_pairs, frame.similarity.len())?;
        if !frame.ignored.is_empty() {
            same(
                "the list of ignored",
                frame.truths.len(),
                frame.ignored.len(),
            )?;
        }
        let likeness = frame.similarity.iter().enumerate();
        let mut pairs: Vec<Pair> = likeness
            .filter(|&(_, &worth)| worth > 0.0)
            .map(|(at, &worth)| Pair {
                row: at / n_results,
                column: at % n_results,
                worth: worth.min(1.0),
            })
            .collect();
        let left_out = |row: usize| frame.ignored.get(row).copied().unwrap_or(false);
        let mut gone = BTreeSet::new();
        if frame.ignored.contains(&true) {
            let limit = self.settings.threshold - ROUNDING;
            let mut can_match = pairs.clone();
            can_match.retain(|pair| pair.worth >= limit);
            let fallen = best_pairs(&can_match).into_iter().map(|at| can_match[at]);
            gone.extend(
                fallen
                    .filter(|pair| left_out(pair.row))
                    .map(|pair| pair.column),
            );
        }
        pairs.retain(|pair| !left_out(pair.row) && !gone.contains(&pair.column));
        let kept_truths: Vec<usize> = (0..frame.truths.len())
            .filter(|&row| !left_out(row))
            .collect();
        let kept_results: Vec<usize> = (0..n_results)
            .filter(|column| !gone.contains(column))
            .collect();
        self.n_ignored += (frame.truths.len() - kept_truths.len()) as u64;
        for pair in &mut pairs {
            pair.row = kept_truths.partition_point(|&row| row < pair.row);
            pair.column = kept_results.partition_point(|&column| column < pair.column);
        }
        let sequence = self.sequences.current();
        let truths = kept_truths.iter().map(|&row| {
            let next = sequence.truth_numbers.len();
            *sequence
                .truth_numbers
                .entry(frame.truths[row])
                .or_insert(next)
        });
        let truths = truths.collect();
        let mut seen = BTreeSet::new();
        let mut results = Vec::with_capacity(kept_results.len());
        for &column in &kept_results {
            let id = frame.results[column];
            let known = sequence
                .result_numbers
                .get(&id)
                .filter(|_| !seen.contains(&id));
            let number = known.copied().unwrap_or(sequence.n_results);
            if number == sequence.n_results {
                sequence.n_results += 1;
            }
            if seen.insert(id) {
                sequence.result_numbers.insert(id, number);
            }
            results.push(number);
        }
        sequence.frames.push(Shown {
            truths,
            results,
            pairs,
        });
        Ok(())
    }

    /// Ends the sequence: identities after this are others.
    pub fn end_sequence(&mut self) {
        self.sequences.end();
    }

    /// Adds another collector's sequences; this one's sequence ends with that.
    pub fn merge(&mut self, other: &Self) {
        self.sequences.merge(&other.sequences);
        self.n_ignored += other.n_ignored;
    }

    /// The figures of all that was added.
    #[must_use]
    pub fn scores(&self) -> Scores {
        let mut hota = hota::Sums::default();
        let mut clear = clear::Counts::default();
        let mut identity = identity::Counts::default();
        let mut scores = Scores {
            n_ignored: self.n_ignored,
            ..Scores::default()
        };
        for sequence in self.sequences.iter() {
            hota.add(sequence);
            clear.add(sequence, self.settings.threshold);
            identity.add(sequence, self.settings.threshold);
            scores.n_tracks += sequence.n_results as u64;
        }
        hota.write(&mut scores);
        clear.write(&mut scores);
        identity.write(&mut scores);
        scores
    }
}

#[cfg(test)]
mod tests;
