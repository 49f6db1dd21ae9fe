//! Axes of plots: even or logarithmic, with round ticks.

/// How values are spread over an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Evenly.
    Linear,
    /// By their logarithm; all are above zero.
    Log,
}

/// An axis.
#[derive(Clone, Debug)]
pub struct Axis {
    pub(super) label: String,
    lo: f64,
    hi: f64,
    scale: Scale,
    ticks: Vec<(f64, String)>,
}

impl Axis {
    /// An axis with round ticks that holds `lo` to `hi`.
    pub fn linear(label: &str, lo: f64, hi: f64) -> Axis {
        let hi = if hi > lo {
            hi
        } else {
            lo + lo.abs().max(1.0) * 0.1
        };
        let step = round_step((hi - lo) / 5.0);
        let decimals = (-step.log10().floor()).max(0.0) as usize;
        let (lo, hi) = (
            (lo / step + 1e-9).floor() * step,
            (hi / step - 1e-9).ceil() * step,
        );
        let n = ((hi - lo) / step).round() as usize;
        let ticks = (0..=n).map(|at| {
            let value = lo + at as f64 * step;
            let text = format!("{value:.decimals$}");
            let text = if text
                .trim_start_matches('-')
                .trim_matches(['0', '.'])
                .is_empty()
            {
                "0".into()
            } else {
                text
            };
            (value, text)
        });
        Axis {
            label: label.into(),
            lo,
            hi,
            scale: Scale::Linear,
            ticks: ticks.collect(),
        }
    }

    /// An axis for values: from zero unless they are close together and far from it.
    pub fn of_values(label: &str, values: impl Iterator<Item = f64>) -> Axis {
        let (mut lo, mut hi) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values {
            (lo, hi) = (lo.min(value), hi.max(value));
        }
        if !lo.is_finite() {
            (lo, hi) = (0.0, 1.0);
        }
        if lo > 0.0 && lo < 0.7 * hi {
            lo = 0.0;
        }
        if hi < 0.0 && hi > 0.7 * lo {
            hi = 0.0;
        }
        Axis::linear(label, lo, hi)
    }

    /// A logarithmic axis that holds `lo` to `hi`, both above zero, with ticks at 1, 2 and 5.
    pub fn log(label: &str, lo: f64, hi: f64) -> Axis {
        let lo = lo.max(1e-9);
        let hi = hi.max(lo * 1.5);
        let mut ticks = Vec::new();
        for decade in (lo.log10().floor() as i32)..=(hi.log10().ceil() as i32) {
            for digit in [1.0, 2.0, 5.0] {
                let value = digit * 10_f64.powi(decade);
                let decimals = (-decade).max(0) as usize;
                ticks.push((value, format!("{value:.decimals$}")));
            }
        }
        let first = ticks
            .iter()
            .rposition(|(value, _)| *value <= lo * 1.001)
            .unwrap_or(0);
        let last = ticks.iter().position(|(value, _)| *value >= hi * 0.999);
        let last = last.unwrap_or(ticks.len() - 1);
        let mut ticks = ticks[first..=last].to_vec();
        let (lo, hi) = (ticks[0].0, ticks[ticks.len() - 1].0);
        if (hi / lo).log10() > 3.0 {
            ticks.retain(|(value, _)| (value.log10() - value.log10().round()).abs() < 1e-6);
        }
        Axis {
            label: label.into(),
            lo,
            hi,
            scale: Scale::Log,
            ticks,
        }
    }

    /// An axis with these ticks and no others, from `lo` to `hi`.
    pub fn with_ticks(
        label: &str,
        scale: Scale,
        lo: f64,
        hi: f64,
        ticks: Vec<(f64, String)>,
    ) -> Axis {
        Axis {
            label: label.into(),
            lo,
            hi,
            scale,
            ticks,
        }
    }

    /// Its ticks: where, and what is written there.
    pub fn ticks(&self) -> &[(f64, String)] {
        &self.ticks
    }

    /// Where a value stands: 0 at the low end, 1 at the high one.
    pub(super) fn share(&self, value: f64) -> f64 {
        let share = match self.scale {
            Scale::Linear => (value - self.lo) / (self.hi - self.lo),
            Scale::Log => (value.max(1e-12) / self.lo).ln() / (self.hi / self.lo).ln(),
        };
        share.clamp(0.0, 1.0)
    }
}

/// 1, 2 or 5 times a power of ten, at least `least`.
fn round_step(least: f64) -> f64 {
    let power = 10_f64.powf(least.log10().floor());
    let steps = [1.0, 2.0, 5.0].map(|digit| digit * power);
    let found = steps.into_iter().find(|step| *step >= least * (1.0 - 1e-9));
    found.unwrap_or(10.0 * power)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(axis: &Axis) -> Vec<&str> {
        axis.ticks.iter().map(|(_, text)| text.as_str()).collect()
    }

    #[test]
    fn ticks_are_round_and_hold_the_values() {
        assert_eq!(
            texts(&Axis::linear("", 0.0, 0.93)),
            ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]
        );
        assert_eq!(
            texts(&Axis::linear("", -3.0, 21.0)),
            ["-5", "0", "5", "10", "15", "20", "25"]
        );
        assert_eq!(
            texts(&Axis::log("", 3.0, 80.0)),
            ["2", "5", "10", "20", "50", "100"]
        );
        assert_eq!(
            texts(&Axis::log("", 0.02, 900.0)),
            ["0.1", "1", "10", "100", "1000"]
        );
        // One value alone, and nothing, still make an axis.
        for axis in [Axis::linear("", 5.0, 5.0), Axis::log("", 0.0, 0.0)] {
            assert!(axis.hi > axis.lo && axis.ticks.len() > 1, "{axis:?}");
        }
        let axis = Axis::log("", 1.0, 100.0);
        assert!((axis.share(10.0) - 0.5).abs() < 1e-12);
        assert_eq!((axis.share(0.0), axis.share(1e9)), (0.0, 1.0));
    }
}
