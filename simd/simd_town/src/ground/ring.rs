//! Closed lines round every block: the kerb and the back of the pavement.

use super::fill::{Border, Fill, Pond};
use crate::geometry::{P2, area, contains};
use crate::network::kerb::corner;
use crate::network::{CROSSWALK_M, KERB_HEIGHT_M, Network, Road};
use crate::plan::Plan;

/// The border of a block, walked with the block on the left. `kerb_m[i]` lies opposite `back_m[i]`.
#[derive(Clone, Debug, Default)]
pub struct Ring {
    /// Along the kerb.
    pub kerb_m: Vec<P2>,
    /// Along the back of the pavement.
    pub back_m: Vec<P2>,
    /// Height of the street there.
    pub height_m: Vec<f64>,
    /// Rise of the kerb over the street.
    pub rise_m: Vec<f64>,
    /// Grass beside the road instead of a pavement.
    pub verge: Vec<bool>,
    /// Between this point and the next a road goes on as a bridge, so there is neither kerb nor
    /// pavement.
    pub seam: Vec<bool>,
    /// Houses may stand here.
    pub fronted: Vec<bool>,
    /// Ground inside (outside) of the pavement's back.
    pub ground: Fill,
    /// Ponds in it.
    pub ponds: Vec<Pond>,
    /// Whether the block is everything outside the town.
    pub outside: bool,
}

/// The rings of all blocks, and the one round the town.
pub fn rings(network: &Network, plan: &Plan) -> Vec<Ring> {
    let mut seen: Vec<Vec<bool>> = network
        .junctions
        .iter()
        .map(|j| vec![false; j.arms.len()])
        .collect();
    let mut rings = Vec::new();
    for start in 0..network.junctions.len() {
        for first in 0..network.junctions[start].arms.len() {
            if seen[start][first] {
                continue;
            }
            let mut ring = Ring::default();
            let (mut junction, mut arm) = (start, first);
            while !seen[junction][arm] {
                seen[junction][arm] = true;
                (junction, arm) = walk(network, junction, arm, &mut ring);
            }
            ring.outside = area(&ring.kerb_m) < 0.0;
            rings.push(ring);
        }
    }
    let is_rough = !network.is_level() || plan.hills_m > 0.0;
    for ring in &mut rings {
        ring.fill(plan, is_rough);
    }
    rings
}

/// How far the ground goes on under a deck, and how much lower it lies there.
pub const ABUTMENT_M: (f64, f64) = (0.4, 2.2);
/// Rise of the kerb over the road.
const KERB_RISE_M: f64 = KERB_HEIGHT_M;
/// Rise of the kerb where a crosswalk begins.
const LOWERED_M: f64 = 0.02;
/// Length of the slope between the two heights.
const SLOPE_M: f64 = 0.5;

impl Ring {
    fn point(&mut self, road: &Road, s_m: f64, left: f64, drop_m: f64, rise_m: f64) {
        self.kerb_m
            .push(road.path.beside(s_m, left * road.profile.kerb_m()));
        self.back_m
            .push(road.path.beside(s_m, left * road.profile.back_m()));
        self.height_m.push(road.elevation.at(s_m) - drop_m);
        self.rise_m.push(rise_m);
        self.verge.push(road.profile.verge);
        self.seam.push(false);
        self.fronted
            .push(!road.profile.one_way && road.profile.speed_kmh < 80 && !road.tunnel);
    }

    /// Adds the points along one side of a road, in the order of the stations.
    fn side(&mut self, network: &Network, road: &Road, stations: &[f64], left: f64) {
        for &s in stations {
            self.point(road, s, left, 0.0, kerb_rise(network, road, s));
        }
    }

    fn fill(&mut self, plan: &Plan, is_rough: bool) {
        let border = Border {
            points_m: &self.back_m,
            heights_m: &self.height_m,
            outside: self.outside,
        };
        let level = self
            .height_m
            .iter()
            .all(|h| (h - self.height_m[0]).abs() < 1e-9);
        for &(middle_m, radius_m) in plan
            .ponds_m
            .iter()
            .filter(|pond| contains(&self.back_m, pond.0) != self.outside)
        {
            let lowest = (self.back_m.iter().zip(&self.height_m))
                .filter(|(p, _)| (*p - middle_m).norm() < radius_m + 60.0)
                .map(|(_, h)| *h)
                .fold(f64::INFINITY, f64::min);
            self.ponds.push(Pond {
                middle_m,
                radius_m,
                level_m: if lowest.is_finite() {
                    lowest
                } else {
                    self.height_m[0]
                } - 0.9,
            });
        }
        let rough = if self.outside {
            is_rough
        } else {
            !level || !self.ponds.is_empty()
        };
        self.ground = Fill::of(&border, rough, plan.hills_m, &self.ponds);
    }
}

/// Rise of the kerb over the road at a station: low where a crosswalk meets it.
pub fn kerb_rise(network: &Network, road: &Road, s_m: f64) -> f64 {
    let idx = road.id as usize - 1;
    let rise = |end: usize| {
        let arms = &network.junctions[road.ends[end]].arms;
        let crossed = arms
            .iter()
            .any(|arm| arm.road == idx && arm.at_start == (end == 0) && arm.crosswalk);
        let away = if end == 0 {
            s_m
        } else {
            road.path.length_m() - s_m
        };
        let beside = (CROSSWALK_M.0 - away).max(away - CROSSWALK_M.1);
        if crossed {
            LOWERED_M + (KERB_RISE_M - LOWERED_M) * (beside / SLOPE_M).clamp(0.0, 1.0)
        } else {
            KERB_RISE_M
        }
    };
    rise(0).min(rise(1))
}

/// Stations of a kerb: those of the road, and where kerbs sink to crosswalks.
fn kerb_stations(network: &Network, road: &Road, from_m: f64, to_m: f64) -> Vec<f64> {
    let mut stations = road.stations_between(from_m, to_m);
    let length = road.path.length_m();
    let knots = [
        CROSSWALK_M.0 - SLOPE_M,
        CROSSWALK_M.0,
        CROSSWALK_M.1,
        CROSSWALK_M.1 + SLOPE_M,
    ];
    for s in knots
        .into_iter()
        .flat_map(|k| [k, length - k])
        .filter(|&s| s > from_m + 0.05 && s < to_m - 0.05)
    {
        let sunk = kerb_rise(network, road, s) < KERB_RISE_M
            || kerb_rise(network, road, s + 0.1) < KERB_RISE_M
            || kerb_rise(network, road, s - 0.1) < KERB_RISE_M;
        if sunk && stations.iter().all(|other| (other - s).abs() > 0.05) {
            stations.push(s);
        }
    }
    stations.sort_by(f64::total_cmp);
    stations
}

/// Walks along the left side of a road to its other end and round the corner there; returns the
/// next arm. If the road goes onto a bridge, the walk turns round at the abutment and comes back
/// along the right side.
fn walk(network: &Network, junction: usize, arm_idx: usize, ring: &mut Ring) -> (usize, usize) {
    let arm = &network.junctions[junction].arms[arm_idx];
    let road = &network.roads[arm.road];
    let length = road.path.length_m();
    let sign = if arm.at_start { 1.0 } else { -1.0 };
    let ordered = |from: f64, to: f64, forwards: bool| {
        let mut stations = kerb_stations(network, road, from, to);
        if !forwards {
            stations.reverse();
        }
        stations
    };
    let Some((from, to)) = road.bridge else {
        ring.side(network, road, &ordered(0.0, length, arm.at_start), sign);
        let there = road.ends[usize::from(arm.at_start)];
        let arms = &network.junctions[there].arms;
        let arrived = arms
            .iter()
            .position(|a| a.road == arm.road && a.at_start != arm.at_start)
            .expect("a road ends at the junction it names");
        return round_corner(network, road, there, arrived, ring);
    };
    let (near, far, tip) = if arm.at_start {
        (0.0, from, from + ABUTMENT_M.0)
    } else {
        (to, length, to - ABUTMENT_M.0)
    };
    ring.side(network, road, &ordered(near, far, arm.at_start), sign);
    ring.point(road, tip, sign, ABUTMENT_M.1, KERB_RISE_M);
    *ring.seam.last_mut().expect("a point was pushed") = true;
    ring.point(road, tip, -sign, ABUTMENT_M.1, KERB_RISE_M);
    ring.side(network, road, &ordered(near, far, !arm.at_start), -sign);
    let n = ring.fronted.len();
    ring.fronted[n - 2 - 2 * ordered(near, far, true).len()..].fill(false);
    round_corner(network, road, junction, arm_idx, ring)
}

/// Walks round the corner from the arm on which the walk arrives to the next arm.
fn round_corner(
    network: &Network,
    road: &Road,
    junction: usize,
    arrived: usize,
    ring: &mut Ring,
) -> (usize, usize) {
    let arms = &network.junctions[junction].arms;
    let next = (arrived + arms.len() - 1) % arms.len();
    let corner = corner(network, junction, next);
    let n = corner.kerb_m.len();
    // The corner's first and last points are left out: they are the ends of the roads.
    ring.kerb_m.extend(corner.kerb_m[1..n - 1].iter().rev());
    ring.back_m.extend(corner.back_m[1..n - 1].iter().rev());
    ring.height_m.extend(std::iter::repeat_n(
        network.junctions[junction].height_m,
        n - 2,
    ));
    ring.rise_m.extend(std::iter::repeat_n(KERB_RISE_M, n - 2));
    let verge = road.profile.verge && network.roads[arms[next].road].profile.verge;
    ring.verge.extend(std::iter::repeat_n(verge, n - 2));
    ring.seam.extend(std::iter::repeat_n(false, n - 2));
    ring.fronted.extend(std::iter::repeat_n(!verge, n - 2));
    (junction, next)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::plans;

    #[test]
    fn pavements_never_fold_over() {
        for plan in (0..10).flat_map(plans) {
            let network = Network::build(&plan);
            let rings = rings(&network, &plan);
            assert_eq!(rings.iter().filter(|ring| ring.outside).count(), 1);
            for ring in &rings {
                let n = ring.kerb_m.len();
                assert_eq!(n, ring.back_m.len());
                for i in 0..n {
                    let k = (i + 1) % n;
                    if ring.seam[i] {
                        continue;
                    }
                    let quad = [
                        ring.kerb_m[i],
                        ring.kerb_m[k],
                        ring.back_m[k],
                        ring.back_m[i],
                    ];
                    assert!(
                        area(&quad) > -0.02,
                        "{}: {quad:?} has area {}",
                        plan.name,
                        area(&quad)
                    );
                }
            }
        }
    }
}
