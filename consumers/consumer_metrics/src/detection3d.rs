//! Detection in space by the rules of nuScenes (Caesar et al., "nuScenes: A multimodal dataset for
//! autonomous driving", and its public development kit).
//!
//! In each frame and class the detections, best score first, each take the nearest truth that
//! nobody took, if the distance of the centres on the ground is less than a threshold: 0.5, 1, 2
//! and 4 m. The average precision at a threshold is the area under the curve of precision over
//! recall where both exceed 0.1, scaled to 0..=1; `mAP` is the mean over thresholds and classes.
//!
//! What was matched at 2 m has errors: of place (`ATE`, metres on the ground), size (`ASE`, one
//! minus the overlap of the boxes laid onto each other), heading (`AOE`, radians), velocity (`AVE`,
//! m/s on the ground) and attribute (`AAE`, share of wrong ones). A class has each as the mean over
//! recalls above 0.1 of the mean up to that recall, and 1 if it never gets there.
//!
//! `NDS` = (5 · mAP + Σ max(0, 1 − error)) / (5 + number of errors), over the means of the errors
//! **that exist**. With all five it is the score of nuScenes. An error exists in a class if its
//! [`ClassRule`] has it and, for velocity and attribute, if a truth has one; then a program that
//! says none gets 1. [`Scores::nds_parts`] names the errors that went into the score.
//!
//! Where nuScenes has no rule: an **ignored** truth takes at most one detection that found no
//! counted truth, which then does not count; detections that are not finite, or without size, are
//! left out and counted ([`Collector::n_invalid`]); of more than [`MAX_DETECTIONS`] in a frame,
//! which nuScenes refuses, the best count ([`Collector::n_too_many`]); a class without counted
//! truths has no scores unless [`Settings::count_absent`] is set. Of detections with equal scores
//! the one that was added last comes first.

mod curve;
mod frame;
mod scores;
mod settings;

use std::collections::BTreeMap;

use curve::Rows;
pub use frame::{Box3, Detection, MAX_DETECTIONS, Truth, matches};
pub use scores::{ClassScores, Scores};
pub use settings::{ClassRule, DISTANCES_M, Heading, Settings};

/// Takes frames one by one. It keeps 16 bytes for each detection that counts, and 40 more for each
/// that is right.
#[derive(Clone, Debug, Default)]
pub struct Collector {
    settings: Settings,
    rows: BTreeMap<u32, Rows>,
    n_frames: u64,
    n_invalid: u64,
    n_too_many: u64,
}

impl Collector {
    /// A collector of the classes that the settings name.
    pub fn new(settings: Settings) -> Collector {
        Collector {
            settings,
            ..Collector::default()
        }
    }

    /// Adds a frame. Truths and detections are in one space whose z axis points up.
    pub fn add(&mut self, truths: &[Truth], detections: &[Detection]) {
        self.add_part(truths, detections, |_| false, |_| false);
    }

    /// Adds a part of a frame: truths for which `ignored_truth` is true are ignored, and detections
    /// for which `ignore_unmatched` is true do not count as false. Both are asked for the index.
    pub fn add_part(
        &mut self,
        truths: &[Truth],
        detections: &[Detection],
        ignored_truth: impl Fn(usize) -> bool,
        ignore_unmatched: impl Fn(usize) -> bool,
    ) {
        self.n_frames += 1;
        let in_range = |class: u32, distance_m: f64| {
            let rule = self.settings.rule(class);
            rule.is_some_and(|rule| rule.range_m.is_none_or(|range_m| distance_m < range_m))
        };
        let frame = frame::Frame::new(truths, detections, in_range);
        self.n_invalid += frame.n_invalid;
        self.n_too_many += frame.n_too_many;
        for (class, of_class) in frame.classes {
            let part = curve::Part {
                truths,
                detections,
                of_class,
                heading: self.settings.rule(class).unwrap_or_default().heading,
            };
            let rows = self.rows.entry(class).or_default();
            rows.add(part, &ignored_truth, &ignore_unmatched);
        }
    }

    /// Adds all frames of another collector behind the own ones; the own settings hold.
    pub fn merge(&mut self, other: &Collector) {
        self.n_frames += other.n_frames;
        self.n_invalid += other.n_invalid;
        self.n_too_many += other.n_too_many;
        for (class, rows) in &other.rows {
            self.rows.entry(*class).or_default().merge(rows);
        }
    }

    /// Frames so far.
    pub fn n_frames(&self) -> u64 {
        self.n_frames
    }

    /// Truths and detections that were left out because their numbers say nothing.
    pub fn n_invalid(&self) -> u64 {
        self.n_invalid
    }

    /// Detections that were left out because their frame had more than [`MAX_DETECTIONS`].
    pub fn n_too_many(&self) -> u64 {
        self.n_too_many
    }

    /// Scores of all frames so far.
    pub fn scores(&self) -> Scores {
        let mut classes: BTreeMap<u32, ClassScores> = self
            .rows
            .iter()
            .map(|(class, rows)| {
                let rule = self.settings.rule(*class).unwrap_or_default();
                (*class, ClassScores::of(rows, &rule))
            })
            .collect();
        if self.settings.count_absent {
            let exists = Scores::exists(&classes);
            for (class, rule) in &self.settings.classes {
                let scores = classes.entry(*class).or_default();
                if scores.n_truths == 0 {
                    scores.be_absent(rule, exists);
                }
            }
        }
        Scores::of(classes)
    }
}

#[cfg(test)]
mod tests;
