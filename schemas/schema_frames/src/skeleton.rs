//! Bones of a walker: what commands say and are answered.

use serde::{Deserialize, Serialize};

use crate::document::PoseText;

/// What is done to the bones of a walker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "act", rename_all = "snake_case", deny_unknown_fields)]
pub enum SkeletonAction {
    /// Answers with every bone as it is now.
    Read,
    /// Holds bones relative to their parents in the walker's own pose; the others of it stay as
    /// they were, or as a standing body holds them.
    Hold {
        /// The bones.
        bones: Vec<HeldBone>,
    },
    /// Shows the own pose instead of the gait by this share: 0 the gait alone, 1 the own pose
    /// alone.
    Blend {
        /// 0 to 1.
        ratio: f64,
    },
    /// Makes the gait's pose of this moment the walker's own.
    Capture,
}

/// A bone and where it is held.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeldBone {
    /// Name, as in the answer to `read`.
    pub name: String,
    /// In the frame of its parent.
    pub bone_in_parent: PoseText,
}

/// A bone as it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoneReading {
    /// Name.
    pub name: String,
    /// In the world.
    pub bone_in_world: PoseText,
    /// In the body's frame: origin between the feet, x forward, y left, z up.
    pub bone_in_body: PoseText,
    /// In the frame of its parent; of the first bone, which has none, in the body's.
    pub bone_in_parent: PoseText,
}
