//! Time as integers: simulated nanoseconds, monotonic nanoseconds and the tick counter.
//!
//! The two clocks are distinct types that cannot be subtracted from each other.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

/// Number of a simulation step. Starts at 1 and never goes back, not even on a map load.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Tick(pub u64);

/// Simulated nanoseconds since the daemon started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SimTime(pub u64);

/// `CLOCK_MONOTONIC` nanoseconds; comparable across processes of one host.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MonoTime(pub u64);

impl MonoTime {
    /// Nanoseconds from `earlier` to `self`; 0 if `earlier` is later.
    pub fn nanos_since(self, earlier: MonoTime) -> u64 {
        self.0.saturating_sub(earlier.0)
    }
}

impl SimTime {
    /// Seconds as `f64`, for printing and for formats that want seconds.
    pub fn as_secs(self) -> f64 {
        self.0 as f64 * 1e-9
    }
}

/// The simulation clock: `base_nanos + (tick − base_tick) × period_nanos`, never a sum of floats.
///
/// A change of the period moves the base to the tick at which it takes effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TickClock {
    base_tick: u64,
    base_nanos: u64,
    period_nanos: u64,
}

impl TickClock {
    /// A clock that has not ticked: tick 0 is time 0, tick 1 is one period.
    pub fn new(period_nanos: u64) -> Self {
        assert!(period_nanos > 0, "a tick lasts at least a nanosecond");
        TickClock {
            base_tick: 0,
            base_nanos: 0,
            period_nanos,
        }
    }

    /// Time at the end of `tick`, which must not lie before the last change of the period.
    pub fn time_of(&self, tick: Tick) -> SimTime {
        let ticks = tick
            .0
            .checked_sub(self.base_tick)
            .expect("tick lies after the clock's base");
        let since_base = ticks.saturating_mul(self.period_nanos);
        SimTime(self.base_nanos.saturating_add(since_base))
    }

    /// Length of one tick.
    pub fn period_nanos(&self) -> u64 {
        self.period_nanos
    }

    /// Moves the clock forward so that `tick` ends at `time`, which must not lie before the time at
    /// which it would have ended.
    pub fn leap(&mut self, tick: Tick, time: SimTime) {
        assert!(time >= self.time_of(tick), "time never goes back");
        (self.base_tick, self.base_nanos) = (tick.0, time.0);
    }

    /// Lets every tick after `tick` last `period_nanos`.
    pub fn set_period(&mut self, tick: Tick, period_nanos: u64) {
        assert!(period_nanos > 0, "a tick lasts at least a nanosecond");
        self.base_nanos = self.time_of(tick).0;
        self.base_tick = tick.0;
        self.period_nanos = period_nanos;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_after_a_million_ticks_is_exact() {
        let clock = TickClock::new(33_333_333);
        assert_eq!(clock.time_of(Tick(1_000_000)), SimTime(33_333_333_000_000));
    }

    #[test]
    fn a_leap_goes_forward_and_the_period_stays() {
        let mut clock = TickClock::new(10);
        clock.leap(Tick(5), SimTime(1000));
        assert_eq!(
            (clock.time_of(Tick(5)), clock.time_of(Tick(7))),
            (SimTime(1000), SimTime(1020))
        );
    }

    #[test]
    fn changing_the_period_keeps_time_continuous() {
        let mut clock = TickClock::new(50_000_000);
        let before = clock.time_of(Tick(10));
        clock.set_period(Tick(10), 10_000_000);
        assert_eq!(clock.time_of(Tick(10)), before);
        assert_eq!(clock.time_of(Tick(11)).0, before.0 + 10_000_000);
    }
}
