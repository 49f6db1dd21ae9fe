//! When the next tick may start in free-running mode.
//!
//! Deadlines are absolute (`start + n × period`), so lateness does not add up. After a pause longer
//! than [`GIVE_UP_PERIODS`] the schedule starts anew, instead of racing through the missed ticks;
//! the lost periods are counted.

/// Most ticks of delay that the daemon makes up for by running faster. Ten ticks at 20 Hz are half a
/// second: a longer stall is a suspended machine or a debugger, not jitter.
const GIVE_UP_PERIODS: u64 = 10;

/// Absolute schedule of free-running ticks, in `CLOCK_MONOTONIC` nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pace {
    next_nanos: u64,
    last_start_nanos: u64,
    period_nanos: u64,
    n_late: u64,
    n_given_up: u64,
}

impl Pace {
    /// The first tick is due at once.
    pub fn new(now_nanos: u64, period_nanos: u64) -> Self {
        Pace {
            next_nanos: now_nanos,
            last_start_nanos: now_nanos,
            period_nanos,
            n_late: 0,
            n_given_up: 0,
        }
    }

    /// Nanoseconds until the next tick is due; 0 if it is due or late.
    pub fn wait_nanos(&self, now_nanos: u64) -> u64 {
        self.next_nanos.saturating_sub(now_nanos)
    }

    /// Notes that a tick starts now and moves the deadline on by one period.
    pub fn start_tick(&mut self, now_nanos: u64) {
        self.last_start_nanos = now_nanos;
        let late_nanos = now_nanos.saturating_sub(self.next_nanos);
        if late_nanos >= self.period_nanos {
            self.n_late = self.n_late.saturating_add(1);
        }
        if late_nanos > self.period_nanos.saturating_mul(GIVE_UP_PERIODS) {
            let n_periods = late_nanos.checked_div(self.period_nanos).unwrap_or(0);
            self.n_given_up = self.n_given_up.saturating_add(n_periods);
            self.next_nanos = now_nanos;
        }
        self.next_nanos = self.next_nanos.saturating_add(self.period_nanos);
    }

    /// When the last tick started, or the schedule if none has.
    pub fn last_start_nanos(&self) -> u64 {
        self.last_start_nanos
    }

    /// Ticks that started a period or more too late.
    pub fn n_late(&self) -> u64 {
        self.n_late
    }

    /// Periods of real time that were given up.
    pub fn n_given_up(&self) -> u64 {
        self.n_given_up
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jitter_does_not_shift_later_deadlines() {
        let mut pace = Pace::new(1_000, 100);
        for (tick, jitter) in [0u64, 30, 5, 99].into_iter().enumerate() {
            let due = 1_000 + 100 * tick as u64;
            assert_eq!(pace.wait_nanos(due - 10), 10);
            pace.start_tick(due + jitter);
        }
        assert_eq!((pace.n_late(), pace.n_given_up()), (0, 0));
    }

    #[test]
    fn a_short_stall_is_caught_up_and_a_long_one_given_up() {
        let mut pace = Pace::new(0, 100);
        pace.start_tick(250);
        assert_eq!(pace.wait_nanos(250), 0);
        assert_eq!(pace.n_late(), 1);
        pace.start_tick(10_000);
        assert_eq!(pace.n_given_up(), 99);
        assert_eq!(pace.wait_nanos(10_000), 100);
    }
}
