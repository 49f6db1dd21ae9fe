//! Optical flow from events: the figures of DSEC's benchmark (Gehrig et al., 2021).
//!
//! The flow is the displacement of a pixel over a window (100 ms there). The angular error is the
//! angle between the vectors (u, v, 1) of truth and result, as Barron, Fleet and Beauchemin (1994)
//! introduced it. All pixels of all windows are one set. A pixel is scored if its true flow is
//! finite. A result that is not finite is no answer: it is wrong in every share, and does not enter
//! the means.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::numbers::{existing, mean, percent};
use crate::sizes::{SizesDiffer, same, same_if_any};

/// Counts window by window.
#[derive(Clone, Debug, Default)]
pub struct Collector {
    error_sum_px: f64,
    angle_sum_rad: f64,
    /// More than 1, 2 and 3 pixels wrong.
    n_bad: [u64; 3],
    n_answered: u64,
    n_scored: u64,
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
        same("the result", truth_px.len(), result_px.len())?;
        same_if_any("the mask", truth_px.len(), mask)?;
        for (at, (truth, result)) in truth_px.iter().zip(result_px).enumerate() {
            let ([u, v], [x, y]) = (truth.map(f64::from), result.map(f64::from));
            if !(u.is_finite() && v.is_finite()) || mask.is_some_and(|mask| !mask[at]) {
                self.n_ignored += 1;
                continue;
            }
            self.n_scored += 1;
            let mut error = f64::INFINITY;
            if x.is_finite() && y.is_finite() {
                error = (x - u).hypot(y - v);
                self.error_sum_px += error;
                // By the sine too: the cosine alone loses small angles.
                let sine = (v - y).hypot(x - u).hypot(u * y - v * x);
                self.angle_sum_rad += sine.atan2(u * x + v * y + 1.0);
                self.n_answered += 1;
            }
            for (limit, count) in [1.0, 2.0, 3.0].into_iter().zip(&mut self.n_bad) {
                *count += u64::from(error > limit);
            }
        }
        Ok(())
    }

    /// Adds another collector's windows.
    pub fn merge(&mut self, other: &Self) {
        self.error_sum_px += other.error_sum_px;
        self.angle_sum_rad += other.angle_sum_rad;
        for (mine, theirs) in self.n_bad.iter_mut().zip(other.n_bad) {
            *mine += theirs;
        }
        self.n_answered += other.n_answered;
        self.n_scored += other.n_scored;
        self.n_ignored += other.n_ignored;
    }

    /// The figures of all that was added.
    #[must_use]
    pub fn scores(&self) -> Scores {
        let [pe1, pe2, pe3] = self.n_bad.map(|bad| percent(bad, self.n_scored));
        Scores {
            epe_px: mean(self.error_sum_px, self.n_answered),
            pe1,
            pe2,
            pe3,
            ae_deg: mean(self.angle_sum_rad.to_degrees(), self.n_answered),
            density: percent(self.n_answered, self.n_scored),
            n_scored: self.n_scored,
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
