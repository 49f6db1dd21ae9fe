//! One run: a program in one mode and one scenario, from the start of its processes to everything
//! that it said.
//!
//! A recording is replayed to the program, or the recorded run is simulated again, in a domain of
//! its own. Whatever the program does, the run ends: a program that crashes, keeps silent or floods
//! its topics is a fault in the [`Capture`] and not of the benchmark.

mod gate;
mod job;
mod launch;
mod observer;
mod usage;

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::time::{Duration, Instant};

use consumer_kit::Lockstep;
use launch_run::{Launched, Note, RunError, domain_name};
use schema_bus::{Bus, names};
use schema_frames::{Command, CommandBatch, CommandReply, InputRecord, StepMode, WorldInfo};

use crate::capture::{Capture, MAX_RESULTS_PER_FRAME, Mode, SentFrame};

use gate::{Expected, Gate, Hold};
pub use job::{Drive, Job, Options, Source};
use job::{drive_recording, inputs_of, n_frames, streamed, topics};
use observer::{Keeps, Observer};
use usage::Meter;

/// Time between two looks at the bus while the clock runs: seldom enough to cost little, often
/// enough for buffers of two images at 200 Hz.
const LOOK_EVERY: Duration = Duration::from_millis(3);
/// Time between two looks while processes start.
const START_LOOK_EVERY: Duration = Duration::from_millis(20);
/// Time without a tick after which a run counts as hanging.
const STALL: Duration = Duration::from_secs(120);
/// Time that results have to arrive once the last frame was answered, or the program has ended.
const LAST_RESULTS: Duration = Duration::from_millis(300);
/// Least time that answers to the last frame are waited for.
const LEAST_PATIENCE: Duration = Duration::from_millis(500);
/// Slowest answers that this wait lasts.
const ANSWERS_PER_PATIENCE: u32 = 3;
/// Time in which the replay answers a command.
const COMMAND_WITHIN: Duration = Duration::from_secs(10);
/// How a process ended that did not crash, as [`Note::Ended`] says it.
const ENDED_WELL: &str = "exit code 0";
/// Most frames of a run whose results are all kept, for the bound on results.
const MAX_KEPT_RESULTS: usize = 20_000_000;

/// Runs a program. `progress` is told how many of how many ticks, or frames of a stream, are done.
///
/// # Errors
/// [`RunError::Stopped`] if `stop` says so, or if the benchmark itself fails: the replay ends, the bus or the
/// disk refuses. What the program does is no error but a fault in the capture.
pub fn run(
    job: &Job<'_>,
    stop: &dyn Fn() -> bool,
    progress: &dyn Fn(u64, u64),
) -> anyhow::Result<Capture> {
    let domain = domain_name("bench");
    let inputs = inputs_of(job.program, job.truth);
    anyhow::ensure!(
        !inputs.is_empty(),
        launch_cli::wrong_usage(format!(
            "[program.{}] inputs = {:?} match no input of {}; there is {}",
            job.program.name,
            job.program.inputs,
            job.truth.scenario.name,
            topics(job.truth).join(", ")
        ))
    );
    let launch = launch::launch(job, &inputs)?;
    let up = Launched::start(&domain, &launch, job.folder)?;
    let bus = Bus::open(&domain, "gantry-bench")?;
    let n_frames = job
        .drive
        .n_frames()
        .map_or_else(|| n_frames(job.truth, &inputs), |n| n as usize);
    let most = n_frames
        .saturating_mul(MAX_RESULTS_PER_FRAME)
        .clamp(10_000, MAX_KEPT_RESULTS);
    let is_stress = job.drive.mode() == Mode::Stress;
    let keeps = Keeps {
        bodies: !is_stress,
        results: most,
    };
    let mut observer = Observer::open(&domain, job.suite, job.program, inputs.clone(), keeps)?;
    if let Some(topic) = streamed(job, &inputs) {
        observer.count(topic, job.truth.scored_from_nanos);
    }
    let mut run = Run {
        job,
        observer,
        inputs,
        up,
        meter: Meter::new(),
        stop,
        progress,
        faults: Vec::new(),
        usage: Vec::new(),
        alive: BTreeMap::new(),
        world_ended: None,
        has_crashed: false,
        starter: None,
    };
    let outcome = run.drive(&bus);
    run.observer.finish();
    let stopped = run.up.stop();
    let capture = run.capture();
    drop(bus);
    outcome?;
    stopped?;
    Ok(capture)
}

/// A run under way.
struct Run<'a> {
    job: &'a Job<'a>,
    // Ports go before the launcher ends what they read.
    observer: Observer<'a>,
    inputs: Vec<String>,
    up: Launched,
    meter: Meter,
    stop: &'a dyn Fn() -> bool,
    progress: &'a dyn Fn(u64, u64),
    faults: Vec<String>,
    usage: Vec<crate::capture::Usage>,
    /// Processes of the program that were started, and whether they still run or will again.
    alive: BTreeMap<String, bool>,
    /// How the replay or the simulator ended, if it did.
    world_ended: Option<String>,
    has_crashed: bool,
    /// A place in lockstep that a simulator waits for before its first tick.
    starter: Option<Lockstep>,
}

impl Run<'_> {
    /// From the start of the processes to the last answer.
    fn drive(&mut self, bus: &Bus) -> anyhow::Result<()> {
        if !self.await_ready(bus)? {
            return Ok(());
        }
        let mut gate = None;
        if let Some(hold) = self.hold() {
            let suite = self.job.suite;
            gate = Some(Gate::join(
                bus,
                expected(self.job, &self.inputs),
                hold,
                Duration::from_secs_f64(suite.answer_within_s),
            )?);
        }
        // What waits was sent before time begins.
        self.observer.look()?;
        self.observer.has_begun = true;
        self.begin(bus, gate.is_some())?;
        let outcome = self.watch(bus, &mut gate);
        if let Some(gate) = gate.filter(|gate| gate.n_given_up > 0) {
            self.faults.push(format!(
                "{} of {} frames were not answered in time in lockstep",
                gate.n_given_up, gate.n_passed
            ));
        }
        outcome
    }

    /// What lets the world go on, if this program has a place in lockstep.
    fn hold(&self) -> Option<Hold> {
        match self.job.drive {
            drive if drive.is_in_lockstep() => match self.job.program.joins_lockstep() {
                true => Some(Hold::Nothing),
                false => Some(Hold::Answers),
            },
            // A simulator that runs a recorded run again knows no pace of its own.
            Drive::Streaming { speed } if self.is_live() && !self.job.suite.is_closed_loop() => {
                Some(Hold::Clock(speed))
            }
            _ => None,
        }
    }

    /// Waits until the program's topics are there and its inputs are read. Returns whether there is
    /// anybody to run.
    fn await_ready(&mut self, bus: &Bus) -> anyhow::Result<bool> {
        let began = Instant::now();
        let within = Duration::from_secs_f64(self.job.suite.ready_within_s);
        let mut world_since = None;
        loop {
            self.look_after()?;
            if bus.exists(names::WORLD_SNAPSHOT) {
                world_since.get_or_insert_with(Instant::now);
            }
            let is_there = world_since.is_some() && self.observer.newest.is_some();
            let is_written = self.observer.has_all_results() && self.observer.is_described();
            if is_there && is_written && self.is_reading(bus)? {
                return Ok(true);
            }
            if self.is_over() {
                self.faults
                    .push("it ended before it was shown anything".to_owned());
                return Ok(false);
            }
            // Simulators may take minutes to start; that is not the program's time.
            match world_since {
                Some(since) if since.elapsed() > within => {
                    let what = self.missing(bus)?;
                    self.faults.push(format!(
                        "it was not ready within {} s ({what}), and the run began without it",
                        within.as_secs_f64()
                    ));
                    return Ok(true);
                }
                None if began.elapsed() > STALL * 3 => anyhow::bail!(
                    "no world has appeared for {} s; gantry up said last:\n  {}",
                    began.elapsed().as_secs(),
                    self.up.last_words()
                ),
                _ => std::thread::sleep(START_LOOK_EVERY),
            }
        }
    }

    /// Whether somebody else reads one of the inputs, and those who join lockstep have.
    fn is_reading(&self, bus: &Bus) -> anyhow::Result<bool> {
        let read = bus.topics()?.into_iter().any(|topic| {
            // One of the readers is this program.
            self.inputs.contains(&topic.name) && topic.subscribers > 1
        });
        Ok(read && self.has_joined(bus)?)
    }

    fn has_joined(&self, bus: &Bus) -> anyhow::Result<bool> {
        let joins = |process: &&crate::suite::ProgramProcess| process.lockstep;
        let mut names = self.job.program.processes.iter().filter(joins).peekable();
        if names.peek().is_none() || !self.job.drive.is_in_lockstep() {
            return Ok(true);
        }
        let mut reader = bus.document_reader(names::WORLD_INFO)?;
        let Some(document) = reader.latest()? else {
            return Ok(false);
        };
        let info: WorldInfo = document.json()?;
        Ok(names.all(|process| info.lockstep.contains(&process.name)))
    }

    /// What a program lacks that is not ready.
    fn missing(&self, bus: &Bus) -> anyhow::Result<String> {
        if !self.observer.has_all_results() {
            let wanted: Vec<&String> = self.job.program.results.keys().collect();
            return Ok(match wanted.is_empty() {
                true => "it writes no topic of a type that a task of the suite asks for".into(),
                false => format!("nobody writes {wanted:?}"),
            });
        }
        Ok(match self.has_joined(bus)? {
            false => "it has not joined lockstep".into(),
            true => format!("it reads none of {:?}", self.inputs),
        })
    }

    /// Lets time begin.
    fn begin(&mut self, bus: &Bus, in_lockstep: bool) -> anyhow::Result<()> {
        if self.is_live() {
            // The simulator waits for somebody in lockstep, so this is its beginning.
            if !in_lockstep {
                self.set_speed(bus)?;
                self.starter = Some(Lockstep::join(bus, "bench", COMMAND_WITHIN)?);
            }
            return Ok(());
        }
        let mut client = bus.command_client("bench-begin")?;
        let batch = CommandBatch::new(vec![Command::Configure {
            mode: Some(StepMode::FreeRunning),
            period_nanos: None,
            longest_substep_nanos: None,
        }]);
        let answer = client.request(&batch, COMMAND_WITHIN)?;
        match answer.replies.first() {
            Some(CommandReply::Refused { error }) => {
                anyhow::bail!("the replay does not begin: {error}")
            }
            _ => Ok(()),
        }
    }

    /// Sets the pace of a simulator whose world the program acts on.
    fn set_speed(&self, bus: &Bus) -> anyhow::Result<()> {
        let ratio = self.job.drive.speed();
        if ratio == 1.0 {
            return Ok(());
        }
        let mut client = bus.command_client("bench-begin")?;
        let batch = CommandBatch::new(vec![Command::SetSpeed { ratio }]);
        let answer = client.request(&batch, COMMAND_WITHIN)?;
        match answer.replies.first() {
            Some(CommandReply::Refused { error }) => {
                anyhow::bail!("the simulator keeps its speed: {error}")
            }
            _ => Ok(()),
        }
    }

    /// Whether a simulator makes the frames.
    fn is_live(&self) -> bool {
        self.job.options.source == Source::Live || self.job.suite.is_closed_loop()
    }

    /// Looks on until the last frame was answered, or nobody answers any more.
    fn watch(&mut self, bus: &Bus, gate: &mut Option<Gate>) -> anyhow::Result<()> {
        let mut last = (None, Instant::now());
        let mut over_since = None;
        let mut at_end_since = None;
        loop {
            self.look_after()?;
            // A stream that is long enough stands still while the last answers come.
            let is_over = self.job.drive.n_frames().is_some() && self.is_at_end();
            if let Some(gate) = gate.as_mut().filter(|_| !is_over) {
                while gate.look(bus, &self.observer)? {
                    self.observer.look()?;
                }
            }
            let newest = self.observer.newest;
            if let (Some(starter), Some((_, tick))) = (&self.starter, newest)
                && tick >= starter.first_tick()
            {
                // From its first tick on, time runs without this program.
                self.starter = None;
            }
            if newest != last.0 {
                last = (newest, Instant::now());
                self.tell();
            }
            if last.1.elapsed() > STALL && at_end_since.is_none() {
                self.faults.push(format!(
                    "the world has stood still for {} s, so the run was ended",
                    STALL.as_secs()
                ));
                return Ok(());
            }
            if self.is_over() {
                let since = *over_since.get_or_insert_with(Instant::now);
                if since.elapsed() > LAST_RESULTS {
                    return Ok(());
                }
            }
            if self.is_at_end() {
                let since = *at_end_since.get_or_insert_with(Instant::now);
                let most = Duration::from_secs_f64(self.job.suite.patience_s);
                let limit = match self.is_all_answered() {
                    // More may follow at once, asked for or not.
                    true => LAST_RESULTS.min(most),
                    false => (self.observer.longest_answer * ANSWERS_PER_PATIENCE)
                        .clamp(LEAST_PATIENCE.min(most), most),
                };
                if since.elapsed() > limit {
                    return Ok(());
                }
            }
            match gate {
                Some(gate) => gate.wait(bus, &self.observer)?,
                None => std::thread::sleep(LOOK_EVERY),
            }
        }
    }

    /// Looks at everything once: stop requests, processes, the bus.
    fn look_after(&mut self) -> anyhow::Result<()> {
        if (self.stop)() {
            return Err(RunError::Stopped.into());
        }
        for note in self.up.look()? {
            self.note(note);
        }
        if self.up.ended()?.is_some() {
            // The launcher gives up when a program was restarted too often; anything else is a
            // failure of the benchmark.
            for note in self.up.look()? {
                self.note(note);
            }
            let by_program = self.alive.values().any(|lives| !lives);
            anyhow::ensure!(
                by_program,
                "gantry up ended; it said last:\n  {}",
                self.up.last_words()
            );
            self.alive.values_mut().for_each(|lives| *lives = false);
        } else if let Some(how) = &self.world_ended {
            anyhow::bail!(
                "the {} ended with {how}; gantry up said last:\n  {}",
                match self.is_live() {
                    false => "replay",
                    true => "simulator",
                },
                self.up.last_words()
            );
        }
        let mut leaders = self.up.pids().clone();
        leaders.insert(
            "bench".into(),
            nix::unistd::getpgrp().as_raw().cast_unsigned(),
        );
        self.meter.look(&leaders, false, &mut self.usage);
        self.observer.search()?;
        self.observer.look()
    }

    fn note(&mut self, note: Note) {
        let is_program = |name: &str| {
            let processes = &self.job.program.processes;
            processes.iter().any(|process| process.name == name)
        };
        match note {
            Note::Started { process, .. } if is_program(&process) => {
                self.alive.insert(process, true);
            }
            Note::Ended { process, how } if is_program(&process) => {
                let at = self.observer.newest.map_or_else(
                    || "before the first tick".to_owned(),
                    |(_, tick)| format!("at tick {tick}"),
                );
                self.has_crashed |= how != ENDED_WELL;
                self.faults.push(format!("{process} ended with {how} {at}"));
                self.alive.insert(process, false);
            }
            Note::Ended { process, how } if process == launch::WORLD => {
                self.world_ended = Some(how);
            }
            Note::Restarting { process, text } if is_program(&process) => {
                self.alive.insert(process, true);
                // It may take as long to answer again as when it began.
                self.observer.longest_held = Duration::ZERO;
                self.faults.push(text);
            }
            Note::GaveUp { text, .. } => {
                self.has_crashed = true;
                self.faults.push(text);
            }
            _ => {}
        }
    }

    /// Whether all processes of the program were started and none will run again.
    fn is_over(&self) -> bool {
        self.alive.len() == self.job.program.processes.len()
            && self.alive.values().all(|lives| !lives)
    }

    fn tell(&self) {
        let Some((_, tick)) = self.observer.newest else {
            return;
        };
        match self.job.drive.n_frames() {
            Some(n) => (self.progress)(self.observer.n_counted.min(n), n),
            None => {
                let first = self.job.truth.last_tick.saturating_sub(self.n_ticks());
                (self.progress)(tick.saturating_sub(first), self.n_ticks());
            }
        }
    }

    fn n_ticks(&self) -> u64 {
        let truth = self.job.truth;
        let secs = (truth.end_nanos - truth.begin_nanos) as f64 * 1e-9;
        (secs * self.job.suite.tick_hz).round() as u64
    }

    /// Whether everything was shown.
    fn is_at_end(&self) -> bool {
        match self.job.drive.n_frames() {
            Some(n) => self.observer.n_counted >= n,
            None => self
                .observer
                .newest
                .is_some_and(|(_, tick)| tick >= self.job.truth.last_tick),
        }
    }

    /// Whether the last frame of every task was answered.
    fn is_all_answered(&self) -> bool {
        if self.job.drive.n_frames().is_some() {
            return false;
        }
        let expected = expected(self.job, &self.inputs);
        let awaited = self.observer.awaited();
        if self.job.suite.is_closed_loop() {
            return true;
        }
        !awaited.is_empty()
            && awaited.iter().all(|(topic, task)| {
                let last = expected.ticks.get(task).and_then(BTreeSet::last);
                last.is_none_or(|tick| self.observer.has_answered(topic, *tick))
            })
    }

    /// When the last frame that was asked for in a stream was published.
    fn last_of_stream(&self, frames: &[SentFrame]) -> Option<u64> {
        let n = self.job.drive.n_frames()?;
        let topic = streamed(self.job, &self.inputs)?;
        let counts = |frame: &&SentFrame| {
            *frame.topic == *topic && frame.sim_nanos >= self.job.truth.scored_from_nanos
        };
        let mut of_stream = frames.iter().filter(counts);
        let last = of_stream.nth((n as usize).saturating_sub(1))?;
        Some(last.published_mono_nanos)
    }

    fn capture(mut self) -> Capture {
        let leaders = self.up.pids().clone();
        self.meter.look(&leaders, true, &mut self.usage);
        let job = self.job;
        let (n_lost, n_refused) = self.observer.counts();
        let mut frames = frames(job, &self.inputs, &self.observer);
        let live = self.is_live();
        let mut results = std::mem::take(&mut self.observer.captured);
        if let Some(cut) = self.last_of_stream(&frames) {
            frames.retain(|frame| frame.published_mono_nanos <= cut);
            let answers = |input: &InputRecord| input.published_mono_nanos <= cut;
            results.retain(|result| result.inputs.iter().all(answers));
        }
        if live {
            // A simulator goes on behind the end of the scenario.
            results.retain(|result| result.header.tick <= job.truth.last_tick);
        }
        let recorded = drive_recording(job);
        let mut faults = self.faults;
        faults.append(&mut self.observer.faults);
        if n_lost > 0 {
            faults.push(format!(
                "{n_lost} of its results came faster than they could be kept"
            ));
        }
        Capture {
            program: job.program.name.clone(),
            scenario: job.truth.scenario.name.clone(),
            mode: job.drive.mode(),
            speed: job.drive.speed(),
            added_delay_nanos: job.options.added_delay_nanos,
            clock: self.observer.clock,
            results,
            abouts: self.observer.abouts,
            frames,
            n_lost,
            n_refused,
            usage: self.usage,
            faults,
            has_crashed: self.has_crashed,
            drive_recording: recorded.is_file().then_some(recorded),
        }
    }
}

/// What is awaited: by task, the topics of its sensor that the program gets, and their ticks.
fn expected(job: &Job<'_>, inputs: &[String]) -> Expected {
    let mut expected = Expected::default();
    for task in &job.suite.tasks {
        let is_its = |topic: &&String| {
            let input = job.truth.inputs.iter().find(|input| input.topic == **topic);
            input.is_some_and(|input| task.sensor.as_deref() == Some(&input.sensor))
        };
        let mut topics: Vec<String> = inputs.iter().filter(is_its).cloned().collect();
        if topics.is_empty() {
            // A program that is shown nothing of the sensor works on results of others.
            topics = inputs.to_vec();
        }
        let frames = topics
            .iter()
            .filter_map(|topic| job.truth.frames.get(topic));
        let ticks = frames.flatten().map(|frame| frame.tick).collect();
        expected.ticks.insert(task.name.clone(), ticks);
        expected.topics.insert(task.name.clone(), topics);
    }
    expected
}

/// The frames that were there to be taken, with the times at which they were sent.
fn frames(job: &Job<'_>, inputs: &[String], observer: &Observer<'_>) -> Vec<SentFrame> {
    let is_stream = job.drive.n_frames().is_some();
    let belongs = |frame: &&SentFrame| is_stream || frame.tick <= job.truth.last_tick;
    let mut frames: Vec<SentFrame> = observer.seen.values().filter(belongs).cloned().collect();
    if job.drive.n_frames().is_none() {
        // Those that this program missed, or that a run which ended early did not reach.
        let seen: BTreeSet<(&str, u64)> = frames
            .iter()
            .map(|frame| (&*frame.topic, frame.tick))
            .collect();
        let mut missed: Vec<SentFrame> = inputs
            .iter()
            .flat_map(|topic| job.truth.sent(topic))
            .filter(|frame| !seen.contains(&(&*frame.topic, frame.tick)))
            .collect();
        // When they were sent is known to those who answered them.
        let answered = observer.captured.iter().flat_map(|result| &result.inputs);
        let answered: HashMap<(String, u64), &InputRecord> = answered
            .map(|input| ((input.topic(), input.tick), input))
            .collect();
        for frame in &mut missed {
            frame.epoch = observer.newest.map_or(0, |(epoch, _)| epoch);
            if let Some(input) = answered.get(&(frame.topic.to_string(), frame.tick)) {
                frame.epoch = input.epoch;
                frame.published_mono_nanos = input.published_mono_nanos;
            }
        }
        frames.extend(missed);
    }
    match job.drive.n_frames() {
        Some(_) => frames.sort_by_key(|frame| frame.published_mono_nanos),
        None => frames.sort_by(|a, b| (a.tick, &a.topic).cmp(&(b.tick, &b.topic))),
    }
    frames
}
