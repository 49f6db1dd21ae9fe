//! Things beside and on the road that are not signals: poles, buildings, barriers, trees, parking
//! spaces.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use crate::raw::{RawMap, RawObject};
use crate::signals::world_corner;

/// An object in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct RoadObject {
    /// OpenDRIVE id; pieces of a repeated object share it.
    pub id: String,
    /// Its name.
    pub name: String,
    /// OpenDRIVE's type, e.g. `pole`, `building`, `tree`, `barrier`, `parkingSpace`.
    pub kind: String,
    /// Middle of its foot; x along its length, y along its width, z off the road.
    pub pose: Isometry3<f64>,
    /// Extent along x, metres; 0 if not stated.
    pub length_m: f64,
    /// Extent along y, metres; 0 if not stated.
    pub width_m: f64,
    /// Height, metres; 0 if not stated.
    pub height_m: f64,
    /// Radius of a round one, metres; 0 if it is not round.
    pub radius_m: f64,
    /// Corners of its outline in the world, and the height of the object over each; empty without
    /// an outline.
    pub outline: Vec<([f64; 3], f64)>,
    /// Number of the road it is listed with.
    pub road: u32,
}

pub(crate) fn object(map: &RawMap, raw: &RawObject) -> RoadObject {
    let road = &map.roads[raw.road];
    let station = road.station(raw.s_m);
    let local = Isometry3::from_parts(
        Vector3::new(0.0, 0.0, raw.z_offset_m).into(),
        UnitQuaternion::from_euler_angles(0.0, 0.0, raw.heading_rad),
    );
    let pose = station.frame(raw.t_m, 0.0, (0.0, 0.0)) * local;
    RoadObject {
        id: raw.id.clone(),
        name: raw.name.clone(),
        kind: raw.kind.clone(),
        pose,
        length_m: raw.length_m,
        width_m: raw.width_m,
        height_m: raw.height_m,
        radius_m: raw.radius_m,
        outline: raw
            .corners
            .iter()
            .map(|corner| world_corner(road, &pose, corner, raw.height_m))
            .collect(),
        road: road.number,
    }
}
