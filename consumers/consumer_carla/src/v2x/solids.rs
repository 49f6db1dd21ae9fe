//! What stands between two antennas: boxes of buildings, walls and vehicles.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::v2x::radio::Path;

/// A box in world space.
#[derive(Clone, Debug)]
pub struct Solid {
    /// The actor, if the box is a vehicle's.
    pub vehicle: Option<u32>,
    /// Pose of its centre.
    pub pose: Isometry3<f64>,
    /// Half extents, metres.
    pub half_m: [f64; 3],
}

impl Solid {
    /// Where the line from `a` to `b` enters and leaves the box, as shares of its length.
    fn crossed(&self, a: &Point3<f64>, b: &Point3<f64>) -> Option<[f64; 2]> {
        let (from, to) = (self.pose.inverse() * a, self.pose.inverse() * b);
        let (mut enters, mut leaves) = (0.0f64, 1.0f64);
        for i in 0..3 {
            let (start, way) = (from[i], to[i] - from[i]);
            if way.abs() < 1e-12 {
                if start.abs() > self.half_m[i] {
                    return None;
                }
                continue;
            }
            let (first, second) = (
                (-self.half_m[i] - start) / way,
                (self.half_m[i] - start) / way,
            );
            enters = enters.max(first.min(second));
            leaves = leaves.min(first.max(second));
        }
        (enters < leaves).then_some([enters, leaves])
    }

    /// Height of its highest point.
    fn top_m(&self) -> f64 {
        let up = |axis: Vector3<f64>, half_m: f64| (self.pose.rotation * axis).z.abs() * half_m;
        self.pose.translation.z
            + up(Vector3::x(), self.half_m[0])
            + up(Vector3::y(), self.half_m[1])
            + up(Vector3::z(), self.half_m[2])
    }
}

/// What stands on the straight line between two antennas, not counting the vehicles that carry
/// them.
pub fn path(solids: &[Solid], from: &Point3<f64>, to: &Point3<f64>, carriers: [u32; 2]) -> Path {
    let distance_m = (to - from).norm();
    let mut edges = Vec::new();
    for solid in solids
        .iter()
        .filter(|solid| solid.vehicle.is_none_or(|id| !carriers.contains(&id)))
    {
        let Some([enters, leaves]) = solid.crossed(from, to) else {
            continue;
        };
        if solid.vehicle.is_none() {
            return Path::BehindBuilding;
        }
        let at = 0.5 * (enters + leaves);
        let line_m = from.z + at * (to.z - from.z);
        edges.push([
            at * distance_m,
            (1.0 - at) * distance_m,
            solid.top_m() - line_m,
        ]);
    }
    if edges.is_empty() {
        Path::Free
    } else {
        Path::BehindVehicles(edges)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(vehicle: Option<u32>, x_m: f64, yaw_rad: f64) -> Solid {
        Solid {
            vehicle,
            pose: Isometry3::new(Vector3::new(x_m, 0.0, 1.0), Vector3::z() * yaw_rad),
            half_m: [2.0, 1.0, 1.0],
        }
    }

    #[test]
    fn lines_meet_what_lies_on_them() {
        let (a, b) = (Point3::new(0.0, 0.0, 1.5), Point3::new(100.0, 0.0, 1.5));
        assert_eq!(path(&[], &a, &b, [1, 2]), Path::Free);
        assert_eq!(
            path(
                &[block(Some(1), 0.0, 0.0), block(Some(2), 100.0, 0.0)],
                &a,
                &b,
                [1, 2]
            ),
            Path::Free
        );
        assert_eq!(
            path(&[block(None, 30.0, 0.7)], &a, &b, [1, 2]),
            Path::BehindBuilding
        );
        let Path::BehindVehicles(edges) = path(&[block(Some(3), 30.0, 0.0)], &a, &b, [1, 2]) else {
            panic!()
        };
        assert!(
            (edges[0][0] - 30.0).abs() < 1e-9
                && (edges[0][1] - 70.0).abs() < 1e-9
                && (edges[0][2] - 0.5).abs() < 1e-9,
            "{edges:?}"
        );
        let above = Point3::new(100.0, 0.0, 30.0);
        assert_eq!(
            path(&[block(Some(3), 70.0, 0.0)], &a, &above, [1, 2]),
            Path::Free
        );
        let aside = Point3::new(100.0, 40.0, 1.5);
        assert_eq!(
            path(&[block(None, 30.0, 0.0)], &a, &aside, [1, 2]),
            Path::Free
        );
    }
}
