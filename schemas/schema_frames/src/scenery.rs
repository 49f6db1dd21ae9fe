//! Objects and lamps of the scenery, as the command `scenery` lists and other commands change them.

use serde::{Deserialize, Serialize};

use crate::document::PoseText;

/// One object of the scenery.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneryObjectInfo {
    /// Id in instance images and semantic lidar: bit 31 is set; stable per map.
    pub id: u32,
    /// Kind and number, e.g. `tree_412`.
    pub name: String,
    /// Semantic class of most of its triangles.
    pub class: u8,
    /// Bit of its layer in CARLA's numbering; 0 for roads, signs, traffic lights, bridges and
    /// terrain, which belong to no layer.
    pub layer: u16,
    /// Pose of its foot, world.
    pub pose: PoseText,
    /// Pose of the middle of its box, world.
    pub box_pose: PoseText,
    /// Half extents of the box, metres.
    pub box_half_m: [f64; 3],
    /// Whether it can be seen and touched now.
    pub shown: bool,
}

/// One lamp of the scenery.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneryLampInfo {
    /// Number of the lamp in the map, from 0.
    pub lamp: u32,
    /// Object it is part of.
    pub object_id: u32,
    /// Middle of the light, world, metres.
    pub position_m: [f64; 3],
    /// Colour, sRGB.
    pub rgb: [u8; 3],
    /// Luminous flux, lumen.
    pub intensity_lm: f32,
    /// CARLA's group of lamps: 2 street, 3 building, 4 other.
    pub group: u8,
    /// Whether it shines now.
    pub on: bool,
}

/// A change of one lamp; a value that is absent stays.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LampChange {
    /// Number of the lamp.
    pub lamp: u32,
    /// Switches the lamp, which then stays so whether it is dark or not; `null` changes nothing.
    #[serde(default)]
    pub on: Option<bool>,
    /// Colour, sRGB.
    #[serde(default)]
    pub rgb: Option<[u8; 3]>,
    /// Luminous flux, lumen.
    #[serde(default)]
    pub intensity_lm: Option<f32>,
    /// Group, 0 to 4.
    #[serde(default)]
    pub group: Option<u8>,
}
