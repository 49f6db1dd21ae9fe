//! A distribution of times, recorded in nanoseconds and reported as p50, p99, p99.9 and maximum in
//! microseconds.

use hdrhistogram::Histogram;
use serde::Serialize;

/// Longest time that is recorded; longer ones count as this.
const LONGEST_NANOS: u64 = 600_000_000_000;

/// Times recorded so far, to three digits.
#[derive(Debug)]
pub struct Spread {
    histogram: Histogram<u64>,
}

impl Default for Spread {
    fn default() -> Self {
        Spread {
            histogram: Histogram::new_with_bounds(1, LONGEST_NANOS, 3)
                .expect("the bounds are constants in order"),
        }
    }
}

impl Spread {
    /// Adds a time.
    pub fn record(&mut self, nanos: u64) {
        self.histogram.saturating_record(nanos.max(1));
    }

    /// The figures of a table; zeros without a sample.
    pub fn summary(&self) -> Summary {
        let micros = |quantile: f64| self.histogram.value_at_quantile(quantile) as f64 * 1e-3;
        Summary {
            n: self.histogram.len(),
            p50_us: micros(0.5),
            p99_us: micros(0.99),
            p999_us: micros(0.999),
            max_us: if self.histogram.is_empty() {
                0.0
            } else {
                self.histogram.max() as f64 * 1e-3
            },
        }
    }
}

impl FromIterator<u64> for Spread {
    fn from_iter<I: IntoIterator<Item = u64>>(nanos: I) -> Self {
        let mut spread = Spread::default();
        nanos.into_iter().for_each(|nanos| spread.record(nanos));
        spread
    }
}

/// A distribution in numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Summary {
    pub n: u64,
    pub p50_us: f64,
    pub p99_us: f64,
    pub p999_us: f64,
    pub max_us: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_a_thousand_steps_are_the_steps() {
        let summary: Summary = (1..=1000).map(|i| i * 1000).collect::<Spread>().summary();
        assert_eq!(summary.n, 1000);
        for (found, expected) in [
            (summary.p50_us, 500.0),
            (summary.p99_us, 990.0),
            (summary.p999_us, 999.0),
            (summary.max_us, 1000.0),
        ] {
            assert!(
                (found / expected - 1.0).abs() < 2e-3,
                "{found} is not {expected}"
            );
        }
    }

    #[test]
    fn nothing_seen_is_zero_and_ages_are_capped() {
        assert_eq!(
            Spread::default().summary(),
            Summary {
                n: 0,
                p50_us: 0.0,
                p99_us: 0.0,
                p999_us: 0.0,
                max_us: 0.0
            }
        );
        assert!(
            [u64::MAX].into_iter().collect::<Spread>().summary().max_us
                <= LONGEST_NANOS as f64 * 1.01e-3
        );
    }
}
