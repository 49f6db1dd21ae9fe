//! Optical flow from events: the figures of DSEC's benchmark (Gehrig et al., 2021).
//!
//! The flow is the displacement of a pixel over a window (100 ms there). The angular error is the
//! angle between the vectors (u, v, 1) of truth and result, as Barron, Fleet and Beauchemin (1994)
//! introduced it. All pixels of all windows are one set. A pixel is scored if its true flow is
//! finite. A result that is not finite is no answer: it is wrong in every share, and does not enter
//! the means.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::errors::{Errors, length_px, masked};
use crate::numbers::existing;
use crate::sizes::SizesDiffer;

/// Counts window by window.
#[derive(Clone, Debug, Default)]
pub struct Collector {
    /// More than 1, 2 and 3 pixels wrong.
    errors: Errors<3>,
    angle_sum_rad: f64,
    n_ignored: u64,
}

impl Collector {
    /// Nothing added yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a window: the true and the given displacement (right, down) of each pixel over it,
    /// pixels. Where the mask is false, nothing is scored.
    ///
    /// # Errors
    ///
    /// [`SizesDiffer`] if the lengths differ; nothing is added then.
    pub fn add(
        &mut self,
        truth_px: &[[f32; 2]],
        result_px: &[[f32; 2]],
        mask: Option<&[bool]>,
    ) -> Result<(), SizesDiffer> {
        for pair in masked(truth_px, result_px, mask)? {
            let is_known = |([u, v], _): &([f32; 2], [f32; 2])| u.is_finite() && v.is_finite();
            let Some((truth, result)) = pair.filter(is_known) else {
                self.n_ignored += 1;
                continue;
            };
            let ([u, v], [x, y]) = (truth.map(f64::from), result.map(f64::from));
            let is_answer = x.is_finite() && y.is_finite();
            if is_answer {
                // By the sine too: the cosine alone loses small angles.
                let sine = length_px(length_px(v - y, x - u), u * y - v * x);
                self.angle_sum_rad += sine.atan2(u * x + v * y + 1.0);
            }
            let error = is_answer.then_some(length_px(x - u, y - v));
            self.errors
                .add(error, |error| [1.0, 2.0, 3.0].map(|limit| error > limit));
        }
        Ok(())
    }

    /// Adds another collector's windows.
    pub fn merge(&mut self, other: &Self) {
        self.errors.merge(&other.errors);
        self.angle_sum_rad += other.angle_sum_rad;
        self.n_ignored += other.n_ignored;
    }

    /// The figures of all that was added.
    #[must_use]
    pub fn scores(&self) -> Scores {
        let [pe1, pe2, pe3] = self.errors.wrong_percent();
        Scores {
            epe_px: self.errors.mean_px(),
            pe1,
            pe2,
            pe3,
            ae_deg: self.errors.mean_of(self.angle_sum_rad.to_degrees()),
            density: self.errors.density_percent(),
            n_scored: self.errors.n_scored,
            n_ignored: self.n_ignored,
        }
    }
}

/// The figures.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Scores {
    /// Mean distance of the end points of what was answered, pixels.
    pub epe_px: Option<f64>,
    /// Share of pixels that are more than 1 pixel wrong, percent.
    pub pe1: Option<f64>,
    /// Share of pixels that are more than 2 pixels wrong, percent.
    pub pe2: Option<f64>,
    /// Share of pixels that are more than 3 pixels wrong, percent.
    pub pe3: Option<f64>,
    /// Mean angle between (u, v, 1) of truth and result of what was answered, degrees.
    pub ae_deg: Option<f64>,
    /// Share of scored pixels that have an answer, percent.
    pub density: Option<f64>,
    /// Pixels that were scored, with an answer or without.
    pub n_scored: u64,
    /// Pixels that were left out.
    pub n_ignored: u64,
}

impl Scores {
    /// The figures that exist: `EPE`, `1PE`, `2PE`, `3PE`, `AE` and `density`.
    #[must_use]
    pub fn named(&self) -> BTreeMap<String, f64> {
        existing([
            ("EPE", self.epe_px),
            ("1PE", self.pe1),
            ("2PE", self.pe2),
            ("3PE", self.pe3),
            ("AE", self.ae_deg),
            ("density", self.density),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_pixel_of_flow_against_none_is_45_degrees() {
        let mut collector = Collector::new();
        collector.add(&[[1.0, 0.0]], &[[0.0, 0.0]], None).unwrap();
        let scores = collector.scores();
        assert!((scores.ae_deg.unwrap() - 45.0).abs() < 1e-12);
        assert_eq!((scores.epe_px, scores.pe1), (Some(1.0), Some(0.0)));
        let unknown = [[f32::NAN, 0.0]];
        collector.add(&[[1.0, 0.0]], &unknown, None).unwrap();
        let named = collector.scores().named();
        assert_eq!((named["EPE"], named["3PE"]), (1.0, 50.0));
        assert_eq!(named["density"], 50.0);
    }
}
