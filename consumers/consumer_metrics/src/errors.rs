//! Errors of pixels: their mean, how many are too large, and how many pixels have no answer.

use crate::numbers::{mean, percent};
use crate::sizes::{SizesDiffer, same, same_if_any};

/// Counts of pixels, and of those that are wrong in each of so many ways.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Errors<const N: usize> {
    sum_px: f64,
    n_wrong: [u64; N],
    n_answered: u64,
    pub(crate) n_scored: u64,
}

impl<const N: usize> Default for Errors<N> {
    fn default() -> Self {
        Self {
            sum_px: 0.0,
            n_wrong: [0; N],
            n_answered: 0,
            n_scored: 0,
        }
    }
}

impl<const N: usize> Errors<N> {
    /// Adds a pixel: its error, unless it has no answer, and in which ways an error is wrong. No
    /// answer is as wrong as can be.
    pub(crate) fn add(&mut self, error_px: Option<f64>, is_wrong: impl Fn(f64) -> [bool; N]) {
        self.n_scored += 1;
        if let Some(error) = error_px {
            self.sum_px += error;
            self.n_answered += 1;
        }
        let ways = is_wrong(error_px.unwrap_or(f64::INFINITY));
        for (count, is_wrong) in self.n_wrong.iter_mut().zip(ways) {
            *count += u64::from(is_wrong);
        }
    }

    pub(crate) fn merge(&mut self, other: &Self) {
        self.sum_px += other.sum_px;
        for (mine, theirs) in self.n_wrong.iter_mut().zip(other.n_wrong) {
            *mine += theirs;
        }
        self.n_answered += other.n_answered;
        self.n_scored += other.n_scored;
    }

    /// Mean error of what was answered, pixels.
    pub(crate) fn mean_px(&self) -> Option<f64> {
        mean(self.sum_px, self.n_answered)
    }

    /// Mean over what was answered of something else that was summed.
    pub(crate) fn mean_of(&self, sum: f64) -> Option<f64> {
        mean(sum, self.n_answered)
    }

    /// Share of pixels that are wrong in each way, percent.
    pub(crate) fn wrong_percent(&self) -> [Option<f64>; N] {
        self.n_wrong.map(|wrong| percent(wrong, self.n_scored))
    }

    /// Share of pixels that have an answer, percent.
    pub(crate) fn density_percent(&self) -> Option<f64> {
        percent(self.n_answered, self.n_scored)
    }
}

/// Length of a vector; several times faster than `hypot`, which also knows numbers whose squares
/// are none, far beyond 32 bits.
pub(crate) fn length_px(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

/// KITTI's rule of outliers: more than 3 pixels and more than 5 % of the truth wrong.
pub(crate) fn is_outlier(error_px: f64, truth_px: f64) -> bool {
    error_px > 3.0 && error_px > 0.05 * truth_px
}

/// Truths and results of the pixels that the mask leaves, `None` for those that it takes out.
///
/// # Errors
///
/// [`SizesDiffer`] if the lengths differ.
pub(crate) fn masked<'a, T: Copy>(
    truth: &'a [T],
    result: &'a [T],
    mask: Option<&'a [bool]>,
) -> Result<impl Iterator<Item = Option<(T, T)>> + 'a, SizesDiffer> {
    same("the result", truth.len(), result.len())?;
    same_if_any("the mask", truth.len(), mask)?;
    let is_left = move |at: usize| mask.is_none_or(|mask| mask[at]);
    let pairs = truth.iter().zip(result).enumerate();
    Ok(pairs.map(move |(at, (&truth, &result))| is_left(at).then_some((truth, result))))
}
