//! CARLA's kinds of sensors: their blueprints, their numbers on the wire, and the modalities that
//! their messages are made of.

use Modality::{
    Collision, Depth, Dvs, Flow, Gnss, Imu, Instance, Lidar, Normals, Obstacle, Radar, Rgb,
    Semantic, SemanticLidar,
};
use schema_frames::Modality;

/// A kind of sensor that clients can listen to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kind {
    /// Id of its blueprint.
    pub type_id: &'static str,
    /// CARLA's number of the kind, in front of every message; a wrong one ends the client's
    /// process.
    pub number: u64,
    /// The modalities whose frames of one tick make a message. Empty if the gateway makes the
    /// messages itself.
    pub modalities: &'static [Modality],
}

/// Sensors whose messages the simulator's frames can fill.
pub const KINDS: &[Kind] = &[
    Kind {
        type_id: "sensor.other.collision",
        number: 0,
        modalities: &[Collision],
    },
    Kind {
        type_id: "sensor.camera.depth",
        number: 1,
        modalities: &[Depth],
    },
    Kind {
        type_id: "sensor.camera.normals",
        number: 2,
        modalities: &[Normals],
    },
    Kind {
        type_id: "sensor.camera.dvs",
        number: 3,
        modalities: &[Dvs],
    },
    Kind {
        type_id: "sensor.other.gnss",
        number: 4,
        modalities: &[Gnss],
    },
    Kind {
        type_id: "sensor.other.imu",
        number: 5,
        modalities: &[Imu],
    },
    Kind {
        type_id: "sensor.other.obstacle",
        number: 7,
        modalities: &[Obstacle],
    },
    Kind {
        type_id: "sensor.camera.optical_flow",
        number: 8,
        modalities: &[Flow],
    },
    Kind {
        type_id: "sensor.other.radar",
        number: 9,
        modalities: &[Radar],
    },
    Kind {
        type_id: "sensor.lidar.ray_cast_semantic",
        number: 10,
        modalities: &[SemanticLidar],
    },
    Kind {
        type_id: "sensor.lidar.ray_cast",
        number: 11,
        modalities: &[Lidar],
    },
    Kind {
        type_id: "sensor.camera.rgb",
        number: 13,
        modalities: &[Rgb],
    },
    Kind {
        type_id: "sensor.camera.semantic_segmentation",
        number: 14,
        modalities: &[Semantic],
    },
    // CARLA's pixels hold the class beside the id.
    Kind {
        type_id: "sensor.camera.instance_segmentation",
        number: 15,
        modalities: &[Instance, Semantic],
    },
    Kind {
        type_id: "sensor.camera.cosmos_visualization",
        number: COSMOS,
        modalities: &[Semantic],
    },
    Kind {
        type_id: AWARENESS,
        number: 20,
        modalities: &[],
    },
    Kind {
        type_id: CUSTOM,
        number: 21,
        modalities: &[],
    },
];

/// Number of the camera that shows classes in their display colours.
pub const COSMOS: u64 = 16;

/// Blueprint of radio stations that send awareness messages by themselves.
pub const AWARENESS: &str = "sensor.other.v2x";
/// Blueprint of radio stations that send texts of scripts.
pub const CUSTOM: &str = "sensor.other.v2x_custom";

/// Sensors that clients compute themselves; they are actors without a stream.
pub const CLIENT_SIDE: &[&str] = &["sensor.other.lane_invasion"];

/// The kind of a blueprint.
pub fn kind(type_id: &str) -> Option<&'static Kind> {
    KINDS.iter().find(|kind| kind.type_id == type_id)
}

/// Whether this blueprint is a radio station.
pub fn is_station(type_id: &str) -> bool {
    [AWARENESS, CUSTOM].contains(&type_id)
}
