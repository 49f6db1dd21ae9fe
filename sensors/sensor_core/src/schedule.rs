//! Firing schedule: which sensors fire at a tick.
//!
//! This is pure arithmetic on simulated nanoseconds, so two runs agree and a test needs no clock. A
//! sensor fires at the first tick whose time is at or after its due time, less 1e-5 of the interval
//! because users write 0.0333334. The due time then moves on by whole intervals until it lies
//! ahead: lateness never adds up, and no tick fires twice. An interval of 0 fires at every tick.
//! The first due time is the first tick after the sensor was made.

use schema_types::SimTime;

/// A firing may come early by the interval divided by this.
const TOLERANCE_DIVISOR: u64 = 100_000;

/// One scheduled firing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Firing {
    /// Count of scheduled firings, from 1, read or not.
    pub seq: u64,
    /// Time since the previous firing. For the first: the interval, or the time since the sensor
    /// was made if the interval is 0.
    pub window_nanos: u64,
    /// Time of the previous firing; `None` for the first.
    pub previous: Option<SimTime>,
}

/// When one sensor fires. A plain value: copying it copies the whole state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Schedule {
    interval_nanos: u64,
    made_at: SimTime,
    due_nanos: u64,
    n_fired: u64,
    last_fired: Option<SimTime>,
    last_asked: SimTime,
}

impl Schedule {
    /// A sensor made at `made_at` that fires every `interval_nanos`, or at every tick if that is 0.
    pub fn new(made_at: SimTime, interval_nanos: u64) -> Self {
        Schedule {
            interval_nanos,
            made_at,
            due_nanos: 0,
            n_fired: 0,
            last_fired: None,
            last_asked: made_at,
        }
    }

    /// A sensor that fires every `interval_secs` (CARLA's `sensor_tick`); an interval that is not
    /// above 0 fires at every tick.
    pub fn from_interval_secs(made_at: SimTime, interval_secs: f64) -> Self {
        let nanos = (interval_secs * 1e9).round();
        Schedule::new(made_at, if nanos > 0.0 { nanos as u64 } else { 0 })
    }

    /// A sensor of a launch file: `rate_hz` divides the tick rate, so it fires at every n-th tick
    /// of `period_nanos` exactly.
    ///
    /// The interval is a whole number of periods even where neither is a whole number of
    /// nanoseconds (10 Hz at 30 ticks a second).
    pub fn from_rate(made_at: SimTime, rate_hz: f64, period_nanos: u64) -> Self {
        let ticks = (1e9 / (rate_hz * period_nanos as f64)).round();
        let ticks = if ticks >= 1.0 { ticks as u64 } else { 1 };
        Schedule::new(made_at, ticks.saturating_mul(period_nanos))
    }

    /// Time between two firings; 0 means every tick.
    pub fn interval_nanos(&self) -> u64 {
        self.interval_nanos
    }

    /// When the sensor was made.
    pub fn made_at(&self) -> SimTime {
        self.made_at
    }

    /// Time of the last firing.
    pub fn last_fired(&self) -> Option<SimTime> {
        self.last_fired
    }

    /// Firings so far.
    pub fn n_fired(&self) -> u64 {
        self.n_fired
    }

    /// Whether the sensor fires at this tick. Ask at every tick, in the order of time: a time that
    /// was asked before, or that lies before the sensor was made, fires nothing.
    pub fn due(&mut self, tick_time: SimTime) -> Option<Firing> {
        if tick_time <= self.last_asked {
            return None;
        }
        self.last_asked = tick_time;
        let tolerance = self.interval_nanos / TOLERANCE_DIVISOR;
        match self.last_fired {
            None => self.due_nanos = tick_time.0,
            Some(_) if tick_time.0.saturating_add(tolerance) < self.due_nanos => return None,
            Some(_) => {}
        }
        self.advance(tick_time);
        let previous = self.last_fired.replace(tick_time);
        self.n_fired += 1;
        let window_nanos = match previous {
            Some(previous) => tick_time.0 - previous.0,
            None if self.interval_nanos > 0 => self.interval_nanos,
            None => tick_time.0 - self.made_at.0,
        };
        Some(Firing {
            seq: self.n_fired,
            window_nanos,
            previous,
        })
    }

    /// A firing beside the schedule, which goes on as it would have; it covers no time.
    pub fn fire_again(&mut self) -> Firing {
        self.n_fired += 1;
        Firing {
            seq: self.n_fired,
            window_nanos: 0,
            previous: self.last_fired,
        }
    }

    /// Moves the due time on by whole intervals, at least one, until it lies ahead of `tick_time`.
    fn advance(&mut self, tick_time: SimTime) {
        if self.interval_nanos == 0 {
            self.due_nanos = tick_time.0;
            return;
        }
        let late_nanos = tick_time.0.saturating_sub(self.due_nanos);
        let intervals = late_nanos / self.interval_nanos + 1;
        self.due_nanos = self
            .due_nanos
            .saturating_add(intervals.saturating_mul(self.interval_nanos));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks (from 1) that fire within `n_ticks` of `period_nanos`.
    fn fired(mut schedule: Schedule, period_nanos: u64, n_ticks: u64) -> Vec<u64> {
        (1..=n_ticks)
            .filter(|tick| schedule.due(SimTime(tick * period_nanos)).is_some())
            .collect()
    }

    #[test]
    fn fifty_steps_of_50_ms_at_one_second_fire_three_times() {
        let schedule = Schedule::from_interval_secs(SimTime(0), 1.0);
        assert_eq!(fired(schedule, 50_000_000, 50), [1, 21, 41]);
    }

    #[test]
    fn a_firing_beside_the_schedule_counts_and_delays_nothing() {
        let mut schedule = Schedule::new(SimTime(0), 100);
        assert_eq!(schedule.due(SimTime(100)).map(|firing| firing.seq), Some(1));
        let again = schedule.fire_again();
        assert_eq!((again.seq, again.window_nanos), (2, 0));
        let next = schedule.due(SimTime(200)).unwrap();
        assert_eq!((next.seq, next.window_nanos), (3, 100));
    }

    #[test]
    fn zero_interval_fires_at_every_tick_with_the_step_as_window() {
        let mut schedule = Schedule::new(SimTime(7), 0);
        assert_eq!(
            schedule.due(SimTime(10)),
            Some(Firing {
                seq: 1,
                window_nanos: 3,
                previous: None
            })
        );
        assert_eq!(
            schedule.due(SimTime(12)),
            Some(Firing {
                seq: 2,
                window_nanos: 2,
                previous: Some(SimTime(10))
            })
        );
        assert_eq!(
            schedule.due(SimTime(12)),
            None,
            "a tick asked twice fires once"
        );
    }

    #[test]
    fn a_launch_files_rate_fires_every_nth_tick_for_ever() {
        // 30 ticks a second are 33 333 333 ns; 10 Hz must stay at every third tick although 3
        // periods are 99 999 999 ns.
        let schedule = Schedule::from_rate(SimTime(0), 10.0, 33_333_333);
        let ticks = fired(schedule, 33_333_333, 300_000);
        assert_eq!(ticks.len(), 100_000);
        assert!(
            ticks
                .iter()
                .enumerate()
                .all(|(i, tick)| *tick == 3 * i as u64 + 1)
        );
    }

    #[test]
    fn lateness_does_not_add_up_when_the_interval_is_no_multiple_of_the_step() {
        // 70 ms at 50 ms steps: 1000 s hold 14 285.7 intervals.
        let n = fired(
            Schedule::from_interval_secs(SimTime(0), 0.07),
            50_000_000,
            20_000,
        )
        .len();
        assert!((14_285..=14_287).contains(&n), "{n}");
    }

    #[test]
    fn a_slightly_long_interval_still_fires_at_the_tick_meant() {
        let ticks = fired(
            Schedule::from_interval_secs(SimTime(0), 0.100_000_4),
            50_000_000,
            5,
        );
        assert_eq!(ticks, [1, 3, 5]);
    }

    #[test]
    fn a_step_longer_than_the_interval_fires_once_per_step() {
        let mut schedule = Schedule::from_interval_secs(SimTime(0), 0.01);
        let firings: Vec<_> = (1..=4)
            .filter_map(|tick| schedule.due(SimTime(tick * 1_000_000_000)))
            .collect();
        assert_eq!(
            firings.iter().map(|f| f.seq).collect::<Vec<_>>(),
            [1, 2, 3, 4]
        );
        assert_eq!(firings[3].window_nanos, 1_000_000_000);
    }

    #[test]
    fn a_sensor_made_later_fires_at_its_first_tick_and_keeps_that_phase() {
        let schedule = Schedule::new(SimTime(100), 30);
        assert_eq!(fired(schedule, 10, 20), [11, 14, 17, 20]);
    }

    #[test]
    fn nonsense_intervals_fire_at_every_tick() {
        for secs in [f64::NAN, -1.0, 0.0] {
            assert_eq!(
                fired(Schedule::from_interval_secs(SimTime(0), secs), 10, 3),
                [1, 2, 3]
            );
        }
        assert_eq!(
            fired(
                Schedule::from_interval_secs(SimTime(0), f64::INFINITY),
                10,
                3
            ),
            [1]
        );
    }
}
