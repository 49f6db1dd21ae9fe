//! The rapier world: solid ground about an `f64` origin, gravity, contacts.
//!
//! The one place where `f32` engine coordinates meet `f64` world coordinates. A body's frame is the
//! actor's own: no offset is kept anywhere.

use std::collections::BTreeSet;
use std::sync::Mutex;

use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rapier3d::glamx::Quat;
use rapier3d::math::{Pose as EnginePose, Vector};
use rapier3d::prelude::*;
use schema_types::{ActorId, Class, ObjectId};
use serde::{Deserialize, Serialize};

use crate::footing::StillThings;
use crate::map::MapData;

/// Standard gravity, m/s², along world −z.
pub(crate) const GRAVITY_MPS2: f64 = 9.81;

/// Two things pushed each other during a tick: one entry per (actor, other), so two actors that
/// touch make two entries.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Collision {
    /// Who was pushed.
    pub actor: ActorId,
    /// What it touched; `None` is scenery.
    pub other: Option<ActorId>,
    /// Class of what it touched; [`Class::UNLABELED`] for solid ground that does not say what it
    /// is.
    pub other_class: Class,
    /// Normal impulse on `actor` summed over the tick, N·s, world: it points away from `other`.
    pub impulse_in_world_ns: [f64; 3],
    /// Where, world, metres: mean of the contact points, weighted with their impulses.
    pub point_in_world_m: [f64; 3],
}

impl Collision {
    /// Size of the impulse, N·s.
    pub fn impulse_ns(&self) -> f64 {
        Vector3::from(self.impulse_in_world_ns).norm()
    }

    /// Adds a later contact of the same two.
    fn add(&mut self, later: &Collision) {
        let (mine, theirs) = (self.impulse_ns(), later.impulse_ns());
        let share = if mine + theirs > 0.0 {
            theirs / (mine + theirs)
        } else {
            0.5
        };
        for axis in 0..3 {
            self.impulse_in_world_ns[axis] += later.impulse_in_world_ns[axis];
            self.point_in_world_m[axis] +=
                share * (later.point_in_world_m[axis] - self.point_in_world_m[axis]);
        }
    }
}

/// What a collider says about itself in contacts: whose it is (0 is scenery) and its class.
pub(crate) fn collider_tag(actor: u32, class: Class) -> u128 {
    u128::from(actor) | u128::from(class.0) << 32
}

/// Engine, solid ground and the contacts of the current tick.
#[derive(Serialize, Deserialize)]
pub(crate) struct Physics {
    #[serde(with = "crate::checkpoint::engine")]
    pub engine: PhysicsWorld,
    #[serde(with = "crate::plain::vector")]
    origin_m: Vector3<f64>,
    /// To be forgotten by whoever touches something fixed.
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
            contacts: _,
        } = self;
        let still = StillThings::default();
        Physics {
            engine: crate::checkpoint::copy(engine),
            origin_m: *origin_m,
            still,
            contacts: ContactLog::default(),
        }
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
    pub fn with_solids(origin_m: [f64; 3], solids: &[(SharedShape, Class)]) -> Self {
        let mut physics = Physics::new(origin_m);
        for (solid, class) in solids {
            let collider = ColliderBuilder::new(solid.clone())
                .friction(0.6)
                .user_data(collider_tag(0, *class));
            physics.engine.insert(RigidBodyBuilder::fixed(), collider);
        }
        // The query pipeline sees colliders only after a step.
        physics.engine.step();
        physics
    }

    /// Gives the map's solid meshes only those triangles whose object is shown. Colliders stay the
    /// same, so that nothing else changes.
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
        for ((idx, mesh), handle) in solid.zip(meshes) {
            let Some(objects) = map
                .collision_objects
                .get(idx)
                .filter(|objects| objects.len() == mesh.triangles.len())
            else {
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
                // A mesh needs a triangle; nobody comes a kilometre below the ground.
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

    /// Before wheels are planned: lists the solid things that stand still, if they changed.
    pub fn refresh_still(&mut self) {
        self.still
            .refresh(&self.engine.bodies, &self.engine.colliders);
    }

    /// World pose as the engine's.
    pub fn engine_pose(&self, pose: &Isometry3<f64>) -> EnginePose {
        let t = pose.translation.vector - self.origin_m;
        let q = pose.rotation.quaternion();
        EnginePose::from_parts(
            narrow(&t),
            Quat::from_xyzw(q.i as f32, q.j as f32, q.k as f32, q.w as f32),
        )
    }

    /// Engine pose in the world; the quaternion is brought back to unit length in `f64`.
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

    /// A point of the engine in the world.
    pub fn world_point(&self, point: Vector) -> Point3<f64> {
        Point3::from(self.origin_m + widen(point))
    }

    /// A point of the world in the engine.
    pub fn engine_point(&self, point_in_world_m: [f64; 3]) -> Vector {
        narrow(&(Vector3::from(point_in_world_m) - self.origin_m))
    }

    /// One sub-step; contacts go to the log.
    pub fn step(&mut self, dt_secs: f32) {
        self.engine.integration_parameters.dt = dt_secs;
        self.contacts.dt_secs = dt_secs;
        self.engine.step_with_events(&(), &self.contacts);
    }

    /// What wheels stand on, as the engine knows it since its last step.
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
        self.contacts
            .entries
            .get_mut()
            .expect("nobody panics while logging a contact")
            .push(collision);
    }

    /// Fills `merged` with the contacts since the last call, one entry per (vehicle, other),
    /// sorted.
    pub fn take_collisions(&mut self, merged: &mut Vec<Collision>) {
        let origin_m = self.origin_m;
        let raw = self
            .contacts
            .entries
            .get_mut()
            .expect("nobody panics while logging a contact");
        raw.sort_by_key(|entry| (entry.actor, entry.other));
        merged.clear();
        for mut entry in raw.drain(..) {
            (0..3).for_each(|axis| entry.point_in_world_m[axis] += origin_m[axis]);
            match merged
                .last_mut()
                .filter(|last| (last.actor, last.other) == (entry.actor, entry.other))
            {
                Some(last) => last.add(&entry),
                None => merged.push(entry),
            }
        }
    }

    /// Whether `shape` at `pose` overlaps solid ground or scenery.
    pub fn touches_scenery(&self, pose: &EnginePose, shape: &dyn Shape) -> bool {
        let pipeline = self
            .engine
            .query_pipeline_with_filter(QueryFilter::only_fixed());
        pipeline.intersect_shape(*pose, shape).next().is_some()
    }
}

/// `f32` engine vector as `f64`.
pub(crate) fn widen(v: Vector) -> Vector3<f64> {
    Vector3::new(v.x as f64, v.y as f64, v.z as f64)
}

/// `f64` vector as the engine's.
pub(crate) fn narrow(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x as f32, v.y as f32, v.z as f32)
}

/// Mean of a pair's contact points, engine coordinates, weighted with their impulses.
fn contact_point(colliders: &ColliderSet, pair: &ContactPair) -> Vector {
    let place = colliders
        .get(pair.collider1)
        .map_or(EnginePose::IDENTITY, |collider| *collider.position());
    let (mut sum, mut weight) = (Vector::ZERO, 0.0);
    for manifold in pair.solver_manifolds() {
        let place = manifold.subshape_pos1().map_or(place, |part| place * part);
        for point in &manifold.points {
            // A point that carries nothing counts a little, so that a pair always has a place.
            let share = point.data.impulse.max(1e-6);
            sum += place * point.local_p1 * share;
            weight += share;
        }
    }
    if weight > 0.0 {
        sum / weight
    } else {
        place.translation
    }
}

/// Collects contact forces; the engine hands them out behind a shared reference.
#[derive(Default)]
struct ContactLog {
    entries: Mutex<Vec<Collision>>,
    dt_secs: f32,
}

impl EventHandler for ContactLog {
    fn handle_collision_event(
        &self,
        _: &RigidBodySet,
        _: &ColliderSet,
        _: CollisionEvent,
        _: Option<&ContactPair>,
    ) {
    }

    fn handle_contact_force_event(
        &self,
        _dt: f32,
        _: &RigidBodySet,
        colliders: &ColliderSet,
        pair: &ContactPair,
        total_force_n: f32,
    ) {
        let tag = |handle: ColliderHandle| {
            colliders
                .get(handle)
                .map_or(0, |collider| collider.user_data)
        };
        let (first, second) = (tag(pair.collider1), tag(pair.collider2));
        let point_in_world_m = widen(contact_point(colliders, pair)).into();
        let direction = widen(pair.total_impulse());
        // The normal points from the first to the second collider; the second is pushed along it.
        let impulse = direction.try_normalize(0.0).unwrap_or_default()
            * (total_force_n * self.dt_secs) as f64;
        let mut entries = self
            .entries
            .lock()
            .expect("nobody panics while logging a contact");
        for (this, that, impulse) in [(first, second, -impulse), (second, first, impulse)] {
            let (this, that, other_class) = (this as u32, that as u32, Class((that >> 32) as u8));
            if this != 0 {
                let other = (that != 0).then_some(ActorId(that));
                entries.push(Collision {
                    actor: ActorId(this),
                    other,
                    other_class,
                    impulse_in_world_ns: impulse.into(),
                    point_in_world_m,
                });
            }
        }
    }

    fn handle_soft_body_tear_event(&self, _: &SoftBodySet, _: &SoftBodyTearEvent) {}
}
