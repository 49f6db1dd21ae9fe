//! The state of a replay, and what it does: begin a tick, begin an epoch, look after participants.

use schema_bus::{Bus, Claim, Complaints, Gate, Look, mono_now};
use schema_frames::StepMode;
use schema_recording::read::RecordingFile;

use crate::keys::{Key, Keys};
use crate::options::{Options, Rate};
use crate::pace::Pace;
use crate::plan::Plan;
use crate::ports::Ports;
use crate::tape::Tape;
use crate::world::State;

/// How long a participant may take to come back after a jump.
const COME_BACK_NANOS: u64 = 3_000_000_000;
/// How often processes that were killed are looked for.
const CLEAN_NANOS: u64 = 1_000_000_000;

/// What the documents say about the replay; a macro, because it borrows single fields.
macro_rules! state {
    ($session:expr) => {
        State {
            epoch: $session.epoch,
            tick: $session.tick,
            gate: &$session.gate,
            mode: $session.mode,
        }
    };
}
/// The outcome of a replay.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Ticks that were sent, in all rounds.
    pub n_ticks: u64,
    /// Frames that were sent to at least one reader's topic.
    pub n_frames: u64,
    /// Bytes of their payloads.
    pub payload_bytes: u64,
    /// Results that were sent.
    pub n_results: u64,
    /// Frames and results that could not be sent, for want of a slot or of memory.
    pub n_dropped: u64,
    /// What could not be read, a sentence each for the first few, and how much in all.
    pub damage: (Vec<String>, u64),
    /// Ticks that began more than a millisecond late.
    pub n_late: u64,
}

/// All state, in the order in which it must be dropped.
pub(crate) struct Session {
    pub tape: Tape,
    pub ports: Ports,
    pub bus: Bus,
    _claim: Claim,
    pub options: Options,
    pub gate: Gate,
    pub mode: StepMode,
    /// Ticks that stepped mode may still begin.
    pub cues: u64,
    pub pace: Pace,
    pub epoch: u64,
    /// The last tick that was begun.
    pub tick: u64,
    /// Simulated time of that tick.
    pub sim_nanos: u64,
    /// Whether a tick has begun in this epoch.
    pub has_begun: bool,
    /// Tick whose snapshot was sent when this epoch began.
    announced: Option<u64>,
    /// Participants of the epoch before, which this one waits for.
    come_back: Vec<String>,
    epoch_began_nanos: u64,
    tick_began_nanos: u64,
    last_cleaned_nanos: u64,
    pub complaints: Complaints,
    unreadable_said: bool,
    keys: Option<Keys>,
    /// Whether the user has asked to end.
    pub quit: bool,
}

impl Session {
    /// Begins at the first tick that is asked for.
    ///
    /// # Errors
    /// If the file or the bus fails.
    pub fn new(
        options: &Options,
        file: RecordingFile,
        plan: &Plan,
        mut ports: Ports,
        bus: Bus,
        claim: Claim,
    ) -> anyhow::Result<Session> {
        let tape = Tape::new(file, plan, options);
        if let Some(map) = tape.attached_map() {
            ports.documents.set_map(&map);
        }
        let mode = match options.paused {
            true => StepMode::Stepped,
            false => StepMode::FreeRunning,
        };
        let keys = options.keys.then(Keys::open).flatten();
        let mut session = Session {
            tape,
            ports,
            bus,
            _claim: claim,
            options: options.clone(),
            gate: Gate::new(StepMode::FreeRunning),
            mode,
            cues: 0,
            pace: Pace::new(match options.rate {
                Rate::Ratio(ratio) => Some(ratio),
                Rate::Max => None,
            }),
            epoch: 0,
            tick: 0,
            sim_nanos: 0,
            has_begun: false,
            announced: None,
            come_back: Vec::new(),
            epoch_began_nanos: 0,
            tick_began_nanos: 0,
            last_cleaned_nanos: mono_now().0,
            complaints: Complaints::default(),
            unreadable_said: false,
            keys,
            quit: false,
        };
        session.begin_epoch(session.tape.start_nanos())?;
        let (first, last) = session.tape.span();
        tracing::info!(
            file = %options.file.display(),
            domain = options.domain,
            from = first as f64 * 1e-9,
            to = last as f64 * 1e-9,
            topics = plan.frames.len().saturating_add(plan.results.len()),
            "ready"
        );
        Ok(session)
    }

    /// Begins the next tick and sends it.
    ///
    /// # Errors
    /// If the file or the bus fails.
    pub fn run_tick(&mut self) -> anyhow::Result<()> {
        let now = mono_now().0;
        // A reader that came while the tick waited gets its frames, too.
        if self.tape.lacks_readers(&self.ports) {
            self.tape.read_again(&mut self.ports)?;
        }
        let Some(next_nanos) = self.tape.next_nanos() else {
            return Ok(());
        };
        self.pace.start_tick(next_nanos, now);
        self.tick_began_nanos = now;
        (self.has_begun, self.cues) = (true, self.cues.saturating_sub(1));
        self.send_tick()
    }

    fn send_tick(&mut self) -> anyhow::Result<()> {
        let Some(group) = self.tape.take() else {
            return Ok(());
        };
        (self.tick, self.sim_nanos) = (group.tick, group.sim_nanos);
        let announced = self.announced == Some(group.tick);
        let ports = &mut self.ports;
        let documents = self.tape.send(group, ports, self.epoch, announced)?;
        let state = state!(self);
        for document in &documents {
            self.ports.documents.send(document, &state)?;
        }
        Ok(())
    }

    /// Goes on at a simulated time, in a new epoch.
    pub fn jump(&mut self, nanos: u64) -> anyhow::Result<()> {
        self.tape.skip_to(nanos);
        self.begin_epoch(nanos)
    }

    /// Begins an epoch whose first tick is the first at `nanos` or later.
    fn begin_epoch(&mut self, nanos: u64) -> anyhow::Result<()> {
        self.sim_nanos = nanos;
        self.tape.load(&mut self.ports)?;
        self.new_epoch()
    }

    /// Begins an epoch at the next tick.
    ///
    /// # Errors
    /// If the file or the bus fails.
    pub fn new_epoch(&mut self) -> anyhow::Result<()> {
        let nanos = self.tape.next_nanos().unwrap_or(self.sim_nanos);
        self.epoch = new_epoch();
        self.tick = self
            .tape
            .next_tick()
            .map_or(self.tick, |tick| tick.saturating_sub(1));
        self.sim_nanos = nanos;
        (self.has_begun, self.announced) = (false, None);
        (self.epoch_began_nanos, self.tick_began_nanos) = (mono_now().0, mono_now().0);
        self.pace.restart();
        let before: Vec<_> = self.gate.participants().to_vec();
        for participant in before {
            self.gate.leave(participant.number);
            if !self.come_back.contains(&participant.name) {
                self.come_back.push(participant.name);
            }
        }
        let documents = self.tape.documents_at(nanos)?;
        let state = state!(self);
        self.ports.documents.begin(&documents, &state)?;
        self.announce()
    }

    /// Shows the world of an epoch before its first tick begins.
    pub fn announce(&mut self) -> anyhow::Result<()> {
        if self.has_begun || self.announced.is_some() {
            return Ok(());
        }
        if self.tape.announce(&self.ports, self.epoch)? {
            self.announced = self.tape.next_tick();
        }
        // Tick 0 is the world before the first tick; it needs no cue, and nobody is done with it.
        if self.announced == Some(0) {
            self.tape.load(&mut self.ports)?;
            self.send_tick()?;
        }
        Ok(())
    }

    /// Whether the next tick may begin, as far as cues and participants are concerned.
    pub fn may_start(&self) -> bool {
        let is_cued = self.mode == StepMode::FreeRunning || self.cues > 0;
        let all_done = self.gate.missing(self.tick).next().is_none();
        is_cued && all_done && (self.has_begun || !self.is_awaiting())
    }

    /// Whether participants are missing that the first tick of an epoch waits for.
    fn is_awaiting(&self) -> bool {
        let participants = self.gate.participants();
        let has_joined = |name: &String| participants.iter().any(|of| of.name == *name);
        participants.len() < self.options.n_awaited
            || !self.options.awaited.iter().all(has_joined)
            || !self.come_back.iter().all(has_joined)
    }

    /// Takes acknowledgements of participants.
    pub fn take_acks(&mut self) {
        match self.ports.acks.drain() {
            Ok(acks) => self
                .gate
                .note(acks, self.epoch, self.tick, &mut self.complaints),
            Err(error) if !std::mem::replace(&mut self.unreadable_said, true) => {
                tracing::warn!(%error, "acknowledgements could not be read; trying again");
            }
            Err(_) => {}
        }
    }

    /// Removes participants that are gone or idle, and says for whom the replay waits.
    pub fn look_after_participants(&mut self) {
        let look = Look {
            tick: self.tick,
            before_first: !self.has_begun && self.is_awaiting(),
            idle_nanos: mono_now().0.saturating_sub(self.tick_began_nanos),
            timeout_nanos: self.options.lockstep_timeout_nanos,
        };
        let n_removed = self.gate.look_after(&self.bus, &self.ports.acks, &look);
        self.look_after_late_ones();
        if n_removed > 0
            && let Err(error) = self.publish_info()
        {
            tracing::warn!(%error, "cannot say who is left in the lockstep");
        }
    }

    /// Notes that a participant of the epoch before has come back.
    pub fn has_come_back(&mut self, name: &str) {
        self.come_back.retain(|other| other != name);
    }

    /// Gives up participants of the epoch before that do not come back.
    fn look_after_late_ones(&mut self) {
        let waited = mono_now().0.saturating_sub(self.epoch_began_nanos);
        if self.come_back.is_empty() || waited < COME_BACK_NANOS {
            return;
        }
        let writers = self.ports.acks.writers();
        let gate = &self.gate;
        self.come_back.retain(|name| {
            let has_joined = gate.participants().iter().any(|of| of.name == *name);
            let lives = writers.iter().any(|writer| writer.port == *name);
            if !has_joined && !lives {
                tracing::warn!(
                    name,
                    "lockstep participant has not come back after the jump; going on without it"
                );
            }
            has_joined || lives
        });
    }

    /// Says what `world/info` says about the replay, if that changed.
    ///
    /// # Errors
    /// [`schema_bus::BusError`].
    pub fn publish_info(&mut self) -> anyhow::Result<()> {
        let state = state!(self);
        self.ports.documents.publish_info(&state)
    }

    /// Takes the places of killed processes back from time to time.
    pub fn clean(&mut self) {
        let now = mono_now().0;
        if now.saturating_sub(self.last_cleaned_nanos) > CLEAN_NANOS {
            self.last_cleaned_nanos = now;
            self.bus.clean_dead_nodes();
        }
    }

    /// The next key that was pressed on the terminal.
    pub fn next_key(&self) -> Option<Key> {
        self.keys.as_ref().and_then(Keys::next)
    }

    /// Shows on the terminal where the replay is.
    pub fn show_status(&mut self) {
        let (_, last) = self.tape.span();
        let (mode, ratio) = (self.mode, self.pace.ratio());
        if let Some(keys) = &mut self.keys {
            keys.show(self.sim_nanos, last, mode, ratio);
        }
    }

    /// What was replayed so far.
    pub fn report(&self) -> Report {
        let damage = self.tape.damage();
        let counts = self.tape.counts();
        Report {
            n_ticks: counts.n_ticks,
            n_frames: self.ports.frames.iter().map(|port| port.n_sent).sum(),
            payload_bytes: counts.payload_bytes,
            n_results: counts.n_results,
            n_dropped: counts.n_dropped,
            damage: (damage.sentences().to_vec(), damage.total()),
            n_late: self.pace.n_late(),
        }
    }
}

/// Tells one epoch from another.
fn new_epoch() -> u64 {
    let wall = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .map_or(0, |since| since.as_nanos() as u64);
    schema_types::noise::mix(wall ^ schema_types::noise::mix(std::process::id() as u64))
}
