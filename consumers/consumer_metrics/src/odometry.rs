//! Trajectories: absolute and relative pose error (Sturm et al., 2012) as the public code of evo
//! computes them, and the relative error over lengths of KITTI's odometry benchmark (Geiger et al.,
//! 2012).
//!
//! Poses come in pairs, truth and result of one time. For the absolute error each sequence of
//! results is first laid on the truth; the errors of all sequences are one set. The relative errors
//! compare motions, so where the results begin does not matter to them.
//!
//! KITTI's lengths are 100, 200 … 800 m of the true path. Where no sequence is 100 m long, 10, 20 …
//! 80 m are taken instead, and the figures have other names, so that nobody takes one for the
//! other.

mod align;
mod segments;
mod settings;

use std::collections::BTreeMap;

use consumer_report::interval::quantile;
use nalgebra::Isometry3;
use serde::Serialize;

use crate::numbers::{existing, mean};
use crate::sequences::Sequences;
pub use settings::{Alignment, Settings, Step};

/// Poses of one drive.
#[derive(Clone, Debug, Default)]
struct Sequence {
    truths: Vec<Isometry3<f64>>,
    results: Vec<Isometry3<f64>>,
}

/// Keeps all poses: 112 bytes for each pair.
#[derive(Clone, Debug)]
pub struct Collector {
    settings: Settings,
    sequences: Sequences<Sequence>,
    n_missing: u64,
}

impl Collector {
    /// Nothing added yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            sequences: Sequences::default(),
            n_missing: 0,
        }
    }

    /// Adds the poses of the next time: both of one body, with one convention of axes; the result
    /// may be in a world of its own. A result that is not there or not finite is counted as missing
    /// and left out.
    pub fn add(&mut self, truth: &Isometry3<f64>, result: Option<&Isometry3<f64>>) {
        let is_finite = |pose: &&Isometry3<f64>| {
            let numbers = pose.translation.vector.iter();
            numbers
                .chain(pose.rotation.coords.iter())
                .all(|it| it.is_finite())
        };
        match result.filter(is_finite) {
            Some(result) if is_finite(&truth) => {
                let sequence = self.sequences.current();
                sequence.truths.push(*truth);
                sequence.results.push(*result);
            }
            _ => self.n_missing += 1,
        }
    }

    /// Ends the sequence: poses after this belong to another drive.
    pub fn end_sequence(&mut self) {
        self.sequences.end();
    }

    /// Adds another collector's sequences; this one's sequence ends with that.
    pub fn merge(&mut self, other: &Self) {
        self.sequences.merge(&other.sequences);
        self.n_missing += other.n_missing;
    }

    /// The figures of all that was added.
    #[must_use]
    pub fn scores(&self) -> Scores {
        let mut errors_m = Vec::new();
        let (mut shifts_m, mut turns_rad) = (Vec::new(), Vec::new());
        let mut scales = Vec::new();
        let mut laid = Vec::new();
        for sequence in self.sequences.iter() {
            let (results, scale) =
                align::laid_on(&sequence.truths, &sequence.results, self.settings.alignment);
            let pairs = sequence.truths.iter().zip(&results);
            errors_m.extend(pairs.map(|(truth, result)| {
                (result.translation.vector - truth.translation.vector).norm()
            }));
            for (from, to) in self.steps(&sequence.truths) {
                let error = segments::error(&sequence.truths, &results, from, to);
                shifts_m.push(error.translation.vector.norm());
                turns_rad.push(error.rotation.angle());
            }
            scales.push(scale);
            laid.push(segments::Laid {
                truths: &sequence.truths,
                results,
            });
        }
        let segments = segments::errors(&laid, self.settings.segment_frames);
        let n_segments = segments.found.len() as u64;
        let of_segments =
            |of: fn(&(f64, f64)) -> f64| mean(segments.found.iter().map(of).sum(), n_segments);
        Scores {
            ate_rmse_m: root_mean_square(&errors_m),
            ate_mean_m: mean(errors_m.iter().sum(), errors_m.len() as u64),
            ate_median_m: quantile(&mut errors_m, 0.5),
            ate_max_m: quantile(&mut errors_m, 1.0),
            rpe_translation_rmse_m: root_mean_square(&shifts_m),
            rpe_translation_mean_m: mean(shifts_m.iter().sum(), shifts_m.len() as u64),
            rpe_rotation_rmse_deg: root_mean_square(&turns_rad).map(f64::to_degrees),
            rpe_rotation_mean_deg: mean(turns_rad.iter().sum(), turns_rad.len() as u64)
                .map(f64::to_degrees),
            t_err_percent: of_segments(|it| it.0).map(|share| 100.0 * share),
            r_err_deg_per_m: of_segments(|it| it.1).map(f64::to_degrees),
            segments_m: (n_segments > 0).then_some(segments.shortest_and_longest_m),
            scale: mean(scales.iter().sum(), scales.len() as u64)
                .filter(|_| self.settings.alignment == Alignment::Scaled),
            n_segments,
            n_poses: errors_m.len() as u64,
            n_missing: self.n_missing,
        }
    }

    fn steps(&self, truths: &[Isometry3<f64>]) -> Vec<(usize, usize)> {
        match (self.settings.step, self.settings.all_pairs) {
            (Step::Frames(n), true) => (n.max(1)..truths.len())
                .map(|to| (to - n.max(1), to))
                .collect(),
            (Step::Frames(n), false) => {
                let ends = (0..truths.len()).step_by(n.max(1));
                ends.clone().zip(ends.skip(1)).collect()
            }
            (Step::Metres(metres), all_pairs) => segments::steps(truths, metres, all_pairs),
        }
    }
}

fn root_mean_square(values: &[f64]) -> Option<f64> {
    mean(values.iter().map(|it| it * it).sum(), values.len() as u64).map(f64::sqrt)
}

/// The figures.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Scores {
    /// Absolute error: root of the mean squared distance, metres.
    pub ate_rmse_m: Option<f64>,
    /// Absolute error: mean distance, metres.
    pub ate_mean_m: Option<f64>,
    /// Absolute error: median distance, metres.
    pub ate_median_m: Option<f64>,
    /// Absolute error: largest distance, metres.
    pub ate_max_m: Option<f64>,
    /// Relative error of translation over a step: root of the mean square, metres.
    pub rpe_translation_rmse_m: Option<f64>,
    /// Relative error of translation over a step: mean, metres.
    pub rpe_translation_mean_m: Option<f64>,
    /// Relative error of rotation over a step: root of the mean square, degrees.
    pub rpe_rotation_rmse_deg: Option<f64>,
    /// Relative error of rotation over a step: mean, degrees.
    pub rpe_rotation_mean_deg: Option<f64>,
    /// KITTI's mean error of translation over segments, percent of their length.
    pub t_err_percent: Option<f64>,
    /// KITTI's mean error of rotation over segments, degrees per metre of their length.
    pub r_err_deg_per_m: Option<f64>,
    /// The shortest and the longest length of KITTI's that occurred, metres.
    pub segments_m: Option<[f64; 2]>,
    /// Mean over sequences of the scale that fits best, if one was asked for.
    pub scale: Option<f64>,
    /// Segments of KITTI's error.
    pub n_segments: u64,
    /// Pairs of poses.
    pub n_poses: u64,
    /// Times without a usable result.
    pub n_missing: u64,
}

impl Scores {
    /// The figures that exist: `ATE` and `ATE/mean`, `ATE/median`, `ATE/max`; `RPE`, `RPE/mean`,
    /// `RPE/rotation_deg`, `RPE/rotation_mean_deg`; `t_err` and `r_err` over 100 m to 800 m, or
    /// `t_err/10-80m` and `r_err/10-80m`; `scale`.
    #[must_use]
    pub fn named(&self) -> BTreeMap<String, f64> {
        let is_short = self
            .segments_m
            .is_some_and(|[shortest, _]| shortest < 100.0);
        let (t_err, r_err) = if is_short {
            ("t_err/10-80m", "r_err/10-80m")
        } else {
            ("t_err", "r_err")
        };
        existing([
            ("ATE", self.ate_rmse_m),
            ("ATE/mean", self.ate_mean_m),
            ("ATE/median", self.ate_median_m),
            ("ATE/max", self.ate_max_m),
            ("RPE", self.rpe_translation_rmse_m),
            ("RPE/mean", self.rpe_translation_mean_m),
            ("RPE/rotation_deg", self.rpe_rotation_rmse_deg),
            ("RPE/rotation_mean_deg", self.rpe_rotation_mean_deg),
            (t_err, self.t_err_percent),
            (r_err, self.r_err_deg_per_m),
            ("scale", self.scale),
        ])
    }
}

#[cfg(test)]
mod tests;
