//! A generated town and how to ask for one.

use nalgebra::Isometry3;
use schema_types::{ObjectId, Pose};
use sensor_core::{Mesh, SceneAssets};

use crate::network::Network;
use crate::object::{SceneryLamp, SceneryObject};
use crate::plan::Plan;
use crate::{furniture, guide, motorway, open_drive, plan, scenery, sketch, spawn};

/// Why there is no such town.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TownError {
    /// Unknown name.
    #[error("map {name:?} not found; generated towns are {}", Town::NAMES.join(", "))]
    Unknown {
        /// What was asked for.
        name: String,
    },
    /// A map whose surfaces would not fit into memory.
    #[error("map {name:?} is too large to be built: {reason}")]
    TooLarge {
        /// Its name.
        name: String,
        /// What there is too much of.
        reason: String,
    },
}

/// The lamps of one OpenDRIVE signal.
#[derive(Clone, Debug)]
pub struct LightSite {
    /// Id of the signal in the OpenDRIVE text.
    pub signal_id: String,
    /// Foot of its pole, yaw facing the traffic that must obey (x points against the traffic's
    /// direction).
    pub pole: Pose,
    /// Where to draw [`Town::light_head`]: x points towards the traffic that must obey.
    pub heads: Vec<Isometry3<f64>>,
}

/// Triangles for collision, `f32` about [`Town::origin_m`].
#[derive(Clone, Debug, Default)]
pub struct CollisionMesh {
    /// What it is, for messages.
    pub name: String,
    /// Corners.
    pub vertices_m: Vec<[f32; 3]>,
    /// Three corners per triangle, counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Scenery object of each triangle.
    pub objects: Vec<ObjectId>,
}

impl CollisionMesh {
    /// Adds a convex polygon of an object.
    pub(crate) fn polygon(&mut self, object: ObjectId, corners_m: &[[f64; 3]]) {
        let base = self.vertices_m.len() as u32;
        self.vertices_m
            .extend(corners_m.iter().map(|c| c.map(|x| x as f32)));
        self.triangles
            .extend((1..corners_m.len() as u32 - 1).map(|i| [base, base + i, base + i + 1]));
        self.objects.resize(self.triangles.len(), object);
    }
}

/// A town: map, scenery, collision.
#[derive(Clone, Debug)]
pub struct Town {
    /// Name, as asked for.
    pub name: String,
    /// OpenDRIVE 1.6 text.
    pub open_drive: String,
    /// Where vehicles may be put: 0.3 m above the ground, x along the lane.
    pub spawn_points: Vec<Pose>,
    /// Meshes and where they stand. Add actors' meshes behind them.
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
    pub const NAMES: [&'static str; 8] = [
        "Town01", "Town02", "Town03", "Town04", "Town05", "Town06", "Town07", "Town10HD",
    ];

    /// The town of this name and seed. `Carla/Maps/` in front and `_Opt` behind the name change
    /// nothing.
    pub fn generate(name: &str, seed: u64) -> Result<Town, TownError> {
        let short = name.rsplit('/').next().unwrap_or(name);
        let short = short.strip_suffix("_Opt").unwrap_or(short);
        let plan = plan_of(short, seed).ok_or_else(|| TownError::Unknown {
            name: name.to_owned(),
        })?;
        let network = Network::build(&plan);
        let scenery = scenery::build(&plan, &network, seed);
        let open_drive = open_drive::write(&plan, &network);
        let mut spawn_points = spawn::spawn_points(&network);
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
            light_head: furniture::light_head(),
            collision: scenery.collision,
            origin_m: [0.0; 3],
        })
    }
}

fn plan_of(name: &str, seed: u64) -> Option<Plan> {
    Some(match name {
        "Town01" => sketch::small_town(name, seed),
        "Town02" => sketch::compact(name, seed),
        "Town03" => sketch::roundabouts(name, seed),
        "Town04" => motorway::figure_of_eight(name, seed),
        "Town05" => sketch::multi_lane_grid(name, seed),
        "Town06" => motorway::long_highways(name, seed),
        "Town07" => sketch::country(name, seed),
        "Town10HD" => plan::dense_centre(name, seed),
        _ => return None,
    })
}

#[cfg(test)]
pub(crate) fn plans(seed: u64) -> impl Iterator<Item = Plan> {
    Town::NAMES
        .into_iter()
        .map(move |name| plan_of(name, seed).expect("a name of the list"))
}
