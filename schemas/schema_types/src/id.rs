//! Identities of what is in the world.
//!
//! One `u32` space: 0 is the background, actors count from 1, scenery objects have bit 31 set.

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

/// An actor: vehicle, walker, light, sign, prop, sensor or spectator. Never 0, never reused within
/// an epoch, bit 31 clear.
#[repr(transparent)]
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    Hash,
    PartialOrd,
    Ord,
    Pod,
    Zeroable,
    Serialize,
    Deserialize,
)]
pub struct ActorId(pub u32);

/// Anything a pixel or a ray can show: an actor's id, a scenery object (bit 31 set), or 0 for the
/// background.
#[repr(transparent)]
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    Hash,
    PartialOrd,
    Ord,
    Pod,
    Zeroable,
    Serialize,
    Deserialize,
)]
pub struct ObjectId(pub u32);

/// Set in the id of every scenery object.
pub const SCENERY_BIT: u32 = 1 << 31;

impl ObjectId {
    /// The background: sky, or nothing hit.
    pub const BACKGROUND: ObjectId = ObjectId(0);

    /// The scenery object with this index; stable per map. `idx` must be below 2³¹.
    pub const fn scenery(idx: u32) -> Self {
        ObjectId(idx | SCENERY_BIT)
    }

    /// Whether this is a scenery object.
    pub const fn is_scenery(self) -> bool {
        self.0 & SCENERY_BIT != 0
    }

    /// The actor's id; `None` for scenery and the background.
    pub const fn actor(self) -> Option<ActorId> {
        if self.0 == 0 || self.is_scenery() {
            None
        } else {
            Some(ActorId(self.0))
        }
    }
}

impl From<ActorId> for ObjectId {
    fn from(actor: ActorId) -> Self {
        ObjectId(actor.0)
    }
}

impl std::fmt::Display for ActorId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenery_and_actors_do_not_overlap() {
        assert!(ObjectId::scenery(0).is_scenery());
        assert_eq!(ObjectId::scenery(7).actor(), None);
        assert_eq!(ObjectId::from(ActorId(7)).actor(), Some(ActorId(7)));
        assert_eq!(ObjectId::BACKGROUND.actor(), None);
    }
}
