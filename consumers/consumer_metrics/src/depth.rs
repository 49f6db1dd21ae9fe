//! Depth of pixels: the figures of Eigen et al. (2014) and of KITTI's depth benchmark (Uhrig et
//! al., 2017).
//!
//! Each image gives its own figures, and every image counts the same, as in KITTI's development
//! kit. A pixel is scored if its truth lies between the two depths of the settings; results are
//! held to these depths first, as is usual since Eigen. A result that is not finite, zero or
//! negative is no answer: it enters the density and nothing else.

use std::collections::BTreeMap;

use consumer_report::interval::quantile;
use serde::Serialize;

use crate::numbers::{existing, mean, percent};
use crate::sizes::{SizesDiffer, same, same_if_any};

/// What is done with results before they are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scaling {
    /// Nothing: depths are metres.
    #[default]
    None,
    /// Each image is multiplied by the median of its truth over the median of its results, for
    /// methods that know depth only up to a factor.
    Median,
}

/// What is scored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Nearest truth that is scored, metres.
    pub min_m: f64,
    /// Farthest truth that is scored, metres.
    pub max_m: f64,
    /// What is done with results first.
    pub scaling: Scaling,
}

impl Default for Settings {
    /// 1 mm to 80 m, as for KITTI, and no scaling.
    fn default() -> Self {
        Self {
            min_m: 1e-3,
            max_m: 80.0,
            scaling: Scaling::None,
        }
    }
}

/// Sums over images of what each image gives.
#[derive(Clone, Debug)]
pub struct Collector {
    settings: Settings,
    /// In the order of [`image_figures`].
    sums: [f64; N_FIGURES],
    n_images: u64,
    n_answered: u64,
    n_scored: u64,
    n_ignored: u64,
}

const N_FIGURES: usize = 8;

impl Collector {
    /// Nothing added yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            sums: [0.0; N_FIGURES],
            n_images: 0,
            n_answered: 0,
            n_scored: 0,
            n_ignored: 0,
        }
    }

    /// Adds an image: the true and the given depth of each pixel, metres. Where the mask is false,
    /// nothing is scored. An image without any answer enters the density alone.
    ///
    /// # Errors
    ///
    /// [`SizesDiffer`] if the lengths differ; nothing is added then.
    pub fn add(
        &mut self,
        truth_m: &[f32],
        result_m: &[f32],
        mask: Option<&[bool]>,
    ) -> Result<(), SizesDiffer> {
        same("the result", truth_m.len(), result_m.len())?;
        same_if_any("the mask", truth_m.len(), mask)?;
        let Settings { min_m, max_m, .. } = self.settings;
        let mut pairs = Vec::with_capacity(truth_m.len());
        let mut n_scored = 0;
        for (at, (&truth, &result)) in truth_m.iter().zip(result_m).enumerate() {
            let (truth, result) = (f64::from(truth), f64::from(result));
            let is_scored = truth > min_m && truth < max_m && mask.is_none_or(|mask| mask[at]);
            n_scored += u64::from(is_scored);
            if is_scored && result.is_finite() && result > 0.0 {
                pairs.push((truth, result));
            }
        }
        self.n_scored += n_scored;
        self.n_ignored += truth_m.len() as u64 - n_scored;
        self.n_answered += pairs.len() as u64;
        if pairs.is_empty() {
            return Ok(());
        }
        let factor = self.factor(&pairs);
        for (_, result) in &mut pairs {
            *result = (*result * factor).max(min_m).min(max_m);
        }
        self.n_images += 1;
        for (sum, figure) in self.sums.iter_mut().zip(image_figures(&pairs)) {
            *sum += figure;
        }
        Ok(())
    }

    fn factor(&self, pairs: &[(f64, f64)]) -> f64 {
        if self.settings.scaling == Scaling::None {
            return 1.0;
        }
        let median = |of: fn(&(f64, f64)) -> f64| {
            quantile(&mut pairs.iter().map(of).collect::<Vec<_>>(), 0.5).unwrap_or(1.0)
        };
        median(|pair| pair.0) / median(|pair| pair.1)
    }

    /// Adds another collector's images.
    pub fn merge(&mut self, other: &Self) {
        for (mine, theirs) in self.sums.iter_mut().zip(other.sums) {
            *mine += theirs;
        }
        self.n_images += other.n_images;
        self.n_answered += other.n_answered;
        self.n_scored += other.n_scored;
        self.n_ignored += other.n_ignored;
    }

    /// The figures of all that was added.
    #[must_use]
    pub fn scores(&self) -> Scores {
        let [
            abs_rel,
            sq_rel,
            rmse_m,
            rmse_log,
            silog,
            delta1,
            delta2,
            delta3,
        ] = self.sums.map(|sum| mean(sum, self.n_images));
        Scores {
            abs_rel,
            sq_rel,
            rmse_m,
            rmse_log,
            silog,
            delta1,
            delta2,
            delta3,
            density: percent(self.n_answered, self.n_scored),
            n_images: self.n_images,
            n_scored: self.n_scored,
            n_ignored: self.n_ignored,
        }
    }
}

/// What the pixels of an image, at least one, say: `AbsRel`, `SqRel`, `RMSE`, `RMSElog`, `SILog`
/// and the three shares of pixels within a factor.
fn image_figures(pairs: &[(f64, f64)]) -> [f64; N_FIGURES] {
    let n = pairs.len() as f64;
    let (mut abs_rel, mut sq_rel, mut square, mut log_square) = (0.0, 0.0, 0.0, 0.0);
    let (mut log_shifted, mut log_shifted_square) = (0.0, 0.0);
    let mut within = [0.0; 3];
    // The variance is taken about the first value: near its mean, sums lose nothing.
    let log_first = (pairs[0].1 / pairs[0].0).ln();
    for &(truth, result) in pairs {
        let error = result - truth;
        abs_rel += error.abs() / truth;
        sq_rel += error * error / truth;
        square += error * error;
        let ratio = result / truth;
        let log = ratio.ln();
        log_square += log * log;
        log_shifted += log - log_first;
        log_shifted_square += (log - log_first) * (log - log_first);
        let factor = ratio.max(truth / result);
        for (power, count) in (1..).zip(&mut within) {
            *count += f64::from(u8::from(factor < 1.25_f64.powi(power)));
        }
    }
    let variance = log_shifted_square / n - (log_shifted / n) * (log_shifted / n);
    [
        abs_rel / n,
        sq_rel / n,
        (square / n).sqrt(),
        (log_square / n).sqrt(),
        100.0 * variance.max(0.0).sqrt(),
        within[0] / n,
        within[1] / n,
        within[2] / n,
    ]
}

/// The figures: means over images.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Scores {
    /// Mean of the error over the true depth.
    pub abs_rel: Option<f64>,
    /// Mean of the squared error over the true depth, metres.
    pub sq_rel: Option<f64>,
    /// Root of the mean squared error, metres.
    pub rmse_m: Option<f64>,
    /// Root of the mean squared error of the natural logarithms.
    pub rmse_log: Option<f64>,
    /// Standard deviation of the error of the natural logarithms, times 100, as KITTI prints it: an
    /// error that is blind to scale.
    pub silog: Option<f64>,
    /// Share of pixels within a factor of 1.25, 0 to 1.
    pub delta1: Option<f64>,
    /// Share of pixels within a factor of 1.25², 0 to 1.
    pub delta2: Option<f64>,
    /// Share of pixels within a factor of 1.25³, 0 to 1.
    pub delta3: Option<f64>,
    /// Share of scored pixels that have an answer, percent.
    pub density: Option<f64>,
    /// Images with an answer.
    pub n_images: u64,
    /// Pixels that were scored, with an answer or without.
    pub n_scored: u64,
    /// Pixels that were left out.
    pub n_ignored: u64,
}

impl Scores {
    /// The figures that exist: `AbsRel`, `SqRel`, `RMSE`, `RMSElog`, `SILog`, `d1`, `d2`, `d3` and
    /// `density`.
    #[must_use]
    pub fn named(&self) -> BTreeMap<String, f64> {
        existing([
            ("AbsRel", self.abs_rel),
            ("SqRel", self.sq_rel),
            ("RMSE", self.rmse_m),
            ("RMSElog", self.rmse_log),
            ("SILog", self.silog),
            ("d1", self.delta1),
            ("d2", self.delta2),
            ("d3", self.delta3),
            ("density", self.density),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: Option<f64>, wanted: f64) -> bool {
        found.is_some_and(|found| (found - wanted).abs() < 1e-7)
    }

    #[test]
    fn everything_a_tenth_too_far() {
        let truth = [1.0, 2.0, 4.0, 100.0, f32::INFINITY];
        let result = truth.map(|depth| depth * 1.1);
        let mut collector = Collector::new(Settings::default());
        collector.add(&truth, &result, None).unwrap();
        let scores = collector.scores();
        assert!(near(scores.abs_rel, 0.1));
        assert!(near(scores.rmse_m, (0.01 * 21.0 / 3.0_f64).sqrt()));
        assert!(near(scores.rmse_log, 1.1_f64.ln()));
        assert!(scores.silog.unwrap() < 1e-4, "{scores:?}");
        assert_eq!(scores.delta1, Some(1.0));
        assert_eq!((scores.n_scored, scores.n_ignored), (3, 2));
    }

    #[test]
    fn the_median_takes_away_a_factor() {
        let settings = Settings {
            scaling: Scaling::Median,
            ..Settings::default()
        };
        let mut collector = Collector::new(settings);
        let truth = [2.0, 4.0, 8.0];
        collector
            .add(&truth, &truth.map(|it| it / 8.0), None)
            .unwrap();
        let scores = collector.scores();
        assert_eq!((scores.abs_rel, scores.delta1), (Some(0.0), Some(1.0)));
    }

    #[test]
    fn no_answer_is_in_the_density_alone() {
        let mut collector = Collector::new(Settings::default());
        let result = [1.0, f32::NAN, 0.0, -1.0];
        collector.add(&[1.0; 4], &result, None).unwrap();
        // Every image counts the same, however many pixels it answers.
        collector.add(&[1.0; 2], &[2.0; 2], None).unwrap();
        let scores = collector.scores();
        assert_eq!(scores.abs_rel, Some(0.5));
        assert_eq!(scores.density, Some(50.0));
        collector.add(&[1.0; 2], &[0.0; 2], None).unwrap();
        assert_eq!(collector.scores().n_images, 2);
    }
}
