//! A town and how to generate one.

use schema_types::Pose;
use sensor_core::{Mesh, SceneAssets};

use crate::meshes::signals;
use crate::network::{Network, guide, open_drive, spawn_points};
use crate::plan::plan_of;
use crate::scenery::{CollisionMesh, LightSite, SceneryLamp, SceneryObject};
use crate::{assembly, plan};

/// Why a town cannot be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TownError {
    /// No town has this name.
    #[error("map {name:?} not found; generated towns are {}", Town::NAMES.join(", "))]
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

impl Town {
    /// Names that [`Town::generate`] knows. `_Opt` behind a name is the same town.
    pub const NAMES: [&'static str; 8] = plan::NAMES;

    /// The town of this name and seed. `Carla/Maps/` in front and `_Opt` behind the name change
    /// nothing.
    pub fn generate(name: &str, seed: u64) -> Result<Town, TownError> {
        let short = name.rsplit('/').next().unwrap_or(name);
        let short = short.strip_suffix("_Opt").unwrap_or(short);
        let plan = plan_of(short, seed).ok_or_else(|| TownError::Unknown {
            name: name.to_owned(),
        })?;
        let network = Network::build(&plan);
        let scenery = assembly::build(&plan, &network, seed);
        let open_drive = open_drive::write(&plan, &network);
        let mut spawn_points = spawn_points(&network);
        if short == "Town10HD" {
            guide::number(&mut spawn_points, &open_drive);
        }
        Ok(Town {
            name: short.to_owned(),
            open_drive,
            spawn_points,
            assets: scenery.assets,
            objects: scenery.objects,
            lamps: scenery.lamps,
            lights: scenery.lights,
            light_head: signals::light_head(),
            collision: scenery.collision,
            origin_m: [0.0; 3],
        })
    }
}
