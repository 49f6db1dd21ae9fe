//! A town, and why one cannot be made.

use schema_types::Pose;
use sensor_core::{Mesh, SceneAssets};

use crate::scenery::{CollisionMesh, LightSite, SceneryLamp, SceneryObject};

/// Why a town cannot be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TownError {
    /// No town has this name.
    #[error("map {name:?} not found; generated towns are {}", crate::plan::all_names().join(", "))]
    Unknown {
        /// The name that was asked for.
        name: String,
    },
    /// A map whose surfaces would not fit into memory.
    #[error("map {name:?} is too large to be built: {reason}")]
    TooLarge {
        /// Name of the map.
        name: String,
        /// What is too large.
        reason: String,
    },
}

/// A town: map, scenery, collision.
#[derive(Clone, Debug)]
pub struct Town {
    /// Name without `Carla/Maps/` and `_Opt`; for an imported map, its given name.
    pub name: String,
    /// OpenDRIVE 1.6 text.
    pub open_drive: String,
    /// Where vehicles may be put: 0.3 m above the ground, x along the lane.
    pub spawn_points: Vec<Pose>,
    /// Meshes and their instances. Meshes of actors may be added behind them.
    pub assets: SceneAssets,
    /// Every object with an id of its own.
    pub objects: Vec<SceneryObject>,
    /// Lamps that can be switched, in a stable order.
    pub lamps: Vec<SceneryLamp>,
    /// Traffic lights: one per light signal of the map.
    pub lights: Vec<LightSite>,
    /// A head with three lamps facing +x: bit 0 red, 1 yellow, 2 green.
    pub light_head: Mesh,
    /// What vehicles can drive on and run into.
    pub collision: Vec<CollisionMesh>,
    /// Origin of the collision coordinates in the world, metres.
    pub origin_m: [f64; 3],
}
