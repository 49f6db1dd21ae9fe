//! Bones of a walker, as commands set and read them.

use serde::{Deserialize, Serialize};

use crate::document::PoseText;

/// An action on the bones of a walker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "act", rename_all = "snake_case", deny_unknown_fields)]
pub enum SkeletonAction {
    /// Answers with every bone as it is now.
    Read,
    /// Sets bones of the walker's own pose, relative to their parents. Bones that were never set
    /// are those of a standing body.
    Hold {
        /// The bones.
        bones: Vec<HeldBone>,
    },
    /// Blends the gait with the walker's own pose.
    Blend {
        /// Share of the own pose: 0 shows the gait alone, 1 the own pose alone.
        ratio: f64,
    },
    /// Takes the gait's current pose as the walker's own.
    Capture,
}

/// A bone and its place in the walker's own pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeldBone {
    /// Name, as in the answer to `read`.
    pub name: String,
    /// Pose in the space of the parent bone.
    pub bone_in_parent: PoseText,
}

/// A bone as it is shown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoneReading {
    /// Name.
    pub name: String,
    /// Pose in the world.
    pub bone_in_world: PoseText,
    /// Pose in the body's space: origin between the feet, x forward, y left, z up.
    pub bone_in_body: PoseText,
    /// Pose in the space of the parent bone; the first bone has none, so its pose is in the body's
    /// space.
    pub bone_in_parent: PoseText,
}
