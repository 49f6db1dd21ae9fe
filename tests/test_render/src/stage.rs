//! A town with traffic, ready for cameras.

use std::sync::Arc;

use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use schema_frames::document::Weather;
use schema_frames::{ActorKind, Command, CommandReply};
use schema_types::{ActorId, SimTime, Tick};
use sensor_core::{DynamicInstance, Scene, SceneAssets};
use simd_town::Town;
use simd_world::{EgoSpawn, MapData, World, WorldOptions};

/// Step of the world between two scenes.
const PERIOD_NANOS: u64 = 50_000_000;

/// A town and its vehicles.
pub struct Stage {
    /// Name of the town.
    pub name: String,
    /// Where cameras may stand: one pose per spawn point, x along the lane, on the ground.
    pub places: Vec<Isometry3<f64>>,
    world: World,
    assets: Arc<SceneAssets>,
    tick: u64,
}

impl Stage {
    /// Generates a town, puts `n_vehicles` on it and lets them settle.
    ///
    /// # Errors
    /// There is no such town, or its first spawn point cannot be used.
    pub fn new(town: &str, seed: u64, n_vehicles: usize) -> anyhow::Result<Stage> {
        let town = Town::generate(town, seed)?;
        let map = MapData::from(&town);
        let mut world = World::new(WorldOptions {
            seed,
            ..Default::default()
        });
        world.load(&map)?;
        let mut assets = town.assets;
        assets.episode = 1;
        world.register_meshes(&mut assets);
        world.spawn_scenario(
            Some(EgoSpawn {
                type_id: "vehicle.tesla.model3",
                spawn_idx: 0,
            }),
            n_vehicles,
        )?;
        let places = map
            .spawn_points
            .iter()
            .map(|point| point.isometry() * Translation3::new(0.0, 0.0, -0.3))
            .collect();
        let mut stage = Stage {
            name: map.name.clone(),
            places,
            world,
            assets: Arc::new(assets),
            tick: 0,
        };
        for _ in 0..20 {
            stage.step();
        }
        Ok(stage)
    }

    /// One step of the world.
    pub fn step(&mut self) {
        self.world.step(PERIOD_NANOS);
        self.tick += 1;
    }

    /// Puts strollers on pavements; fewer than `n` if there is no room.
    pub fn add_walkers(&mut self, n: usize) {
        self.world.spawn_walkers(n);
    }

    /// Gives every vehicle this control.
    pub fn drive(&mut self, control: schema_frames::VehicleControl) {
        for actor in self.actors(ActorKind::Vehicle) {
            self.world
                .set_control(actor, control)
                .expect("it is a vehicle of this world");
        }
    }

    /// All actors of a kind, by rising id.
    pub fn actors(&self, kind: ActorKind) -> Vec<ActorId> {
        let of_kind = |record: &&schema_frames::ActorRecord| record.kind == kind as u16;
        self.world
            .snapshot_records()
            .iter()
            .filter(of_kind)
            .map(|record| ActorId(record.id))
            .collect()
    }

    /// Applies a command as if a client had sent it.
    ///
    /// # Errors
    /// The world's message, if it refuses.
    pub fn apply(&mut self, command: &Command) -> anyhow::Result<CommandReply> {
        let reply = self.world.apply(command);
        let switched = self.world.switched_lamps();
        if self.assets.switched != switched {
            self.assets = Arc::new(SceneAssets {
                switched,
                ..(*self.assets).clone()
            });
        }
        match reply {
            CommandReply::Refused { error } => Err(anyhow::Error::msg(error)),
            reply => Ok(reply),
        }
    }

    /// The simulated world.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Switches every vehicle's lamps to these bits.
    pub fn set_lamps(&mut self, lamps: u32) {
        for actor in self.actors(ActorKind::Vehicle) {
            self.world
                .set_lamps(actor, lamps)
                .expect("it is a vehicle of this world");
        }
    }

    /// The scene of the current tick in this weather.
    pub fn scene(&self, weather: Weather) -> Scene {
        let mut dynamics: Vec<DynamicInstance> = Vec::new();
        self.world.dynamic_instances(&mut dynamics);
        Scene {
            tick: Tick(self.tick),
            sim_time: SimTime(self.tick * PERIOD_NANOS),
            period_nanos: PERIOD_NANOS,
            assets: self.assets.clone(),
            dynamics,
            past: Default::default(),
            weather,
            lidar_extinction_per_m: 0.0,
            debug: Vec::new(),
            overlay: Default::default(),
        }
    }

    /// A camera 1.6 m above a spawn point (counted round), moved along its lane, turned to the left
    /// and down.
    pub fn camera(
        &self,
        place: usize,
        along_m: f64,
        yaw_deg: f64,
        pitch_deg: f64,
    ) -> Isometry3<f64> {
        let turn =
            UnitQuaternion::from_euler_angles(0.0, pitch_deg.to_radians(), yaw_deg.to_radians());
        self.places[place % self.places.len()]
            * Isometry3::from_parts(Translation3::new(along_m, 0.0, 1.6), turn)
    }
}
