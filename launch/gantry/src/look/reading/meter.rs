//! The figures of a topic over a time: rate, jitter, losses, sizes, ages and latencies.

use std::collections::BTreeMap;

use anyhow::Context as _;
use hdrhistogram::Histogram;
use serde_json::{Value, json};

use super::source::Stamp;

/// Counts samples as they come.
pub struct Meter {
    pub samples: u64,
    /// Gaps in the writers' numbers.
    pub lost: u64,
    pub bytes: u64,
    /// Least and greatest payload, bytes.
    pub sizes: Option<(u64, u64)>,
    /// Times between samples, by the writer's clock where its header has a time, nanoseconds.
    pub intervals: Histogram<u64>,
    /// Times from publishing until the sample was in hand, nanoseconds.
    pub ages: Histogram<u64>,
    /// Of results, by the input's topic: times from its publishing to the result's, nanoseconds.
    pub latencies: BTreeMap<String, Histogram<u64>>,
    /// Of results: times from the publishing of the oldest sensor frame behind them, nanoseconds.
    pub since_sensor: Histogram<u64>,
}

/// Where the writers were at their last samples. It outlives a meter, so that no gap between two
/// measurements is missed.
#[derive(Debug, Default)]
pub struct Previous {
    /// Epoch and number by writer.
    numbers: BTreeMap<String, (u64, u64)>,
    at_nanos: Option<u64>,
}

impl Meter {
    pub fn new() -> anyhow::Result<Self> {
        Ok(Meter {
            samples: 0,
            lost: 0,
            bytes: 0,
            sizes: None,
            intervals: histogram()?,
            ages: histogram()?,
            latencies: BTreeMap::new(),
            since_sensor: histogram()?,
        })
    }

    /// Counts a sample that was in hand at `now_nanos` (`CLOCK_MONOTONIC`).
    pub fn count(
        &mut self,
        stamp: &Stamp,
        previous: &mut Previous,
        now_nanos: u64,
    ) -> anyhow::Result<()> {
        self.samples += 1;
        self.bytes += stamp.bytes;
        let (least, most) = self.sizes.unwrap_or((stamp.bytes, stamp.bytes));
        self.sizes = Some((least.min(stamp.bytes), most.max(stamp.bytes)));
        if let Some(seq) = stamp.seq {
            let before = previous
                .numbers
                .insert(stamp.writer.clone(), (stamp.epoch, seq));
            // Another epoch, or a number that falls back, comes from a writer that began anew.
            if let Some((epoch, before)) = before
                && epoch == stamp.epoch
            {
                let gap = seq.saturating_sub(before.saturating_add(1));
                self.lost = self.lost.saturating_add(gap);
            }
        }
        let at = stamp.published_mono_nanos.unwrap_or(now_nanos);
        if let Some(before) = previous.at_nanos.replace(at) {
            note(&mut self.intervals, at.saturating_sub(before))?;
        }
        if let Some(published) = stamp.published_mono_nanos {
            note(&mut self.ages, now_nanos.saturating_sub(published))?;
        }
        for (input, nanos) in &stamp.answers {
            if !self.latencies.contains_key(input) {
                self.latencies.insert(input.clone(), histogram()?);
            }
            if let Some(times) = self.latencies.get_mut(input) {
                note(times, *nanos)?;
            }
        }
        if let Some(nanos) = stamp.since_sensor_nanos {
            note(&mut self.since_sensor, nanos)?;
        }
        Ok(())
    }

    /// Samples per second over `secs`: from the mean interval if there is one.
    pub fn rate_hz(&self, secs: f64) -> f64 {
        let mean = self.intervals.mean();
        if self.intervals.is_empty() || mean <= 0.0 {
            self.samples as f64 / secs
        } else {
            1e9 / mean
        }
    }
}

fn histogram() -> anyhow::Result<Histogram<u64>> {
    Histogram::new(3).context("cannot make a histogram")
}

fn note(times: &mut Histogram<u64>, nanos: u64) -> anyhow::Result<()> {
    times.record(nanos).context("a time is too long to count")
}

/// Adds least, percentiles and greatest as `NAME_nanos_p50` and so on; null without any.
pub fn quantiles_into(object: &mut Value, name: &str, times: &Histogram<u64>) {
    let at = |quantile: f64| times.value_at_quantile(quantile);
    let figures = [
        ("min", times.min()),
        ("p50", at(0.5)),
        ("p90", at(0.9)),
        ("p99", at(0.99)),
        ("p999", at(0.999)),
        ("max", times.max()),
    ];
    for (figure, value) in figures {
        object[format!("{name}_nanos_{figure}")] = match times.is_empty() {
            true => Value::Null,
            false => json!(value),
        };
    }
}

/// `min 0.1  p50 0.2  p99 0.3  max 0.4` in units of `nanos_each`.
pub fn spread(times: &Histogram<u64>, nanos_each: f64) -> String {
    let in_units = |nanos: u64| nanos as f64 / nanos_each;
    let [min, p50, p99, max] = [
        times.min(),
        times.value_at_quantile(0.5),
        times.value_at_quantile(0.99),
        times.max(),
    ]
    .map(in_units);
    format!("min {min:.3}  p50 {p50:.3}  p99 {p99:.3}  max {max:.3}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamp(epoch: u64, seq: u64, published: u64) -> Stamp {
        Stamp {
            epoch,
            seq: Some(seq),
            published_mono_nanos: Some(published),
            bytes: 10,
            ..Stamp::default()
        }
    }

    #[test]
    fn rate_comes_from_the_writers_clock_and_gaps_are_losses() {
        let (mut meter, mut previous) = (Meter::new().unwrap(), Previous::default());
        for seq in [1, 2, 3, 6, 7] {
            let at = seq * 50_000_000;
            meter
                .count(&stamp(1, seq, at), &mut previous, at + 1000)
                .unwrap();
        }
        assert_eq!((meter.samples, meter.lost, meter.bytes), (5, 2, 50));
        // Four intervals of 50, 50, 150 and 50 ms.
        let rate = meter.rate_hz(1.0);
        assert!((rate - 1e9 / 75e6).abs() < 0.05, "{rate}");
        assert!((990..=1010).contains(&meter.ages.value_at_quantile(0.5)));
        // A writer that began anew lost nothing, neither with a lower number nor with a higher one.
        meter
            .count(&stamp(2, 900, 1_000_000_000), &mut previous, 1_000_000_000)
            .unwrap();
        meter
            .count(&stamp(2, 5, 1_100_000_000), &mut previous, 1_100_000_000)
            .unwrap();
        assert_eq!(meter.lost, 2);
    }

    #[test]
    fn writers_of_one_topic_are_counted_apart() {
        let (mut meter, mut previous) = (Meter::new().unwrap(), Previous::default());
        for (writer, seq) in [("a", 1), ("b", 70), ("a", 2), ("b", 72)] {
            let stamp = Stamp {
                writer: writer.into(),
                seq: Some(seq),
                bytes: seq,
                ..Stamp::default()
            };
            meter.count(&stamp, &mut previous, 1).unwrap();
        }
        assert_eq!((meter.lost, meter.sizes), (1, Some((1, 72))));
        assert!(
            meter.ages.is_empty(),
            "without a time of publishing there is no age"
        );
    }

    #[test]
    fn latencies_are_kept_by_input() {
        let (mut meter, mut previous) = (Meter::new().unwrap(), Previous::default());
        let mut result = stamp(1, 1, 9_000_000);
        result.answers = vec![
            ("ego/front/rgb".into(), 4_000_000),
            ("a/boxes".into(), 1_000_000),
        ];
        result.since_sensor_nanos = Some(4_000_000);
        meter.count(&result, &mut previous, 9_500_000).unwrap();
        let p50 = |topic: &str| meter.latencies[topic].value_at_quantile(0.5);
        assert!((3_990_000..4_010_000).contains(&p50("ego/front/rgb")));
        assert!((999_000..1_001_000).contains(&p50("a/boxes")));
        let mut object = json!({});
        quantiles_into(&mut object, "delay", &Meter::new().unwrap().ages);
        assert!(object["delay_nanos_p50"].is_null());
    }
}
