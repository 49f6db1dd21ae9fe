//! What became of every detection of one class, and its figures.

use super::pairs::{ClassPairs, by_score};
use super::scores::ClassScores;

/// Thresholds of overlap: 0.50, 0.55 … 0.95, rounded as an even division of the span is.
const OVERLAPS: [f64; 10] = {
    let step = (0.95 - 0.5) / 9.0;
    let mut overlaps = [0.95; 10];
    let mut i = 0;
    while i < 9 {
        overlaps[i] = i as f64 * step + 0.5;
        i += 1;
    }
    overlaps
};

/// Recalls at which precision is read are the multiples of this up to 1.
const RECALL_STEP: f64 = 0.01;
const N_RECALLS: u32 = 101;

/// All, small, medium and large: smallest and largest area, square pixels.
const AREAS: [[f64; 2]; 4] = [[0.0, 1e10], [0.0, 1024.0], [1024.0, 9216.0], [9216.0, 1e10]];

/// Numbers of detections per image for which recall is told.
const LIMITS: [u8; 3] = [1, 10, 100];

/// One bit for each threshold, for each range of areas.
const ALL_BITS: u64 = (1 << (OVERLAPS.len() * AREAS.len())) - 1;

fn bit(area: usize, threshold: usize) -> u64 {
    1 << (area * OVERLAPS.len() + threshold)
}

/// Bits of the ranges in which an area does not lie.
fn outside(area_px: f64) -> u64 {
    let mut bits = 0;
    for (i, [least, most]) in AREAS.into_iter().enumerate() {
        if area_px < least || area_px > most {
            bits |= bits_of(i);
        }
    }
    bits
}

/// A detection.
#[derive(Clone, Copy, Debug)]
struct Row {
    score: f64,
    /// Where it found a truth that counts.
    right: u64,
    /// Where it counts as false.
    wrong: u64,
    /// Better detections in its image.
    rank: u8,
}

/// All detections of a class.
#[derive(Clone, Debug, Default)]
pub(super) struct Rows {
    rows: Vec<Row>,
    /// Truths that count, by range of areas.
    n_truths: [u64; 4],
    n_ignored: u64,
}

impl Rows {
    pub(super) fn add(
        &mut self,
        pairs: &ClassPairs,
        ignored_truth: &impl Fn(usize) -> bool,
        ignore_unmatched: &impl Fn(usize) -> bool,
    ) {
        // Where truths do not count, and where they were found.
        let mut ignored = Vec::with_capacity(pairs.truths.len());
        let mut taken = vec![0u64; pairs.truths.len()];
        for truth in &pairs.truths {
            let everywhere = truth.ignore || ignored_truth(truth.index);
            let bits = if everywhere {
                ALL_BITS
            } else {
                outside(truth.area_px)
            };
            for (area, n) in self.n_truths.iter_mut().enumerate() {
                *n += u64::from(bits & bit(area, 0) == 0);
            }
            self.n_ignored += u64::from(everywhere && truth.own);
            ignored.push(bits);
        }
        for (rank, detection) in pairs.detections.iter().enumerate() {
            let (mut right, mut found) = (0, 0);
            let overlaps = pairs.overlaps(detection).iter();
            let most = overlaps.map(|(_, overlap)| *overlap).fold(0.0, f64::max);
            for area in 0..AREAS.len() {
                for (threshold, iou) in OVERLAPS.into_iter().enumerate() {
                    if most < iou {
                        break;
                    }
                    let bit = bit(area, threshold);
                    let best = pairs.best(
                        detection,
                        iou,
                        |at| taken[at] & bit != 0,
                        |at| ignored[at] & bit != 0,
                    );
                    if let Some(at) = best {
                        found |= bit;
                        taken[at] |= bit;
                        right |= bit & !ignored[at];
                    }
                }
            }
            let left_out = if detection.ignore_unmatched || ignore_unmatched(detection.index) {
                ALL_BITS
            } else {
                outside(detection.area_px)
            };
            self.rows.push(Row {
                score: detection.score,
                right,
                wrong: ALL_BITS & !found & !left_out,
                rank: rank as u8,
            });
        }
    }

    pub(super) fn merge(&mut self, other: &Rows) {
        self.rows.extend_from_slice(&other.rows);
        for (n, others) in self.n_truths.iter_mut().zip(other.n_truths) {
            *n += others;
        }
        self.n_ignored += other.n_ignored;
    }

    pub(super) fn scores(&self) -> ClassScores {
        let mut rows = self.rows.clone();
        rows.sort_by(|a, b| by_score(a.score, b.score));
        let mut precisions = Vec::new();
        let mut precision = |area: usize, threshold: usize| {
            let n_truths = self.n_truths[area];
            average_precision(&rows, bit(area, threshold), n_truths, &mut precisions)
        };
        let mean_precision = |of: [Option<f64>; 10]| {
            let sum: Option<f64> = of.into_iter().sum();
            Some(sum? / of.len() as f64)
        };
        let mut by_area = [None; 4];
        let mut overall = [None; 10];
        for (area, mean) in by_area.iter_mut().enumerate() {
            let each = std::array::from_fn(|threshold| precision(area, threshold));
            if area == 0 {
                overall = each;
            }
            *mean = mean_precision(each);
        }
        let recall = |area: usize, limit: u8| {
            let bits = bits_of(area);
            let found = rows.iter().filter(|row| row.rank < limit);
            let found: u64 = found
                .map(|row| u64::from((row.right & bits).count_ones()))
                .sum();
            let n_truths = self.n_truths[area];
            (n_truths > 0).then(|| found as f64 / n_truths as f64 / OVERLAPS.len() as f64)
        };
        ClassScores {
            ap: by_area[0],
            ap50: overall[0],
            ap75: overall[5],
            ap_small: by_area[1],
            ap_medium: by_area[2],
            ap_large: by_area[3],
            ar1: recall(0, LIMITS[0]),
            ar10: recall(0, LIMITS[1]),
            ar100: recall(0, LIMITS[2]),
            ar_small: recall(1, LIMITS[2]),
            ar_medium: recall(2, LIMITS[2]),
            ar_large: recall(3, LIMITS[2]),
            n_truths: self.n_truths[0],
            n_ignored: self.n_ignored,
            n_detections: self.rows.len() as u64,
        }
    }
}

/// Bits of one range of areas.
fn bits_of(area: usize) -> u64 {
    (0..OVERLAPS.len()).fold(0, |bits, threshold| bits | bit(area, threshold))
}

/// Mean precision over all recalls; `None` without truths. Precision is highest and recall rises
/// where a truth is found, so these places are enough.
fn average_precision(
    rows: &[Row],
    bit: u64,
    n_truths: u64,
    precisions: &mut Vec<f64>,
) -> Option<f64> {
    if n_truths == 0 {
        return None;
    }
    precisions.clear();
    let mut n_wrong = 0u64;
    for row in rows {
        if row.right & bit != 0 {
            let n_right = (precisions.len() + 1) as f64;
            precisions.push(n_right / (n_wrong as f64 + n_right + f64::EPSILON));
        }
        n_wrong += u64::from(row.wrong & bit != 0);
    }
    for i in (1..precisions.len()).rev() {
        precisions[i - 1] = precisions[i - 1].max(precisions[i]);
    }
    let mut sum = 0.0;
    let mut at = 0;
    for i in 0..N_RECALLS {
        let recall = f64::from(i) * RECALL_STEP;
        while at < precisions.len() && ((at + 1) as f64 / n_truths as f64) < recall {
            at += 1;
        }
        sum += precisions.get(at).copied().unwrap_or(0.0);
    }
    Some(sum / f64::from(N_RECALLS))
}
