//! When a process that ended by itself is started again, and how often.

use std::collections::VecDeque;
use std::process::ExitStatus;
use std::time::{Duration, Instant};

use launch_spec::{Restart, RestartPolicy};

/// The restarts of one process.
#[derive(Debug)]
pub struct Restarts {
    rule: Restart,
    /// Those within the window.
    times: VecDeque<Instant>,
    pause: Duration,
}

impl Restarts {
    /// None yet.
    pub fn of(rule: Restart) -> Self {
        Restarts {
            rule,
            times: VecDeque::new(),
            pause: rule.delay.duration(),
        }
    }

    /// Whether a process that ended so is started again.
    pub fn is_wanted(&self, status: ExitStatus) -> bool {
        match self.rule.policy {
            RestartPolicy::Never => false,
            RestartPolicy::OnFailure => !status.success(),
            RestartPolicy::Always => true,
        }
    }

    /// Counts a restart of a process that ran for `ran_for`: its number within the window, and the
    /// pause before it; `None` if there were too many.
    pub fn next(&mut self, now: Instant, ran_for: Duration) -> Option<(usize, Duration)> {
        let window = self.rule.window.duration();
        self.times.retain(|at| now.duration_since(*at) < window);
        if self.times.len() >= self.rule.max as usize {
            return None;
        }
        if ran_for > window {
            self.pause = self.rule.delay.duration();
        }
        self.times.push_back(now);
        let pause = self.pause;
        self.pause = pause
            .mul_f64(self.rule.factor)
            .min(self.rule.max_delay.duration());
        Some((self.times.len(), pause))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use launch_spec::Period;

    #[test]
    fn pauses_grow_to_their_limit_and_begin_anew_after_a_long_run() {
        let rule = Restart {
            policy: RestartPolicy::Always,
            delay: Period::from_millis(100),
            factor: 3.0,
            max_delay: Period::from_millis(500),
            max: 4,
            window: Period::from_millis(60_000),
        };
        let mut restarts = Restarts::of(rule);
        let start = Instant::now();
        let mut next = |secs: u64, ran_for_secs: u64| {
            let now = start + Duration::from_secs(secs);
            let next = restarts.next(now, Duration::from_secs(ran_for_secs));
            next.map(|(n, pause)| (n, pause.as_millis()))
        };
        assert_eq!(next(0, 0), Some((1, 100)));
        assert_eq!(next(1, 0), Some((2, 300)));
        assert_eq!(next(2, 0), Some((3, 500)));
        assert_eq!(next(3, 0), Some((4, 500)));
        assert_eq!(next(4, 0), None, "a fifth within a minute");
        // A minute after the first there is room for one more, and its pause is still the longest.
        assert_eq!(next(60, 50), Some((4, 500)));
        assert_eq!(next(200, 61), Some((1, 100)));
    }
}
