//! Where vehicles may be put.

use schema_types::Pose;

use super::model::Network;
use crate::geometry::wrap;

/// Distance between spawn points of one lane: more than the longest vehicle.
const SPACING_M: f64 = 16.0;
/// Distance of spawn points from the junction ahead and from the junction behind.
const MARGINS_M: (f64, f64) = (13.5, 6.0);

/// Spawn points on driving lanes between junctions, x along the lane, 0.3 m above the road.
pub fn spawn_points(network: &Network) -> Vec<Pose> {
    let mut points = Vec::new();
    for road in &network.roads {
        let length = road.path.length_m();
        for lane in 0..road.profile.n_lanes {
            for against in [false, true]
                .into_iter()
                .filter(|&against| !(against && road.profile.one_way))
            {
                let room = length - MARGINS_M.0 - MARGINS_M.1;
                if room < 0.0 {
                    continue;
                }
                for k in 0..=(room / SPACING_M) as usize {
                    let along = MARGINS_M.1 + k as f64 * SPACING_M;
                    let s = if against { length - along } else { along };
                    let aside = road.profile.lane_left_m(lane) + 0.5 * road.profile.lane_m;
                    let p = road.path.beside(s, if against { aside } else { -aside });
                    let heading =
                        road.path.at(s).1 + if against { std::f64::consts::PI } else { 0.0 };
                    points.push(Pose::from_xyz_yaw(
                        p.x,
                        p.y,
                        road.elevation.at(s) + 0.3,
                        wrap(heading),
                    ));
                }
            }
        }
    }
    points
}
