//! The state of the daemon, and what every change of it publishes.
//!
//! The tick loop and the commands work on this state; it knows neither of them.

use std::sync::Arc;

use schema_bus::{Bus, Claim, Gate, GpuServer, mono_now};
use schema_frames::{CollisionEvent, SnapshotHeader};
use schema_types::time::TickClock;
use schema_types::{ActorId, SimTime, Tick};
use sensor_core::scene::Scene;
use simd_frames::frames::{Sensors, TickView};
use simd_frames::hash::BytesHash;
use simd_frames::topic::Audience;
use simd_world::{Collision, World};

use crate::checkpoints::Checkpoints;
use crate::clients::Clients;
use crate::debug_shapes::{DebugShapes, Visible};
use crate::documents::State;
use crate::episode::Episode;
use crate::faults::Faults;
use crate::journal::Journal;
use crate::keep_up::KeepUp;
use crate::maps::Maps;
use crate::pace::Pace;
use crate::player::Player;
use crate::ports::Ports;
use crate::settings::Settings;
use crate::spectator::{self, Still};
use crate::stages;
use crate::workers::Workers;

/// All state of the daemon, in the order in which it must be dropped.
pub struct Daemon {
    pub settings: Settings,
    pub sensors: Sensors,
    pub workers: Workers,
    pub ports: Ports,
    /// Where readers ask for frames that stay on the GPU.
    pub gpu_server: Option<Arc<GpuServer>>,
    /// The right to publish the domain's world.
    pub _claim: Claim,
    pub bus: Bus,
    pub world: World,
    pub maps: Maps,
    pub clock: TickClock,
    /// The last tick that was begun.
    pub tick: Tick,
    pub gate: Gate,
    pub pace: Pace,
    /// Used if the settings ask for it.
    pub keep_up: KeepUp,
    /// Simulated seconds per second that paced ticks aim at.
    pub speed_ratio: f64,
    pub episode: Episode,
    pub clients: Clients,
    pub faults: Faults,
    pub checkpoints: Checkpoints,
    /// Whether the next snapshot is the first after going back to a checkpoint.
    pub just_restored: bool,
    pub debug: DebugShapes,
    /// What the spectator's last image shows.
    pub still: Still,
    /// What acted on the world so far.
    pub journal: Journal,
    /// The journal that is run again, until it ends.
    pub player: Option<Player>,
}

impl Daemon {
    /// Simulated time of the current tick.
    pub fn now(&self) -> SimTime {
        self.clock.time_of(self.tick)
    }

    /// Time from one paced tick to the next, nanoseconds.
    pub fn wall_period_nanos(&self) -> u64 {
        ((self.clock.period_nanos() as f64 / self.speed_ratio).round() as u64).max(1)
    }

    /// Keeps the world as it is now as the start of the episode.
    pub fn mark_start(&mut self) {
        let start = self.world.checkpoint(0);
        self.checkpoints.begin_episode(start);
    }

    /// The scene of the current tick, without debug shapes.
    pub fn scene(&self) -> Scene {
        let mut dynamics = Vec::new();
        self.world.dynamic_instances(&mut dynamics);
        Scene {
            tick: self.tick,
            sim_time: self.now(),
            period_nanos: self.clock.period_nanos(),
            assets: self.episode.assets.clone(),
            dynamics,
            weather: *self.world.weather(),
            lidar_extinction_per_m: self.world.lidar_extinction_per_m(),
            debug: Vec::new(),
            overlay: Default::default(),
        }
    }

    /// On a large map, brings the scenery near the sensors.
    fn stream_scenery(&mut self) -> anyhow::Result<()> {
        let Some(stream) = &mut self.episode.stream else {
            return Ok(());
        };
        stream.follow(&mut self.sensors, &self.world, self.tick.0)?;
        self.episode.assets = stream.shown().clone();
        Ok(())
    }

    /// Fires the sensors that are due at the current tick.
    pub fn fire_sensors(&mut self) -> anyhow::Result<()> {
        let scene_span = stages::SCENE.span();
        self.stream_scenery()?;
        let sim_time = self.now();
        let visible = self.debug.at(sim_time);
        let scene = self.scene_with(visible);
        drop(scene_span);
        self.still.note(&self.sensors, &self.world, &self.debug);
        let world = &self.world;
        let collisions: Vec<_> = world.collisions().iter().map(event_of).collect();
        let edge = self.tick.0.saturating_sub(1);
        let tick = TickView {
            scene: &scene,
            stamp: &self.episode.stamp,
            collisions: &collisions,
            roads: world.roads().map(Arc::as_ref),
        };
        let (workers, faults) = (&mut self.workers, &mut self.faults);
        self.sensors.fire(
            &tick,
            |actor| crate::carrier::carrier_of(world, actor, sim_time),
            |away| {
                if let Err(error) = workers.send_scene(&tick, away) {
                    faults.unsent("the scene for render workers", &error);
                }
            },
        )?;
        for (topic, is_made) in self.sensors.take_audience_changes() {
            self.journal.note_audience(edge, &topic, is_made);
        }
        Ok(())
    }

    /// Makes the spectator's image anew while the world stands still, if it is read and shows
    /// something else than its last one. No other sensor fires.
    pub fn show_again(&mut self) -> anyhow::Result<()> {
        let idle_nanos = mono_now().0.saturating_sub(self.pace.last_start_nanos());
        if self.tick.0 == 0 || idle_nanos < spectator::STILL_NANOS {
            return Ok(());
        }
        self.sensors
            .settle_topics(&self.bus, self.clock.period_nanos())?;
        if !self.still.note(&self.sensors, &self.world, &self.debug) {
            return Ok(());
        }
        self.stream_scenery()?;
        let visible = self.debug.all();
        let scene = self.scene_with(visible);
        let (world, sim_time) = (&self.world, self.now());
        let tick = TickView {
            scene: &scene,
            stamp: &self.episode.stamp,
            collisions: &[],
            roads: world.roads().map(Arc::as_ref),
        };
        let away = self.sensors.fire_spectator(&tick, |actor| {
            crate::carrier::carrier_of(world, actor, sim_time)
        })?;
        if let Err(error) = self.workers.send_scene(&tick, Vec::from_iter(away)) {
            self.faults.unsent("the scene for render workers", &error);
        }
        Ok(())
    }

    /// The scene of the current tick with what is drawn for debugging.
    fn scene_with(&mut self, mut visible: Visible) -> Scene {
        let (sensors, now) = (&self.sensors.sensors, self.now());
        visible
            .strokes
            .extend(spectator::traces(sensors, &self.world, now));
        if let Some(vehicle) = self.debug.telemetry_of() {
            visible.overlay.panel = spectator::telemetry_lines(&mut self.world, vehicle);
        }
        Scene {
            debug: visible.strokes,
            overlay: visible.overlay,
            ..self.scene()
        }
    }

    /// Publishes the actors' states after the current tick. If the snapshot cannot be sent, that is
    /// said and counted, and the world goes on: its readers see a gap.
    ///
    /// # Errors
    /// If the scenery of this tick cannot be shown.
    pub fn publish_snapshot(&mut self) -> anyhow::Result<()> {
        let restored = if std::mem::take(&mut self.just_restored) {
            SnapshotHeader::RESTORED
        } else {
            0
        };
        let header = SnapshotHeader {
            flags: self.show_scenery()? | restored,
            tick: self.tick.0,
            sim_nanos: self.now().0,
            episode_start_nanos: self.episode.start.0,
            period_nanos: self.clock.period_nanos(),
            episode: self.episode.stamp.episode,
            actors_revision: self.ports.documents.actors_revision(&self.world),
            epoch: self.episode.stamp.epoch,
            ..bytemuck::Zeroable::zeroed()
        };
        let records = self.world.snapshot_records();
        if self.settings.audience == Audience::Hash {
            let hash = BytesHash::new()
                .chunk(bytemuck::cast_slice(records))
                .finish();
            println!("{} world/snapshot {hash:016x}", self.tick.0);
        }
        match self.ports.snapshot.send(header, records) {
            Ok(()) => drop(self.ports.snapshot_wake.notify()),
            Err(error) => {
                self.just_restored = restored != 0;
                self.faults.unsent("the snapshot", &error);
            }
        }
        Ok(())
    }

    /// Shows the sensors the scenery as it is now; returns the snapshot's flags.
    fn show_scenery(&mut self) -> anyhow::Result<u32> {
        let Some(change) = self.episode.take_scenery(&self.world) else {
            return Ok(0);
        };
        if change.objects {
            self.sensors.load(&self.episode.assets)?;
            if let Some(stream) = &self.episode.stream
                && self.sensors.has_rays()
            {
                self.sensors.load_rays(&stream.hit(), true);
            }
        }
        Ok(change.snapshot_flags())
    }

    /// Publishes the documents that changed. One that cannot be sent is said and counted, and tried
    /// again with the next tick: until then its readers have the older one.
    pub fn publish_documents(&mut self) {
        let sent = self.ports.documents.publish(&State {
            world: &self.world,
            gate: &self.gate,
            episode: &self.episode,
            period_nanos: self.clock.period_nanos(),
            tick: self.tick.0,
            sensors: &self.sensors,
        });
        if let Err(error) = sent {
            self.faults.unsent("a document", &error);
        }
    }
}

/// A contact as the frames of collision detectors tell it to the actor that was pushed.
fn event_of(collision: &Collision) -> (ActorId, CollisionEvent) {
    let event = CollisionEvent {
        other_id: collision.other.map_or(0, |other| other.0),
        class: collision.other_class.0,
        reserved: [0; 3],
        impulse_in_world_ns: collision.impulse_in_world_ns,
        point_in_world_m: collision.point_in_world_m,
        reserved1: 0,
    };
    (collision.actor, event)
}
