//! What became of every detection of one class, and its curves of precision and errors over recall.

use super::frame::{Detection, Truth, best_first, distance, nearest};
use super::settings::{DISTANCES_M, Heading};

/// Names of the errors, in the order in which they are kept.
pub(super) const ERRORS: [&str; 5] = ["ATE", "ASE", "AOE", "AVE", "AAE"];

/// Index in [`DISTANCES_M`] of the distance at which errors are taken.
const AT_ERRORS: usize = 2;

/// Recalls of a curve: 0, 0.01 … 1.
const N_RECALLS: usize = 101;
const RECALL_STEP: f64 = 0.01;

/// The first recall that counts is the one behind 0.1.
const FIRST: usize = 11;

/// Precision below this counts as none.
const MIN_PRECISION: f64 = 0.1;

/// A detection; bits stand for [`DISTANCES_M`].
#[derive(Clone, Copy, Debug)]
struct Row {
    score: f64,
    right: u8,
    wrong: u8,
    /// Index of its errors, if it is right at 2 m.
    errors: u32,
}

/// All detections of a class.
#[derive(Clone, Debug, Default)]
pub(super) struct Rows {
    rows: Vec<Row>,
    /// In the order of [`ERRORS`]; NaN where a truth or detection does not have what it takes.
    errors: Vec<[f64; ERRORS.len()]>,
    pub(super) n_truths: u64,
    pub(super) n_ignored: u64,
    pub(super) has_velocity: bool,
    pub(super) has_attribute: bool,
}

/// Figures of a class with truths.
pub(super) struct Figures {
    pub(super) ap_at: [f64; 4],
    pub(super) errors: [f64; ERRORS.len()],
}

/// Truths and detections of one class and frame.
pub(super) struct Part<'a> {
    pub(super) truths: &'a [Truth],
    pub(super) detections: &'a [Detection],
    /// Those that count, as indices.
    pub(super) of_class: (Vec<usize>, Vec<usize>),
    pub(super) heading: Heading,
}

impl Rows {
    pub(super) fn add(
        &mut self,
        part: Part<'_>,
        ignored_truth: &impl Fn(usize) -> bool,
        ignore_unmatched: &impl Fn(usize) -> bool,
    ) {
        let (truths, mut found) = part.of_class;
        let ignored: Vec<bool> = truths
            .iter()
            .map(|index| part.truths[*index].ignore || ignored_truth(*index))
            .collect();
        for (index, ignored) in truths.iter().zip(&ignored) {
            let truth = &part.truths[*index];
            self.n_truths += u64::from(!ignored);
            self.n_ignored += u64::from(*ignored);
            self.has_velocity |= !ignored && truth.velocity_mps.is_some();
            self.has_attribute |= !ignored && truth.attribute.is_some();
        }
        let start = self.rows.len();
        self.rows.extend(found.iter().map(|index| Row {
            score: part.detections[*index].score,
            right: 0,
            wrong: 0,
            errors: 0,
        }));
        // Rows stay in the order in which detections were given, which decides between equals.
        let mut order: Vec<usize> = (0..found.len()).collect();
        order.sort_by(|a, b| best_first(part.detections, found[*a], found[*b]));
        let mut taken = vec![0u8; truths.len()];
        let mut distances_m = Vec::with_capacity(truths.len());
        for at in order {
            let index = std::mem::take(&mut found[at]);
            let detection = &part.detections[index];
            let row = &mut self.rows[start + at];
            distances_m.clear();
            let shapes = truths.iter().map(|truth| &part.truths[*truth].shape);
            distances_m.extend(shapes.map(|shape| shape.distance_m(&detection.shape)));
            for (i, limit_m) in DISTANCES_M.into_iter().enumerate() {
                let bit = 1 << i;
                let free = |at: usize| taken[at] & bit == 0;
                let counted = nearest(&distances_m, limit_m, |at| free(at) && !ignored[at]);
                if let Some(at) = counted {
                    taken[at] |= bit;
                    row.right |= bit;
                    if i == AT_ERRORS {
                        row.errors = self.errors.len() as u32;
                        let truth = &part.truths[truths[at]];
                        self.errors.push(errors(truth, detection, part.heading));
                    }
                    continue;
                }
                let left_out = nearest(&distances_m, limit_m, |at| free(at) && ignored[at]);
                if let Some(at) = left_out {
                    taken[at] |= bit;
                } else if !detection.ignore_unmatched && !ignore_unmatched(index) {
                    row.wrong |= bit;
                }
            }
        }
    }

    pub(super) fn merge(&mut self, other: &Rows) {
        let first = self.errors.len() as u32;
        self.rows.extend(other.rows.iter().map(|row| Row {
            errors: row.errors + first,
            ..*row
        }));
        self.errors.extend_from_slice(&other.errors);
        self.n_truths += other.n_truths;
        self.n_ignored += other.n_ignored;
        self.has_velocity |= other.has_velocity;
        self.has_attribute |= other.has_attribute;
    }

    pub(super) fn n_detections(&self) -> u64 {
        self.rows.len() as u64
    }

    /// `None` without truths that count.
    pub(super) fn figures(&self) -> Option<Figures> {
        if self.n_truths == 0 {
            return None;
        }
        let mut rows = self.rows.clone();
        rows.reverse();
        rows.sort_by(|a, b| {
            let order = b.score.partial_cmp(&a.score);
            order.unwrap_or(std::cmp::Ordering::Equal)
        });
        let curves: [Option<Curve>; 4] =
            std::array::from_fn(|at| Curve::new(&rows, 1 << at, self.n_truths));
        let errors = match &curves[AT_ERRORS] {
            Some(curve) => std::array::from_fn(|kind| {
                let right = rows.iter().filter(|row| row.right & (1 << AT_ERRORS) != 0);
                curve.mean_error(
                    right.map(|row| (row.score, self.errors[row.errors as usize][kind])),
                )
            }),
            None => [1.0; ERRORS.len()],
        };
        Some(Figures {
            ap_at: curves.map(|curve| curve.map_or(0.0, |curve| curve.average_precision())),
            errors,
        })
    }
}

/// Errors of a detection that found a truth.
fn errors(truth: &Truth, detection: &Detection, heading: Heading) -> [f64; ERRORS.len()] {
    let (shape, other) = (&truth.shape, &detection.shape);
    let velocity = truth.velocity_mps.zip(detection.velocity_mps);
    let period = match heading {
        Heading::HalfTurn => std::f64::consts::PI,
        Heading::Full | Heading::None => std::f64::consts::TAU,
    };
    [
        shape.distance_m(other),
        1.0 - shape.size_overlap(other),
        shape.turn_rad(other, period),
        velocity
            .map(|(a, b)| distance(a, b))
            .filter(|error| error.is_finite())
            .unwrap_or(f64::NAN),
        truth.attribute.map_or(f64::NAN, |attribute| {
            f64::from(u8::from(detection.attribute != Some(attribute)))
        }),
    ]
}

/// Precision and score at each recall.
struct Curve {
    precision: [f64; N_RECALLS],
    score: [f64; N_RECALLS],
}

impl Curve {
    /// The curve of all detections, best first; `None` if none is right.
    fn new(rows: &[Row], bit: u8, n_truths: u64) -> Option<Curve> {
        let (mut n_right, mut n_wrong) = (0u64, 0u64);
        let (mut recall, mut precision, mut score) = (Vec::new(), Vec::new(), Vec::new());
        for row in rows.iter().filter(|row| (row.right | row.wrong) & bit != 0) {
            n_right += u64::from(row.right & bit != 0);
            n_wrong += u64::from(row.wrong & bit != 0);
            recall.push(n_right as f64 / n_truths as f64);
            precision.push(n_right as f64 / (n_right + n_wrong) as f64);
            score.push(row.score);
        }
        let most = *recall.last().filter(|_| n_right > 0)?;
        let at = |values: &[f64]| {
            std::array::from_fn(|i| {
                let wanted = i as f64 * RECALL_STEP;
                if wanted > most {
                    0.0
                } else {
                    interpolated(&recall, values, wanted)
                }
            })
        };
        Some(Curve {
            precision: at(&precision),
            score: at(&score),
        })
    }

    fn average_precision(&self) -> f64 {
        let counted = &self.precision[FIRST..];
        let sum: f64 = counted.iter().map(|p| (p - MIN_PRECISION).max(0.0)).sum();
        sum / counted.len() as f64 / (1.0 - MIN_PRECISION)
    }

    /// Mean over the recalls that were reached of the mean error down to the score there, of scores
    /// and errors of what is right, best first.
    fn mean_error(&self, right: impl Iterator<Item = (f64, f64)>) -> f64 {
        let reached = self.score.iter().rposition(|score| *score != 0.0);
        let last = reached.unwrap_or(0);
        if last < FIRST {
            return 1.0;
        }
        let (mut scores, mut means) = (Vec::new(), Vec::new());
        let (mut sum, mut n) = (0.0, 0.0);
        for (score, error) in right {
            if !error.is_nan() {
                sum += error;
                n += 1.0;
            }
            scores.push(score);
            means.push(if n > 0.0 { sum / n } else { 0.0 });
        }
        if n == 0.0 {
            return 1.0;
        }
        scores.reverse();
        means.reverse();
        let reached = &self.score[FIRST..=last];
        let errors = reached
            .iter()
            .map(|score| interpolated(&scores, &means, *score));
        errors.sum::<f64>() / reached.len() as f64
    }
}

/// Value at `x` of the line through points whose `xs` do not fall; the first or last value beyond
/// them, and the last of those at the same `x`.
fn interpolated(xs: &[f64], ys: &[f64], x: f64) -> f64 {
    let behind = xs.partition_point(|known| *known <= x);
    if behind == 0 {
        return ys[0];
    }
    let at = behind - 1;
    if behind == xs.len() || xs[at] == x {
        return ys[at];
    }
    (ys[behind] - ys[at]) / (xs[behind] - xs[at]) * (x - xs[at]) + ys[at]
}
