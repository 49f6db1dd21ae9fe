//! The daemon: its parts, and its top-level steps, each of which hands the parts that it needs to one
//! of them.
//!
//! The tick loop says in which order the steps are made.

use std::time::Duration;

use schema_bus::mono_now;
use schema_frames::JournalFile;
use schema_stages::Stage;
use schema_types::Tick;
use simd_frames::hash::BytesHash;

use crate::clock::Clock;
use crate::commands::{self, Again};
use crate::faults::Faults;
use crate::files::{Files, Given};
use crate::history::{Act, History, Played};
use crate::participants::Participants;
use crate::ports::{Ports, State};
use crate::sensing::{DueSensors, Parting, Sensing, Surroundings};
use crate::world::LiveWorld;

/// Requests of clients, and controls. Stages up to a tick's scene count their processor time always;
/// `gantry bench tick --profile` shows them. Those of frames are in `simd_frames`.
static COMMANDS: Stage = Stage::new("commands");
/// The world's step: vehicles, people, lights, weather.
static PHYSICS: Stage = Stage::new("physics");
/// Snapshot and documents.
static SNAPSHOT: Stage = Stage::new("snapshot");

/// Least time between two looks after those that the world waits for. One lists all nodes of the bus,
/// which takes longer than a tick; acknowledgements wake the daemon several times a tick.
const LOOK_EVERY_NANOS: u64 = 50_000_000;

/// The parts of the daemon.
///
/// The order of the first three fields matters, because fields are dropped in theirs: frames in
/// flight, the topics of sensors, and the thread that reads files and its port go before the services
/// of the daemon, its claim and its bus. What the GPU writes into must outlive its work, and while the
/// claim is held no other daemon opens services of the same names.
pub struct Daemon {
    sensing: Sensing,
    files: Files,
    ports: Ports,
    world: LiveWorld,
    clock: Clock,
    participants: Participants,
    history: History,
    /// Commands of a journal that wait for what is read for them.
    again: Option<Again>,
    faults: Faults,
    /// The tick that participants were told is complete.
    told: Tick,
    /// When those that the world waits for were looked after last.
    looked_nanos: u64,
}

impl Daemon {
    /// A daemon before its first tick. Publishes the world as it stands then: processes that must be
    /// ready before the first tick (lockstep participants, controllers) see it.
    ///
    /// # Errors
    /// If the scenery cannot be shown.
    pub fn new(
        sensing: Sensing,
        files: Files,
        ports: Ports,
        world: LiveWorld,
        clock: Clock,
        participants: Participants,
        history: History,
    ) -> anyhow::Result<Daemon> {
        let mut daemon = Daemon {
            sensing,
            files,
            ports,
            world,
            clock,
            participants,
            history,
            again: None,
            faults: Faults::default(),
            told: Tick(0),
            looked_nanos: mono_now().0,
        };
        daemon.publish_documents();
        daemon.send_snapshot()?;
        tracing::info!(
            map = daemon.world.world().map().name,
            actors = daemon.world.world().snapshot_records().len(),
            "ready"
        );
        Ok(daemon)
    }

    /// Lets processor time be read by tick.
    pub fn post_stages(&self) {
        schema_stages::post(self.clock.tick().0);
    }

    /// A world that stands still hears of a lost GPU here.
    pub fn check_gpu(&self) -> anyhow::Result<()> {
        self.sensing.lose_gpu_if_asked();
        Ok(self.sensing.check_gpu()?)
    }

    /// Whether the run is over: its last tick has begun, and participants of the lockstep have got all
    /// of it, too.
    pub fn has_finished(&self) -> bool {
        self.clock.is_at_end()
            && self.participants.have_acknowledged(self.clock.tick())
            && self.sensing.workers_have_sent_all()
    }

    /// Lets everything act that a journal has for the edge behind the last tick, or ends the journal.
    /// Returns whether that is done; what is still to be read of it comes from the thread for files.
    pub fn play_journal(&mut self) -> anyhow::Result<bool> {
        if !self.history.is_played() {
            return Ok(true);
        }
        let edge = self.clock.tick();
        let (now_nanos, period_nanos) = (self.clock.now().0, self.clock.period_nanos());
        loop {
            if let Some(stretch) = self.files.take_stretch() {
                self.history.add(stretch);
            }
            if self.history.begin_to_read() {
                self.files.read_journal();
            }
            self.files.go_on(self.world.world());
            if let Some(again) = self.again.take() {
                let Some(given) = self.files.take_given() else {
                    self.again = Some(again);
                    return Ok(false);
                };
                self.run_again(&again, given);
                continue;
            }
            match self.history.next_at(edge, now_nanos, period_nanos)? {
                Played::Act(act) => self.play(act)?,
                Played::Waits => return Ok(true),
                Played::Unread => return Ok(false),
                Played::Ends => break,
            }
        }
        self.sensing.follow_readers();
        self.clock.pace_anew(mono_now().0);
        self.ports.touch_info();
        tracing::info!(tick = edge.0, "the journal ends; the world is live");
        Ok(true)
    }

    fn run_again(&mut self, again: &Again, given: Given) {
        commands::run_again(&mut self.context(), again, given);
        if again.is_last_of_round {
            self.history.end_round(self.clock.tick());
            self.publish_documents();
        }
    }

    /// Lets one entry of a journal act.
    fn play(&mut self, act: Act) -> anyhow::Result<()> {
        let edge = self.clock.tick();
        match act {
            Act::Commands {
                client,
                seq,
                text,
                outcomes,
                is_last_of_round,
            } => {
                let by = (client, seq);
                let (again, needs) = Again::of(&self.files, by, text, outcomes, is_last_of_round)?;
                match needs.nothing() {
                    true => self.run_again(&again, Given::refusals(needs.refused)),
                    false => {
                        self.files.read_for_journal(needs);
                        self.again = Some(again);
                    }
                }
            }
            Act::Controls { writer, records } => {
                self.history.note_controls(edge, &writer, &records);
                for record in &records {
                    // What was refused then is refused now.
                    if let Err(error) = self.world.hold_control(record) {
                        tracing::debug!(%error, writer, "a control of the journal is refused");
                    }
                }
            }
            Act::Audience { topic, is_made } => self.sensing.tell(&topic, is_made),
            Act::File {
                of: JournalFile::Map,
                name,
                title,
                bytes,
            } => self.files.provide_map(name, title, bytes),
            Act::File {
                of: JournalFile::Checkpoint,
                name,
                bytes,
                ..
            } => self.files.provide_checkpoint(name, bytes),
        }
        Ok(())
    }

    /// Sends the latest snapshot and documents to readers that joined since the last call.
    pub fn greet(&self) {
        self.ports.greet();
    }

    /// Takes note of the acknowledgements that wait.
    pub fn take_acks(&mut self) {
        let epoch = self.world.episode().stamp().epoch;
        let acks = self.ports.acks_mut();
        self.participants
            .take_acks(acks, epoch, self.clock.tick(), &mut self.faults);
    }

    /// Hears the workers, and gives cameras their places.
    pub fn attend_workers(&mut self) -> anyhow::Result<()> {
        let (tick, is_played) = (self.clock.tick(), self.history.is_played());
        let are_owed_frames = self.participants.want_whole_ticks() && tick > Tick(0);
        let around = Surroundings {
            world: &self.world,
            clock: &self.clock,
            bus: self.ports.bus(),
            parting: match are_owed_frames && !self.participants.let_start(tick, is_played) {
                true => Parting::WithNextTick,
                false => Parting::Now,
            },
        };
        self.sensing
            .attend_workers(&around, &self.participants, &mut self.faults)
    }

    /// Whether the next tick may start, its deadline aside.
    pub fn may_start(&self) -> bool {
        let is_played = self.history.is_played();
        !self.clock.is_at_end()
            && self.participants.let_start(self.clock.tick(), is_played)
            && self.sensing.let_start(&self.clock, &self.participants)
    }

    /// Whether ticks have deadlines in real time.
    pub fn is_paced(&self) -> bool {
        let is_free = self.participants.mode() == schema_frames::StepMode::FreeRunning;
        !self.history.is_played()
            && ((is_free && self.clock.keeps_real_time()) || self.participants.run_alone())
    }

    /// Real time until the next tick is due; 0 if it is due, late, or has no deadline.
    pub fn wait_nanos(&self, now_nanos: u64) -> u64 {
        match self.is_paced() {
            true => self.clock.wait_nanos(now_nanos),
            false => 0,
        }
    }

    /// Whether all frames of a tick are sent before the next begins.
    pub fn wants_whole_ticks(&self) -> bool {
        self.participants.want_whole_ticks()
    }

    /// Whether frames are in flight.
    pub fn is_drawing(&self) -> bool {
        self.sensing.is_busy()
    }

    /// Sends the oldest frames in flight if they are drawn within `most`.
    pub fn finish_oldest_within(&mut self, most: Duration) -> anyhow::Result<()> {
        self.sensing.finish_oldest_within(most)
    }

    /// Waits for all frames in flight, and sends them.
    pub fn finish_frames(&mut self) -> anyhow::Result<()> {
        self.sensing.finish_all()
    }

    /// Tells the participants of the lockstep, once, that every frame of the tick was sent. If that
    /// cannot be said, it is counted; who does not hear it asks.
    pub fn tell_complete(&mut self) {
        let tick = self.clock.tick();
        if self.told == tick
            || !self.participants.are_there()
            || !self.sensing.let_answer(&self.participants)
        {
            return;
        }
        self.told = tick;
        let epoch = self.world.episode().stamp().epoch;
        if let Err(error) = self.ports.tell_complete(epoch, tick) {
            self.faults.unsent("the end of a tick", &error);
        }
    }

    /// Whether workers are expected to answer soon.
    pub fn workers_are_busy(&self) -> bool {
        self.sensing.workers_are_busy()
    }

    /// Whether requests wait for which nobody wakes the daemon again.
    pub fn is_behind(&self) -> bool {
        self.ports.is_behind()
    }

    /// Waits until somebody asks for something; returns whether that happened within `most`.
    pub fn wait(&self, most: Duration) -> anyhow::Result<bool> {
        Ok(self.ports.wait(most)?)
    }

    /// Whether commands may be answered: clients of stepped mode or lockstep may count on the frames
    /// of the tick.
    pub fn may_answer(&self) -> bool {
        self.sensing.let_answer(&self.participants)
    }

    /// Serves the commands that wait.
    pub fn serve_commands(&mut self) {
        if commands::serve(&mut self.context()) {
            self.publish_documents();
        }
    }

    /// Makes the spectator's image anew while the world stands still.
    pub fn show_again(&mut self) -> anyhow::Result<()> {
        let (world, bus) = (&mut self.world, self.ports.bus());
        self.sensing
            .show_again(world, &self.clock, bus, &mut self.faults)
    }

    /// Looks after those that the world waits for: participants, workers and clients. Does nothing
    /// until some time after the last look.
    pub fn look_after_all(&mut self) {
        let now_nanos = mono_now().0;
        if now_nanos.saturating_sub(self.looked_nanos) < LOOK_EVERY_NANOS {
            return;
        }
        self.looked_nanos = now_nanos;
        let (bus, acks) = (self.ports.bus(), self.ports.acks());
        if self.participants.look_after(&self.clock, bus, acks) {
            self.ports.touch_info();
            // While the world stands still, no tick says who is left.
            self.publish_documents();
        }
        self.sensing
            .look_after_workers(&self.clock, &self.participants);
        self.clean(now_nanos, true);
        let (n_clients, tick) = (self.ports.n_clients(), self.clock.tick());
        if self
            .participants
            .look_after_clients(n_clients, tick, now_nanos)
        {
            self.clock.pace_anew(now_nanos);
        }
    }

    /// Takes the places of killed processes back from time to time.
    pub fn clean(&mut self, now_nanos: u64, is_idle: bool) {
        self.participants
            .clean(self.ports.bus(), now_nanos, is_idle);
    }

    /// Begins the next tick, after the commands and controls that wait between two; `false` if these
    /// say that it may not start yet.
    pub fn begin_tick(&mut self) -> bool {
        self.clock.start_tick();
        self.keep_up();
        {
            let _span = COMMANDS.span();
            self.serve_commands();
            if !self.may_start() {
                return false;
            }
            self.hold_controls();
        }
        self.clock.advance();
        self.sensing.start_tick(&self.clock);
        true
    }

    /// Lets cameras and lidars fire less often if real time is not kept and the user wants that.
    fn keep_up(&mut self) {
        let is_paced = self.is_paced();
        if let Some(every) = self.clock.keep_up(is_paced) {
            self.sensing.fire_every(every);
            tracing::warn!(
                tick = self.clock.tick().0,
                "real time is not kept: cameras and lidars fire once in {every} ticks from now on (--keep-up)"
            );
        }
    }

    /// Holds the controls that wait. While a journal is run again they do not count.
    fn hold_controls(&mut self) {
        let batches = self.ports.take_controls(&mut self.faults);
        if self.history.is_played() {
            return;
        }
        for batch in batches {
            self.history
                .note_controls(self.clock.tick(), &batch.writer, &batch.records);
            for record in &batch.records {
                if let Err(error) = self.world.hold_control(record) {
                    self.faults.refused_control(&batch, &error);
                }
            }
        }
    }

    /// Moves the world by one tick.
    pub fn step_physics(&mut self) {
        let _span = PHYSICS.span();
        self.world.step(self.clock.period_nanos());
    }

    /// Publishes the actors' states after the current tick, and the documents that changed.
    pub fn publish_snapshot(&mut self) -> anyhow::Result<()> {
        let _span = SNAPSHOT.span();
        self.send_snapshot()?;
        self.publish_documents();
        Ok(())
    }

    /// Finds the sensors that fire in the current tick, after their topics have got memory.
    pub fn schedule(&mut self) -> anyhow::Result<DueSensors> {
        self.sensing.settle_topics(self.ports.bus(), &self.clock)?;
        self.sensing.schedule(&mut self.world, &self.clock)
    }

    /// Makes the frames of the sensors that are due.
    pub fn fire(&mut self, due: DueSensors) -> anyhow::Result<()> {
        self.sensing.fire(due, &self.world, &mut self.faults)?;
        let edge = self.clock.edge_before();
        for (topic, is_made) in self.sensing.take_audience_changes() {
            self.history.note_audience(edge, &topic, is_made);
        }
        Ok(())
    }

    /// Ends the run with its result: sends what is in flight, says the daemon's last line, and gives
    /// everything back.
    pub fn end(mut self, result: anyhow::Result<()>) -> anyhow::Result<()> {
        let finished = self.sensing.finish_all();
        for (request, answer) in self.files.finish() {
            self.ports.reply(request, &answer);
        }
        self.report();
        let ended = result
            .and(finished)
            .and(self.sensing.check_gpu().map_err(Into::into));
        let closed = self.sensing.close();
        ended.and(closed)
    }

    /// Sends the snapshot of the current tick. If it cannot be sent, that is said and counted, and the
    /// world goes on: its readers see a gap.
    fn send_snapshot(&mut self) -> anyhow::Result<()> {
        let flags = self.world.show_scenery(self.sensing.sensors_mut())?;
        let revision = self.ports.actors_revision(self.world.world());
        let (header, records) = self.world.snapshot(&self.clock, flags, revision);
        if self.sensing.prints_hashes() {
            let hash = BytesHash::new()
                .chunk(bytemuck::cast_slice(records))
                .finish();
            println!("{} world/snapshot {hash:016x}", header.tick);
        }
        match self.ports.send_snapshot(header, records) {
            Ok(()) => self.world.snapshot_is_sent(),
            Err(error) => self.faults.unsent("the snapshot", &error),
        }
        Ok(())
    }

    /// Publishes the documents that changed.
    fn publish_documents(&mut self) {
        let state = State {
            world: &self.world,
            participants: &self.participants,
            clock: &self.clock,
            sensors: self.sensing.sensors(),
        };
        self.ports.publish_documents(&state, &mut self.faults);
    }

    /// The parts, lent to commands.
    fn context(&mut self) -> commands::Context<'_> {
        commands::Context {
            world: &mut self.world,
            sensing: &mut self.sensing,
            ports: &mut self.ports,
            clock: &mut self.clock,
            participants: &mut self.participants,
            history: &mut self.history,
            files: &mut self.files,
            faults: &mut self.faults,
        }
    }

    /// The daemon's last line.
    fn report(&self) {
        let frames = self.sensing.all_frames();
        tracing::info!(
            ticks = self.clock.tick().0,
            frames = frames.n_sent,
            dropped = frames.n_dropped,
            late_ticks = self.clock.late_ticks().n_late,
            "stopped after {:.1} s of simulated time",
            self.clock.now().as_secs()
        );
    }
}
