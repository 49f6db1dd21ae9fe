//! Average precision of boxes in images and of masks, by the rules of COCO's detection challenge
//! (Lin et al., "Microsoft COCO: Common Objects in Context", and its public evaluation code).
//!
//! In each image and class the detections, best score first, each take the truth that they overlap
//! most, if the overlap (intersection over union) reaches a threshold and nobody took it before.
//! Over all images, again best score first, precision is drawn over recall; its upper envelope,
//! read at 101 recalls from 0 to 1, has the average precision as its mean. `AP` is the mean over
//! the thresholds 0.50, 0.55 … 0.95 and over classes, `AP50` and `AP75` stand for one threshold,
//! `APs`, `APm`, `APl` for truths below 32², from 32² to 96² and above 96² square pixels. `AR1`,
//! `AR10`, `AR100` are the mean recall with that many detections per image and class.
//!
//! Two kinds of truth do not count, neither found nor missed:
//!
//! - **ignored**: takes at most one detection that found no counted truth, which then does not
//!   count either;
//! - **crowd**: takes any number of them, and what has to reach the threshold is the share of the
//!   detection that lies inside.
//!
//! A class without counted truths has no scores, whatever was detected of it. Detections with equal
//! scores keep their order: within an image as given, and images as they were added. At most
//! [`MAX_DETECTIONS`] per image and class count, best first. What is not a region (numbers that are
//! not finite, corners in the wrong order) or has no finite score is left out and counted in
//! [`Collector::n_invalid`].

mod accumulate;
mod pairs;
mod regions;

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use accumulate::Rows;
pub use pairs::{MAX_DETECTIONS, Matches, Pairs};
pub use regions::{BoxPx, MaskError, Region, RunMask};

/// Class of a truth that belongs to every class and is ignored in each: a region that is left out.
pub const ANY_CLASS: u32 = u32::MAX;

/// An object, or a region that does not count.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth<R> {
    /// Its class, or [`ANY_CLASS`].
    pub class: u32,
    /// Where it is.
    pub region: R,
    /// Area by which it is small, medium or large, square pixels.
    pub area_px: f64,
    /// A region with many objects of its class that are not told apart; does not count.
    pub crowd: bool,
    /// Does not count; always so in [`ANY_CLASS`].
    pub ignore: bool,
}

impl<R: Region> Truth<R> {
    /// An object that counts, with the area of its region.
    pub fn new(class: u32, region: R) -> Self {
        let area_px = region.area();
        Truth {
            class,
            region,
            area_px,
            crowd: false,
            ignore: false,
        }
    }

    /// A region of which any part may be detected any number of times.
    pub fn crowd(class: u32, region: R) -> Self {
        Truth {
            crowd: true,
            ..Truth::new(class, region)
        }
    }

    /// An object that does not count.
    pub fn ignored(class: u32, region: R) -> Self {
        Truth {
            ignore: true,
            ..Truth::new(class, region)
        }
    }
}

/// Something that was detected.
#[derive(Clone, Debug, PartialEq)]
pub struct Detection<R> {
    /// Its class.
    pub class: u32,
    /// Where it is.
    pub region: R,
    /// Confidence; only its order matters.
    pub score: f64,
    /// Does not count as false if it finds no truth.
    pub ignore_unmatched: bool,
}

impl<R> Detection<R> {
    /// A detection that counts as false if it finds no truth.
    pub fn new(class: u32, score: f64, region: R) -> Self {
        Detection {
            class,
            region,
            score,
            ignore_unmatched: false,
        }
    }
}

/// Takes images one by one. It keeps 32 bytes for each detection that counts.
#[derive(Clone, Debug, Default)]
pub struct Collector {
    only: Option<BTreeSet<u32>>,
    rows: BTreeMap<u32, Rows>,
    n_images: u64,
    n_invalid: u64,
}

impl Collector {
    /// A collector of all classes.
    pub fn new() -> Collector {
        Collector::default()
    }

    /// A collector that leaves out what has another class than these.
    pub fn for_classes(classes: &[u32]) -> Collector {
        Collector {
            only: Some(classes.iter().copied().collect()),
            ..Collector::default()
        }
    }

    /// Adds an image.
    pub fn add<R: Region>(&mut self, truths: &[Truth<R>], detections: &[Detection<R>]) {
        self.add_pairs(&Pairs::new(truths, detections));
    }

    /// Adds an image whose overlaps are known.
    pub fn add_pairs(&mut self, pairs: &Pairs) {
        self.add_part(pairs, |_| false, |_| false);
    }

    /// Adds a part of an image: truths for which `ignored_truth` is true are ignored, and detections
    /// for which `ignore_unmatched` is true do not count as false. Both are asked for the index in
    /// the lists that `pairs` was made of.
    pub fn add_part(
        &mut self,
        pairs: &Pairs,
        ignored_truth: impl Fn(usize) -> bool,
        ignore_unmatched: impl Fn(usize) -> bool,
    ) {
        self.n_images += 1;
        self.n_invalid += pairs.n_invalid;
        for pairs in &pairs.classes {
            if self
                .only
                .as_ref()
                .is_none_or(|only| only.contains(&pairs.class))
            {
                let rows = self.rows.entry(pairs.class).or_default();
                rows.add(pairs, &ignored_truth, &ignore_unmatched);
            }
        }
    }

    /// Adds all images of another collector behind the own ones.
    pub fn merge(&mut self, other: &Collector) {
        self.n_images += other.n_images;
        self.n_invalid += other.n_invalid;
        for (class, rows) in &other.rows {
            self.rows.entry(*class).or_default().merge(rows);
        }
    }

    /// Images so far.
    pub fn n_images(&self) -> u64 {
        self.n_images
    }

    /// Truths and detections that were left out because their numbers say nothing.
    pub fn n_invalid(&self) -> u64 {
        self.n_invalid
    }

    /// Scores of all images so far.
    pub fn scores(&self) -> Scores {
        let classes: BTreeMap<u32, ClassScores> = self
            .rows
            .iter()
            .map(|(class, rows)| (*class, rows.scores()))
            .collect();
        let all = ClassScores::mean(classes.values());
        Scores { all, classes }
    }
}

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
    /// Truths that are ignored or a crowd, without those of [`ANY_CLASS`].
    pub n_ignored: u64,
    /// Detections, of each image and class at most [`MAX_DETECTIONS`].
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
    fn mean<'a>(classes: impl Iterator<Item = &'a ClassScores>) -> ClassScores {
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

#[cfg(test)]
mod tests;
