//! Participants of the lockstep and clients: those that ticks wait for.

mod clients;

use anyhow::{Context as _, ensure};
use schema_bus::{AckReader, Bus, Gate, Look, Origin, mono_now};
use schema_frames::StepMode;
use schema_types::Tick;

use crate::clock::Clock;
use crate::faults::Faults;
use crate::settings::Settings;
use crate::settings::cli::OnLostClient;
pub use clients::CLEANING_NANOS;
use clients::Clients;

/// Most ticks one cue can ask for: a day at 100 Hz; more is surely a mistake in units.
const MAX_CUE: u64 = 8_640_000;

/// Those that ticks wait for.
pub struct Participants {
    gate: Gate,
    clients: Clients,
    /// Lockstep participants that the first tick waits for: how many, and of which names.
    n_awaited: usize,
    awaited_names: Vec<String>,
    /// Idle time after which a living participant is removed.
    timeout_nanos: Option<u64>,
    on_lost_client: OnLostClient,
}

impl Participants {
    /// Nobody has joined yet.
    pub fn new(settings: &Settings, now_nanos: u64) -> Participants {
        Participants {
            gate: Gate::new(settings.launch.scenario.mode),
            clients: Clients::new(now_nanos),
            n_awaited: settings.run.n_awaited_participants,
            awaited_names: settings.awaited_participants.clone(),
            timeout_nanos: settings.run.lockstep_timeout_nanos,
            on_lost_client: settings.run.on_lost_client,
        }
    }

    /// How ticks are started.
    pub fn mode(&self) -> StepMode {
        self.gate.mode()
    }

    /// Names of the participants.
    pub fn names(&self) -> Vec<String> {
        let participants = self.gate.participants().iter();
        participants.map(|it| it.name.clone()).collect()
    }

    /// The name under which a participant joined.
    pub fn name_of(&self, number: u32) -> Option<String> {
        self.gate.name_of(number)
    }

    /// Whether anybody takes part in the lockstep; they are owed the frames of a tick until they
    /// acknowledge it.
    pub fn are_there(&self) -> bool {
        !self.gate.participants().is_empty()
    }

    /// Whether all frames of a tick are sent before the next begins.
    pub fn want_whole_ticks(&self) -> bool {
        self.gate.mode() == StepMode::Stepped || self.are_there()
    }

    /// Whether everybody has acknowledged the last tick that was begun.
    pub fn have_acknowledged(&self, Tick(last_tick): Tick) -> bool {
        self.gate.missing(last_tick).next().is_none()
    }

    /// Idle time after which those that the world waits for are given up in lockstep.
    pub fn timeout_nanos(&self) -> Option<u64> {
        self.timeout_nanos
    }

    /// Whether stepped mode runs on without cues, because its clients are gone.
    pub fn run_alone(&self) -> bool {
        self.clients.is_running_alone()
    }

    /// Whether participants and clients let the next tick start. A journal, which is being run again
    /// if `is_played`, needs no cues, and neither does a daemon without clients.
    pub fn let_start(&self, last_tick: Tick, is_played: bool) -> bool {
        let has_joined = |name: &String| self.gate.participants().iter().any(|p| p.name == *name);
        let enough = last_tick > Tick(0)
            || (self.gate.participants().len() >= self.n_awaited
                && self.awaited_names.iter().all(has_joined));
        let is_uncued = self.run_alone() || is_played;
        let open =
            self.gate.is_open(last_tick.0) || (is_uncued && self.have_acknowledged(last_tick));
        enough && open
    }

    /// Takes note of the acknowledgements that wait.
    pub fn take_acks(
        &mut self,
        acks: &mut AckReader,
        epoch: u64,
        Tick(last_tick): Tick,
        faults: &mut Faults,
    ) {
        match acks.drain() {
            Ok(acks) => self.gate.note(acks, epoch, last_tick, faults.of_acks()),
            Err(error) => faults.unreadable(&error),
        }
    }

    /// Removes lockstep participants whose process is gone, and idle ones if a time-out is set. Says
    /// for whom the world waits long. Returns whether any were removed.
    pub fn look_after(&mut self, clock: &Clock, bus: &Bus, acks: &AckReader) -> bool {
        let Tick(tick) = clock.tick();
        let is_awaited = self.n_awaited > 0 || !self.awaited_names.is_empty();
        let look = Look {
            tick,
            before_first: tick == 0 && is_awaited,
            idle_nanos: clock.idle_nanos(),
            timeout_nanos: self.timeout_nanos,
        };
        self.gate.look_after(bus, acks, &look) > 0
    }

    /// Takes the places of killed processes back from time to time, so that nothing is rendered for
    /// them.
    pub fn clean(&mut self, bus: &Bus, now_nanos: u64, is_idle: bool) {
        if self.clients.must_clean(now_nanos, is_idle) {
            bus.clean_dead_nodes();
        }
    }

    /// Notices killed clients, and lets stepped mode run on by itself once none is left. Returns
    /// whether it begins to.
    pub fn look_after_clients(
        &mut self,
        n_clients: usize,
        Tick(tick): Tick,
        now_nanos: u64,
    ) -> bool {
        if self.mode() == StepMode::FreeRunning || n_clients > 0 || tick == 0 {
            self.clients.seen(now_nanos);
            return false;
        }
        let begins = self.clients.missed(now_nanos, self.on_lost_client);
        if begins {
            tracing::warn!(
                tick,
                "no client for 10 s in stepped mode; running on by itself until the next cue"
            );
        }
        begins
    }

    /// A client asks for `n` ticks. Returns the last tick that is cued.
    ///
    /// # Errors
    /// If ticks need no cues, or `n` is out of bounds.
    pub fn cue(&mut self, n: u64, Tick(last_tick): Tick) -> anyhow::Result<u64> {
        ensure!(
            self.mode() == StepMode::Stepped,
            "step needs stepped mode; send {{\"do\":\"configure\",\"mode\":\"stepped\"}} first"
        );
        ensure!(
            (1..=MAX_CUE).contains(&n),
            "n is {n}, but must be 1 to {MAX_CUE}"
        );
        if self.clients.take_over(mono_now().0) {
            tracing::info!(tick = last_tick, "a client steps again");
        }
        Ok(self.gate.cue(n, last_tick))
    }

    /// A client sets how ticks are started.
    pub fn set_mode(&mut self, mode: StepMode, Tick(last_tick): Tick) {
        self.gate.set_mode(mode, last_tick);
        self.clients.take_over(mono_now().0);
    }

    /// Lets the process `asker` join the lockstep under `name`. Returns its number.
    ///
    /// # Errors
    /// If the name cannot be used.
    pub fn join(
        &mut self,
        name: &str,
        asker: &Origin,
        bus: &Bus,
        acks: &AckReader,
        Tick(last_tick): Tick,
    ) -> anyhow::Result<u32> {
        Ok(self.gate.admit(name, asker, bus, acks, last_tick)?)
    }

    /// Lets a participant leave the lockstep.
    ///
    /// # Errors
    /// If there is none of this number.
    pub fn leave(&mut self, participant: u32) -> anyhow::Result<()> {
        let left = self.gate.leave(participant).with_context(|| {
            format!("participant is {participant}, but nobody joined under that number")
        })?;
        tracing::info!(name = left.name, participant, "left the lockstep");
        Ok(())
    }
}
