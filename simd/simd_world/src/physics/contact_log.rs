//! Collects the contact forces that the engine reports during its step.

use std::collections::HashMap;
use std::sync::Arc;

use parking_lot::Mutex;
use rapier3d::math::{Pose as EnginePose, Vector};
use rapier3d::prelude::*;
use schema_types::{ActorId, Class};

use super::collision::Collision;
use super::vectors::widen;

/// Mean of a pair's contact points, engine coordinates, weighted with their impulses.
fn contact_point(colliders: &ColliderSet, pair: &ContactPair) -> Vector {
    let place = colliders
        .get(pair.collider1)
        .map_or(EnginePose::IDENTITY, |collider| *collider.position());
    let (mut sum, mut weight) = (Vector::ZERO, 0.0);
    for manifold in pair.solver_manifolds() {
        let place = manifold.subshape_pos1().map_or(place, |part| place * part);
        for point in &manifold.points {
            // A point without an impulse counts a little, so that a pair always has a place.
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

/// The triangle of a mesh that a pair pressed deepest into: `None` if nothing touches.
fn deepest_triangle(pair: &ContactPair, is_first: bool) -> Option<usize> {
    let depth = |manifold: &ContactManifold| {
        let depths = manifold.points.iter().map(|point| -point.dist);
        depths.max_by(f32::total_cmp)
    };
    let manifolds = pair.manifolds().iter();
    let touching = manifolds.filter_map(|manifold| Some((depth(manifold)?, manifold)));
    let (_, deepest) = touching.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let triangle = match is_first {
        true => deepest.subshape1,
        false => deepest.subshape2,
    };
    Some(triangle as usize)
}

/// Collects contact forces. It locks because the engine reports them through a shared reference.
#[derive(Default)]
pub(crate) struct ContactLog {
    entries: Mutex<Vec<Collision>>,
    /// Length of the engine's sub-step, seconds.
    pub dt_secs: f32,
    /// Classes of the triangles of the map's meshes.
    classes: HashMap<ColliderHandle, Arc<[Class]>>,
}

impl ContactLog {
    /// The contacts so far; their points are relative to the engine's origin.
    pub fn entries(&mut self) -> &mut Vec<Collision> {
        self.entries.get_mut()
    }

    /// A log without contacts of a world on the same ground.
    pub fn emptied(&self) -> ContactLog {
        ContactLog {
            classes: self.classes.clone(),
            ..ContactLog::default()
        }
    }

    /// Sets the classes of a mesh's triangles.
    pub fn set_classes(&mut self, mesh: ColliderHandle, classes: Arc<[Class]>) {
        self.classes.insert(mesh, classes);
    }

    /// Class of what one side of a pair is: a mesh's where it was pressed deepest.
    fn class(&self, tag: u128, side: (ColliderHandle, bool), pair: &ContactPair) -> Class {
        let class = Class((tag >> 32) as u8);
        let Some(classes) = self.classes.get(&side.0) else {
            return class;
        };
        let triangle = deepest_triangle(pair, side.1);
        let found = triangle.and_then(|triangle| classes.get(triangle));
        found.copied().unwrap_or(class)
    }
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
        let (one, two) = ((pair.collider1, true), (pair.collider2, false));
        let mut entries = self.entries.lock();
        for (this, that, side, impulse) in [
            (first, second, two, -impulse),
            (second, first, one, impulse),
        ] {
            let other_class = self.class(that, side, pair);
            let (this, that) = (this as u32, that as u32);
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
