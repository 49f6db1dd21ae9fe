//! Lines of lanes in the vehicle's frame: the F1 score of OpenLane's benchmark of lanes in space
//! (Chen et al., 2022, after Guo et al., 2020), at several distances.
//!
//! Each line is read at equal steps forward, within its own ends, as lateral place and height. At a
//! step where only one of two lines is, they count as one threshold apart. Lines are paired so that
//! the sum of distances, in whole metres as OpenLane rounds it, is least. A truth is found if at
//! least three quarters of its steps lie within the threshold of its partner; a result is right if
//! that holds for three quarters of its own. Recall and precision follow, and F1 from them. Errors
//! are those of all partners: the mean over the steps that both have, and then over pairs, near the
//! vehicle and farther.
//!
//! Lines run forward: one that runs backward is turned round, and where a line turns back, only
//! what reaches farther than all before is kept, as OpenLane does it. Lines with fewer than two
//! steps in the range do not count. A truth that is ignored is no miss, and a result that is right
//! for it does not count either.

mod matching;
mod settings;

use std::collections::BTreeMap;

use serde::Serialize;

use crate::numbers::{existing, mean, share};
use crate::sizes::{SizesDiffer, same};
use matching::{Match, Sampled};
pub use settings::{Line, Settings};

/// Counts frame by frame.
#[derive(Clone, Debug)]
pub struct Collector {
    settings: Settings,
    at: Vec<Counts>,
    n_ignored: u64,
    n_frames: u64,
}

/// Counts at a threshold.
#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    n_truths: u64,
    n_results: u64,
    n_found: u64,
    n_right: u64,
    /// Lateral near, lateral far, height near, height far: sum over pairs, and how many.
    errors_m: [(f64, u64); 4],
}

impl Collector {
    /// Nothing added yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        let at = vec![Counts::default(); settings.thresholds_m.len()];
        Self {
            settings,
            at,
            n_ignored: 0,
            n_frames: 0,
        }
    }

    /// Adds a frame. `ignored` tells of each truth whether it is ignored; empty: none is.
    ///
    /// # Errors
    ///
    /// [`SizesDiffer`] if that list does not fit; nothing is added then.
    pub fn add(
        &mut self,
        truths: &[Line],
        ignored: &[bool],
        results: &[Line],
    ) -> Result<(), SizesDiffer> {
        if !ignored.is_empty() {
            same("the list of ignored", truths.len(), ignored.len())?;
        }
        let mut sampled_truths = Vec::new();
        let mut left_out = Vec::new();
        for (at, line) in truths.iter().enumerate() {
            if let Some(sampled) = Sampled::new(line, &self.settings) {
                sampled_truths.push(sampled);
                left_out.push(ignored.get(at).copied().unwrap_or(false));
            }
        }
        let sample = |line: &Line| Sampled::new(line, &self.settings);
        let sampled_results: Vec<_> = results.iter().filter_map(sample).collect();
        let n_left_out = left_out.iter().filter(|&&it| it).count() as u64;
        self.n_ignored += n_left_out;
        self.n_frames += 1;
        for (counts, &threshold_m) in self.at.iter_mut().zip(&self.settings.thresholds_m) {
            counts.n_truths += sampled_truths.len() as u64 - n_left_out;
            counts.n_results += sampled_results.len() as u64;
            let matches = matching::matches(
                &sampled_truths,
                &sampled_results,
                threshold_m,
                &self.settings,
            );
            for found in matches {
                if left_out[found.truth] {
                    counts.n_results -= u64::from(found.is_right);
                } else {
                    counts.add(&found);
                }
            }
        }
        Ok(())
    }

    /// Adds another collector's frames.
    ///
    /// # Errors
    ///
    /// [`SizesDiffer`] if the other has another number of thresholds; nothing is added then.
    pub fn merge(&mut self, other: &Self) -> Result<(), SizesDiffer> {
        same(
            "the other list of thresholds",
            self.at.len(),
            other.at.len(),
        )?;
        for (mine, theirs) in self.at.iter_mut().zip(&other.at) {
            mine.n_truths += theirs.n_truths;
            mine.n_results += theirs.n_results;
            mine.n_found += theirs.n_found;
            mine.n_right += theirs.n_right;
            for (mine, theirs) in mine.errors_m.iter_mut().zip(theirs.errors_m) {
                mine.0 += theirs.0;
                mine.1 += theirs.1;
            }
        }
        self.n_ignored += other.n_ignored;
        self.n_frames += other.n_frames;
        Ok(())
    }

    /// The figures of all that was added.
    #[must_use]
    pub fn scores(&self) -> Scores {
        let thresholds = self.settings.thresholds_m.iter();
        let most = |of: fn(&Counts) -> u64| self.at.iter().map(of).max().unwrap_or(0);
        Scores {
            at: thresholds
                .zip(&self.at)
                .map(|(&threshold_m, counts)| counts.scores(threshold_m))
                .collect(),
            n_truths: most(|counts| counts.n_truths),
            n_results: most(|counts| counts.n_results),
            n_ignored: self.n_ignored,
            n_frames: self.n_frames,
        }
    }
}

impl Counts {
    fn add(&mut self, found: &Match) {
        self.n_found += u64::from(found.is_found);
        self.n_right += u64::from(found.is_right);
        for (sum, error) in self.errors_m.iter_mut().zip(found.errors_m) {
            if let Some(error) = error {
                sum.0 += error;
                sum.1 += 1;
            }
        }
    }

    fn scores(&self, threshold_m: f64) -> AtThreshold {
        let recall = share(self.n_found, self.n_truths);
        let precision = share(self.n_right, self.n_results);
        // Without truths or without results, what is wrong is all there is.
        let (r, p) = (recall.unwrap_or(0.0), precision.unwrap_or(0.0));
        let balance = if r + p > 0.0 {
            2.0 * r * p / (r + p)
        } else {
            0.0
        };
        let [lateral_near_m, lateral_far_m, height_near_m, height_far_m] =
            self.errors_m.map(|(sum, n)| mean(sum, n));
        AtThreshold {
            threshold_m,
            f1: (self.n_truths + self.n_results > 0).then_some(balance),
            precision,
            recall,
            lateral_near_m,
            lateral_far_m,
            height_near_m,
            height_far_m,
        }
    }
}

/// The figures.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Scores {
    /// At each distance, in the order of the settings.
    pub at: Vec<AtThreshold>,
    /// Lines that were scored, each counted in each frame.
    pub n_truths: u64,
    /// Lines that were given, each counted in each frame.
    pub n_results: u64,
    /// Lines that were left out, each counted in each frame.
    pub n_ignored: u64,
    /// Frames.
    pub n_frames: u64,
}

/// The figures at a distance; shares are 0 to 1.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct AtThreshold {
    /// The distance, metres.
    pub threshold_m: f64,
    /// Balance of precision and recall.
    pub f1: Option<f64>,
    /// Share of results that are right.
    pub precision: Option<f64>,
    /// Share of truths that are found.
    pub recall: Option<f64>,
    /// Mean sideways error of partners near the vehicle, metres.
    pub lateral_near_m: Option<f64>,
    /// Mean sideways error of partners farther away, metres.
    pub lateral_far_m: Option<f64>,
    /// Mean error in height of partners near the vehicle, metres.
    pub height_near_m: Option<f64>,
    /// Mean error in height of partners farther away, metres.
    pub height_far_m: Option<f64>,
}

impl Scores {
    /// The figures that exist: at the largest distance `F1`, `precision`, `recall`,
    /// `lateral_near`, `lateral_far`, `height_near` and `height_far`; and F1 at each, `F1@0.5m`.
    #[must_use]
    pub fn named(&self) -> BTreeMap<String, f64> {
        let f1_at = |at: &AtThreshold| (format!("F1@{}m", at.threshold_m), at.f1);
        let mut named = existing(self.at.iter().map(f1_at));
        let largest = |a: &&AtThreshold, b: &&AtThreshold| a.threshold_m.total_cmp(&b.threshold_m);
        if let Some(at) = self.at.iter().max_by(largest) {
            named.extend(existing([
                ("F1", at.f1),
                ("precision", at.precision),
                ("recall", at.recall),
                ("lateral_near", at.lateral_near_m),
                ("lateral_far", at.lateral_far_m),
                ("height_near", at.height_near_m),
                ("height_far", at.height_far_m),
            ]));
        }
        named
    }
}

#[cfg(test)]
mod tests;
