//! Times while they are measured: recorded in nanoseconds to three digits.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use hdrhistogram::Histogram;
use hdrhistogram::serialization::{Deserializer, Serializer as _, V2DeflateSerializer};
use serde::Serialize;

/// Longest time that is recorded, nanoseconds; longer ones count as this.
pub const LONGEST_NANOS: u64 = 600_000_000_000;

/// Why the text of a histogram cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum HistogramError {
    /// It is no base64.
    #[error("a histogram of the report is no base64")]
    NoBase64(#[source] base64::DecodeError),
    /// The bytes are no histogram.
    #[error("a histogram of the report cannot be read: {0:?}")]
    Unreadable(hdrhistogram::serialization::DeserializeError),
}

/// Times recorded so far.
#[derive(Clone, Debug)]
pub struct Times {
    histogram: Histogram<u64>,
}

impl Default for Times {
    fn default() -> Self {
        Times {
            histogram: Histogram::new_with_bounds(1, LONGEST_NANOS, 3)
                .expect("the bounds are constants in order"),
        }
    }
}

impl Times {
    /// Adds a time.
    pub fn record(&mut self, nanos: u64) {
        self.histogram.saturating_record(nanos.max(1));
    }

    /// Adds all times of another distribution.
    pub fn add(&mut self, other: &Times) {
        // The bounds are the same or the histogram grows.
        self.histogram.auto(true);
        let _ = self.histogram.add(&other.histogram);
    }

    /// The histogram of nanoseconds, given away.
    pub fn into_histogram(self) -> Histogram<u64> {
        self.histogram
    }

    /// The histogram of nanoseconds.
    pub fn histogram(&self) -> &Histogram<u64> {
        &self.histogram
    }

    /// Everything as text: HdrHistogram's V2 form, compressed, base64.
    pub fn encode(&self) -> String {
        let mut bytes = Vec::new();
        V2DeflateSerializer::new()
            .serialize(&self.histogram, &mut bytes)
            .expect("a vector takes all bytes");
        STANDARD.encode(bytes)
    }

    /// The times of such a text; none of an empty one.
    ///
    /// # Errors
    ///
    /// The text is no histogram.
    pub fn decode(text: &str) -> Result<Times, HistogramError> {
        if text.is_empty() {
            return Ok(Times::default());
        }
        let bytes = STANDARD.decode(text).map_err(HistogramError::NoBase64)?;
        let histogram = Deserializer::new()
            .deserialize(&mut bytes.as_slice())
            .map_err(HistogramError::Unreadable)?;
        Ok(Times { histogram })
    }

    /// The figures of a table in microseconds; zeros without a sample.
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

impl FromIterator<u64> for Times {
    fn from_iter<I: IntoIterator<Item = u64>>(nanos: I) -> Self {
        let mut times = Times::default();
        nanos.into_iter().for_each(|nanos| times.record(nanos));
        times
    }
}

/// A distribution in four numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// How many.
    pub n: u64,
    /// Half are below.
    pub p50_us: f64,
    /// 99 % are below.
    pub p99_us: f64,
    /// 99.9 % are below.
    pub p999_us: f64,
    /// Largest.
    pub max_us: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_a_thousand_steps_are_the_steps() {
        let summary: Summary = (1..=1000).map(|i| i * 1000).collect::<Times>().summary();
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
            Times::default().summary(),
            Summary {
                n: 0,
                p50_us: 0.0,
                p99_us: 0.0,
                p999_us: 0.0,
                max_us: 0.0
            }
        );
        assert!(
            [u64::MAX].into_iter().collect::<Times>().summary().max_us
                <= LONGEST_NANOS as f64 * 1.01e-3
        );
    }
}
