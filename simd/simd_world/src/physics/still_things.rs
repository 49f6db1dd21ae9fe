//! Colliders that stand still: ground, buildings, props.

use rapier3d::math::{Pose, Vector};
use rapier3d::prelude::*;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Room {
    pub low: Vector,
    pub high: Vector,
}

impl Room {
    pub const NOWHERE: Room = Room {
        low: Vector::splat(f32::INFINITY),
        high: Vector::splat(f32::NEG_INFINITY),
    };

    #[inline]
    pub fn around(points: impl IntoIterator<Item = Vector>) -> Room {
        points.into_iter().fold(Room::NOWHERE, |room, point| Room {
            low: room.low.min(point),
            high: room.high.max(point),
        })
    }

    #[inline]
    pub fn grown(self, margin: Vector) -> Room {
        Room {
            low: self.low - margin,
            high: self.high + margin,
        }
    }

    #[inline]
    pub fn touches(&self, other: &Room) -> bool {
        self.low.cmple(other.high).all() && other.low.cmple(self.high).all()
    }

    #[inline]
    pub fn contains(&self, other: &Room) -> bool {
        self.low.cmple(other.low).all() && other.high.cmple(self.high).all()
    }

    #[inline]
    pub fn aabb(&self) -> Aabb {
        Aabb::new(self.low, self.high)
    }
}

impl From<Aabb> for Room {
    fn from(aabb: Aabb) -> Room {
        Room {
            low: aabb.mins,
            high: aabb.maxs,
        }
    }
}

/// A collider that stands still.
#[derive(Clone, Debug)]
pub(crate) struct Still {
    pub collider: ColliderHandle,
    pub place: Pose,
    pub room: Room,
}

/// The colliders that stand still, by rising handle.
#[derive(Clone, Default)]
pub(crate) struct StillThings {
    /// Grows with every change; 0 before the first `refresh`.
    revision: u64,
    is_known: bool,
    things: Vec<Still>,
}

impl StillThings {
    /// Grows with every change; 0 before the first `refresh`.
    #[inline]
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// The things by rising collider handle.
    #[inline]
    pub fn things(&self) -> &[Still] {
        &self.things
    }

    /// Must be called after something fixed was added, moved, reshaped or removed.
    pub fn forget(&mut self) {
        self.is_known = false;
    }

    /// Lists the colliders anew if they may have changed.
    pub fn refresh(&mut self, bodies: &RigidBodySet, colliders: &ColliderSet) {
        if self.is_known {
            return;
        }
        self.things.clear();
        for (handle, collider) in colliders.iter() {
            let body = collider.parent().and_then(|parent| bodies.get(parent));
            let passes = collider.collision_groups() == InteractionGroups::none();
            if body.is_some_and(|body| !body.is_fixed()) || collider.is_sensor() || passes {
                continue;
            }
            // A moved body moves its colliders only in the engine's next step, but wheels ask
            // before it.
            let place = match (body, collider.position_wrt_parent()) {
                (Some(body), Some(in_body)) => *body.position() * *in_body,
                _ => *collider.position(),
            };
            self.things.push(Still {
                collider: handle,
                place,
                room: collider.shape().compute_aabb(&place).into(),
            });
        }
        self.things
            .sort_by_key(|thing| thing.collider.into_raw_parts());
        self.revision += 1;
        self.is_known = true;
    }
}
