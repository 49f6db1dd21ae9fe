//! Collisions of a tick.

use nalgebra::Vector3;
use schema_types::{ActorId, Class};
use serde::{Deserialize, Serialize};

/// One actor pushed by another thing during a tick. There is one entry per (actor, other), so two
/// actors that touch make two entries.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Collision {
    /// The actor that was pushed.
    pub actor: ActorId,
    /// What it touched; `None` is scenery.
    pub other: Option<ActorId>,
    /// Class of what it touched, of scenery the object's that was pressed hardest;
    /// [`Class::UNLABELED`] for solid ground without a class.
    pub other_class: Class,
    /// Normal impulse on `actor` summed over the tick, N·s, world: it points away from `other`.
    pub impulse_in_world_ns: [f64; 3],
    /// Place in the world, metres: the mean of the contact points, weighted with their impulses.
    pub point_in_world_m: [f64; 3],
}

impl Collision {
    /// Size of the impulse, N·s.
    pub fn impulse_ns(&self) -> f64 {
        Vector3::from(self.impulse_in_world_ns).norm()
    }

    /// Adds a later contact of the same pair.
    pub(crate) fn add(&mut self, later: &Collision) {
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
