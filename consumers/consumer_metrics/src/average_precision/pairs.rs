//! Which detections overlap which truths of an image, and who takes whom.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use super::objects::{ANY_CLASS, Detection, Truth};
use super::regions::Region;

/// Detections of an image and class that count, best scores first.
pub const MAX_DETECTIONS: usize = 100;

/// All overlaps of one image.
#[derive(Clone, Debug, Default)]
pub struct Pairs {
    pub(super) classes: Vec<ClassPairs>,
    pub(super) n_invalid: u64,
}

/// All overlaps of one class.
#[derive(Clone, Debug, Default)]
pub(super) struct ClassPairs {
    pub(super) class: u32,
    pub(super) truths: Vec<TruthEntry>,
    /// Best score first, at most [`MAX_DETECTIONS`].
    pub(super) detections: Vec<DetectionEntry>,
    /// Of one detection after another: position in `truths` and overlap, which is not 0.
    overlaps: Vec<(u32, f64)>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct TruthEntry {
    /// Index in the caller's list.
    pub(super) index: usize,
    pub(super) area_px: f64,
    pub(super) crowd: bool,
    pub(super) ignore: bool,
    /// Whether it belongs to this class, not to all.
    pub(super) own: bool,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct DetectionEntry {
    /// Index in the caller's list.
    pub(super) index: usize,
    pub(super) score: f64,
    pub(super) area_px: f64,
    pub(super) ignore_unmatched: bool,
    /// Its part of `overlaps`.
    first: u32,
    behind: u32,
}

/// Who found whom in an image at one threshold, as indices of truths and detections.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Matches {
    /// Truth that counts, and the detection that found it.
    pub pairs: Vec<(usize, usize)>,
    /// Truths that count and were not found.
    pub missed: Vec<usize>,
    /// Detections that count as false.
    pub unmatched: Vec<usize>,
}

/// Order of finite scores, best first; 0 and -0 are equal.
pub(super) fn by_score(a: f64, b: f64) -> Ordering {
    b.partial_cmp(&a).unwrap_or(Ordering::Equal)
}

impl Pairs {
    /// Overlaps of each detection with each truth of its class and of [`ANY_CLASS`].
    pub fn new<R: Region>(truths: &[Truth<R>], detections: &[Detection<R>]) -> Pairs {
        let mut by_class: BTreeMap<u32, (Vec<usize>, Vec<usize>)> = BTreeMap::new();
        let mut everywhere = Vec::new();
        let mut n_invalid = 0;
        for (index, truth) in truths.iter().enumerate() {
            if !truth.region.is_valid() {
                n_invalid += 1;
            } else if truth.class == ANY_CLASS {
                everywhere.push(index);
            } else {
                by_class.entry(truth.class).or_default().0.push(index);
            }
        }
        for (index, detection) in detections.iter().enumerate() {
            let valid = detection.region.is_valid() && detection.score.is_finite();
            if valid && detection.class != ANY_CLASS {
                by_class.entry(detection.class).or_default().1.push(index);
            } else {
                n_invalid += 1;
            }
        }
        let classes = by_class.into_iter().map(|(class, (own, mut found))| {
            found.sort_by(|a, b| by_score(detections[*a].score, detections[*b].score));
            found.truncate(MAX_DETECTIONS);
            let mut pairs = ClassPairs {
                class,
                ..ClassPairs::default()
            };
            for index in own.iter().chain(&everywhere) {
                let truth = &truths[*index];
                pairs.truths.push(TruthEntry {
                    index: *index,
                    area_px: truth.area_px,
                    crowd: truth.crowd,
                    ignore: truth.ignore || truth.crowd || truth.class == ANY_CLASS,
                    own: truth.class != ANY_CLASS,
                });
            }
            for index in found {
                let detection = &detections[index];
                let first = pairs.overlaps.len() as u32;
                for (at, entry) in pairs.truths.iter().enumerate() {
                    let truth = &truths[entry.index].region;
                    let overlap = detection.region.overlap(truth, entry.crowd);
                    if overlap > 0.0 {
                        pairs.overlaps.push((at as u32, overlap));
                    }
                }
                pairs.detections.push(DetectionEntry {
                    index,
                    score: detection.score,
                    area_px: detection.region.area(),
                    ignore_unmatched: detection.ignore_unmatched,
                    first,
                    behind: pairs.overlaps.len() as u32,
                });
            }
            pairs
        });
        Pairs {
            classes: classes.collect(),
            n_invalid,
        }
    }

    /// Who finds whom if overlaps must reach `iou` (0..=1), over truths of all sizes.
    pub fn matches(&self, iou: f64) -> Matches {
        let mut matches = Matches::default();
        for pairs in &self.classes {
            let mut taken = vec![false; pairs.truths.len()];
            for detection in &pairs.detections {
                let found =
                    pairs.best(detection, iou, |at| taken[at], |at| pairs.truths[at].ignore);
                match found {
                    Some(at) => {
                        taken[at] = true;
                        let truth = &pairs.truths[at];
                        if !truth.ignore {
                            matches.pairs.push((truth.index, detection.index));
                        }
                    }
                    None if detection.ignore_unmatched => {}
                    None => matches.unmatched.push(detection.index),
                }
            }
            let missed = pairs.truths.iter().zip(&taken);
            let missed = missed.filter(|(truth, taken)| !truth.ignore && !**taken);
            matches.missed.extend(missed.map(|(truth, _)| truth.index));
        }
        matches
    }
}

impl ClassPairs {
    /// Overlaps of a detection.
    pub(super) fn overlaps(&self, detection: &DetectionEntry) -> &[(u32, f64)] {
        &self.overlaps[detection.first as usize..detection.behind as usize]
    }

    /// Position of the truth that a detection takes: of those that are free and overlap it enough
    /// the one that overlaps most, the last one of equals, and an ignored one only if there is no
    /// other.
    #[inline]
    pub(super) fn best(
        &self,
        detection: &DetectionEntry,
        iou: f64,
        taken: impl Fn(usize) -> bool,
        ignored: impl Fn(usize) -> bool,
    ) -> Option<usize> {
        // COCO lets an overlap of 1 fall short by rounding.
        let enough = iou.min(1.0 - 1e-10);
        let (mut best, mut of_ignored) = ((enough, None), (enough, None));
        for (at, overlap) in self.overlaps(detection) {
            let at = *at as usize;
            let best = if ignored(at) {
                &mut of_ignored
            } else {
                &mut best
            };
            if *overlap >= best.0 && (self.truths[at].crowd || !taken(at)) {
                *best = (*overlap, Some(at));
            }
        }
        best.1.or(of_ignored.1)
    }
}
