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
mod objects;
mod pairs;
mod regions;
mod scores;

use std::collections::{BTreeMap, BTreeSet};

use accumulate::Rows;
pub use objects::{ANY_CLASS, Detection, Truth};
pub use pairs::{MAX_DETECTIONS, Matches, Pairs};
pub use regions::{BoxPx, MaskError, Region, RunMask};
pub use scores::{ClassScores, Scores};

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

#[cfg(test)]
mod tests;
