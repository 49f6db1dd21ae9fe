//! The world: its parts, and in which order they take a step.

use std::collections::BTreeMap;
use std::sync::Arc;

use schema_frames::document::{BodyBox, Catalogue};
use schema_roads::RoadMap;
use schema_types::{ActorId, Pose};
use serde::{Deserialize, Serialize};

use crate::actor_scene::ActorMeshes;
use crate::actors::{Actor, Actors, Counts};
use crate::booms::Booms;
use crate::catalogue::catalogue;
use crate::errors::{ActorError, DestroyError, SpawnError};
use crate::friction_areas::{self, FrictionAreas, GroundGrip};
use crate::jumps::Jumps;
use crate::map_actors::{add_map_actors, check_actors};
use crate::map_data::{LoadError, MapData};
use crate::physics::{Collision, Physics, Solids};
use crate::props::Props;
use crate::records::{Observed, Records};
use crate::scenery::SceneryState;
use crate::signals::{PostedLimits, TrafficLights};
use crate::spawn::{Spawner, Wanted};
use crate::vehicles::{Body, Vehicles};
use crate::walkers::{Surroundings, Walker, Walkers};
use crate::weather::WeatherInForce;

/// With longer sub-steps vehicles stay stable but drive off differently.
const LONGEST_SUBSTEP_SECS: f64 = 0.01;

/// How a world is computed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorldOptions {
    /// Seed of everything that is drawn by lot.
    pub seed: u64,
    /// Longest physics sub-step, seconds. A tick is split into equal sub-steps no longer than this
    /// and never longer than 10 ms; up to there the motion does not depend on it.
    pub physics_substep_secs: f64,
}

impl Default for WorldOptions {
    fn default() -> Self {
        WorldOptions {
            seed: 1,
            physics_substep_secs: 0.01,
        }
    }
}

impl WorldOptions {
    fn n_sub_steps(&self, dt_secs: f64) -> u32 {
        let longest_secs = self.physics_substep_secs.clamp(1e-4, LONGEST_SUBSTEP_SECS);
        (dt_secs / longest_secs - 1e-9).ceil().max(1.0) as u32
    }
}

/// Actors, physics, traffic lights, weather: all that changes from tick to tick.
///
/// A [`crate::Checkpoint`] is a copy of this very struct, so a new field is saved and restored
/// without further work. A field that follows from the map alone, or is made anew every tick, is
/// marked `serde(skip)`; `World::restore` takes it from the living world. The order of the fields
/// is their order in a checkpoint's bytes.
#[derive(Clone, Serialize, Deserialize)]
pub struct World {
    pub(crate) options: WorldOptions,
    #[serde(skip)]
    pub(crate) map: Arc<MapData>,
    #[serde(skip)]
    pub(crate) roads: Option<Arc<RoadMap>>,
    pub(crate) physics: Physics,
    #[serde(skip)]
    pub(crate) solids: Solids,
    pub(crate) lights: TrafficLights,
    #[serde(skip)]
    pub(crate) catalogue: Arc<Catalogue>,
    pub(crate) actors: Actors,
    pub(crate) vehicles: Vehicles,
    pub(crate) walkers: Walkers,
    pub(crate) props: Props,
    pub(crate) records: Records,
    pub(crate) booms: Booms,
    #[serde(skip)]
    pub(crate) meshes: Arc<ActorMeshes>,
    pub(crate) weather: WeatherInForce,
    /// Boxes of lights and signs on lanes, in the signals' own space.
    #[serde(with = "crate::serde_forms::shared")]
    pub(crate) trigger_boxes: Arc<BTreeMap<ActorId, BodyBox>>,
    /// Speed limits that signs post; empty where lanes say them.
    #[serde(skip)]
    pub(crate) posted: Arc<PostedLimits>,
    pub(crate) friction: FrictionAreas,
    pub(crate) collisions: Vec<Collision>,
    pub(crate) counts: Counts,
    pub(crate) spectator: ActorId,
    #[serde(skip)]
    pub(crate) jumps: Jumps,
    /// Which scenery is hidden and switched; not part of a checkpoint.
    #[serde(skip)]
    pub(crate) scenery: SceneryState,
}

impl World {
    /// A world without ground: load a map before spawning vehicles.
    pub fn new(options: WorldOptions) -> World {
        let mut world = World::empty(options);
        world.add_map_actors();
        world
    }

    /// A world without any actor, not even a spectator.
    fn empty(options: WorldOptions) -> World {
        World {
            options,
            map: Arc::default(),
            roads: None,
            physics: Physics::new([0.0; 3]),
            solids: Solids::default(),
            lights: TrafficLights::default(),
            catalogue: catalogue(),
            actors: Actors::default(),
            vehicles: Vehicles::default(),
            walkers: Walkers::default(),
            props: Props::default(),
            records: Records::default(),
            booms: Booms::default(),
            meshes: Arc::default(),
            weather: WeatherInForce::default(),
            trigger_boxes: Arc::default(),
            posted: Arc::default(),
            friction: FrictionAreas::default(),
            collisions: Vec::new(),
            counts: Counts::START,
            spectator: ActorId(0),
            jumps: Jumps::default(),
            scenery: SceneryState::default(),
        }
    }

    /// Loads a map: a new episode without the old one's actors. Ids go on counting. On an error the
    /// old map stays.
    pub fn load(&mut self, map: &MapData) -> Result<(), LoadError> {
        self.load_shared(&Arc::new(map.clone()))
    }

    /// As [`World::load`]; a map that was loaded a short while ago costs little, because its solids
    /// are kept.
    pub fn load_shared(&mut self, map: &Arc<MapData>) -> Result<(), LoadError> {
        let roads = map.read_roads()?;
        check_actors(map, roads.as_deref(), &self.counts)?;
        let solids = self.solids.of(map)?;
        self.roads = roads;
        self.physics = Physics::with_solids(map.origin_m, &solids);
        self.map = map.clone();
        self.actors = Actors::default();
        self.vehicles = Vehicles::default();
        self.walkers = Walkers::default();
        self.props = Props::default();
        self.booms = Booms::default();
        self.friction = FrictionAreas::default();
        self.collisions.clear();
        self.records.forget_all();
        self.meshes = Arc::default();
        self.scenery = SceneryState::of(map);
        self.counts.episode += 1;
        self.add_map_actors();
        Ok(())
    }

    /// A world without actors that can take the place of this one: it counts on from here and has
    /// the same options, weather and loaded maps. What fails while it is filled does not touch this
    /// one.
    pub fn successor(&self) -> World {
        World {
            catalogue: self.catalogue.clone(),
            counts: self.counts,
            solids: self.solids.clone(),
            weather: self.weather,
            ..World::empty(self.options)
        }
    }

    fn add_map_actors(&mut self) {
        let added = add_map_actors(
            &mut self.actors,
            &mut self.counts,
            &self.catalogue,
            &self.map,
            self.roads.as_deref(),
        );
        self.spectator = added.spectator;
        self.lights = added.lights;
        self.trigger_boxes = Arc::new(added.trigger_boxes);
        let posted = match self.roads.as_deref() {
            Some(roads) if self.map.signs_post_limits => PostedLimits::of(roads),
            _ => PostedLimits::default(),
        };
        self.posted = Arc::new(posted);
        self.actors_changed();
    }

    /// Advances by `dt_nanos`: vehicles in equal sub-steps, walkers, then lights, then the records.
    pub fn step(&mut self, dt_nanos: u64) {
        let dt_secs = dt_nanos as f64 * 1e-9;
        let n_sub_steps = self.options.n_sub_steps(dt_secs);
        let sub_step_secs = (dt_secs / n_sub_steps as f64) as f32;
        let ground = GroundGrip {
            friction: &self.friction.boxes,
            grip_ratio: self.weather.grip_ratio() as f32,
        };
        self.jumps.begin_step();
        self.vehicles.begin_tick(&self.physics, dt_secs as f32);
        self.physics.refresh_still();
        for _ in 0..n_sub_steps {
            self.vehicles
                .plan_sub_step(&mut self.physics, &ground, sub_step_secs);
            self.physics.step(sub_step_secs);
            self.vehicles.finish_sub_step(&mut self.physics);
            self.walkers
                .meet_vehicles(&self.vehicles, &mut self.physics);
        }
        self.vehicles.end_tick(&self.physics, dt_secs);
        self.props.end_tick(&mut self.actors, &mut self.physics);
        let around = Surroundings {
            physics: &self.physics,
            vehicles: &self.vehicles,
            lights: &self.lights,
            roads: self.roads.as_deref(),
            seed: self.options.seed,
            origin_z_m: self.map.origin_m[2],
        };
        self.walkers.step(&around, dt_secs);
        self.physics.take_collisions(&mut self.collisions);
        self.lights.step(dt_nanos);
        self.refresh_records(Some(dt_secs));
        self.carry_riders();
    }

    /// Puts the bodies of attached vehicles and walkers, which have no physics of their own, where
    /// their records say.
    fn carry_riders(&mut self) {
        let attached = |actor: &&Arc<Actor>| actor.parent.is_some();
        for actor in self.actors.by_id.values().filter(attached) {
            let Some(record) = self.records.get(actor.id) else {
                continue;
            };
            let pose = record.world_from_actor;
            if let Some(vehicle) = self.vehicles.by_id.get_mut(&actor.id)
                && !vehicle.switches.simulated
            {
                vehicle.set_pose(&mut self.physics, &pose.isometry());
            }
            if let Some(walker) = self.walkers.by_id.get_mut(&actor.id)
                && !walker.simulated
            {
                walker.put_middle(&pose);
            }
        }
    }

    /// Longest physics sub-step from now on, see [`WorldOptions::physics_substep_secs`].
    pub fn set_longest_substep(&mut self, secs: f64) {
        self.options.physics_substep_secs = secs;
    }

    /// Makes an actor. `pose` is in the world, or on `parent` for an actor that is attached to it.
    ///
    /// Vehicles take the attributes `color` (`r,g,b`, each 0–255) and `sticky_control` (`false`: a
    /// control is for one tick); sensors keep whatever attributes they are given. The pose is used
    /// as it is: a vehicle above the ground falls onto it.
    pub fn spawn(
        &mut self,
        type_id: &str,
        pose: Pose,
        parent: Option<ActorId>,
        role: &str,
        attributes: &BTreeMap<String, String>,
    ) -> Result<ActorId, SpawnError> {
        self.spawn_wanted(Wanted {
            type_id,
            pose,
            parent,
            role,
            attributes,
            world_from_parent: None,
            is_added: false,
        })
    }

    /// Makes a sensor's actor as [`World::spawn`], with an id from
    /// [`schema_frames::journal::FIRST_ADDED_ID`] on, so
    /// that all other actors have the ids that they have without it.
    pub fn spawn_added_sensor(
        &mut self,
        type_id: &str,
        pose: Pose,
        parent: Option<ActorId>,
        role: &str,
    ) -> Result<ActorId, SpawnError> {
        self.spawn_wanted(Wanted {
            type_id,
            pose,
            parent,
            role,
            attributes: &BTreeMap::new(),
            world_from_parent: None,
            is_added: true,
        })
    }

    fn spawn_wanted(&mut self, wanted: Wanted<'_>) -> Result<ActorId, SpawnError> {
        let parent = wanted.parent.and_then(|parent| self.records.get(parent));
        let wanted = Wanted {
            world_from_parent: parent.map(|parent| parent.world_from_actor),
            ..wanted
        };
        let mut spawner = Spawner {
            catalogue: &self.catalogue,
            origin_m: self.map.origin_m,
            physics: &mut self.physics,
            actors: &mut self.actors,
            counts: &mut self.counts,
            vehicles: &mut self.vehicles,
            walkers: &mut self.walkers,
            props: &mut self.props,
            friction: &mut self.friction,
        };
        let id = spawner.spawn(wanted)?;
        self.counts.actors_revision += 1;
        let (records, booms, seen) = self.recording();
        records.add(&seen, booms, id);
        Ok(id)
    }

    /// Removes an actor and what is attached to it; returns everything that went, by rising id.
    pub fn destroy(&mut self, actor: ActorId) -> Result<Vec<ActorId>, DestroyError> {
        let gone = self.actors.with_attached(actor, &self.catalogue)?;
        let is_area = |id: &ActorId| {
            let actor = &self.actors.by_id[id];
            actor.type_id(&self.catalogue) == friction_areas::TYPE_ID
        };
        let areas_change = gone.iter().any(is_area);
        for id in &gone {
            self.actors.remove(*id);
            self.records.remove(*id);
            self.booms.by_id.remove(id);
            self.walkers.by_id.remove(id);
            self.props.remove(*id, &mut self.physics);
            self.vehicles.remove(*id, &mut self.physics);
        }
        if areas_change {
            self.friction.refresh(&self.actors, &self.catalogue);
        }
        self.counts.actors_revision += 1;
        Ok(gone)
    }

    /// Must be called after actors came or went.
    pub(crate) fn actors_changed(&mut self) {
        self.counts.actors_revision += 1;
        self.refresh_records(None);
    }

    /// Makes all records anew; `dt_secs` is the step's length, or `None` between steps.
    pub(crate) fn refresh_records(&mut self, dt_secs: Option<f64>) {
        let (records, booms, seen) = self.recording();
        records.refresh(&seen, booms, dt_secs);
    }

    /// Makes the records of one actor and of what is attached to it anew.
    pub(crate) fn refresh_actor(&mut self, actor: ActorId) {
        let (records, booms, seen) = self.recording();
        records.refresh_one(&seen, booms, actor);
    }

    fn recording(&mut self) -> (&mut Records, &mut Booms, Observed<'_>) {
        let seen = Observed {
            catalogue: &self.catalogue,
            actors: &self.actors,
            vehicles: &self.vehicles,
            walkers: &self.walkers,
            props: &self.props,
            lights: &self.lights,
            roads: self.roads.as_deref(),
            posted: &self.posted,
            physics: &self.physics,
            collisions: &self.collisions,
        };
        (&mut self.records, &mut self.booms, seen)
    }

    /// The vehicle of an action, with what is needed to act on its body.
    pub(crate) fn body(&mut self, actor: ActorId) -> Body<'_> {
        let vehicle = self.vehicles.by_id.get_mut(&actor);
        Body {
            actor,
            vehicle: vehicle.ok_or_else(|| self.actors.is_no("vehicle", actor, &self.catalogue)),
            physics: &mut self.physics,
        }
    }

    pub(crate) fn walker_mut(&mut self, actor: ActorId) -> Result<&mut Walker, ActorError> {
        let walker = self.walkers.by_id.get_mut(&actor);
        walker.ok_or_else(|| self.actors.is_no("walker", actor, &self.catalogue))
    }
}
