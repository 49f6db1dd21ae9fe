//! The live world: actors on a map for one episode after the other, checkpoints of it, and what
//! sensors and readers are shown of it.

mod carrier;
pub mod checkpoints;
pub mod episode;
pub mod maps;
mod scenery_stream;

use anyhow::bail;
use launch_spec::Launch;
use nalgebra::{Point3, Vector3};
use schema_frames::{
    ActorRecord, CollisionEvent, Command, CommandReply, SnapshotHeader, VehicleControlRecord,
};
use schema_types::{ActorId, SimTime};
use sensor_core::scene::Scene;
use simd_frames::carrier::Carrier;
use simd_frames::frames::Sensors;
use simd_frames::sensor::{Role, Sensor};
use simd_world::{Checkpoint, Collision, World};

use crate::clock::Clock;
pub use carrier::carrier_of;
use checkpoints::Checkpoints;
use episode::{Episode, EpisodeId};
use maps::LoadedMap;

/// The world of the daemon, and all that it is begun anew or restored from.
pub struct LiveWorld {
    world: World,
    episode: Episode,
    checkpoints: Checkpoints,
    /// Whether the next snapshot is the first after going back to a checkpoint.
    is_just_restored: bool,
    /// What every episode begins with.
    launch: Launch,
}

/// An episode on another map that can take the place of the one that runs.
pub struct NextEpisode {
    world: World,
    episode: Episode,
    /// Actors of the sensors that stay, in their order.
    actors: Vec<ActorId>,
}

impl NextEpisode {
    /// The episode.
    pub fn episode(&self) -> &Episode {
        &self.episode
    }
}

impl LiveWorld {
    /// A world whose first episode has begun, with its sensors' actors.
    pub fn new(
        world: World,
        episode: Episode,
        checkpoints: Checkpoints,
        launch: Launch,
    ) -> LiveWorld {
        let mut live = LiveWorld {
            world,
            episode,
            checkpoints,
            is_just_restored: false,
            launch,
        };
        live.mark_start();
        live
    }

    /// The actors.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The actors, to be changed.
    pub fn world_mut(&mut self) -> &mut World {
        &mut self.world
    }

    /// The episode that runs.
    pub fn episode(&self) -> &Episode {
        &self.episode
    }

    /// The launch file.
    pub fn launch(&self) -> &Launch {
        &self.launch
    }

    /// Moves everything by one tick.
    pub fn step(&mut self, period_nanos: u64) {
        self.world.step(period_nanos);
    }

    /// Carries out a command that concerns the world alone.
    pub fn apply(&mut self, command: &Command) -> CommandReply {
        self.world.apply(command)
    }

    /// Holds a control until it is replaced.
    ///
    /// # Errors
    /// If a number of it is not finite, or there is no such vehicle. It is refused whole then, and
    /// the vehicle keeps the control that it has.
    pub fn hold_control(&mut self, record: &VehicleControlRecord) -> anyhow::Result<()> {
        let pedals = [
            ("throttle_ratio", record.throttle_ratio),
            ("steer_ratio", record.steer_ratio),
            ("brake_ratio", record.brake_ratio),
        ];
        if let Some((name, value)) = pedals.into_iter().find(|(_, value)| !value.is_finite()) {
            bail!(
                "{name} of actor {} is {value}, but must be a finite number",
                record.actor_id
            );
        }
        let actor = ActorId(record.actor_id);
        self.world.set_control(actor, record.control())?;
        if record.lamps != u32::MAX {
            self.world.set_lamps(actor, record.lamps)?;
        }
        Ok(())
    }

    /// The carrier of a sensor; `None` if the sensor or the actor it is attached to has gone.
    pub fn carrier_of(&self, sensor: ActorId, sim_time: SimTime) -> Option<Carrier> {
        carrier_of(&self.world, sensor, sim_time)
    }

    /// The scene of the current tick, without debug shapes.
    pub fn scene(&self, clock: &Clock) -> Scene {
        let mut dynamics = Vec::new();
        self.world.dynamic_instances(&mut dynamics);
        Scene {
            tick: clock.tick(),
            sim_time: clock.now(),
            period_nanos: clock.period_nanos(),
            assets: self.episode.assets().clone(),
            dynamics,
            weather: *self.world.weather(),
            lidar_extinction_per_m: self.world.lidar_extinction_per_m(),
            debug: Vec::new(),
            overlay: Default::default(),
        }
    }

    /// Contacts of the current tick, as the frames of collision detectors tell them.
    pub fn collisions(&self) -> Vec<(ActorId, CollisionEvent)> {
        self.world.collisions().iter().map(event_of).collect()
    }

    /// On a large map, brings the scenery near the sensors.
    ///
    /// # Errors
    /// When frames in flight cannot be sent.
    pub fn stream_scenery(&mut self, sensors: &mut Sensors, clock: &Clock) -> anyhow::Result<()> {
        self.episode.follow(sensors, &self.world, clock.tick())
    }

    /// On a large map, brings the scenery that rays of a query pass.
    pub fn stream_for_rays(
        &mut self,
        sensors: &mut Sensors,
        rays: &[(Point3<f64>, Vector3<f64>, f64)],
        clock: &Clock,
    ) {
        self.episode.ask(sensors, rays, clock.tick());
    }

    /// Shows the sensors the scenery as it is now; returns the snapshot's flags.
    ///
    /// # Errors
    /// If it cannot be shown.
    pub fn show_scenery(&mut self, sensors: &mut Sensors) -> anyhow::Result<u32> {
        let restored = match self.is_just_restored {
            true => SnapshotHeader::RESTORED,
            false => 0,
        };
        let Some(change) = self.episode.take_scenery(&self.world) else {
            return Ok(restored);
        };
        if change.objects {
            sensors.load(self.episode.assets())?;
            if sensors.has_rays()
                && let Some(hit) = self.episode.ray_scenery()
            {
                sensors.load_rays(&hit, true);
            }
        }
        Ok(change.snapshot_flags() | restored)
    }

    /// The snapshot of the current tick with these flags, and the revision of the list of actors
    /// that it belongs to.
    pub fn snapshot(
        &self,
        clock: &Clock,
        flags: u32,
        actors_revision: u64,
    ) -> (SnapshotHeader, &[ActorRecord]) {
        let stamp = self.episode.stamp();
        let header = SnapshotHeader {
            flags,
            tick: clock.tick().0,
            sim_nanos: clock.now().0,
            episode_start_nanos: self.episode.start().0,
            period_nanos: clock.period_nanos(),
            episode: stamp.episode,
            actors_revision,
            epoch: stamp.epoch,
            ..bytemuck::Zeroable::zeroed()
        };
        (header, self.world.snapshot_records())
    }

    /// A snapshot was sent: the next one is not the first after a restored checkpoint.
    pub fn snapshot_is_sent(&mut self) {
        self.is_just_restored = false;
    }

    /// A copy of the world as it is now.
    pub fn checkpoint(&self, now: SimTime) -> Checkpoint {
        let elapsed_nanos = now.0.saturating_sub(self.episode.start().0);
        self.world.checkpoint(elapsed_nanos)
    }

    /// Keeps a checkpoint in memory.
    ///
    /// # Errors
    /// If it cannot be kept.
    pub fn save(&mut self, name: &str, now: SimTime) -> anyhow::Result<()> {
        self.checkpoints.save(name, self.checkpoint(now))
    }

    /// A checkpoint in memory.
    ///
    /// # Errors
    /// If there is none.
    pub fn saved(&self, name: &str) -> anyhow::Result<&Checkpoint> {
        self.checkpoints.find(name)
    }

    /// The start of the episode.
    ///
    /// # Errors
    /// If there is none.
    pub fn start(&self) -> anyhow::Result<Checkpoint> {
        self.checkpoints.start()
    }

    /// Restores a checkpoint; returns the actors that are gone with it. [`LiveWorld::restart_at`] says
    /// when the episode began then.
    ///
    /// # Errors
    /// If it is of another map.
    pub fn restore(&mut self, checkpoint: &Checkpoint) -> anyhow::Result<Vec<ActorId>> {
        Ok(self.world.restore(checkpoint)?)
    }

    /// A checkpoint was restored, and with it the episode began at `start`.
    pub fn restart_at(&mut self, start: SimTime) {
        self.episode.start_at(start);
        self.is_just_restored = true;
    }

    /// Builds an episode on another map beside the one that runs, with actors for those of
    /// `sensors` that stay, so that a map that cannot be used leaves the old world as it is.
    ///
    /// # Errors
    /// If the map cannot be used.
    pub fn prepare<'a>(
        &self,
        map: &LoadedMap,
        start: SimTime,
        sensors: impl Iterator<Item = &'a Sensor>,
    ) -> anyhow::Result<NextEpisode> {
        let stamp = self.episode.stamp();
        let id = EpisodeId {
            epoch: stamp.epoch,
            episode: stamp.episode + 1,
            start,
        };
        let mut world = self.world.successor();
        let episode = episode::begin(&mut world, &self.launch, map, id)?;
        let mut actors: Vec<ActorId> = Vec::new();
        for sensor in sensors {
            let actor = match (sensor.role, &sensor.launch_rig) {
                (Role::Sensor, Some(rig)) => episode::spawn_sensor(
                    &mut world,
                    episode.scenario(),
                    rig,
                    &sensor.spec,
                    &sensor.name,
                    sensor.is_added,
                )?,
                _ => world.spectator(),
            };
            world.set_topics(actor, sensor.topic_infos())?;
            actors.push(actor);
        }
        Ok(NextEpisode {
            world,
            episode,
            actors,
        })
    }

    /// Lets a prepared episode take the place of the one that runs. Returns the actors of the sensors
    /// that stay, in their order.
    pub fn begin(&mut self, next: NextEpisode) -> Vec<ActorId> {
        self.world = next.world;
        self.episode = next.episode;
        next.actors
    }

    /// Keeps the world as it is now as the start of the episode.
    pub fn mark_start(&mut self) {
        let start = self.world.checkpoint(0);
        self.checkpoints.begin_episode(start);
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
