//! Lamps of the scenery that can be switched, and heads of traffic lights.

use nalgebra::Isometry3;
use schema_types::{ObjectId, Pose};

/// What a lamp belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LampGroup {
    /// Along streets.
    Street,
    /// On or in buildings.
    Building,
    /// Anything else.
    Other,
}

/// A lamp of the scenery that can be switched.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneryLamp {
    /// Object whose lamps or windows shine.
    pub object: ObjectId,
    /// Middle of the light, world.
    pub position_m: [f64; 3],
    /// Colour, sRGB.
    pub rgb: [u8; 3],
    /// Luminous flux, lumen.
    pub intensity_lm: f32,
    /// What the lamp belongs to.
    pub group: LampGroup,
}

impl SceneryLamp {
    /// The lit windows of a building.
    pub(crate) fn windows(object: ObjectId, position_m: [f64; 3]) -> SceneryLamp {
        SceneryLamp {
            object,
            position_m,
            rgb: [255, 206, 148],
            intensity_lm: 2000.0,
            group: LampGroup::Building,
        }
    }
}

/// The lamps of one OpenDRIVE signal.
#[derive(Clone, Debug)]
pub struct LightSite {
    /// Id of the signal in the OpenDRIVE text.
    pub signal_id: String,
    /// Foot of its pole, yaw facing the traffic that must obey (x points against the traffic's
    /// direction).
    pub pole: Pose,
    /// Where to draw [`Town::light_head`](crate::Town::light_head): x points towards the traffic that must obey.
    pub heads: Vec<Isometry3<f64>>,
}
