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

use std::collections::BTreeMap;

use serde::Serialize;

use curve::{ERRORS, Rows};
pub use frame::{Box3, Detection, Truth, matches};

/// Distances at which centres match, metres.
pub const DISTANCES_M: [f64; 4] = [0.5, 1.0, 2.0, 4.0];

/// Detections of a frame that count, best scores first.
pub const MAX_DETECTIONS: usize = 500;

/// Weight of `mAP` in `NDS`; each error has 1.
const MAP_WEIGHT: f64 = 5.0;

/// What of a box's heading can be told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Heading {
    /// Front and back differ.
    #[default]
    Full,
    /// Front and back are alike, as of a barrier: headings half a turn apart are equal.
    HalfTurn,
    /// It has none, as a traffic cone.
    None,
}

/// How a class is scored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClassRule {
    /// Truths and detections count below this distance from the vehicle, metres; `None`: all.
    pub range_m: Option<f64>,
    /// What of its heading can be told.
    pub heading: Heading,
    /// Whether it has a velocity.
    pub velocity: bool,
    /// Whether it has attributes.
    pub attribute: bool,
}

impl Default for ClassRule {
    /// Any distance, a full heading, velocity and attributes.
    fn default() -> Self {
        ClassRule {
            range_m: None,
            heading: Heading::Full,
            velocity: true,
            attribute: true,
        }
    }
}

/// What is scored.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// Classes that count and their rules; empty: all classes, with the default rule.
    pub classes: BTreeMap<u32, ClassRule>,
    /// Whether a class of `classes` without truths counts with precision 0 and errors 1, as
    /// nuScenes has it, instead of being left out.
    pub count_absent: bool,
}

impl Settings {
    fn rule(&self, class: u32) -> Option<ClassRule> {
        if self.classes.is_empty() {
            return Some(ClassRule::default());
        }
        self.classes.get(&class).copied()
    }
}

/// Takes frames one by one. It keeps 24 bytes for each detection that counts, and 40 more for each
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

/// Figures of all classes together and of each.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Scores {
    /// Mean average precision, 0..=1.
    pub map: Option<f64>,
    /// nuScenes' detection score, 0..=1, of the parts that exist.
    pub nds: Option<f64>,
    /// Mean over classes of the error of place, metres.
    pub ate_m: Option<f64>,
    /// Mean over classes of the error of size, 0..=1.
    pub ase: Option<f64>,
    /// Mean over classes of the error of heading, radians.
    pub aoe_rad: Option<f64>,
    /// Mean over classes of the error of velocity, m/s.
    pub ave_mps: Option<f64>,
    /// Mean over classes of the error of attributes, 0..=1.
    pub aae: Option<f64>,
    /// Mean over classes of the average precision at each of [`DISTANCES_M`].
    pub ap_at: [Option<f64>; 4],
    /// Errors that went into `nds`, e.g. `ATE`.
    pub nds_parts: Vec<&'static str>,
    /// Figures of each class of which there was a truth or a detection.
    pub classes: BTreeMap<u32, ClassScores>,
}

/// Figures of a class. `None`: no truth counts, or none has what the error is about.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ClassScores {
    /// Mean of `ap_at`.
    pub ap: Option<f64>,
    /// Average precision at each of [`DISTANCES_M`], 0..=1.
    pub ap_at: [Option<f64>; 4],
    /// Error of place, metres.
    pub ate_m: Option<f64>,
    /// Error of size, 0..=1.
    pub ase: Option<f64>,
    /// Error of heading, radians.
    pub aoe_rad: Option<f64>,
    /// Error of velocity, m/s.
    pub ave_mps: Option<f64>,
    /// Error of attributes, 0..=1.
    pub aae: Option<f64>,
    /// Truths that count.
    pub n_truths: u64,
    /// Truths in range that are ignored.
    pub n_ignored: u64,
    /// Detections in range.
    pub n_detections: u64,
}

impl ClassScores {
    fn of(rows: &Rows, rule: &ClassRule) -> ClassScores {
        let mut scores = ClassScores {
            n_truths: rows.n_truths,
            n_ignored: rows.n_ignored,
            n_detections: rows.n_detections(),
            ..ClassScores::default()
        };
        let Some(figures) = rows.figures() else {
            return scores;
        };
        scores.ap_at = figures.ap_at.map(Some);
        scores.ap = Some(figures.ap_at.iter().sum::<f64>() / figures.ap_at.len() as f64);
        let [place, size, heading, velocity, attribute] = figures.errors.map(Some);
        scores.ate_m = place;
        scores.ase = size;
        scores.aoe_rad = heading.filter(|_| rule.heading != Heading::None);
        scores.ave_mps = velocity.filter(|_| rule.velocity && rows.has_velocity);
        scores.aae = attribute.filter(|_| rule.attribute && rows.has_attribute);
        scores
    }

    fn errors(&self) -> [Option<f64>; ERRORS.len()] {
        [self.ate_m, self.ase, self.aoe_rad, self.ave_mps, self.aae]
    }

    /// Scores of a class without truths that counts nevertheless; `exists` says which errors any
    /// class has.
    fn be_absent(&mut self, rule: &ClassRule, exists: [bool; ERRORS.len()]) {
        self.ap = Some(0.0);
        self.ap_at = [Some(0.0); 4];
        let worst = |at: usize, has: bool| (has && exists[at]).then_some(1.0);
        self.ate_m = worst(0, true);
        self.ase = worst(1, true);
        self.aoe_rad = worst(2, rule.heading != Heading::None);
        self.ave_mps = worst(3, rule.velocity);
        self.aae = worst(4, rule.attribute);
    }
}

impl Scores {
    fn exists(classes: &BTreeMap<u32, ClassScores>) -> [bool; ERRORS.len()] {
        std::array::from_fn(|at| classes.values().any(|class| class.errors()[at].is_some()))
    }

    fn of(classes: BTreeMap<u32, ClassScores>) -> Scores {
        let mean = |figure: &dyn Fn(&ClassScores) -> Option<f64>| {
            let values: Vec<f64> = classes.values().filter_map(figure).collect();
            (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
        };
        let map = mean(&|class| class.ap);
        let errors: [Option<f64>; 5] = std::array::from_fn(|at| mean(&|class| class.errors()[at]));
        let n_errors = errors.iter().flatten().count() as f64;
        let right: f64 = errors.iter().flatten().map(|e| (1.0 - e).max(0.0)).sum();
        let names = ERRORS.into_iter().zip(errors);
        Scores {
            map,
            nds: map.map(|map| (MAP_WEIGHT * map + right) / (MAP_WEIGHT + n_errors)),
            ate_m: errors[0],
            ase: errors[1],
            aoe_rad: errors[2],
            ave_mps: errors[3],
            aae: errors[4],
            ap_at: std::array::from_fn(|at| mean(&|class| class.ap_at[at])),
            nds_parts: names
                .filter_map(|(name, error)| error.map(|_| name))
                .collect(),
            classes,
        }
    }

    /// The figures of all classes together that exist: `mAP`, `NDS`, `mATE` …, `AP@0.5m` ….
    pub fn named(&self) -> BTreeMap<String, f64> {
        let errors = [self.ate_m, self.ase, self.aoe_rad, self.ave_mps, self.aae];
        let errors = ERRORS.into_iter().zip(errors);
        let errors = errors.map(|(name, error)| (format!("m{name}"), error));
        let at = DISTANCES_M.into_iter().zip(self.ap_at);
        let at = at.map(|(distance_m, ap)| (format!("AP@{distance_m}m"), ap));
        let whole = [("mAP".to_owned(), self.map), ("NDS".to_owned(), self.nds)];
        let all = whole.into_iter().chain(errors).chain(at);
        all.filter_map(|(name, value)| Some((name, value?)))
            .collect()
    }

    /// Of each class the average precision and the errors that exist, e.g. as `AP/car`, `ATE/car`.
    pub fn named_classes(&self, name: impl Fn(u32) -> String) -> BTreeMap<String, f64> {
        let mut named = BTreeMap::new();
        for (class, scores) in &self.classes {
            let class = name(*class);
            let errors = ERRORS.into_iter().zip(scores.errors());
            for (key, value) in std::iter::once(("AP", scores.ap)).chain(errors) {
                named.extend(value.map(|value| (format!("{key}/{class}"), value)));
            }
        }
        named
    }
}

#[cfg(test)]
mod tests;
