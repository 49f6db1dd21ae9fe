//! A distribution of times as a report keeps it: its quantiles in milliseconds, and all of it as
//! HdrHistogram's compressed form.

use hdrhistogram::Histogram;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::times::{HistogramError, Times};

const NANOS_PER_MS: f64 = 1e6;

/// A distribution, milliseconds.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
pub struct Spread {
    /// How many.
    pub n: u64,
    /// Mean.
    pub mean: f64,
    /// Smallest.
    pub min: f64,
    /// Half are below.
    pub p50: f64,
    /// 90 % are below.
    pub p90: f64,
    /// 99 % are below.
    pub p99: f64,
    /// 99.9 % are below.
    pub p999: f64,
    /// Largest.
    pub max: f64,
    /// The whole distribution: HdrHistogram, V2 compressed, base64; values in nanoseconds.
    pub histogram: String,
}

impl Spread {
    /// The distribution of some times, nanoseconds; all zero if there are none.
    pub fn of(nanos: impl IntoIterator<Item = u64>) -> Spread {
        Spread::of_times(&nanos.into_iter().collect())
    }

    /// The distribution of recorded times.
    pub fn of_times(times: &Times) -> Spread {
        let all = times.histogram();
        if all.is_empty() {
            return Spread::default();
        }
        let ms = |nanos: u64| nanos as f64 / NANOS_PER_MS;
        let at = |quantile: f64| ms(all.value_at_quantile(quantile));
        Spread {
            n: all.len(),
            mean: all.mean() / NANOS_PER_MS,
            min: ms(all.min()),
            p50: at(0.5),
            p90: at(0.9),
            p99: at(0.99),
            p999: at(0.999),
            max: ms(all.max()),
            histogram: times.encode(),
        }
    }

    /// Several distributions together. Parts that cannot be read are left out.
    pub fn merged<'a>(parts: impl IntoIterator<Item = &'a Spread>) -> Spread {
        let mut all = Times::default();
        for part in parts {
            if let Ok(part) = Times::decode(&part.histogram) {
                all.add(&part);
            }
        }
        Spread::of_times(&all)
    }

    /// The time that half are below, milliseconds; `None` if there are none.
    pub fn shown_p50(&self) -> Option<f64> {
        (self.n > 0).then_some(self.p50)
    }

    /// The time that 99 % are below; `None` for fewer than 100 times, whose largest it would be.
    pub fn shown_p99(&self) -> Option<f64> {
        (self.n >= 100).then_some(self.p99)
    }

    /// The time that 99.9 % are below; `None` for fewer than 1000 times, whose largest it would be.
    pub fn shown_p999(&self) -> Option<f64> {
        (self.n >= 1000).then_some(self.p999)
    }

    /// The whole distribution, nanoseconds; an empty one if nothing was recorded.
    ///
    /// # Errors
    ///
    /// The text is no histogram.
    pub fn decode(&self) -> Result<Histogram<u64>, HistogramError> {
        Ok(Times::decode(&self.histogram)?.into_histogram())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::times::LONGEST_NANOS;

    #[test]
    fn a_spread_says_the_quantiles_of_its_times_and_keeps_them_all() {
        let spread = Spread::of((1..=1000).map(|ms| ms * 1_000_000));
        assert_eq!(spread.n, 1000);
        for (found, expected) in [
            (spread.mean, 500.5),
            (spread.min, 1.0),
            (spread.p50, 500.0),
            (spread.p90, 900.0),
            (spread.p99, 990.0),
            (spread.p999, 999.0),
            (spread.max, 1000.0),
        ] {
            assert!((found / expected - 1.0).abs() < 2e-3, "{found} {expected}");
        }
        let again = Spread::of_times(&Times::decode(&spread.histogram).unwrap());
        assert_eq!(
            (again.n, again.p50, again.histogram),
            (spread.n, spread.p50, spread.histogram)
        );
    }

    #[test]
    fn parts_together_are_the_whole() {
        let nanos = |from: u64| (from..from + 500).map(|n| n * n * 1000);
        let (a, b) = (Spread::of(nanos(1)), Spread::of(nanos(501)));
        let (whole, merged) = (
            Spread::of(nanos(1).chain(nanos(501))),
            Spread::merged([&a, &b]),
        );
        assert_eq!(merged.n, 1000);
        assert_eq!(
            (merged.p50, merged.p999, merged.max, merged.histogram),
            (whole.p50, whole.p999, whole.max, whole.histogram)
        );
    }

    #[test]
    fn nothing_is_zero_longest_is_capped_and_nonsense_is_refused() {
        let none = Spread::of([]);
        assert_eq!((none.n, none.max, none.histogram.as_str()), (0, 0.0, ""));
        assert!(none.decode().unwrap().is_empty());
        assert_eq!(Spread::merged([&none]).n, 0);
        assert!(Spread::of([u64::MAX]).max <= LONGEST_NANOS as f64 / NANOS_PER_MS * 1.001);
        for text in ["%", "AAAA"] {
            let bad = Spread {
                histogram: text.into(),
                ..Spread::default()
            };
            assert!(bad.decode().is_err(), "{text}");
        }
    }
}
