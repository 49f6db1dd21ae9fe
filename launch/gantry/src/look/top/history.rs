//! What was seen of one writer over time: its rate, its size and when it was last heard.

use std::collections::VecDeque;

use schema_bus::Newest;

/// Time over which a rate is taken, nanoseconds.
const WINDOW_NANOS: u64 = 5_000_000_000;
/// A writer is silent if nothing came for this long, nanoseconds …
const SILENT_NANOS: u64 = 1_500_000_000;
/// … and for this many of its periods.
const SILENT_PERIODS: f64 = 3.0;

/// The samples of one writer that were seen.
#[derive(Clone, Debug, Default)]
pub struct Track {
    seen: VecDeque<Seen>,
}

#[derive(Clone, Copy, Debug)]
struct Seen {
    /// The writer's clock where the header has it, else ours, nanoseconds.
    at_nanos: u64,
    sample: Newest,
}

impl Track {
    /// Notes the newest sample as of `now_nanos` (`CLOCK_MONOTONIC`).
    pub fn see(&mut self, sample: Newest, now_nanos: u64) {
        let at_nanos = sample.published_mono_nanos.unwrap_or(now_nanos);
        if let Some(last) = self.seen.back() {
            if last.sample == sample || last.at_nanos > at_nanos {
                return;
            }
            // A writer that began anew, or went back, says nothing about the rate before.
            if last.sample.epoch != sample.epoch || last.sample.seq > sample.seq {
                self.seen.clear();
            }
        }
        self.seen.push_back(Seen { at_nanos, sample });
        while self.seen.len() > 2 && at_nanos.saturating_sub(self.seen[0].at_nanos) > WINDOW_NANOS {
            self.seen.pop_front();
        }
    }

    /// The newest sample.
    pub fn newest(&self) -> Option<Newest> {
        self.seen.back().map(|seen| seen.sample)
    }

    /// Samples per second as of `now_nanos`, by the numbers that the writer gave them, so that
    /// those count which nobody saw. 0 of a silent writer, `None` as long as only one was seen.
    pub fn rate_hz(&self, now_nanos: u64) -> Option<f64> {
        let (first, last) = (self.seen.front()?, self.seen.back()?);
        let silence = now_nanos.saturating_sub(last.at_nanos);
        let nanos = last.at_nanos.saturating_sub(first.at_nanos);
        let n = last.sample.seq - first.sample.seq;
        if n == 0 || nanos == 0 {
            return (silence > SILENT_NANOS).then_some(0.0);
        }
        let period = nanos as f64 / n as f64;
        let is_silent = silence > SILENT_NANOS && silence as f64 > SILENT_PERIODS * period;
        Some(if is_silent { 0.0 } else { 1e9 / period })
    }

    /// Mean payload of the samples seen, bytes.
    pub fn mean_bytes(&self) -> Option<f64> {
        // As floating point, because a broken header may claim any number.
        let sizes = self
            .seen
            .iter()
            .map(|seen| seen.sample.payload_bytes as f64);
        (!self.seen.is_empty()).then(|| sizes.sum::<f64>() / self.seen.len() as f64)
    }

    /// Simulated seconds per second, of writers that stamp simulated time.
    pub fn speed(&self, now_nanos: u64) -> Option<f64> {
        let (first, last) = (self.seen.front()?, self.seen.back()?);
        if self.rate_hz(now_nanos)? == 0.0 {
            return Some(0.0);
        }
        let sim = last
            .sample
            .sim_nanos?
            .checked_sub(first.sample.sim_nanos?)?;
        let nanos = last.at_nanos.checked_sub(first.at_nanos)?;
        (nanos > 0).then(|| sim as f64 / nanos as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn sample(seq: u64, published_ms: u64) -> Newest {
        Newest {
            seq,
            sim_nanos: Some(seq * 50 * MS),
            published_mono_nanos: Some(published_ms * MS),
            payload_bytes: 100,
            epoch: 1,
            ..Newest::default()
        }
    }

    #[test]
    fn the_rate_counts_samples_that_were_not_seen() {
        let mut track = Track::default();
        assert_eq!(track.rate_hz(0), None);
        track.see(sample(10, 1000), 1001 * MS);
        assert_eq!(track.rate_hz(1001 * MS), None, "one sample is no rate");
        track.see(sample(10, 1000), 1500 * MS);
        track.see(sample(30, 2000), 2001 * MS);
        let rate = track.rate_hz(2001 * MS).unwrap();
        assert!((rate - 20.0).abs() < 1e-9, "{rate}");
        let speed = track.speed(2001 * MS).unwrap();
        assert!((speed - 1.0).abs() < 1e-9, "{speed}");
        assert_eq!(track.mean_bytes(), Some(100.0));
    }

    #[test]
    fn a_silent_writer_has_the_rate_zero_and_a_slow_one_keeps_its_own() {
        let mut track = Track::default();
        track.see(sample(1, 1000), 1000 * MS);
        assert_eq!(track.rate_hz(2600 * MS), Some(0.0));
        track.see(sample(2, 5000), 5000 * MS);
        // One sample in 4 s: 3 s of silence are usual.
        assert_eq!(track.rate_hz(8000 * MS), Some(0.25));
        assert_eq!(track.rate_hz(18_000 * MS), Some(0.0));
    }

    #[test]
    fn old_samples_leave_the_window_and_a_restart_empties_it() {
        let mut track = Track::default();
        for i in 0..40 {
            // 10 Hz for two seconds, then 2 Hz.
            let ms = if i < 20 {
                i * 100
            } else {
                2000 + (i - 20) * 500
            };
            track.see(sample(i, 1000 + ms), (1000 + ms) * MS);
        }
        let now = (1000 + 2000 + 19 * 500) * MS;
        assert!((track.rate_hz(now).unwrap() - 2.0).abs() < 1e-9);
        let mut anew = sample(1, 20_000);
        anew.epoch = 2;
        track.see(anew, 20_000 * MS);
        assert_eq!(track.rate_hz(20_000 * MS), None);
    }

    #[test]
    fn without_a_time_of_publishing_our_clock_counts() {
        let mut track = Track::default();
        for (seq, ms) in [(1, 1000), (2, 2000), (3, 3000)] {
            let sample = Newest {
                published_mono_nanos: None,
                sim_nanos: None,
                ..sample(seq, 0)
            };
            track.see(sample, ms * MS);
        }
        assert_eq!(track.rate_hz(3000 * MS), Some(1.0));
        assert_eq!(track.speed(3000 * MS), None);
    }
}
