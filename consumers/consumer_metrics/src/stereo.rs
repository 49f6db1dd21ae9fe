//! Disparity of pixels: the figures of KITTI's stereo benchmark of 2015 (Menze and Geiger) and of
//! Middlebury (bad pixels).
//!
//! All pixels of all images are one set. A pixel is scored if its truth is finite and more than
//! zero. A result that is negative or not finite is no answer: it is bad in every share, and does
//! not enter the mean error.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::errors::{Errors, is_outlier, masked};
use crate::numbers::existing;
use crate::sizes::SizesDiffer;

/// Disparity of a point of this depth, pixels.
#[must_use]
pub fn disparity_px(depth_m: f32, fx_px: f64, baseline_m: f64) -> f32 {
    (fx_px * baseline_m / f64::from(depth_m)) as f32
}

/// Counts image by image.
#[derive(Clone, Debug, Default)]
pub struct Collector {
    /// More than 1, 2 and 3 pixels wrong, and outliers by KITTI's rule.
    errors: Errors<4>,
    n_ignored: u64,
}

impl Collector {
    /// Nothing added yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds an image: the true and the given disparity of each pixel, pixels. Where the mask is
    /// false, nothing is scored.
    ///
    /// # Errors
    ///
    /// [`SizesDiffer`] if the lengths differ; nothing is added then.
    pub fn add(
        &mut self,
        truth_px: &[f32],
        result_px: &[f32],
        mask: Option<&[bool]>,
    ) -> Result<(), SizesDiffer> {
        for pair in masked(truth_px, result_px, mask)? {
            let is_known = |(truth, _): &(f32, f32)| truth.is_finite() && *truth > 0.0;
            let Some((truth, result)) = pair.filter(is_known) else {
                self.n_ignored += 1;
                continue;
            };
            let (truth, result) = (f64::from(truth), f64::from(result));
            let is_answer = result.is_finite() && result >= 0.0;
            let error = is_answer.then_some((result - truth).abs());
            self.errors.add(error, |error| {
                let is_outlier = is_outlier(error, truth);
                [error > 1.0, error > 2.0, error > 3.0, is_outlier]
            });
        }
        Ok(())
    }

    /// Adds another collector's images.
    pub fn merge(&mut self, other: &Self) {
        self.errors.merge(&other.errors);
        self.n_ignored += other.n_ignored;
    }

    /// The figures of all that was added.
    #[must_use]
    pub fn scores(&self) -> Scores {
        let [bad1, bad2, bad3, d1] = self.errors.wrong_percent();
        Scores {
            d1,
            epe_px: self.errors.mean_px(),
            bad1,
            bad2,
            bad3,
            density: self.errors.density_percent(),
            n_scored: self.errors.n_scored,
            n_ignored: self.n_ignored,
        }
    }
}

/// The figures.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Scores {
    /// Share of outliers: more than 3 pixels and more than 5 % wrong; percent.
    pub d1: Option<f64>,
    /// Mean error of what was answered, pixels.
    pub epe_px: Option<f64>,
    /// Share of pixels that are more than 1 pixel wrong, percent.
    pub bad1: Option<f64>,
    /// Share of pixels that are more than 2 pixels wrong, percent.
    pub bad2: Option<f64>,
    /// Share of pixels that are more than 3 pixels wrong, percent.
    pub bad3: Option<f64>,
    /// Share of scored pixels that have an answer, percent.
    pub density: Option<f64>,
    /// Pixels that were scored, with an answer or without.
    pub n_scored: u64,
    /// Pixels that were left out.
    pub n_ignored: u64,
}

impl Scores {
    /// The figures that exist: `D1`, `EPE`, `bad1`, `bad2`, `bad3` and `density`.
    #[must_use]
    pub fn named(&self) -> BTreeMap<String, f64> {
        existing([
            ("D1", self.d1),
            ("EPE", self.epe_px),
            ("bad1", self.bad1),
            ("bad2", self.bad2),
            ("bad3", self.bad3),
            ("density", self.density),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_outlier_is_wrong_by_pixels_and_by_percent() {
        let mut collector = Collector::new();
        // 4 of 100 pixels is within 5 %, 4 of 50 is not; the third is no answer.
        let truth = [100.0, 50.0, 50.0, 0.0];
        let result = [104.0, 54.0, -1.0, 9.0];
        collector.add(&truth, &result, None).unwrap();
        let scores = collector.scores();
        assert_eq!(scores.epe_px, Some(4.0));
        assert_eq!(scores.d1, Some(200.0 / 3.0));
        assert_eq!(scores.bad3, Some(100.0));
        assert_eq!((scores.n_scored, scores.n_ignored), (3, 1));
        let mut twice = collector.clone();
        twice.merge(&collector);
        assert_eq!(twice.scores().named(), scores.named());
    }

    #[test]
    fn disparity_is_focal_length_times_baseline_over_depth() {
        assert_eq!(disparity_px(10.0, 500.0, 0.2), 10.0);
        assert_eq!(disparity_px(f32::INFINITY, 500.0, 0.2), 0.0);
    }
}
