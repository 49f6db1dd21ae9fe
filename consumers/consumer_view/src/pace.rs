//! Limits how often a topic is shown per second of wall time. If frames come faster, the average
//! rate is exactly the limit.

use std::time::{Duration, Instant};

/// One topic's pace.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    period: Duration,
    due: Option<Instant>,
}

impl Pace {
    /// At most `max_hz` per second; `max_hz` must be above 0.
    pub fn new(max_hz: f64) -> Pace {
        assert!(max_hz > 0.0, "a pace is above zero");
        Pace {
            period: Duration::from_secs_f64(1.0 / max_hz),
            due: None,
        }
    }

    /// Whether something that arrives now is shown. A single delay does not lower the average rate.
    pub fn admits(&mut self, now: Instant) -> bool {
        match self.due {
            Some(due) if now < due => false,
            Some(due) => {
                self.due = Some((due + self.period).max(now));
                true
            }
            None => {
                self.due = Some(now + self.period);
                true
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_input_rate_is_brought_down_to_the_limit_and_slow_ones_pass() {
        let start = Instant::now();
        for (input_hz, expected) in [(5u32, 50), (10, 100), (13, 100), (30, 100), (1000, 100)] {
            let mut pace = Pace::new(10.0);
            let n = (0..input_hz * 10)
                .filter(|i| pace.admits(start + Duration::from_secs(1) * *i / input_hz))
                .count();
            assert!(
                (expected - 2..=expected + 1).contains(&n),
                "{n} of {input_hz} Hz over ten seconds"
            );
        }
    }
}
