//! The life of a set of processes: starts them in order, watches, restarts and stops them in order,
//! and leaves nothing behind.
//!
//! One thread decides everything; the threads around a process only report. A process starts when
//! all processes that it comes `after` are ready. It is asked to end when all processes that come
//! after it have ended, so that readers end before what they read. Every wait is limited: after the
//! grace period comes TERM, then KILL, always sent to the whole process group.

use std::os::unix::process::ExitStatusExt as _;
use std::process::ExitStatus;
use std::sync::mpsc::{Receiver, Sender};
use std::time::{Duration, Instant};

use launch_cli::Exit;
use launch_run::process::describe;
use launch_run::{Note, NoteWriter};
use nix::sys::signal::Signal;

use super::child::{self, Event, Running};
use super::lockstep::LockstepWatch;
use super::outcome::{Asked, Outcome, code_of, outcome_of, signal_of};
use super::output::{Output, Sink};
use super::plan::Plan;
use super::ready::Readiness;
use super::restarts::Restarts;
use super::signals::Signals;
use crate::bus::Bus;

/// Time between two looks for a sign of readiness.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Time between TERM and KILL.
const TERM_GRACE: Duration = Duration::from_secs(2);
/// Longest wait for the remaining output of processes that have ended.
const LAST_WORDS: Duration = Duration::from_secs(1);

/// One process of the launch file through all its starts.
struct Slot {
    plan: Plan,
    sink: Sink,
    state: State,
    starts: u64,
    restarts: Restarts,
}

enum State {
    /// Waits for the processes that it comes after.
    Waiting,
    Up {
        run: Running,
        ready: Readiness,
        asked: Option<Asked>,
    },
    /// Waits for its next start.
    Pausing {
        until: Instant,
    },
    Over(Outcome),
}

/// Why the whole set of processes ends.
enum Reason {
    /// Ctrl-C, or `--for` is over.
    Wished,
    /// A required process ended.
    Required(ExitStatus),
    /// Something went wrong, and the message has been printed.
    Failed,
}

pub struct Supervisor {
    slots: Vec<Slot>,
    output: Output,
    notes: NoteWriter,
    bus: Bus,
    events: Sender<Event>,
    inbox: Receiver<Event>,
    run_for: Option<Duration>,
    all_ready_at: Option<Instant>,
    next_look: Instant,
    ending: Option<Reason>,
    killed: bool,
    open_pipes: usize,
    lockstep: LockstepWatch,
}

impl Supervisor {
    /// # Errors
    /// When a log file cannot be made.
    pub fn new(
        plans: Vec<Plan>,
        output: Output,
        notes: NoteWriter,
        bus: Bus,
        run_for: Option<Duration>,
        signals: Signals,
    ) -> anyhow::Result<Self> {
        let slots = plans.into_iter().enumerate().map(|(idx, plan)| {
            let sink = output.sink(idx, &plan.name, &plan.run_dir)?;
            Ok(Slot {
                restarts: Restarts::of(plan.restart),
                plan,
                sink,
                state: State::Waiting,
                starts: 0,
            })
        });
        Ok(Supervisor {
            slots: slots.collect::<anyhow::Result<_>>()?,
            output,
            notes,
            bus,
            events: signals.events,
            inbox: signals.inbox,
            run_for,
            all_ready_at: None,
            next_look: Instant::now(),
            ending: None,
            killed: false,
            open_pipes: 0,
            lockstep: LockstepWatch::default(),
        })
    }

    /// Runs until everything has ended.
    pub fn run(mut self) -> Exit {
        loop {
            if self.ending.is_none() {
                self.look_for_readiness();
                // Repeat as long as something starts: a process without a sign of readiness is
                // ready at once, and others may wait for it.
                while self.start_those_that_may() {}
                self.note_all_ready();
            }
            if self.ending.is_some() {
                self.ask_to_end();
            }
            if self
                .slots
                .iter()
                .all(|slot| matches!(slot.state, State::Over(_)))
            {
                break;
            }
            let nap = self
                .next_deadline()
                .saturating_duration_since(Instant::now());
            if let Ok(event) = self.inbox.recv_timeout(nap) {
                self.handle(event);
            }
        }
        self.wait_for_last_words();
        self.bus.clean();
        self.verdict()
    }

    /// Returns whether any was started.
    fn start_those_that_may(&mut self) -> bool {
        let now = Instant::now();
        let mut started = false;
        for idx in 0..self.slots.len() {
            let due = match self.slots[idx].state {
                State::Waiting => self.slots[idx]
                    .plan
                    .after
                    .iter()
                    .all(|before| self.is_ready_or_done(*before)),
                State::Pausing { until } => until <= now,
                _ => false,
            };
            if due && self.ending.is_none() {
                self.start(idx);
                started = true;
            }
        }
        started
    }

    fn is_ready_or_done(&self, idx: usize) -> bool {
        match &self.slots[idx].state {
            State::Up { ready, .. } => ready.is_complete(),
            State::Over(outcome) => *outcome == Outcome::Fine,
            // It has been ready; the processes that come after it go on without it.
            State::Pausing { .. } => true,
            State::Waiting => false,
        }
    }

    fn start(&mut self, idx: usize) {
        let further_args = self.further_args(idx);
        if self.slots[idx].plan.is_daemon {
            self.await_lockstep_again();
        }
        let slot = &mut self.slots[idx];
        slot.starts += 1;
        match child::start(
            idx,
            slot.starts,
            &slot.plan,
            &further_args,
            &slot.sink,
            &self.events,
        ) {
            Ok(run) => {
                self.open_pipes += 2;
                let (process, pid) = (slot.plan.name.clone(), run.pid());
                self.output.say(&format!("started {process} (pid {pid})"));
                self.notes.write(&Note::Started { process, pid });
                slot.state = State::Up {
                    run,
                    ready: Readiness::of(&slot.plan),
                    asked: None,
                };
            }
            Err(error) => {
                self.output
                    .warn(&format!("process {}: {error:#}", slot.plan.name));
                slot.state = State::Over(Outcome::Failed);
                self.end(Reason::Failed);
            }
        }
    }

    /// Arguments that depend on what runs at the moment: whom the daemon awaits before its first
    /// tick.
    fn further_args(&self, idx: usize) -> Vec<String> {
        if !self.slots[idx].plan.is_daemon {
            return Vec::new();
        }
        self.slots
            .iter()
            .filter(|slot| slot.plan.lockstep && !matches!(slot.state, State::Over(_)))
            .flat_map(|slot| ["--await-participant".into(), slot.plan.name.clone()])
            .collect()
    }

    /// A daemon that starts knows no participants: those that run have to join it.
    fn await_lockstep_again(&mut self) {
        self.lockstep.forget();
        for slot in self.slots.iter_mut().filter(|slot| slot.plan.lockstep) {
            if let State::Up { ready, .. } = &mut slot.state {
                ready.join_again();
            }
        }
    }

    /// Whether somebody waits for what the daemon says about lockstep.
    fn watches_lockstep(&self) -> bool {
        let takes_part = |slot: &Slot| {
            slot.plan.lockstep
                && match slot.state {
                    State::Up { ready, .. } => ready.lacks_place() || !self.lockstep.has_begun(),
                    _ => false,
                }
        };
        self.slots.iter().any(takes_part)
    }

    fn look_for_readiness(&mut self) {
        let now = Instant::now();
        let look = self.next_look <= now;
        if look {
            self.next_look = now + LOOK_EVERY;
            if self.watches_lockstep() {
                self.lockstep.look(&self.bus);
            } else {
                self.lockstep.rest();
            }
        }
        for idx in 0..self.slots.len() {
            let slot = &mut self.slots[idx];
            let State::Up { ready, .. } = &mut slot.state else {
                continue;
            };
            if ready.is_complete() {
                continue;
            }
            if look {
                ready.look(&slot.plan, &self.bus, &self.lockstep);
            }
            if ready.is_complete() {
                self.say_ready(idx);
            } else if now >= ready.until(&slot.plan) {
                let sentence = ready.sentence(&slot.plan, &self.lockstep);
                self.output.warn(&sentence);
                self.end(Reason::Failed);
            }
        }
    }

    fn say_ready(&self, idx: usize) {
        let slot = &self.slots[idx];
        if let State::Up { ready, .. } = &slot.state {
            self.output.say(&format!(
                "{} is ready after {:.1} s",
                slot.plan.name,
                ready.waited().as_secs_f64()
            ));
        }
    }

    /// Notices that all processes are ready; `--for` counts from that moment.
    fn note_all_ready(&mut self) {
        let now = Instant::now();
        let at_rest = |slot: &Slot| match &slot.state {
            State::Up { ready, .. } => ready.is_complete(),
            State::Over(_) | State::Pausing { .. } => true,
            State::Waiting => false,
        };
        if self.all_ready_at.is_none() && self.ending.is_none() && self.slots.iter().all(at_rest) {
            self.all_ready_at = Some(now);
            let until = self.run_for.map_or("Ctrl-C stops them".to_owned(), |time| {
                format!("they run for {} s", time.as_secs_f64())
            });
            self.output.say(&format!(
                "all {} processes are up; {until}",
                self.slots.len()
            ));
        }
        if let (Some(since), Some(time)) = (self.all_ready_at, self.run_for)
            && now >= since + time
        {
            self.output
                .say(&format!("{} s are over; stopping", time.as_secs_f64()));
            self.end(Reason::Wished);
        }
    }

    /// Begins to end all processes. Only the first reason counts.
    fn end(&mut self, reason: Reason) {
        self.ending.get_or_insert(reason);
    }

    /// Asks processes to end whose readers have all ended, and sends a harder signal to those that
    /// have used up their time.
    fn ask_to_end(&mut self) {
        let now = Instant::now();
        for idx in 0..self.slots.len() {
            let has_readers = self.slots.iter().any(|slot| {
                slot.plan.after.contains(&idx) && matches!(slot.state, State::Up { .. })
            });
            let slot = &mut self.slots[idx];
            let grace = slot.plan.stop.grace.duration();
            match &mut slot.state {
                State::Waiting | State::Pausing { .. } => slot.state = State::Over(Outcome::Fine),
                State::Up {
                    run,
                    asked: asked @ None,
                    ..
                } if !has_readers => {
                    let signal = signal_of(slot.plan.stop.signal);
                    run.signal(signal);
                    *asked = Some(Asked {
                        first: signal,
                        last: signal,
                        until: now + grace,
                    });
                }
                State::Up {
                    run,
                    asked: Some(asked),
                    ..
                } if now >= asked.until && asked.last != Signal::SIGKILL => {
                    let harder = if asked.last == Signal::SIGTERM {
                        Signal::SIGKILL
                    } else {
                        Signal::SIGTERM
                    };
                    self.output.warn(&format!(
                        "{} did not end after {}; sending {harder}",
                        slot.plan.name, asked.last
                    ));
                    run.signal(harder);
                    *asked = Asked {
                        last: harder,
                        until: now + TERM_GRACE,
                        ..*asked
                    };
                }
                _ => {}
            }
        }
    }

    fn next_deadline(&self) -> Instant {
        let idle = Instant::now() + Duration::from_secs(3600);
        let of_slot = |slot: &Slot| match &slot.state {
            State::Pausing { until } => *until,
            State::Up {
                asked: Some(asked), ..
            } if asked.last != Signal::SIGKILL => asked.until,
            State::Up { ready, .. } if !ready.is_complete() && self.ending.is_none() => {
                let until = ready.until(&slot.plan);
                if ready.needs_looks(&slot.plan) {
                    self.next_look.min(until)
                } else {
                    until
                }
            }
            _ if slot.plan.lockstep && self.ending.is_none() && self.watches_lockstep() => {
                self.next_look
            }
            _ => idle,
        };
        let time_is_over = match (self.all_ready_at, self.run_for) {
            (Some(since), Some(time)) if self.ending.is_none() => since + time,
            _ => idle,
        };
        self.slots
            .iter()
            .map(of_slot)
            .fold(time_is_over.min(idle), Instant::min)
    }

    fn handle(&mut self, event: Event) {
        match event {
            Event::PipeClosed => self.open_pipes -= 1,
            Event::SaidReady { idx, start } => {
                if let State::Up { run, ready, .. } = &mut self.slots[idx].state
                    && run.start == start
                    && ready.said()
                {
                    self.say_ready(idx);
                }
            }
            Event::Signal if self.ending.is_none() => {
                self.output.say("stopping; once more kills at once");
                self.end(Reason::Wished);
            }
            Event::Signal => self.kill_all(),
            Event::Ended { idx, start } => {
                if matches!(&self.slots[idx].state, State::Up { run, .. } if run.start == start) {
                    self.ended(idx);
                }
            }
        }
    }

    fn kill_all(&mut self) {
        self.killed = true;
        self.output.warn("killing what still runs");
        for slot in &mut self.slots {
            if let State::Up { run, asked, .. } = &mut slot.state {
                run.signal(Signal::SIGKILL);
                *asked = Some(Asked {
                    first: Signal::SIGINT,
                    last: Signal::SIGKILL,
                    until: Instant::now(),
                });
            }
        }
    }

    fn ended(&mut self, idx: usize) {
        let slot = &mut self.slots[idx];
        let State::Up { run, asked, .. } = std::mem::replace(&mut slot.state, State::Waiting)
        else {
            return;
        };
        let ran_for = run.since.elapsed();
        let status = match run.reap() {
            Ok(status) => status,
            Err(error) => {
                self.output
                    .warn(&format!("process {}: {error:#}", slot.plan.name));
                ExitStatus::from_raw(1 << 8)
            }
        };
        // Its shared memory is freed before any process is restarted.
        self.bus.clean();
        if slot.plan.is_daemon {
            self.lockstep.forget();
        } else if slot.plan.lockstep {
            self.lockstep.look(&self.bus);
        }
        let (process, how) = (slot.plan.name.clone(), describe(status));
        let text = format!(
            "{process} ended with {how} after {:.1} s",
            ran_for.as_secs_f64()
        );
        self.notes.write(&Note::Ended { process, how });
        slot.sink.note(&format!("--- {text}"));
        let outcome = outcome_of(status, asked);
        if outcome == Outcome::Fine {
            self.output.say(&text)
        } else {
            self.output.warn(&text)
        }
        self.slots[idx].state = State::Over(outcome);
        if self.ending.is_none() {
            self.after_its_own_end(idx, status, ran_for);
        }
    }

    /// Decides what follows when a process ended by itself: restart it, end all processes, or go on
    /// without it.
    fn after_its_own_end(&mut self, idx: usize, status: ExitStatus, ran_for: Duration) {
        let slot = &mut self.slots[idx];
        let restart = slot.plan.restart;
        if slot.restarts.is_wanted(status) {
            let now = Instant::now();
            if let Some((n, pause)) = slot.restarts.next(now, ran_for) {
                let process = slot.plan.name.clone();
                let millis = pause.as_millis();
                let text = format!(
                    "restarting {process} in {millis} ms ({n} of {})",
                    restart.max
                );
                self.output.say(&text);
                self.notes.write(&Note::Restarting { process, text });
                slot.state = State::Pausing { until: now + pause };
                return;
            }
            let (name, max) = (&slot.plan.name, restart.max);
            let log = slot.plan.run_dir.join(format!("{name}.log"));
            let text = format!(
                "{name} was restarted {max} times within {}; giving up, its log is {}",
                restart.window,
                log.display()
            );
            self.output.warn(&text);
            let process = name.clone();
            self.notes.write(&Note::GaveUp { process, text });
            slot.state = State::Over(Outcome::Failed);
            return self.end(Reason::Failed);
        }
        if slot.plan.required {
            self.output
                .say(&format!("{} is required; stopping", slot.plan.name));
            return self.end(Reason::Required(status));
        }
        if slot.plan.lockstep && !self.lockstep.has_begun() {
            self.output.warn(&format!(
                "{} ended before the first tick, which waits until it has joined lockstep; stopping",
                slot.plan.name
            ));
            return self.end(Reason::Failed);
        }
        let is_waited_for = self
            .slots
            .iter()
            .any(|other| other.plan.after.contains(&idx) && matches!(other.state, State::Waiting));
        if is_waited_for && !status.success() {
            self.output.warn(&format!(
                "others wait for {}; stopping",
                self.slots[idx].plan.name
            ));
            self.end(Reason::Failed);
        }
    }

    /// Waits for the remaining output. A pipe closes when the last process that holds it is gone; a
    /// process that left its group may hold it longer, and is not waited for.
    fn wait_for_last_words(&mut self) {
        let until = Instant::now() + LAST_WORDS;
        while self.open_pipes > 0 {
            match self
                .inbox
                .recv_timeout(until.saturating_duration_since(Instant::now()))
            {
                Ok(event) => self.handle(event),
                Err(_) => return,
            }
        }
    }

    fn verdict(&self) -> Exit {
        let outcomes = self.slots.iter().filter_map(|slot| {
            if let State::Over(outcome) = slot.state {
                Some(outcome)
            } else {
                None
            }
        });
        let worst = outcomes.max().unwrap_or(Outcome::Fine);
        let exit = match (&self.ending, worst) {
            (_, _) if self.killed => Exit::Failed,
            (Some(Reason::Failed), _) => Exit::Failed,
            (Some(Reason::Required(status)), _) if !status.success() => {
                Exit::Code(code_of(*status))
            }
            (_, Outcome::Failed) => Exit::Failed,
            (_, Outcome::DataLost) => Exit::DataLost,
            (_, Outcome::Fine) => Exit::Done,
        };
        self.output
            .say(&format!("everything has ended: exit code {}", exit.code()));
        exit
    }
}
