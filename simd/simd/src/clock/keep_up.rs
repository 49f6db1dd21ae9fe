//! `--keep-up`: lets cameras and lidars fire at fewer ticks once the world falls behind real time.
//!
//! What it does depends on the machine, so nothing does it without being asked. Rates only fall: a
//! rig whose rates went up and down would be harder to use than a slow one.

/// Ticks after which it is looked whether real time was kept.
const WINDOW_TICKS: u64 = 20;
/// Windows in a row that must lag: one may hold a map load or a suspended machine.
const LAGGING_WINDOWS: u32 = 2;
/// Longer windows than this share of real time lag.
const TOLERANCE: f64 = 1.05;
/// Most ticks from one firing to the next.
const MOST: u64 = 20;

/// How many ticks lie between two firings of cameras and lidars: one, until the world lags.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeepUp {
    every: u64,
    /// Ticks of this window so far.
    n_ticks: u64,
    began_nanos: u64,
    n_lagging: u32,
}

impl Default for KeepUp {
    fn default() -> KeepUp {
        KeepUp {
            every: 1,
            n_ticks: 0,
            began_nanos: 0,
            n_lagging: 0,
        }
    }
}

impl KeepUp {
    /// Notes that a paced tick starts `period_nanos` after the one before, if real time is kept.
    /// Returns a new number of ticks from one firing to the next.
    pub fn note(&mut self, now_nanos: u64, period_nanos: u64) -> Option<u64> {
        if self.n_ticks < WINDOW_TICKS {
            if self.n_ticks == 0 {
                self.began_nanos = now_nanos;
            }
            self.n_ticks = self.n_ticks.saturating_add(1);
            return None;
        }
        let took = now_nanos.saturating_sub(self.began_nanos) as f64;
        let lag = took / period_nanos.saturating_mul(WINDOW_TICKS).max(1) as f64;
        (self.n_ticks, self.began_nanos) = (1, now_nanos);
        if lag <= TOLERANCE {
            self.n_lagging = 0;
            return None;
        }
        self.n_lagging = self.n_lagging.saturating_add(1);
        if self.n_lagging < LAGGING_WINDOWS || self.every == MOST {
            return None;
        }
        self.n_lagging = 0;
        // If sensors were all that a tick does, this would be enough.
        let enough = (self.every as f64 * lag).round() as u64;
        self.every = enough.clamp(self.every.saturating_add(1).min(MOST), MOST);
        Some(self.every)
    }

    /// Forgets what it has seen of a window: ticks do not follow real time now.
    pub fn pause(&mut self) {
        (self.n_ticks, self.n_lagging) = (0, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NANOS: u64 = 50_000_000;

    /// Where it ends after so many ticks, each of which takes `other` and, when sensors fire,
    /// `sensors` milliseconds more, or the period if that is longer.
    fn ends_at(n_ticks: u64, other: u64, sensors: u64, extra: impl Fn(u64) -> u64) -> (u64, u32) {
        let (mut keep_up, mut every, mut n_changes) = (KeepUp::default(), 1, 0);
        let (mut now_nanos, mut due_nanos) = (0, 0);
        for tick in 0..n_ticks {
            if let Some(fewer) = keep_up.note(now_nanos, PERIOD_NANOS) {
                assert!(fewer > every);
                (every, n_changes) = (fewer, n_changes + 1);
            }
            let millis = other + if tick % every == 0 { sensors } else { 0 } + extra(tick);
            due_nanos += PERIOD_NANOS;
            now_nanos = (now_nanos + millis * 1_000_000).max(due_nanos);
        }
        (every, n_changes)
    }

    #[test]
    fn a_world_that_keeps_real_time_stays_as_it_is() {
        assert_eq!(ends_at(1000, 10, 35, |_| 0), (1, 0));
    }

    #[test]
    fn one_long_stall_changes_nothing() {
        let stall = |tick| if tick == 300 { 4_000 } else { 0 };
        assert_eq!(ends_at(1000, 10, 35, stall), (1, 0));
    }

    #[test]
    fn rates_fall_until_real_time_is_kept() {
        // 10 + 70 / 2 ms fit a period of 50 ms, 10 + 70 do not.
        assert_eq!(ends_at(2000, 10, 70, |_| 0), (2, 1));
        // 10 + 200 / 5 fit just so; one step looks ahead by what all of the tick costs.
        let (every, n_changes) = ends_at(2000, 10, 200, |_| 0);
        assert!((5..=6).contains(&every) && n_changes <= 3, "{every}");
    }

    #[test]
    fn what_cannot_be_kept_ends_at_the_least_rate() {
        assert_eq!(ends_at(5000, 60, 10, |_| 0).0, MOST);
    }

    #[test]
    fn a_world_that_is_not_paced_is_not_judged() {
        let mut keep_up = KeepUp::default();
        for tick in 0..500 {
            assert_eq!(keep_up.note(tick * 10 * PERIOD_NANOS, PERIOD_NANOS), None);
            keep_up.pause();
        }
    }
}
