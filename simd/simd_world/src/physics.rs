//! The physics engine's world: solid ground about an `f64` origin, gravity, contacts.
//!
//! This is the one place where the engine's `f32` coordinates meet the world's `f64` coordinates. A
//! body's origin and axes are the actor's own, so no offset is kept anywhere.

use std::collections::BTreeSet;

use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rapier3d::glamx::Quat;
use rapier3d::math::{Pose as EnginePose, Vector};
use rapier3d::prelude::*;
use schema_types::{Class, ObjectId};
use serde::{Deserialize, Serialize};

use crate::map_data::MapData;
use contact_log::ContactLog;

mod collision;
mod contact_log;
pub(crate) mod engine_state;
mod solids;
mod still_things;
mod vectors;

use solids::{Solid, TriangleClasses};

pub use collision::Collision;
pub(crate) use solids::Solids;
pub(crate) use still_things::{Room, StillThings};
pub(crate) use vectors::{narrow, widen};

/// Standard gravity, m/s², along world −z.
pub(crate) const GRAVITY_MPS2: f64 = 9.81;

/// Bodies that [`Physics::try_to_grow`] makes.
const N_TRIAL_BODIES: usize = 16;

/// User data of a collider, read from contacts: its actor (0 is scenery) and its class.
pub(crate) fn collider_tag(actor: u32, class: Class) -> u128 {
    u128::from(actor) | u128::from(class.0) << 32
}

/// Engine, solid ground and the contacts of the current tick.
#[derive(Serialize, Deserialize)]
pub(crate) struct Physics {
    #[serde(with = "crate::physics::engine_state")]
    pub engine: PhysicsWorld,
    #[serde(with = "crate::serde_forms::vector")]
    origin_m: Vector3<f64>,
    /// Whoever adds, moves or removes something fixed must call `forget` on it.
    #[serde(skip)]
    pub still: StillThings,
    #[serde(skip)]
    contacts: ContactLog,
}

impl Clone for Physics {
    fn clone(&self) -> Self {
        let Physics {
            engine,
            origin_m,
            still: _,
            contacts,
        } = self;
        let still = StillThings::default();
        Physics {
            engine: engine_state::copy(engine),
            origin_m: *origin_m,
            still,
            contacts: contacts.emptied(),
        }
    }

    fn clone_from(&mut self, source: &Self) {
        let Physics {
            engine,
            origin_m,
            still: _,
            contacts,
        } = source;
        engine_state::copy_into(&mut self.engine, engine);
        self.origin_m = *origin_m;
        self.still.forget();
        self.contacts = contacts.emptied();
    }
}

impl Physics {
    /// An empty world about `origin_m`.
    pub fn new(origin_m: [f64; 3]) -> Self {
        let mut engine = PhysicsWorld::new();
        engine.gravity = Vector::new(0.0, 0.0, -GRAVITY_MPS2 as f32);
        Physics {
            engine,
            origin_m: origin_m.into(),
            still: StillThings::default(),
            contacts: ContactLog::default(),
        }
    }

    /// A world with a map's solid ground.
    pub fn with_solids(origin_m: [f64; 3], solids: &[Solid]) -> Self {
        let mut physics = Physics::new(origin_m);
        for solid in solids {
            let collider = ColliderBuilder::new(solid.shape.clone())
                .friction(0.6)
                .user_data(collider_tag(0, solid.class));
            let (_, handle) = physics.engine.insert(RigidBodyBuilder::fixed(), collider);
            let classes = solid.triangle_classes.clone();
            physics.contacts.set_classes(handle, classes);
        }
        // The query pipeline sees colliders only after a step.
        physics.engine.step();
        physics
    }

    /// Gives the map's solid meshes only those triangles whose object is shown. The colliders and
    /// their handles stay, so nothing else in the engine changes.
    pub fn show_only(&mut self, map: &MapData, hidden: &BTreeSet<ObjectId>) {
        self.still.forget();
        let mut meshes: Vec<ColliderHandle> = self
            .engine
            .colliders
            .iter()
            .filter(|(_, collider)| collider.shape().as_trimesh().is_some())
            .map(|(handle, _)| handle)
            .collect();
        meshes.sort_by_key(|handle| handle.into_raw_parts());
        let solid = map
            .collision
            .iter()
            .enumerate()
            .filter(|(_, mesh)| !mesh.triangles.is_empty());
        let classes = TriangleClasses::new(map);
        for ((idx, mesh), handle) in solid.zip(meshes) {
            self.contacts.set_classes(handle, classes.of(idx, hidden));
            let Some(objects) = map.objects_of(idx) else {
                continue;
            };
            let shown = mesh
                .triangles
                .iter()
                .zip(objects)
                .filter(|(_, object)| !hidden.contains(object))
                .map(|(corners, _)| *corners);
            let mut shown: Vec<[u32; 3]> = shown.collect();
            if self.engine.colliders[handle]
                .shape()
                .as_trimesh()
                .is_some_and(|now| now.indices().len() == shown.len())
            {
                continue;
            }
            let mut vertices: Vec<Vector> =
                mesh.vertices_m.iter().map(|v| Vector::from(*v)).collect();
            if shown.is_empty() {
                // A mesh needs at least one triangle; nothing comes a kilometre below the ground.
                let first = vertices.len() as u32;
                vertices.extend(
                    [
                        [0.0, 0.0, -1000.0],
                        [1.0, 0.0, -1000.0],
                        [0.0, 1.0, -1000.0],
                    ]
                    .map(Vector::from),
                );
                shown.push([first, first + 1, first + 2]);
            }
            if let Ok(shape) = SharedShape::trimesh(vertices, shown)
                && let Some(collider) = self.engine.colliders.get_mut(handle)
            {
                collider.set_shape(shape);
            }
        }
    }

    /// Lists the solid things that stand still, if they changed; must run before vehicles are
    /// planned.
    pub fn refresh_still(&mut self) {
        self.still
            .refresh(&self.engine.bodies, &self.engine.colliders);
    }

    /// A world pose in engine coordinates.
    pub fn engine_pose(&self, pose: &Isometry3<f64>) -> EnginePose {
        let t = pose.translation.vector - self.origin_m;
        let q = pose.rotation.quaternion();
        EnginePose::from_parts(
            narrow(&t),
            Quat::from_xyzw(q.i as f32, q.j as f32, q.k as f32, q.w as f32),
        )
    }

    /// An engine pose in world coordinates; the quaternion is normalised in `f64`.
    pub fn world_pose(&self, pose: &EnginePose) -> Isometry3<f64> {
        let q = pose.rotation;
        let rotation = UnitQuaternion::new_normalize(Quaternion::new(
            q.w as f64, q.x as f64, q.y as f64, q.z as f64,
        ));
        Isometry3::from_parts(
            Translation3::from(self.origin_m + widen(pose.translation)),
            rotation,
        )
    }

    /// An engine point in world coordinates.
    pub fn world_point(&self, point: Vector) -> Point3<f64> {
        Point3::from(self.origin_m + widen(point))
    }

    /// A world point in engine coordinates.
    pub fn engine_point(&self, point_in_world_m: [f64; 3]) -> Vector {
        narrow(&(Vector3::from(point_in_world_m) - self.origin_m))
    }

    /// Advances the engine by one sub-step; its contacts go to the log.
    pub fn step(&mut self, dt_secs: f32) {
        self.engine.integration_parameters.dt = dt_secs;
        self.contacts.dt_secs = dt_secs;
        self.engine.step_with_events(&(), &self.contacts);
    }

    /// Makes bodies and removes them again: places that are free must be free, as a checkpoint may
    /// say otherwise.
    pub fn try_to_grow(&mut self) {
        let body = |_| {
            let collider = ColliderBuilder::cuboid(1.0, 1.0, 1.0);
            self.engine.insert(RigidBodyBuilder::fixed(), collider).0
        };
        let bodies: Vec<RigidBodyHandle> = (0..N_TRIAL_BODIES).map(body).collect();
        for body in bodies {
            self.engine.remove_body(body);
        }
    }

    /// Query for fixed colliders, as the engine knows them since its last step.
    pub fn ground_query(&self) -> QueryPipeline<'_> {
        let filter = QueryFilter::only_fixed();
        let engine = &self.engine;
        engine.broad_phase.as_query_pipeline(
            engine.narrow_phase.query_dispatcher(),
            &engine.bodies,
            &engine.colliders,
            filter,
        )
    }

    /// Adds a collision that was found outside the engine.
    pub fn log_contact(&mut self, mut collision: Collision) {
        (0..3).for_each(|axis| collision.point_in_world_m[axis] -= self.origin_m[axis]);
        self.contacts.entries().push(collision);
    }

    /// Fills `merged` with the contacts since the last call: one entry per (actor, other), sorted;
    /// of scenery the class is that of the hardest contact.
    pub fn take_collisions(&mut self, merged: &mut Vec<Collision>) {
        let origin_m = self.origin_m;
        let raw = self.contacts.entries();
        raw.sort_by_key(|entry| (entry.actor, entry.other));
        merged.clear();
        let mut hardest_ns = 0.0;
        for mut entry in raw.drain(..) {
            (0..3).for_each(|axis| entry.point_in_world_m[axis] += origin_m[axis]);
            match merged
                .last_mut()
                .filter(|last| (last.actor, last.other) == (entry.actor, entry.other))
            {
                Some(last) => {
                    last.add(&entry);
                    if entry.impulse_ns() > hardest_ns {
                        (hardest_ns, last.other_class) = (entry.impulse_ns(), entry.other_class);
                    }
                }
                None => {
                    hardest_ns = entry.impulse_ns();
                    merged.push(entry);
                }
            }
        }
    }

    /// Whether `shape` at `pose` overlaps solid ground or scenery.
    pub fn touches_scenery(&self, pose: &EnginePose, shape: &dyn Shape) -> bool {
        let pipeline = self
            .engine
            .query_pipeline_with_filter(QueryFilter::only_fixed().groups(InteractionGroups::all()));
        pipeline.intersect_shape(*pose, shape).next().is_some()
    }
}
