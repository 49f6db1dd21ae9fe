//! Figures and their names.

use std::collections::BTreeMap;

use serde::Serialize;

use super::curve::{ERRORS, Rows};
use super::settings::{ClassRule, DISTANCES_M, Heading};

/// Weight of `mAP` in `NDS`; each error has 1.
const MAP_WEIGHT: f64 = 5.0;

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
    pub(super) fn of(rows: &Rows, rule: &ClassRule) -> ClassScores {
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
    pub(super) fn be_absent(&mut self, rule: &ClassRule, exists: [bool; ERRORS.len()]) {
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
    pub(super) fn exists(classes: &BTreeMap<u32, ClassScores>) -> [bool; ERRORS.len()] {
        std::array::from_fn(|at| classes.values().any(|class| class.errors()[at].is_some()))
    }

    pub(super) fn of(classes: BTreeMap<u32, ClassScores>) -> Scores {
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
