//! The clock: which tick it is, how long a tick lasts, and when the next one is due.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

mod keep_up;
mod pace;

use anyhow::ensure;
use schema_bus::mono_now;
use schema_frames::command::SPEED_RATIO;
use schema_types::time::TickClock;
use schema_types::{SimTime, Tick};

use crate::settings::{RunSettings, Speed};
use keep_up::KeepUp;
use pace::Pace;

/// Simulated time, and its deadlines in real time.
pub struct Clock {
    ticks: TickClock,
    /// The last tick that was begun.
    tick: Tick,
    /// The last tick of the run; `None` if it has no end.
    last_tick: Option<Tick>,
    speed: Speed,
    /// Simulated seconds per second that paced ticks aim at.
    speed_ratio: f64,
    pace: Pace,
    /// `None` if cameras and lidars keep their rates.
    keep_up: Option<KeepUp>,
}

/// Ticks that started too late.
#[derive(Clone, Copy, Debug)]
pub struct LateTicks {
    /// Ticks that started a period or more too late.
    pub n_late: u64,
    /// Periods of real time that were given up.
    pub n_given_up: u64,
}

impl Clock {
    /// A clock before its first tick, which is due at once.
    pub fn new(period_nanos: u64, run: &RunSettings, now_nanos: u64) -> Clock {
        Clock {
            ticks: TickClock::new(period_nanos),
            tick: Tick(0),
            last_tick: run.last_tick.map(Tick),
            speed: run.speed,
            speed_ratio: 1.0,
            pace: Pace::new(now_nanos, period_nanos),
            keep_up: run.keep_up.then(KeepUp::default),
        }
    }

    /// The last tick that was begun.
    pub fn tick(&self) -> Tick {
        self.tick
    }

    /// The last tick before the current one: the edge at which the current one began.
    pub fn edge_before(&self) -> Tick {
        Tick(self.tick.0.saturating_sub(1))
    }

    /// Simulated time of the current tick.
    pub fn now(&self) -> SimTime {
        self.ticks.time_of(self.tick)
    }

    /// Length of a tick.
    pub fn period_nanos(&self) -> u64 {
        self.ticks.period_nanos()
    }

    /// Whether the last tick of the run has begun.
    pub fn is_at_end(&self) -> bool {
        self.last_tick.is_some_and(|last| self.tick >= last)
    }

    /// Whether ticks that run freely keep real time.
    pub fn keeps_real_time(&self) -> bool {
        self.speed == Speed::RealTime
    }

    /// Real time since the last tick started.
    pub fn idle_nanos(&self) -> u64 {
        mono_now().0.saturating_sub(self.pace.last_start_nanos())
    }

    /// Real time until the next paced tick is due; 0 if it is due or late.
    pub fn wait_nanos(&self, now_nanos: u64) -> u64 {
        self.pace.wait_nanos(now_nanos)
    }

    /// Notes that the next tick starts now.
    pub fn start_tick(&mut self) {
        self.pace.start_tick(mono_now().0);
    }

    /// Looks whether paced ticks keep real time, if the user wants cameras and lidars to fire less
    /// often where they do not. Returns how many ticks are to lie between two firings from now on,
    /// if that changes.
    pub fn keep_up(&mut self, is_paced: bool) -> Option<u64> {
        let period_nanos = self.wall_period_nanos();
        let keep_up = self.keep_up.as_mut()?;
        if !is_paced {
            keep_up.pause();
            return None;
        }
        keep_up.note(mono_now().0, period_nanos)
    }

    /// The next tick begins.
    pub fn advance(&mut self) {
        self.tick = Tick(self.tick.0.saturating_add(1));
    }

    /// Paced ticks are due from now on, at the speed that is set.
    pub fn pace_anew(&mut self, now_nanos: u64) {
        self.pace = Pace::new(now_nanos, self.wall_period_nanos());
    }

    /// Paced ticks are due from now on, one period of simulated time apart.
    pub fn pace_by_period(&mut self, now_nanos: u64) {
        self.pace = Pace::new(now_nanos, self.period_nanos());
    }

    /// Lets every later tick last `period_nanos`.
    pub fn set_period(&mut self, period_nanos: u64) {
        self.ticks.set_period(self.tick, period_nanos);
    }

    /// Sets how many simulated seconds a second has.
    ///
    /// # Errors
    /// If ticks do not keep real time, or the ratio is out of bounds.
    pub fn set_speed(&mut self, ratio: f64) -> anyhow::Result<()> {
        ensure!(
            self.keeps_real_time(),
            "this simulator runs as fast as it can; start it without --unpaced to set its speed"
        );
        let (slowest, fastest) = SPEED_RATIO;
        ensure!(
            (slowest..=fastest).contains(&ratio),
            "ratio is {ratio}, but must be {slowest} to {fastest}"
        );
        self.speed_ratio = ratio;
        self.pace_anew(mono_now().0);
        Ok(())
    }

    /// Moves simulated time forward to `time` if that lies ahead.
    pub fn leap_to(&mut self, time: SimTime) {
        if self.now() < time {
            self.ticks.leap(self.tick, time);
        }
    }

    /// Ticks that started too late so far.
    pub fn late_ticks(&self) -> LateTicks {
        LateTicks {
            n_late: self.pace.n_late(),
            n_given_up: self.pace.n_given_up(),
        }
    }

    /// Real time from one paced tick to the next.
    fn wall_period_nanos(&self) -> u64 {
        ((self.period_nanos() as f64 / self.speed_ratio).round() as u64).max(1)
    }
}
