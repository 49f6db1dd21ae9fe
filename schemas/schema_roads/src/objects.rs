//! Objects beside and on the road: poles, buildings, barriers, trees, parking spaces, crosswalks.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use crate::raw::{Corner, RawCrosswalk, RawMap, RawObject, Road};

/// An object in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct RoadObject {
    /// OpenDRIVE id; pieces of a repeated object share it.
    pub id: String,
    /// Its name.
    pub name: String,
    /// OpenDRIVE's type, e.g. `pole`, `building`, `tree`, `barrier`, `parkingSpace`.
    pub kind: String,
    /// Pose of the middle of its foot: x along its length, y along its width, z off the road.
    pub pose: Isometry3<f64>,
    /// Extent along x, metres; 0 if not stated.
    pub length_m: f64,
    /// Extent along y, metres; 0 if not stated.
    pub width_m: f64,
    /// Height, metres; 0 if not stated.
    pub height_m: f64,
    /// Radius of a round one, metres; 0 if it is not round.
    pub radius_m: f64,
    /// Corners of its outline; empty without an outline.
    pub outline: Vec<OutlineCorner>,
    /// Number of the road that the file lists it with.
    pub road: u32,
}

/// A corner of an object's outline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutlineCorner {
    /// Where it is, world, metres.
    pub point_m: [f64; 3],
    /// Height of the object over it, metres.
    pub height_m: f64,
}

/// A crosswalk's outline in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Crosswalk {
    /// OpenDRIVE id of the object.
    pub id: String,
    /// Corners in order, metres; not closed.
    pub corners: Vec<[f64; 3]>,
}

pub(crate) fn object(map: &RawMap, raw: &RawObject) -> RoadObject {
    let road = &map.roads[raw.road];
    let station = road.station(raw.s_m);
    let local = Isometry3::from_parts(
        Vector3::new(0.0, 0.0, raw.z_offset_m).into(),
        UnitQuaternion::from_euler_angles(0.0, 0.0, raw.heading_rad),
    );
    let pose = station.pose(raw.t_m, 0.0, (0.0, 0.0)) * local;
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

pub(crate) fn crosswalk(map: &RawMap, raw: &RawCrosswalk) -> Crosswalk {
    let road = &map.roads[raw.road];
    let station = road.station(raw.s_m);
    let pose = station.pose(raw.t_m, 0.0, (0.0, 0.0))
        * Isometry3::from_parts(
            Vector3::new(0.0, 0.0, raw.z_offset_m).into(),
            UnitQuaternion::from_euler_angles(0.0, 0.0, raw.heading_rad),
        );
    let corners = raw
        .corners
        .iter()
        .map(|corner| world_corner(road, &pose, corner, 0.0).point_m)
        .collect();
    Crosswalk {
        id: raw.id.clone(),
        corners,
    }
}

/// A corner in the world, and the height of its object there; `height_m` if the corner states none.
fn world_corner(
    road: &Road,
    pose: &Isometry3<f64>,
    corner: &Corner,
    height_m: f64,
) -> OutlineCorner {
    let (point_m, own_m) = match *corner {
        Corner::Local {
            u_m,
            v_m,
            z_m,
            height_m,
        } => ((pose * Point3::new(u_m, v_m, z_m)).coords.into(), height_m),
        Corner::Road {
            s_m,
            t_m,
            dz_m,
            height_m,
        } => (road.station(s_m).point(t_m, dz_m), height_m),
    };
    OutlineCorner {
        point_m,
        height_m: if own_m > 0.0 { own_m } else { height_m },
    }
}
