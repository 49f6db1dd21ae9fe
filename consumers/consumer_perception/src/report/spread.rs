//! Distributions of times: recorded in nanoseconds to three digits, said in milliseconds, kept whole
//! as HdrHistogram's compressed form.

use anyhow::Context as _;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use hdrhistogram::Histogram;
use hdrhistogram::serialization::{Deserializer, Serializer as _, V2DeflateSerializer};

use super::types::Spread;

/// Longest time that is recorded, nanoseconds; longer ones count as this.
pub const LONGEST_NANOS: u64 = 600_000_000_000;

const NANOS_PER_MS: f64 = 1e6;

/// An empty histogram as all spreads use it: 1 ns to [`LONGEST_NANOS`], three digits.
pub fn histogram() -> Histogram<u64> {
    Histogram::new_with_bounds(1, LONGEST_NANOS, 3).expect("the bounds are constants in order")
}

impl Spread {
    /// The distribution of some times, nanoseconds; all zero if there are none.
    pub fn of(nanos: impl IntoIterator<Item = u64>) -> Spread {
        let mut all = histogram();
        for nanos in nanos {
            all.saturating_record(nanos.max(1));
        }
        Spread::of_histogram(&all)
    }

    /// The distribution in a histogram of nanoseconds.
    pub fn of_histogram(all: &Histogram<u64>) -> Spread {
        if all.is_empty() {
            return Spread::default();
        }
        let ms = |nanos: u64| nanos as f64 / NANOS_PER_MS;
        let at = |quantile: f64| ms(all.value_at_quantile(quantile));
        let mut bytes = Vec::new();
        V2DeflateSerializer::new()
            .serialize(all, &mut bytes)
            .expect("a vector takes all bytes");
        Spread {
            n: all.len(),
            mean: all.mean() / NANOS_PER_MS,
            min: ms(all.min()),
            p50: at(0.5),
            p90: at(0.9),
            p99: at(0.99),
            p999: at(0.999),
            max: ms(all.max()),
            histogram: STANDARD.encode(bytes),
        }
    }

    /// Several distributions together. Parts that cannot be read are left out.
    pub fn merged<'a>(parts: impl IntoIterator<Item = &'a Spread>) -> Spread {
        let mut all = histogram();
        for part in parts {
            if let Ok(part) = part.decode() {
                // The bounds are the same or the histogram grows.
                all.auto(true);
                let _ = all.add(&part);
            }
        }
        Spread::of_histogram(&all)
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
    pub fn decode(&self) -> anyhow::Result<Histogram<u64>> {
        if self.histogram.is_empty() {
            return Ok(histogram());
        }
        let bytes = STANDARD
            .decode(&self.histogram)
            .context("a histogram of the report is no base64")?;
        Deserializer::new()
            .deserialize(&mut bytes.as_slice())
            .map_err(|error| anyhow::anyhow!("a histogram of the report cannot be read: {error:?}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let again = Spread::of_histogram(&spread.decode().unwrap());
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
