//! Lines at equal steps forward, and which of them are partners.

use super::settings::{Line, Settings};
use crate::assignment::{Pair, best_pairs};

/// A line at the steps of the settings; `None` where it is not.
pub(super) struct Sampled {
    at: Vec<Option<[f64; 2]>>,
    n_visible: usize,
}

/// A truth and its partner.
pub(super) struct Match {
    /// Which of the truths.
    pub(super) truth: usize,
    /// Whether enough of the truth lies near the result.
    pub(super) is_found: bool,
    /// Whether enough of the result lies near the truth.
    pub(super) is_right: bool,
    /// Mean errors over the steps that both have, metres: lateral near and far, height near and
    /// far.
    pub(super) errors_m: [Option<f64>; 4],
}

impl Sampled {
    /// `None` if the line has fewer than two steps in the range.
    pub(super) fn new(line: &Line, settings: &Settings) -> Option<Self> {
        let mut points: Vec<[f64; 3]> = line.clone();
        points.retain(|point| point.iter().all(|number| number.is_finite()));
        if points.first()?[0] > points.last()?[0] {
            points.reverse();
        }
        let mut farthest = f64::NEG_INFINITY;
        points.retain(|point| {
            let is_farther = point[0] > farthest;
            farthest = farthest.max(point[0]);
            is_farther
        });
        let at: Vec<_> = steps(settings).map(|x| place(&points, x)).collect();
        let n_visible = at.iter().flatten().count();
        (n_visible > 1).then_some(Self { at, n_visible })
    }
}

fn steps(settings: &Settings) -> impl Iterator<Item = f64> {
    let Settings {
        from_m,
        to_m,
        n_samples,
        ..
    } = *settings;
    (0..n_samples).map(move |at| from_m + (to_m - from_m) * at as f64 / n_samples as f64)
}

/// Lateral place and height of a line that runs forward.
fn place(points: &[[f64; 3]], x: f64) -> Option<[f64; 2]> {
    let above = points.partition_point(|point| point[0] < x);
    let end = points.get(above)?;
    if end[0] == x {
        return Some([end[1], end[2]]);
    }
    let begin = &points[above.checked_sub(1)?];
    let share = (x - begin[0]) / (end[0] - begin[0]);
    Some([1, 2].map(|axis| begin[axis] + (end[axis] - begin[axis]) * share))
}

/// All partners at a threshold.
pub(super) fn matches(
    truths: &[Sampled],
    results: &[Sampled],
    threshold_m: f64,
    settings: &Settings,
) -> Vec<Match> {
    let mut pairs = Vec::with_capacity(truths.len() * results.len());
    let mut costs = Vec::with_capacity(pairs.capacity());
    for (row, truth) in truths.iter().enumerate() {
        for (column, result) in results.iter().enumerate() {
            let cost = cost(truth, result, threshold_m, settings);
            // As many pairs as can be are made: each is worth more than all distances together.
            let worth = 1e9 - cost;
            pairs.push(Pair { row, column, worth });
            costs.push(cost);
        }
    }
    let chosen = best_pairs(&pairs);
    let limit = threshold_m * settings.n_samples as f64;
    chosen
        .into_iter()
        .filter(|&at| costs[at] < limit)
        .map(|at| {
            let Pair { row, column, .. } = pairs[at];
            compare(row, &truths[row], &results[column], threshold_m, settings)
        })
        .collect()
}

fn distance(truth: [f64; 2], result: [f64; 2], settings: &Settings) -> f64 {
    let height = if settings.use_height {
        truth[1] - result[1]
    } else {
        0.0
    };
    (truth[0] - result[0]).hypot(height)
}

/// OpenLane's cost of a pair: the sum of distances, cut to whole metres, but not to none.
fn cost(truth: &Sampled, result: &Sampled, threshold_m: f64, settings: &Settings) -> f64 {
    let sum: f64 = truth
        .at
        .iter()
        .zip(&result.at)
        .map(|places| match places {
            (Some(truth), Some(result)) => distance(*truth, *result, settings),
            (None, None) => 0.0,
            _ => threshold_m,
        })
        .sum();
    if sum > 0.0 { sum.max(1.0).floor() } else { 0.0 }
}

fn compare(
    row: usize,
    truth: &Sampled,
    result: &Sampled,
    threshold_m: f64,
    settings: &Settings,
) -> Match {
    let mut n_within = 0;
    let mut sums = [(0.0, 0_u64); 4];
    for ((truth, result), x) in truth.at.iter().zip(&result.at).zip(steps(settings)) {
        let (Some(truth), Some(result)) = (*truth, *result) else {
            continue;
        };
        n_within += usize::from(distance(truth, result, settings) < threshold_m);
        let is_far = usize::from(x > settings.near_m);
        for (which, axis) in [(is_far, 0), (2 + is_far, 1)] {
            sums[which].0 += (truth[axis] - result[axis]).abs();
            sums[which].1 += 1;
        }
    }
    let is_enough = |whole: usize| n_within as f64 / whole as f64 >= settings.share;
    Match {
        truth: row,
        is_found: is_enough(truth.n_visible),
        is_right: is_enough(result.n_visible),
        errors_m: sums.map(|(sum, n)| crate::numbers::mean(sum, n)),
    }
}
