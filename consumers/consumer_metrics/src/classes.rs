//! Classes of pixels and of points: intersection over union per class and their mean.
//!
//! The confusion of all pixels (or points) of all frames is counted, and the figures follow from
//! it, as for Cityscapes (Cordts et al., 2016) and SemanticKITTI (Behley et al., 2019). Truths of
//! ignored classes are left out. A result with an ignored or unknown class is wrong: it misses the
//! true class, and is held against no other. Classes that occur neither in the truth nor in the
//! results have no figures and do not enter the means.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::numbers::{existing, share};
use crate::sizes::{SizesDiffer, same, same_if_any};

/// Classes are bytes.
const N_CLASSES: usize = 256;

/// What is counted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Settings {
    /// Truths of these classes are left out.
    pub ignored: Vec<u8>,
}

/// Counts frame by frame.
#[derive(Clone, Debug)]
pub struct Collector {
    is_ignored: [bool; N_CLASSES],
    /// By truth and result: `counts[truth * N_CLASSES + result]`.
    counts: Vec<u64>,
    n_ignored: u64,
}

impl Collector {
    /// Nothing counted yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        let mut is_ignored = [false; N_CLASSES];
        for class in settings.ignored {
            is_ignored[usize::from(class)] = true;
        }
        Self {
            is_ignored,
            counts: vec![0; N_CLASSES * N_CLASSES],
            n_ignored: 0,
        }
    }

    /// Adds a frame: the true and the given class of each pixel or point. Where the mask is false,
    /// nothing is counted.
    ///
    /// # Errors
    ///
    /// [`SizesDiffer`] if the lengths differ; nothing is added then.
    pub fn add(
        &mut self,
        truth: &[u8],
        result: &[u8],
        mask: Option<&[bool]>,
    ) -> Result<(), SizesDiffer> {
        same("the result", truth.len(), result.len())?;
        same_if_any("the mask", truth.len(), mask)?;
        for (at, (&truth, &result)) in truth.iter().zip(result).enumerate() {
            if self.is_ignored[usize::from(truth)] || mask.is_some_and(|mask| !mask[at]) {
                self.n_ignored += 1;
            } else {
                self.counts[usize::from(truth) * N_CLASSES + usize::from(result)] += 1;
            }
        }
        Ok(())
    }

    /// Adds another collector's frames.
    pub fn merge(&mut self, other: &Self) {
        for (mine, theirs) in self.counts.iter_mut().zip(&other.counts) {
            *mine += theirs;
        }
        self.n_ignored += other.n_ignored;
    }

    /// How many pixels or points of this true class were given that class.
    #[must_use]
    pub fn confusion(&self, truth: u8, result: u8) -> u64 {
        self.counts[usize::from(truth) * N_CLASSES + usize::from(result)]
    }

    /// The figures of all that was added.
    #[must_use]
    pub fn scores(&self) -> Scores {
        let mut n_truth = [0; N_CLASSES];
        let mut n_result = [0; N_CLASSES];
        for (truth, row) in self.counts.chunks_exact(N_CLASSES).enumerate() {
            for (result, count) in row.iter().enumerate() {
                n_truth[truth] += count;
                n_result[result] += count;
            }
        }
        let n_scored: u64 = n_truth.iter().sum();
        let mut scores = Scores {
            n_scored,
            n_ignored: self.n_ignored,
            ..Scores::default()
        };
        let (mut n_right, mut weighted, mut ious, mut accuracies) = (0, 0.0, vec![], vec![]);
        for class in 0..N_CLASSES {
            let right = self.counts[class * N_CLASSES + class];
            let union = n_truth[class] + n_result[class] - right;
            if union == 0 || self.is_ignored[class] {
                continue;
            }
            let iou = share(right, union);
            let accuracy = share(right, n_truth[class]);
            n_right += right;
            weighted += iou.unwrap_or(0.0) * n_truth[class] as f64;
            ious.extend(iou);
            accuracies.extend(accuracy);
            let of_class = ClassScores {
                iou,
                accuracy,
                n_truth: n_truth[class],
                n_result: n_result[class],
            };
            scores.classes.insert(class as u32, of_class);
        }
        scores.miou = mean_of(&ious);
        scores.mean_accuracy = mean_of(&accuracies);
        scores.accuracy = share(n_right, n_scored);
        scores.fwiou = (n_scored > 0).then(|| weighted / n_scored as f64);
        scores
    }
}

fn mean_of(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// The figures, 0 to 1.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Scores {
    /// Mean over classes of the intersection over union.
    pub miou: Option<f64>,
    /// Share of pixels or points with the right class.
    pub accuracy: Option<f64>,
    /// Mean over classes of the share of its truths that were found.
    pub mean_accuracy: Option<f64>,
    /// Intersection over union, weighted with how frequent each class is in the truth.
    pub fwiou: Option<f64>,
    /// By class.
    pub classes: BTreeMap<u32, ClassScores>,
    /// Pixels or points that were counted.
    pub n_scored: u64,
    /// Pixels or points that were left out.
    pub n_ignored: u64,
}

/// The figures of a class.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ClassScores {
    /// Intersection over union.
    pub iou: Option<f64>,
    /// Share of its truths that were found; `None` if there are none.
    pub accuracy: Option<f64>,
    /// Pixels or points that are of this class.
    pub n_truth: u64,
    /// Pixels or points that were given this class.
    pub n_result: u64,
}

impl Scores {
    /// The figures that exist: `mIoU`, `accuracy`, `mAcc` and `fwIoU`.
    #[must_use]
    pub fn named(&self) -> BTreeMap<String, f64> {
        existing([
            ("mIoU", self.miou),
            ("accuracy", self.accuracy),
            ("mAcc", self.mean_accuracy),
            ("fwIoU", self.fwiou),
        ])
    }

    /// The intersection over union of each class: `IoU/road`.
    #[must_use]
    pub fn named_classes(&self, name: impl Fn(u32) -> String) -> BTreeMap<String, f64> {
        let of_class =
            |(&class, scores): (&u32, &ClassScores)| (format!("IoU/{}", name(class)), scores.iou);
        existing(self.classes.iter().map(of_class))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_that_is_half_right() {
        // Class 1 has four truths; two are found, and two of class 0 are taken for it: 2 of 6.
        let truth = [1, 1, 1, 1, 0, 0, 0, 0, 0, 0];
        let result = [1, 1, 0, 0, 1, 1, 0, 0, 0, 0];
        let mut collector = Collector::new(Settings::default());
        collector.add(&truth, &result, None).unwrap();
        let scores = collector.scores();
        assert_eq!(scores.classes[&1].iou, Some(2.0 / 6.0));
        assert_eq!(scores.classes[&0].iou, Some(4.0 / 8.0));
        assert_eq!(scores.miou, Some((2.0 / 6.0 + 0.5) / 2.0));
        assert_eq!(scores.accuracy, Some(0.6));
        assert_eq!(collector.confusion(0, 1), 2);
        assert!(collector.add(&truth, &result[1..], None).is_err());
    }

    #[test]
    fn ignored_truths_do_not_count_and_ignored_results_are_wrong() {
        let settings = Settings { ignored: vec![255] };
        let mut collector = Collector::new(settings);
        let mask = [true, true, true, false];
        collector
            .add(&[255, 1, 1, 1], &[1, 255, 1, 0], Some(&mask))
            .unwrap();
        let scores = collector.scores();
        assert_eq!((scores.n_scored, scores.n_ignored), (2, 2));
        assert_eq!(scores.miou, Some(0.5));
        assert_eq!(
            scores.named_classes(|class| class.to_string())["IoU/1"],
            0.5
        );
        assert!(!scores.classes.contains_key(&255));
    }

    #[test]
    fn of_nothing_there_are_no_figures() {
        let scores = Collector::new(Settings::default()).scores();
        assert_eq!(scores, Scores::default());
        assert!(scores.named().is_empty());
    }
}
