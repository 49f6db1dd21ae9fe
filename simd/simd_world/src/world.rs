//! The world and its step.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::Isometry3;
use rayon::iter::{IntoParallelRefMutIterator as _, ParallelIterator as _};
use schema_frames::document::{ActorInfo, ActorList, BodyBox, Catalogue, TopicInfo, Weather};
use schema_frames::{ActorKind, ActorRecord, VehicleControl};
use schema_roads::RoadMap;
use schema_types::{ActorId, Pose};
use serde::{Deserialize, Serialize};

use crate::boom::Boom;
use crate::catalogue;
use crate::friction::FrictionBox;
use crate::lights::Lights;
use crate::map::{LoadError, MapData};
use crate::motion::Around;
use crate::physics::{Collision, Physics};
use crate::props::Prop;
use crate::scene::ActorMeshes;
use crate::scenery::SceneryState;
use crate::signs;
use crate::solids::Solids;
use crate::vehicle::Vehicle;
use crate::walkers::{Crowd, Walker};

/// From this number on vehicles are planned on several threads.
const SIDE_BY_SIDE: usize = 32;

/// Beyond, vehicles stay stable but drive off differently.
const LONGEST_SUBSTEP_SECS: f64 = 0.01;

/// How a world is computed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorldOptions {
    /// Seed of everything that is drawn by lot.
    pub seed: u64,
    /// Longest physics sub-step, seconds; a tick is split into equal sub-steps no longer than this
    /// and never longer than 10 ms: up to there
    /// the motion does not depend on it.
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

/// Why something could not be done to an actor.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ActorError {
    /// No such actor.
    #[error("actor {0} not found; it may have been destroyed")]
    Unknown(ActorId),
    /// The actor is of another kind.
    #[error("actor {actor} is a {type_id}, but this needs a {needed}")]
    WrongKind {
        /// The actor.
        actor: ActorId,
        /// What it is.
        type_id: String,
        /// What would do.
        needed: &'static str,
    },
    /// A number cannot be used.
    #[error("{what} of actor {actor} {problem}")]
    Value {
        /// The actor.
        actor: ActorId,
        /// Which quantity.
        what: &'static str,
        /// What is wrong with it.
        problem: &'static str,
    },
}

/// Everything constant about an actor, and its place on its parent.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Actor {
    pub id: ActorId,
    pub kind: ActorKind,
    pub catalogue_idx: u32,
    pub role: String,
    pub parent: Option<ActorId>,
    /// World pose of what does not move by itself; pose on the parent for what is attached.
    pub pose: Pose,
    pub attributes: BTreeMap<String, String>,
    pub topics: Vec<TopicInfo>,
}

/// Actors, physics, traffic lights, weather: all that changes from tick to tick.
///
/// A [`crate::Checkpoint`] is a copy of this very struct: a new field is saved and restored without
/// further ado. What follows from the map
/// alone, or is made anew every tick, says `serde(skip)` and is taken from the living world by
/// `World::restore`.
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
    pub(crate) lights: Lights,
    #[serde(skip)]
    pub(crate) catalogue: Catalogue,
    pub(crate) actors: BTreeMap<ActorId, Actor>,
    pub(crate) vehicles: BTreeMap<ActorId, Vehicle>,
    pub(crate) walkers: BTreeMap<ActorId, Walker>,
    pub(crate) crowd: Crowd,
    pub(crate) props: BTreeMap<ActorId, Prop>,
    #[serde(with = "crate::plain::pods")]
    pub(crate) records: Vec<ActorRecord>,
    /// Records before the last step or change; kept so that their memory is used again.
    #[serde(skip)]
    pub(crate) previous_records: Vec<ActorRecord>,
    pub(crate) speed_limits: BTreeMap<ActorId, ([f64; 3], f32)>,
    pub(crate) booms: BTreeMap<ActorId, Boom>,
    #[serde(skip)]
    pub(crate) meshes: ActorMeshes,
    pub(crate) weather: Weather,
    /// Whether weather acts on tyres and lidar.
    pub(crate) weather_acts: bool,
    /// Lights' and signs' boxes on lanes, in their own space.
    pub(crate) trigger_boxes: BTreeMap<ActorId, BodyBox>,
    /// Areas of other friction, of the actors of that kind, by rising id.
    pub(crate) friction_boxes: Vec<FrictionBox>,
    collisions: Vec<Collision>,
    pub(crate) next_actor: u32,
    pub(crate) actors_revision: u64,
    pub(crate) episode: u32,
    spectator: ActorId,
    /// What is hidden and switched; not part of a checkpoint.
    #[serde(skip)]
    pub(crate) scenery: SceneryState,
}

impl World {
    /// A world on an empty plane of nothing: load a map before spawning vehicles.
    pub fn new(options: WorldOptions) -> World {
        let mut world = World {
            options,
            map: Arc::default(),
            roads: None,
            physics: Physics::new([0.0; 3]),
            solids: Solids::default(),
            lights: Lights::default(),
            catalogue: catalogue::catalogue(),
            actors: BTreeMap::new(),
            vehicles: BTreeMap::new(),
            walkers: BTreeMap::new(),
            crowd: Crowd::default(),
            props: BTreeMap::new(),
            records: Vec::new(),
            previous_records: Vec::new(),
            speed_limits: BTreeMap::new(),
            booms: BTreeMap::new(),
            meshes: ActorMeshes::default(),
            weather: Weather::default(),
            weather_acts: false,
            trigger_boxes: BTreeMap::new(),
            friction_boxes: Vec::new(),
            collisions: Vec::new(),
            next_actor: 1,
            actors_revision: 0,
            episode: 0,
            spectator: ActorId(0),
            scenery: SceneryState::default(),
        };
        world.populate();
        world
    }

    /// Loads a map: a new episode without the old one's actors. Ids go on counting. On an error the
    /// old map stays.
    pub fn load(&mut self, map: &MapData) -> Result<(), LoadError> {
        self.load_shared(&Arc::new(map.clone()))
    }

    /// As [`World::load`]; a map that was loaded a short while ago costs little, for its solids are
    /// kept.
    pub fn load_shared(&mut self, map: &Arc<MapData>) -> Result<(), LoadError> {
        let roads = match (&map.roads, map.open_drive.as_str()) {
            (Some(roads), _) => Some(roads.clone()),
            (None, "") => None,
            (None, text) => Some(Arc::new(RoadMap::parse(text).map_err(|source| {
                LoadError::Roads {
                    map: map.name.clone(),
                    source,
                }
            })?)),
        };
        let solids = self
            .solids
            .of(map)
            .map_err(|(mesh_idx, reason)| LoadError::Collision {
                map: map.name.clone(),
                mesh_idx,
                reason,
            })?;
        let physics = Physics::with_solids(map.origin_m, &solids);
        self.map = map.clone();
        self.roads = roads;
        self.physics = physics;
        self.actors.clear();
        self.vehicles.clear();
        self.walkers.clear();
        self.crowd = Crowd::default();
        self.props.clear();
        self.speed_limits.clear();
        self.booms.clear();
        self.collisions.clear();
        self.friction_boxes.clear();
        self.meshes = ActorMeshes::default();
        self.scenery = SceneryState::of(&self.map);
        self.episode += 1;
        self.populate();
        Ok(())
    }

    /// The actors that every episode has: spectator, traffic lights, signs.
    fn populate(&mut self) {
        let pose = self.map.spawn_points.first().copied().unwrap_or_default();
        let above = Pose {
            translation_m: [
                pose.translation_m[0],
                pose.translation_m[1],
                pose.translation_m[2] + 20.0,
            ],
            ..pose
        };
        self.spectator = self.add_fixed("spectator", ActorKind::Spectator, above, BTreeMap::new());
        self.lights = Lights::default();
        self.trigger_boxes.clear();
        if let Some(roads) = self.roads.clone() {
            let mut ids = Vec::new();
            for signal in roads.signals() {
                let (type_id, kind) = self.signal_type(signal);
                let attributes = BTreeMap::from([("opendrive_id".to_owned(), signal.id.clone())]);
                let id = self.add_fixed(&type_id, kind, signal.pose.into(), attributes);
                self.trigger_boxes
                    .extend(signs::trigger_box(&roads, signal).map(|trigger| (id, trigger)));
                if kind == ActorKind::TrafficLight {
                    ids.push(id);
                }
            }
            let mut ids = ids.into_iter();
            self.lights = Lights::new(&roads, || {
                ids.next()
                    .expect("one actor was made for each light signal, in the same order")
            });
        }
        self.changed();
    }

    fn add_fixed(
        &mut self,
        type_id: &str,
        kind: ActorKind,
        pose: Pose,
        attributes: BTreeMap<String, String>,
    ) -> ActorId {
        let catalogue_idx = self
            .catalogue_idx(type_id)
            .expect("the catalogue has every type the map can bring");
        let id = self.new_id();
        self.actors.insert(
            id,
            Actor {
                id,
                kind,
                catalogue_idx,
                role: String::new(),
                parent: None,
                pose,
                attributes,
                topics: Vec::new(),
            },
        );
        id
    }

    /// Advances by `dt_nanos`: vehicles in equal sub-steps, walkers, then lights, then the records.
    pub fn step(&mut self, dt_nanos: u64) {
        let dt_secs = dt_nanos as f64 * 1e-9;
        let n_sub_steps = (dt_secs
            / self
                .options
                .physics_substep_secs
                .clamp(1e-4, LONGEST_SUBSTEP_SECS)
            - 1e-9)
            .ceil()
            .max(1.0) as u32;
        let sub_step_secs = (dt_secs / n_sub_steps as f64) as f32;
        self.vehicles
            .values_mut()
            .for_each(|vehicle| vehicle.begin_tick(&self.physics, dt_secs as f32));
        self.physics.refresh_still();
        for _ in 0..n_sub_steps {
            self.move_vehicles(sub_step_secs);
            self.physics.step(sub_step_secs);
            for (id, vehicle) in &mut self.vehicles {
                if vehicle.finish_step(&mut self.physics) {
                    tracing::error!(
                        actor = id.0,
                        type_id = vehicle.model.type_id,
                        "vehicle left every sensible state and was taken out of the physics; destroy it or set its pose"
                    );
                }
            }
            self.meet_vehicles();
        }
        self.vehicles
            .values_mut()
            .for_each(|vehicle| vehicle.end_tick(&self.physics, dt_secs));
        self.move_walkers(dt_secs);
        self.physics.take_collisions(&mut self.collisions);
        self.lights.step(dt_nanos);
        self.refresh_records(Some(dt_secs));
    }

    /// Vehicles plan their sub-step side by side; what they plan is given to the engine in order.
    fn move_vehicles(&mut self, dt_secs: f32) {
        let grip_ratio = self.grip_ratio() as f32;
        let around = Around {
            physics: &self.physics,
            friction: &self.friction_boxes,
            grip_ratio,
            dt_secs,
        };
        let plan = |vehicle: &mut Vehicle| Some((vehicle.body, vehicle.plan(&around)?));
        let motions: Vec<_> = match self.vehicles.len() >= SIDE_BY_SIDE {
            true => self
                .vehicles
                .par_iter_mut()
                .map(|(_, vehicle)| plan(vehicle))
                .collect(),
            false => self.vehicles.values_mut().map(plan).collect(),
        };
        for (body, motion) in motions.into_iter().flatten() {
            let body = &mut self.physics.engine.bodies[body];
            body.set_linvel(motion.linear, true);
            body.set_angvel(motion.angular, true);
        }
    }

    /// Longest physics sub-step from now on, see [`WorldOptions::physics_substep_secs`].
    pub fn set_longest_substep(&mut self, secs: f64) {
        self.options.physics_substep_secs = secs;
    }

    /// What vehicles and walkers touched in the last step, by (actor, other).
    pub fn collisions(&self) -> &[Collision] {
        &self.collisions
    }

    /// Every actor after the last step or change, by rising id.
    pub fn snapshot_records(&self) -> &[ActorRecord] {
        &self.records
    }

    /// One actor's record.
    pub fn record(&self, actor: ActorId) -> Option<&ActorRecord> {
        self.records
            .binary_search_by_key(&actor.0, |record| record.id)
            .ok()
            .map(|idx| &self.records[idx])
    }

    /// Pose of an actor, the very bits of its record; `None` if there is no such actor.
    pub fn sensor_pose(&self, actor: ActorId) -> Option<Isometry3<f64>> {
        self.record(actor)
            .map(|record| record.world_from_actor.isometry())
    }

    /// What is constant about every actor.
    pub fn actor_list(&self) -> ActorList {
        let info = |actor: &Actor| {
            let entry = &self.catalogue.entries[actor.catalogue_idx as usize];
            ActorInfo {
                id: actor.id.0,
                type_id: entry.type_id.clone(),
                kind: entry.kind.clone(),
                role: actor.role.clone(),
                parent_id: actor.parent.map_or(0, |parent| parent.0),
                mount: actor.parent.map(|_| actor.pose.into()),
                body_box: BodyBox { ..entry.body_box },
                trigger_box: self.trigger_boxes.get(&actor.id).copied(),
                attributes: actor.attributes.clone(),
                topics: actor.topics.clone(),
            }
        };
        ActorList {
            actors: self.actors.values().map(info).collect(),
        }
    }

    /// Grows whenever [`World::actor_list`] changes.
    pub fn actors_revision(&self) -> u64 {
        self.actors_revision
    }

    /// What can be spawned; `catalogue_idx` of a record is an index into it.
    pub fn catalogue(&self) -> &Catalogue {
        &self.catalogue
    }

    /// The map as loaded.
    pub fn map(&self) -> &MapData {
        &self.map
    }

    /// Roads of the map; `None` for a ground without roads.
    pub fn roads(&self) -> Option<&Arc<RoadMap>> {
        self.roads.as_ref()
    }

    /// Count of map loads.
    pub fn episode(&self) -> u32 {
        self.episode
    }

    /// The spectator of this episode.
    pub fn spectator(&self) -> ActorId {
        self.spectator
    }

    /// Weather in force.
    pub fn weather(&self) -> &Weather {
        &self.weather
    }

    /// First actor with this role.
    pub fn actor_with_role(&self, role: &str) -> Option<ActorId> {
        self.actors
            .values()
            .find(|actor| actor.role == role)
            .map(|actor| actor.id)
    }

    /// Holds a vehicle's control until it is replaced. Values out of range are clamped; what is not
    /// finite counts as 0.
    pub fn set_control(
        &mut self,
        actor: ActorId,
        control: VehicleControl,
    ) -> Result<(), ActorError> {
        self.vehicle_mut(actor)?.set_control(control);
        Ok(())
    }

    /// Sets a vehicle's lamps, bits as in `VehiclePart::lamps`.
    pub fn set_lamps(&mut self, actor: ActorId, lamps: u32) -> Result<(), ActorError> {
        self.vehicle_mut(actor)?.lamps = lamps & 0x7ff;
        Ok(())
    }

    /// Names a sensor's topics for `world/actors`.
    pub fn set_topics(&mut self, actor: ActorId, topics: Vec<TopicInfo>) -> Result<(), ActorError> {
        self.actors
            .get_mut(&actor)
            .ok_or(ActorError::Unknown(actor))?
            .topics = topics;
        self.actors_revision += 1;
        Ok(())
    }

    pub(crate) fn vehicle_mut(&mut self, actor: ActorId) -> Result<&mut Vehicle, ActorError> {
        match self.vehicles.get_mut(&actor) {
            Some(vehicle) => Ok(vehicle),
            None => Err(match self.actors.get(&actor) {
                None => ActorError::Unknown(actor),
                Some(other) => {
                    let type_id = self.catalogue.entries[other.catalogue_idx as usize]
                        .type_id
                        .clone();
                    ActorError::WrongKind {
                        actor,
                        type_id,
                        needed: "vehicle",
                    }
                }
            }),
        }
    }

    pub(crate) fn catalogue_idx(&self, type_id: &str) -> Option<u32> {
        self.catalogue
            .entries
            .iter()
            .position(|entry| entry.type_id == type_id)
            .map(|idx| idx as u32)
    }

    pub(crate) fn new_id(&mut self) -> ActorId {
        let id = ActorId(self.next_actor);
        self.next_actor += 1;
        id
    }

    /// After actors came or went.
    pub(crate) fn changed(&mut self) {
        self.actors_revision += 1;
        self.refresh_records(None);
    }

    fn signal_type(&self, signal: &schema_roads::Signal) -> (String, ActorKind) {
        use schema_roads::SignalKind;
        let limit = || {
            let kmh = signal.value.or_else(|| signal.subtype.parse().ok())?;
            let type_id = format!("traffic.speed_limit.{}", kmh.round());
            self.catalogue_idx(&type_id).map(|_| type_id)
        };
        match signal.kind {
            SignalKind::TrafficLight => {
                ("traffic.traffic_light".to_owned(), ActorKind::TrafficLight)
            }
            SignalKind::Stop => ("traffic.stop".to_owned(), ActorKind::TrafficSign),
            SignalKind::Yield => ("traffic.yield".to_owned(), ActorKind::TrafficSign),
            SignalKind::SpeedLimit => (
                limit().unwrap_or_else(|| "traffic.unknown".to_owned()),
                ActorKind::TrafficSign,
            ),
            SignalKind::Other => ("traffic.unknown".to_owned(), ActorKind::TrafficSign),
        }
    }
}
