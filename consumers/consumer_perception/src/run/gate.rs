//! Holds the world still in lockstep until a program has answered what it was shown, so that programs
//! that know nothing of lockstep get every frame; or until the clock says so, where a simulator runs
//! a recorded run again, which knows no pace of its own.
//!
//! A frame is waited for as long as the suite allows, and once answers have come no longer than
//! twenty times the slowest of them: a program that passes over frames by design would otherwise
//! take hours.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use consumer_kit::{Lockstep, WakeUps};
use schema_bus::{Bus, names};

use super::observer::Observer;

/// Name in lockstep.
const NAME: &str = "bench";
/// Longest wait for a place in lockstep.
const JOIN_WITHIN: Duration = Duration::from_secs(30);
/// Longest sleep between two looks.
const NAP: Duration = Duration::from_millis(5);
/// Least time that a frame is waited for: a busy machine may leave a program aside for a while.
const LEAST_WAIT: Duration = Duration::from_secs(1);
/// Waits of full length in a row, before any answer has come, after which waits are short.
const MOST_IN_VAIN: u32 = 2;
/// Length of these short waits.
const SHORT_WAIT: Duration = Duration::from_secs(1);
/// Slowest answers that a wait lasts.
const ANSWERS_PER_WAIT: u32 = 20;

/// What is waited for: topics of inputs by task, and the ticks in which they have frames.
#[derive(Clone, Debug, Default)]
pub struct Expected {
    /// Topics of the task's sensor, by the task's name.
    pub topics: BTreeMap<String, Vec<String>>,
    /// Ticks in which one of them has a frame.
    pub ticks: BTreeMap<String, BTreeSet<u64>>,
}

/// What lets the world go on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Hold {
    /// The program's answers.
    Answers,
    /// The program itself, which takes part in lockstep too.
    Nothing,
    /// The clock: so many simulated seconds per second.
    Clock(f64),
}

/// Longest lateness that is made up for, as a replay does.
const GIVE_UP: Duration = Duration::from_millis(500);
/// The last stretch before a tick is due is slept by the clock, because events wake too coarsely.
const LAST_STRETCH: Duration = Duration::from_micros(1500);

/// A place in lockstep.
#[derive(Debug)]
pub struct Gate {
    lockstep: Lockstep,
    wake_ups: WakeUps,
    expected: Expected,
    hold: Hold,
    /// A moment, and the simulated time that was due then.
    origin: Option<(Instant, u64)>,
    answer_within: Duration,
    /// Epoch and tick that were acknowledged last.
    done: Option<(u64, u64)>,
    /// The tick that is held, and since when its frames were there.
    held: Option<((u64, u64), Instant)>,
    in_vain: u32,
    /// Ticks that were not answered in time.
    pub n_given_up: u64,
    /// Frames that were answered, or given up.
    pub n_passed: u64,
}

impl Gate {
    /// Takes part in lockstep.
    ///
    /// # Errors
    /// If the replay or the simulator does not answer.
    pub fn join(
        bus: &Bus,
        expected: Expected,
        hold: Hold,
        answer_within: Duration,
    ) -> anyhow::Result<Gate> {
        let mut wake_ups = WakeUps::new();
        wake_ups.listen(bus, names::WORLD_SNAPSHOT)?;
        Ok(Gate {
            lockstep: Lockstep::join(bus, NAME, JOIN_WITHIN)?,
            wake_ups,
            expected,
            hold,
            origin: None,
            answer_within,
            done: None,
            held: None,
            in_vain: 0,
            n_given_up: 0,
            n_passed: 0,
        })
    }

    /// Sleeps until something may have come.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn wait(&mut self, bus: &Bus, observer: &Observer<'_>) -> anyhow::Result<()> {
        for topic in observer.result_topics() {
            self.wake_ups.listen(bus, topic)?;
        }
        match self.time_left(observer) {
            Some(left) if left <= LAST_STRETCH => std::thread::sleep(left),
            Some(left) => drop(self.wake_ups.wait((left - LAST_STRETCH).min(NAP))?),
            None => drop(self.wake_ups.wait(NAP)?),
        }
        Ok(())
    }

    /// Time until the next tick is due by the clock; `None` without a clock, or if it is due.
    fn time_left(&self, observer: &Observer<'_>) -> Option<Duration> {
        let (Hold::Clock(speed), Some((since, from))) = (self.hold, self.origin) else {
            return None;
        };
        let (sim_nanos, period_nanos) = observer.newest_nanos;
        let passed = (sim_nanos + period_nanos).saturating_sub(from);
        let due = Duration::from_secs_f64(passed as f64 * 1e-9 / speed);
        let left = due.saturating_sub(since.elapsed());
        (!left.is_zero()).then_some(left)
    }

    /// Keeps the clock's schedule: it begins with the first tick, and anew after a long delay.
    fn keep_time(&mut self, observer: &Observer<'_>) {
        let Hold::Clock(speed) = self.hold else {
            return;
        };
        let sim_nanos = observer.newest_nanos.0;
        let late = self.origin.map(|(since, from)| {
            let passed = sim_nanos.saturating_sub(from) as f64 * 1e-9 / speed;
            since
                .elapsed()
                .saturating_sub(Duration::from_secs_f64(passed))
        });
        if late.is_none_or(|late| late > GIVE_UP) {
            self.origin = Some((Instant::now(), sim_nanos));
        }
    }

    /// Lets the world go on if the newest tick is done with. Returns whether a tick was
    /// acknowledged.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn look(&mut self, bus: &Bus, observer: &Observer<'_>) -> anyhow::Result<bool> {
        let Some(now @ (epoch, tick)) = observer.newest else {
            return Ok(false);
        };
        if self.lockstep.epoch() != epoch {
            // A recording that begins again has a new epoch, and waits for those who took part.
            self.lockstep = rejoin(bus)?;
            self.held = None;
        }
        if self.done == Some(now) || self.lockstep.epoch() != epoch {
            return Ok(false);
        }
        let mut missing = false;
        let mut expects = false;
        if self.hold == Hold::Answers {
            for (topic, task) in observer.awaited() {
                let ticks = self.expected.ticks.get(&task);
                if ticks.is_some_and(|ticks| ticks.contains(&tick)) {
                    expects = true;
                    missing |= !observer.has_answered(&topic, tick);
                }
            }
        }
        if missing && !self.gives_up(now, observer) {
            return Ok(false);
        }
        if self.held.is_none_or(|(held, _)| held != now) {
            self.keep_time(observer);
            self.held = Some((now, Instant::now()));
        }
        if self.time_left(observer).is_some() {
            return Ok(false);
        }
        // A replay shows the world of its first tick before that begins.
        let is_first = self.done.is_none_or(|(before, _)| before != epoch);
        if is_first && !self.lockstep.is_complete(tick)? {
            return Ok(false);
        }
        if expects {
            self.n_passed += 1;
            match missing {
                true => {
                    self.n_given_up += 1;
                    self.in_vain += 1;
                }
                false => self.in_vain = 0,
            }
        }
        (self.done, self.held) = (Some(now), None);
        self.lockstep.ack(tick)?;
        Ok(true)
    }

    /// Whether the tick at hand was waited for long enough, since its frames were there.
    fn gives_up(&mut self, now: (u64, u64), observer: &Observer<'_>) -> bool {
        let (epoch, tick) = now;
        let is_shown = self
            .expected
            .topics
            .values()
            .any(|topics| observer.has_seen(topics, epoch, tick));
        if !is_shown {
            return false;
        }
        let since = match self.held {
            Some((held, since)) if held == now => since,
            _ => self.held.insert((now, Instant::now())).1,
        };
        let longest = observer.longest_held;
        if !longest.is_zero() {
            self.in_vain = 0;
        }
        let limit = match (longest.is_zero(), self.in_vain >= MOST_IN_VAIN) {
            (true, false) => self.answer_within,
            (true, true) => SHORT_WAIT.min(self.answer_within),
            (false, _) => (longest * ANSWERS_PER_WAIT)
                .clamp(LEAST_WAIT.min(self.answer_within), self.answer_within),
        };
        since.elapsed() >= limit
    }
}

fn rejoin(bus: &Bus) -> anyhow::Result<Lockstep> {
    Ok(Lockstep::join(bus, NAME, JOIN_WITHIN)?)
}
