//! Collects the contact forces that the engine reports during its step.

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

/// Collects contact forces. It locks because the engine reports them through a shared reference.
#[derive(Default)]
pub(crate) struct ContactLog {
    entries: Mutex<Vec<Collision>>,
    /// Length of the engine's sub-step, seconds.
    pub dt_secs: f32,
}

impl ContactLog {
    /// The contacts so far; their points are relative to the engine's origin.
    pub fn entries(&mut self) -> &mut Vec<Collision> {
        self.entries.get_mut()
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
        let mut entries = self.entries.lock();
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
