//! The tick loop: commands → physics → snapshot → sensors, and what waits between two ticks.

use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use launch_cli::Shutdown;
use launch_spec::Launch;
use schema_bus::{
    AckReader, CommandServer, ControlReader, Listener, Notifier, SnapshotPublisher, mono_now,
};
use schema_frames::{SnapshotHeader, StepMode};
use schema_types::time::TickClock;
use schema_types::{ActorId, SimTime, Tick};
use sensor_core::scene::{Scene, SceneAssets};
use simd_world::{Scenario, World};

use crate::checkpoints::Checkpoints;
use crate::cli::{Args, OnLostClient};
use crate::debug_shapes::DebugShapes;
use crate::documents::Documents;
use crate::frames::{Sensors, Stamp, TickEvents};
use crate::gate::Gate;
use crate::maps::Maps;
use crate::pace::Pace;
use crate::scene;

/// Longest time without a look at shutdown, lockstep participants and lost clients.
const LOOK_AROUND: Duration = Duration::from_millis(100);

/// Time without any client after which stepped mode runs on by itself (`--on-lost-client resume`).
const LOST_CLIENT_NANOS: u64 = 10_000_000_000;

/// How often a waiting daemon looks for clients that were killed: a dead one counts as a client
/// until it is cleaned up.
const CLEAN_NANOS: u64 = 1_000_000_000;

/// Ports of the daemon that are not topics of sensors.
pub struct Ports {
    /// `world/snapshot`.
    pub snapshot: SnapshotPublisher,
    /// Event of the same name, for who drives without sensors.
    pub snapshot_wake: Notifier,
    /// `control/world`.
    pub commands: CommandServer,
    /// `control/vehicles`.
    pub controls: ControlReader,
    /// `control/ack`.
    pub acks: AckReader,
    /// `control/wake`.
    pub wake: Listener,
    /// `world/info`, `map`, `actors`, `catalogue`.
    pub documents: Documents,
}

impl Ports {
    /// Hands what greets late readers to those that came since the last call.
    fn greet(&self) {
        self.snapshot.greet();
        self.documents.greet();
    }
}

/// The episode that runs.
pub struct Episode {
    /// Static world as it is shown.
    pub assets: Arc<SceneAssets>,
    /// All of it.
    pub whole: Arc<SceneAssets>,
    /// Counts of changes of the scenery that `assets` shows and snapshots told of.
    pub scenery: (u64, u64),
    /// What is the same in all headers.
    pub stamp: Stamp,
    /// Simulated time at which it began.
    pub start: SimTime,
    /// Ego and other vehicles.
    pub scenario: Scenario,
}

/// Everything, in the order in which it must be dropped.
pub struct Daemon {
    pub(crate) args: Args,
    pub(crate) launch: Launch,
    pub(crate) sensors: Sensors,
    pub(crate) ports: Ports,
    pub(crate) bus: schema_bus::Bus,
    pub(crate) world: World,
    pub(crate) maps: Maps,
    pub(crate) clock: TickClock,
    pub(crate) tick: Tick,
    pub(crate) gate: Gate,
    pub(crate) pace: Pace,
    pub(crate) episode: Episode,
    pub(crate) shutdown: Shutdown,
    pub(crate) last_client_nanos: u64,
    pub(crate) last_cleaned_nanos: u64,
    pub(crate) running_alone: bool,
    pub(crate) n_controls_refused: u64,
    pub(crate) checkpoints: Checkpoints,
    pub(crate) debug: DebugShapes,
}

/// What to do next.
enum Next {
    Tick,
    Look,
    Stop,
}

impl Daemon {
    /// Runs until the shutdown flag, the tick limit or an error.
    pub fn run(mut self) -> anyhow::Result<()> {
        let result = self.run_ticks();
        self.report();
        let closed = self.sensors.close();
        result.and(closed)
    }

    fn run_ticks(&mut self) -> anyhow::Result<()> {
        loop {
            match self.wait_for_tick()? {
                Next::Tick => self.run_tick()?,
                Next::Look => {}
                Next::Stop => return Ok(()),
            }
        }
    }

    /// Serves who asks, and says whether the next tick may start now.
    fn wait_for_tick(&mut self) -> anyhow::Result<Next> {
        if self.shutdown.requested() || self.args.ticks.is_some_and(|limit| self.tick.0 >= limit) {
            self.sensors.finish_all()?;
            return Ok(Next::Stop);
        }
        self.ports.greet();
        self.take_acks()?;
        if !self.may_start() {
            // Before a wait nothing may be left on its way: all frames of tick N are sent before
            // N+1 begins.
            self.sensors.finish_all()?;
            self.ports.wake.wait(LOOK_AROUND)?;
            self.serve_commands()?;
            self.look_after_participants();
            self.look_after_clients();
            return Ok(Next::Look);
        }
        if self.is_paced() {
            let wait_nanos = self.pace.wait_nanos(mono_now().0);
            if wait_nanos > 0 {
                if self.sensors.is_busy() {
                    self.sensors.finish_all()?;
                    return Ok(Next::Look);
                }
                if self
                    .ports
                    .wake
                    .wait(Duration::from_nanos(wait_nanos).min(LOOK_AROUND))?
                {
                    self.serve_commands()?;
                }
                return Ok(Next::Look);
            }
        }
        if self.gate.mode() == StepMode::Stepped || !self.gate.participants().is_empty() {
            self.sensors.finish_all()?;
        }
        Ok(Next::Tick)
    }

    fn may_start(&self) -> bool {
        let enough =
            self.tick.0 > 0 || self.gate.participants().len() >= self.args.await_lockstep as usize;
        let open = self.gate.is_open(self.tick.0)
            || (self.running_alone && self.gate.missing(self.tick.0).next().is_none());
        enough && open
    }

    fn is_paced(&self) -> bool {
        (self.gate.mode() == StepMode::FreeRunning && !self.args.unpaced) || self.running_alone
    }

    /// One tick in its fixed order.
    fn run_tick(&mut self) -> anyhow::Result<()> {
        self.pace.start_tick(mono_now().0);
        self.serve_commands()?;
        if !self.may_start() {
            return Ok(());
        }
        self.apply_controls()?;
        self.tick = Tick(self.tick.0 + 1);
        self.sensors.start_tick(self.tick);
        let sim_time = self.clock.time_of(self.tick);
        self.world.step(self.clock.period_nanos());
        self.publish_snapshot(sim_time)?;
        self.publish_documents()?;
        self.sensors
            .settle_topics(&self.bus, self.args.staged, self.clock.period_nanos())?;
        let scene = Scene {
            debug: self.debug.at(sim_time),
            ..self.scene(sim_time)
        };
        let (world, sensors) = (&self.world, &mut self.sensors);
        let events = TickEvents {
            collisions: world.collisions(),
            roads: world.roads().map(Arc::as_ref),
        };
        sensors.fire(&scene, &self.episode.stamp, &events, |actor| {
            scene::carrier(world, actor, sim_time)
        })
    }

    pub(crate) fn publish_snapshot(&mut self, sim_time: SimTime) -> anyhow::Result<()> {
        let restored = if std::mem::take(&mut self.checkpoints.just_restored) {
            SnapshotHeader::RESTORED
        } else {
            0
        };
        let flags = self.show_scenery()? | restored;
        let header = SnapshotHeader {
            flags,
            tick: self.tick.0,
            sim_nanos: sim_time.0,
            episode_start_nanos: self.episode.start.0,
            period_nanos: self.clock.period_nanos(),
            episode: self.episode.stamp.episode,
            actors_revision: self.ports.documents.actors_revision(&self.world),
            epoch: self.episode.stamp.epoch,
            ..bytemuck::Zeroable::zeroed()
        };
        let records = self.world.snapshot_records();
        if self.args.hash {
            let hash = crate::hash::BytesHash::new()
                .chunk(bytemuck::cast_slice(records))
                .finish();
            println!("{} world/snapshot {hash:016x}", self.tick.0);
        }
        self.ports
            .snapshot
            .send(header, records)
            .context("cannot publish the snapshot")?;
        self.ports.snapshot_wake.notify();
        Ok(())
    }

    /// Takes over what was hidden, shown or switched since the last snapshot; gives the snapshot's
    /// flags.
    fn show_scenery(&mut self) -> anyhow::Result<u32> {
        let (now, before) = (self.world.scenery_revisions(), self.episode.scenery);
        if now == before {
            return Ok(0);
        }
        let mut assets = self.episode.whole.without(self.world.hidden_objects());
        assets.switched = self.world.switched_lamps();
        self.episode.assets = Arc::new(assets);
        self.episode.scenery = now;
        if now.0 != before.0 {
            self.sensors.load(&self.episode.assets)?;
        }
        let flag = |changed: bool, flag: u32| if changed { flag } else { 0 };
        Ok(flag(now.0 != before.0, SnapshotHeader::SCENERY_CHANGED)
            | flag(now.1 != before.1, SnapshotHeader::LAMPS_CHANGED))
    }

    pub(crate) fn scene(&self, sim_time: SimTime) -> Scene {
        let mut dynamics = Vec::new();
        self.world.dynamic_instances(&mut dynamics);
        Scene {
            tick: self.tick,
            sim_time,
            period_nanos: self.clock.period_nanos(),
            assets: self.episode.assets.clone(),
            dynamics,
            weather: *self.world.weather(),
            lidar_extinction_per_m: self.world.lidar_extinction_per_m(),
            debug: Vec::new(),
        }
    }

    fn apply_controls(&mut self) -> anyhow::Result<()> {
        for batch in self.ports.controls.drain()? {
            for record in &batch.records {
                let actor = ActorId(record.actor_id);
                let lamps = if record.lamps == u32::MAX {
                    Ok(())
                } else {
                    self.world.set_lamps(actor, record.lamps)
                };
                if let Err(error) = self.world.set_control(actor, record.control()).and(lamps) {
                    if self.n_controls_refused == 0 {
                        tracing::warn!(writer = batch.writer, %error, "control refused; further refusals are only counted");
                    }
                    self.n_controls_refused += 1;
                }
            }
        }
        Ok(())
    }

    fn take_acks(&mut self) -> anyhow::Result<()> {
        for ack in self.ports.acks.drain()? {
            if ack.epoch == self.episode.stamp.epoch {
                self.gate.ack(ack.participant, ack.tick);
            }
        }
        Ok(())
    }

    /// Removes lockstep participants whose process is gone, and idle ones if a time-out is set.
    fn look_after_participants(&mut self) {
        if self.gate.missing(self.tick.0).next().is_none() {
            return;
        }
        self.bus.clean_dead_nodes();
        let living = self.ports.acks.writers();
        let missing: Vec<_> = self.gate.missing(self.tick.0).cloned().collect();
        let idle_nanos = mono_now().0.saturating_sub(self.pace.last_start_nanos());
        let timed_out = self
            .args
            .lockstep_timeout
            .is_some_and(|secs| idle_nanos > secs as u64 * 1_000_000_000);
        for participant in missing {
            let alive = living.contains(&participant.name);
            if !alive || timed_out {
                let why = if alive {
                    "is idle for longer than --lockstep-timeout"
                } else {
                    "is gone"
                };
                tracing::warn!(
                    name = participant.name,
                    tick = self.tick.0,
                    "lockstep participant {why}; going on without it"
                );
                self.gate.leave(participant.number);
                self.ports.documents.touch_info();
            }
        }
    }

    /// Stepped mode without a client: runs on by itself after a while, unless told to wait.
    fn look_after_clients(&mut self) {
        let now = mono_now().0;
        if now.saturating_sub(self.last_cleaned_nanos) > CLEAN_NANOS {
            self.bus.clean_dead_nodes();
            self.last_cleaned_nanos = now;
        }
        if self.gate.mode() == StepMode::FreeRunning
            || self.ports.commands.n_clients() > 0
            || self.tick.0 == 0
        {
            self.last_client_nanos = now;
        } else if self.args.on_lost_client == OnLostClient::Resume
            && !self.running_alone
            && now.saturating_sub(self.last_client_nanos) > LOST_CLIENT_NANOS
        {
            tracing::warn!(
                tick = self.tick.0,
                "no client for 10 s in stepped mode; running on by itself until the next cue"
            );
            self.running_alone = true;
            self.pace = Pace::new(now, self.clock.period_nanos());
        }
    }

    pub(crate) fn publish_documents(&mut self) -> anyhow::Result<()> {
        self.ports.documents.publish(&crate::documents::State {
            world: &self.world,
            launch: &self.launch,
            gate: &self.gate,
            episode: &self.episode,
            period_nanos: self.clock.period_nanos(),
            tick: self.tick.0,
            sensors: &self.sensors,
        })
    }

    fn report(&self) {
        let topics = self
            .sensors
            .sensors
            .iter()
            .flat_map(|sensor| &sensor.topics);
        let (sent, dropped) = topics.fold((0, 0), |(sent, dropped), topic| {
            (sent + topic.n_sent, dropped + topic.n_dropped)
        });
        tracing::info!(
            ticks = self.tick.0,
            frames = sent,
            dropped,
            late_ticks = self.pace.n_late(),
            "stopped after {:.1} s of simulated time",
            self.clock.time_of(self.tick).as_secs()
        );
    }
}
