//! Optical flow: the figures of KITTI's flow benchmark of 2015 (Menze and Geiger), for all pixels
//! and for parts of them.
//!
//! All pixels of all frames are one set. A pixel is scored if its true flow is finite. A result
//! that is not finite is no answer: it is an outlier in every share, and does not enter the mean
//! error.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::errors::{Errors, is_outlier, length_px, masked};
use crate::numbers::existing;
use crate::sizes::{SizesDiffer, same_if_any};

/// Which pixels count, and as what.
#[derive(Clone, Copy, Debug, Default)]
pub struct Masks<'a> {
    /// Where it is false, nothing is scored.
    pub scored: Option<&'a [bool]>,
    /// Pixels of what moves by itself; the others are static.
    pub moving: Option<&'a [bool]>,
    /// Pixels of what the other image does not show; the others are visible.
    pub occluded: Option<&'a [bool]>,
}

/// Counts frame by frame.
#[derive(Clone, Debug, Default)]
pub struct Collector {
    all: Part,
    moving: Part,
    still: Part,
    occluded: Part,
    visible: Part,
    n_ignored: u64,
}

/// More than 1, 3 and 5 pixels wrong, and outliers by KITTI's rule.
type Part = Errors<4>;

fn part_scores(part: &Part) -> PartScores {
    let [px1, px3, px5, fl] = part.wrong_percent();
    PartScores {
        epe_px: part.mean_px(),
        fl,
        px1,
        px3,
        px5,
        density: part.density_percent(),
        n_scored: part.n_scored,
    }
}

fn part_scores_if_any(part: &Part) -> Option<PartScores> {
    (part.n_scored > 0).then(|| part_scores(part))
}

impl Collector {
    /// Nothing added yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a frame: the true and the given flow (right, down) of each pixel, pixels.
    ///
    /// # Errors
    ///
    /// [`SizesDiffer`] if the lengths differ; nothing is added then.
    pub fn add(
        &mut self,
        truth_px: &[[f32; 2]],
        result_px: &[[f32; 2]],
        masks: Masks<'_>,
    ) -> Result<(), SizesDiffer> {
        same_if_any("the mask of what moves", truth_px.len(), masks.moving)?;
        same_if_any("the mask of what is hidden", truth_px.len(), masks.occluded)?;
        for (at, pair) in masked(truth_px, result_px, masks.scored)?.enumerate() {
            let is_known = |([u, v], _): &([f32; 2], [f32; 2])| u.is_finite() && v.is_finite();
            let Some((truth, result)) = pair.filter(is_known) else {
                self.n_ignored += 1;
                continue;
            };
            let ([u, v], [x, y]) = (truth.map(f64::from), result.map(f64::from));
            let error = Some(length_px(x - u, y - v)).filter(|error| error.is_finite());
            let truth_length = length_px(u, v);
            let add = |part: &mut Part| {
                part.add(error, |error| {
                    let is_outlier = is_outlier(error, truth_length);
                    [error > 1.0, error > 3.0, error > 5.0, is_outlier]
                });
            };
            add(&mut self.all);
            match masks.moving.map(|mask| mask[at]) {
                Some(true) => add(&mut self.moving),
                Some(false) => add(&mut self.still),
                None => {}
            }
            match masks.occluded.map(|mask| mask[at]) {
                Some(true) => add(&mut self.occluded),
                Some(false) => add(&mut self.visible),
                None => {}
            }
        }
        Ok(())
    }

    /// Adds another collector's frames.
    pub fn merge(&mut self, other: &Self) {
        self.all.merge(&other.all);
        self.moving.merge(&other.moving);
        self.still.merge(&other.still);
        self.occluded.merge(&other.occluded);
        self.visible.merge(&other.visible);
        self.n_ignored += other.n_ignored;
    }

    /// The figures of all that was added.
    #[must_use]
    pub fn scores(&self) -> Scores {
        Scores {
            all: part_scores(&self.all),
            moving: part_scores_if_any(&self.moving),
            still: part_scores_if_any(&self.still),
            occluded: part_scores_if_any(&self.occluded),
            visible: part_scores_if_any(&self.visible),
            n_ignored: self.n_ignored,
        }
    }
}

/// The figures.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Scores {
    /// All scored pixels.
    pub all: PartScores,
    /// Pixels of what moves by itself; `None` if there were none.
    pub moving: Option<PartScores>,
    /// Pixels of what stands; `None` if no frame told what moves.
    pub still: Option<PartScores>,
    /// Pixels of what the other image does not show; `None` if there were none.
    pub occluded: Option<PartScores>,
    /// Pixels of what both images show; `None` if no frame told what is hidden.
    pub visible: Option<PartScores>,
    /// Pixels that were left out.
    pub n_ignored: u64,
}

/// The figures of a part of the pixels.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PartScores {
    /// Mean distance of the end points of what was answered, pixels.
    pub epe_px: Option<f64>,
    /// Share of outliers: more than 3 pixels and more than 5 % wrong; percent.
    pub fl: Option<f64>,
    /// Share of pixels that are more than 1 pixel wrong, percent.
    pub px1: Option<f64>,
    /// Share of pixels that are more than 3 pixels wrong, percent.
    pub px3: Option<f64>,
    /// Share of pixels that are more than 5 pixels wrong, percent.
    pub px5: Option<f64>,
    /// Share of scored pixels that have an answer, percent.
    pub density: Option<f64>,
    /// Pixels that were scored, with an answer or without.
    pub n_scored: u64,
}

impl Scores {
    /// The figures that exist: `EPE`, `Fl`, `1px`, `3px`, `5px` and `density`, and the first five
    /// for parts, `EPE/moving`, `/static`, `/occluded` and `/visible`.
    #[must_use]
    pub fn named(&self) -> BTreeMap<String, f64> {
        let mut named = self.all.named("");
        for (part, scores) in [
            ("/moving", &self.moving),
            ("/static", &self.still),
            ("/occluded", &self.occluded),
            ("/visible", &self.visible),
        ] {
            named.extend(scores.iter().flat_map(|scores| scores.named(part)));
        }
        named.extend(existing([("density", self.all.density)]));
        named
    }
}

impl PartScores {
    fn named(&self, part: &str) -> BTreeMap<String, f64> {
        existing([
            (format!("EPE{part}"), self.epe_px),
            (format!("Fl{part}"), self.fl),
            (format!("1px{part}"), self.px1),
            (format!("3px{part}"), self.px3),
            (format!("5px{part}"), self.px5),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_counted_by_themselves() {
        let truth = [[0.0, 0.0], [100.0, 0.0], [0.0, 10.0], [f32::NAN, 0.0]];
        let result = [[3.0, 4.0], [104.0, 0.0], [f32::NAN, 0.0], [0.0, 0.0]];
        let masks = Masks {
            scored: None,
            moving: Some(&[false, true, true, true]),
            occluded: Some(&[false; 4]),
        };
        let mut collector = Collector::new();
        collector.add(&truth, &result, masks).unwrap();
        let named = collector.scores().named();
        assert_eq!(named["EPE"], 4.5);
        assert_eq!(named["EPE/moving"], 4.0);
        assert_eq!(named["EPE/static"], 5.0);
        // 4 of 100 pixels is within 5 %; no answer is an outlier.
        assert_eq!(named["Fl/moving"], 50.0);
        assert_eq!(named["5px"], 100.0 / 3.0);
        assert_eq!(named["Fl/visible"], named["Fl"]);
        assert!(!named.contains_key("EPE/occluded"));
        assert_eq!(collector.scores().n_ignored, 1);
    }
}
