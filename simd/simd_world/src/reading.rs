//! Read access to a world between steps.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::Isometry3;
use schema_frames::document::{ActorList, Catalogue, Weather};
use schema_frames::{ActorRecord, VehiclePhysics};
use schema_roads::RoadMap;
use schema_types::{ActorId, ObjectId, Pose};
use sensor_core::{DynamicInstance, LampSetting, SceneAssets};

use crate::actor_scene::{ActorMeshes, PosedActors};
use crate::errors::ActorError;
use crate::map_data::MapData;
use crate::physics::Collision;
use crate::scenery::SceneryRevisions;
use crate::world::World;

impl World {
    /// Contacts of vehicles and walkers in the last step, by (actor, other).
    pub fn collisions(&self) -> &[Collision] {
        &self.collisions
    }

    /// The records of all actors after the last step or change, by rising id.
    pub fn snapshot_records(&self) -> &[ActorRecord] {
        self.records.all()
    }

    /// One actor's record.
    pub fn record(&self, actor: ActorId) -> Option<&ActorRecord> {
        self.records.get(actor)
    }

    /// Pose of an actor, with the very bits of its record; `None` if there is no such actor.
    pub fn sensor_pose(&self, actor: ActorId) -> Option<Isometry3<f64>> {
        self.record(actor)
            .map(|record| record.world_from_actor.isometry())
    }

    /// The constants of all actors.
    pub fn actor_list(&self) -> ActorList {
        self.actors.list(&self.catalogue, &self.trigger_boxes)
    }

    /// Pose of an attached actor on its parent; `None` for one without a parent, and for none.
    pub fn mount(&self, actor: ActorId) -> Option<Pose> {
        let actor = self.actors.get(actor).ok()?;
        actor.parent.map(|_| actor.pose)
    }

    /// Grows whenever [`World::actor_list`] changes.
    pub fn actors_revision(&self) -> u64 {
        self.counts.actors_revision
    }

    /// First actor with this role.
    pub fn actor_with_role(&self, role: &str) -> Option<ActorId> {
        let mut actors = self.actors.by_id.values();
        actors
            .find(|actor| actor.role == role)
            .map(|actor| actor.id)
    }

    /// An actor's catalogue id and its role; `None` if there is no such actor.
    pub fn type_and_role(&self, actor: ActorId) -> Option<(&str, &str)> {
        let actor = self.actors.get(actor).ok()?;
        Some((actor.type_id(&self.catalogue), &actor.role))
    }

    /// A vehicle's physical data.
    ///
    /// # Errors
    /// If the actor is no vehicle.
    pub fn vehicle_physics(&mut self, actor: ActorId) -> Result<&VehiclePhysics, ActorError> {
        Ok(&self.body(actor).vehicle?.physics)
    }

    /// What can be spawned; `catalogue_idx` of a record is an index into it.
    pub fn catalogue(&self) -> &Catalogue {
        &self.catalogue
    }

    /// The loaded map.
    pub fn map(&self) -> &MapData {
        &self.map
    }

    /// Roads of the map; `None` for a ground without roads.
    pub fn roads(&self) -> Option<&Arc<RoadMap>> {
        self.roads.as_ref()
    }

    /// Count of map loads.
    pub fn episode(&self) -> u32 {
        self.counts.episode
    }

    /// The spectator of this episode.
    pub fn spectator(&self) -> ActorId {
        self.spectator
    }

    /// The current weather.
    pub fn weather(&self) -> &Weather {
        &self.weather.now
    }

    /// Extinction of lidar light by rain, fog and dust, 1/m: 0 unless weather acts.
    pub fn lidar_extinction_per_m(&self) -> f64 {
        self.weather.lidar_extinction_per_m()
    }

    /// Objects of the scenery that are hidden.
    pub fn hidden_objects(&self) -> &BTreeSet<ObjectId> {
        self.scenery.hidden_objects()
    }

    /// Settings of lamps that differ from the map's, by object.
    pub fn switched_lamps(&self) -> BTreeMap<ObjectId, LampSetting> {
        self.scenery.switched_lamps(&self.map)
    }

    /// What tells the state of the scenery from others of this episode.
    pub fn scenery_revisions(&self) -> SceneryRevisions {
        self.scenery.revisions(&self.weather.now)
    }

    /// Adds the meshes of every actor that may appear. Must be called once per episode, after the
    /// map's own meshes were added.
    pub fn register_meshes(&mut self, assets: &mut SceneAssets) {
        self.meshes = Arc::new(ActorMeshes::register(assets, &self.map, &self.lights));
    }

    /// Actors that a command put elsewhere before the last step although the engine moves them, and
    /// what is attached to them, by rising id: their way there is no motion.
    pub fn jumped(&self) -> Vec<ActorId> {
        let put = self.jumps.before_last_step();
        let mut jumped: Vec<ActorId> = Vec::new();
        if put.is_empty() {
            return jumped;
        }
        // Parents have smaller ids than what is attached to them.
        for record in self.records.all() {
            let is_carried = jumped.binary_search(&ActorId(record.parent_id)).is_ok();
            if is_carried || put.contains(&ActorId(record.id)) {
                jumped.push(ActorId(record.id));
            }
        }
        jumped
    }

    /// Fills `out` with every part of every actor, by rising (actor, part). Empty before
    /// [`World::register_meshes`].
    pub fn dynamic_instances(&self, out: &mut Vec<DynamicInstance>) {
        let posed = PosedActors {
            records: &self.records,
            vehicles: &self.vehicles,
            walkers: &self.walkers,
            props: &self.props,
            lights: &self.lights,
            physics: &self.physics,
        };
        self.meshes.instances(&posed, out);
    }
}
