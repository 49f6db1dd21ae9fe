//! When a tick of a recording is due.
//!
//! Times are counted from one moment at which a simulated time was due, so lateness does not add up.
//! After a pause longer than [`GIVE_UP_NANOS`] the schedule starts anew, instead of racing through
//! what was missed.

/// Longest lateness that is made up for: a longer one is a slow participant or a suspended machine.
const GIVE_UP_NANOS: u64 = 500_000_000;

/// The schedule. Wall times are `CLOCK_MONOTONIC` nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// Simulated seconds per second; `None` for as fast as possible.
    ratio: Option<f64>,
    /// A wall time, and the simulated time that is due then.
    begin: Option<(u64, u64)>,
    n_late: u64,
    n_given_up: u64,
}

impl Pace {
    /// A schedule whose first tick is due at once.
    pub fn new(ratio: Option<f64>) -> Pace {
        Pace {
            ratio,
            begin: None,
            n_late: 0,
            n_given_up: 0,
        }
    }

    /// Simulated seconds per second; `None` for as fast as possible.
    pub fn ratio(&self) -> Option<f64> {
        self.ratio
    }

    /// Changes the speed; the next tick is due at once.
    pub fn set_ratio(&mut self, ratio: f64) {
        self.ratio = Some(ratio);
        self.begin = None;
    }

    /// Makes the next tick due at once.
    pub fn restart(&mut self) {
        self.begin = None;
    }

    /// When the tick at `sim_nanos` is due.
    pub fn due_nanos(&mut self, sim_nanos: u64, now_nanos: u64) -> u64 {
        let Some(ratio) = self.ratio else {
            return now_nanos;
        };
        let (wall, sim) = *self.begin.get_or_insert((now_nanos, sim_nanos));
        let passed = i128::from(sim_nanos).saturating_sub(i128::from(sim));
        let later = (passed as f64 / ratio).round() as i128;
        u64::try_from(i128::from(wall).saturating_add(later)).unwrap_or(now_nanos)
    }

    /// Notes that the tick at `sim_nanos`, which was due, starts now.
    pub fn start_tick(&mut self, sim_nanos: u64, now_nanos: u64) {
        if self.ratio.is_none() {
            return;
        }
        let late_nanos = now_nanos.saturating_sub(self.due_nanos(sim_nanos, now_nanos));
        if late_nanos > LATE_NANOS {
            self.n_late = self.n_late.saturating_add(1);
        }
        if late_nanos > GIVE_UP_NANOS {
            self.n_given_up = self.n_given_up.saturating_add(1);
            self.begin = Some((now_nanos, sim_nanos));
        }
    }

    /// Ticks that started more than a millisecond late.
    pub fn n_late(&self) -> u64 {
        self.n_late
    }

    /// How often the schedule was started anew because a tick was far too late.
    pub fn n_given_up(&self) -> u64 {
        self.n_given_up
    }
}

/// Lateness from which on a tick is counted as late.
const LATE_NANOS: u64 = 1_000_000;

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn lateness_does_not_add_up_and_long_stalls_are_given_up() {
        let mut pace = Pace::new(Some(2.0));
        assert_eq!(pace.due_nanos(1000 * MS, 77 * MS), 77 * MS);
        pace.start_tick(1000 * MS, 77 * MS);
        assert_eq!(pace.due_nanos(1100 * MS, 80 * MS), 127 * MS);
        pace.start_tick(1100 * MS, 140 * MS);
        assert_eq!(pace.due_nanos(1200 * MS, 141 * MS), 177 * MS);
        pace.start_tick(1200 * MS, 1000 * MS);
        assert_eq!(pace.due_nanos(1300 * MS, 1001 * MS), 1050 * MS);
        assert_eq!((pace.n_late(), pace.n_given_up()), (2, 1));
        pace.set_ratio(0.5);
        assert_eq!(pace.due_nanos(1300 * MS, 2000 * MS), 2000 * MS);
        assert_eq!(pace.due_nanos(1350 * MS, 2000 * MS), 2100 * MS);
    }

    #[test]
    fn without_a_ratio_everything_is_due() {
        let mut pace = Pace::new(None);
        assert_eq!(pace.due_nanos(u64::MAX, 5), 5);
        pace.start_tick(0, u64::MAX);
        assert_eq!(pace.n_late(), 0);
    }
}
