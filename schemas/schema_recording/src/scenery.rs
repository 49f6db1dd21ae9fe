//! Objects of the map in a recording: attachments `scenery.<tick>.json`, each with what stands there
//! from that tick on.

use schema_frames::document::PoseText;
use schema_frames::scenery::SceneryObjectInfo;
use serde::{Deserialize, Serialize};

/// What stands on the map from a tick on, until the next attachment of its kind.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneryList {
    /// First tick.
    pub tick: u64,
    /// Whether all objects of the classes that are kept are here. `false`: what stands there from
    /// this tick on is not known, because the lists had become too long.
    pub complete: bool,
    /// The objects, by rising id.
    pub objects: Vec<SceneryBox>,
}

/// One object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneryBox {
    /// Id in instance images and semantic lidar: bit 31 is set; stable per map.
    pub id: u32,
    /// Kind and number, e.g. `parked_car_412`.
    pub name: String,
    /// Semantic class of most of its triangles.
    pub class: u8,
    /// Pose of the middle of its box, world; x is forward for vehicles.
    pub box_pose: PoseText,
    /// Half extents of the box, metres.
    pub box_half_m: [f64; 3],
    /// Whether it can be seen and touched.
    pub shown: bool,
}

impl SceneryBox {
    /// What is kept of an object; `None` for classes that detectors do not label.
    pub fn of(object: SceneryObjectInfo) -> Option<SceneryBox> {
        is_kept(object.class).then_some(SceneryBox {
            id: object.id,
            name: object.name,
            class: object.class,
            box_pose: object.box_pose,
            box_half_m: object.box_half_m,
            shown: object.shown,
        })
    }
}

/// Whether objects of a class are kept: poles, traffic lights, signs, people and vehicles. A town has
/// many times more houses, trees and street furniture.
pub fn is_kept(class: u8) -> bool {
    matches!(class, 6..=8 | 12..=19)
}

/// Name of the attachment with what stands there from `tick` on.
pub fn attachment_name(tick: u64) -> String {
    format!("scenery.{tick}.json")
}

/// The tick in an attachment's name; `None` for other attachments.
pub fn tick_of(attachment: &str) -> Option<u64> {
    let tick = attachment.strip_prefix("scenery.")?.strip_suffix(".json")?;
    tick.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back_to_their_ticks() {
        assert_eq!(tick_of(&attachment_name(417)), Some(417));
        for other in ["launch.toml", "scenery.json", "scenery.x.json", "a.xodr"] {
            assert_eq!(tick_of(other), None, "{other}");
        }
    }
}
