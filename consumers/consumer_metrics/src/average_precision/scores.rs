//! Figures and their names.

use std::collections::BTreeMap;

use serde::Serialize;

/// Figures of all classes together and of each.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Scores {
    /// Means over the classes that have the figure.
    pub all: ClassScores,
    /// Figures of each class of which there was a truth or a detection.
    pub classes: BTreeMap<u32, ClassScores>,
}

impl Scores {
    /// The figures of all classes together that exist.
    pub fn named(&self) -> BTreeMap<String, f64> {
        let named = self.all.named().into_iter();
        named.map(|(key, value)| (key.to_owned(), value)).collect()
    }

    /// Of each class with truths those of `AP`, `AP50` and `AR100` that exist, e.g. as `AP/car`.
    pub fn named_classes(&self, name: impl Fn(u32) -> String) -> BTreeMap<String, f64> {
        let mut named = BTreeMap::new();
        for (class, scores) in &self.classes {
            for (key, value) in scores.named() {
                if ["AP", "AP50", "AR100"].contains(&key) {
                    named.insert(format!("{key}/{}", name(*class)), value);
                }
            }
        }
        named
    }
}

/// Figures of a class, or means over classes, 0..=1. `None`: no truth counts.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ClassScores {
    /// Average precision, mean over ten thresholds of overlap.
    pub ap: Option<f64>,
    /// Average precision with overlaps of at least 0.5.
    pub ap50: Option<f64>,
    /// Average precision with overlaps of at least 0.75.
    pub ap75: Option<f64>,
    /// `ap` of truths up to 32² square pixels.
    pub ap_small: Option<f64>,
    /// `ap` of truths from 32² to 96² square pixels.
    pub ap_medium: Option<f64>,
    /// `ap` of truths from 96² square pixels on.
    pub ap_large: Option<f64>,
    /// Recall with one detection per image and class, mean over ten thresholds of overlap.
    pub ar1: Option<f64>,
    /// The same with ten detections.
    pub ar10: Option<f64>,
    /// The same with a hundred.
    pub ar100: Option<f64>,
    /// `ar100` of truths up to 32² square pixels.
    pub ar_small: Option<f64>,
    /// `ar100` of truths from 32² to 96² square pixels.
    pub ar_medium: Option<f64>,
    /// `ar100` of truths from 96² square pixels on.
    pub ar_large: Option<f64>,
    /// Truths that count.
    pub n_truths: u64,
    /// Truths that are ignored or a crowd, without those of [`super::ANY_CLASS`].
    pub n_ignored: u64,
    /// Detections, of each image and class at most
    /// [`super::MAX_DETECTIONS`].
    pub n_detections: u64,
}

/// A figure of a class.
type Figure = fn(&mut ClassScores) -> &mut Option<f64>;

/// Every figure and its usual name.
const FIGURES: [(&str, Figure); 12] = [
    ("AP", |s| &mut s.ap),
    ("AP50", |s| &mut s.ap50),
    ("AP75", |s| &mut s.ap75),
    ("APs", |s| &mut s.ap_small),
    ("APm", |s| &mut s.ap_medium),
    ("APl", |s| &mut s.ap_large),
    ("AR1", |s| &mut s.ar1),
    ("AR10", |s| &mut s.ar10),
    ("AR100", |s| &mut s.ar100),
    ("ARs", |s| &mut s.ar_small),
    ("ARm", |s| &mut s.ar_medium),
    ("ARl", |s| &mut s.ar_large),
];

impl ClassScores {
    /// The figures that exist.
    fn named(&self) -> BTreeMap<&'static str, f64> {
        let mut own = self.clone();
        let named = FIGURES.iter();
        named
            .filter_map(|(name, figure)| Some((*name, (*figure(&mut own))?)))
            .collect()
    }

    /// Means of the figures over the classes that have them, and sums of the numbers.
    pub(super) fn mean<'a>(classes: impl Iterator<Item = &'a ClassScores>) -> ClassScores {
        let mut all = ClassScores::default();
        let mut n = [0.0; FIGURES.len()];
        for class in classes {
            let mut class = class.clone();
            for (n, (_, figure)) in n.iter_mut().zip(FIGURES) {
                if let Some(value) = *figure(&mut class) {
                    *figure(&mut all).get_or_insert(0.0) += value;
                    *n += 1.0;
                }
            }
            all.n_truths += class.n_truths;
            all.n_ignored += class.n_ignored;
            all.n_detections += class.n_detections;
        }
        for (n, (_, figure)) in n.iter().zip(FIGURES) {
            if let Some(sum) = figure(&mut all) {
                *sum /= n;
            }
        }
        all
    }
}
