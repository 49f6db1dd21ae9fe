//! Closed lines round every block: the kerb and the back of the pavement.

use std::f64::consts::PI;

use crate::geometry::{P2, Path, cross, left, unit};
use crate::network::{Arm, CORNER_RADIUS_M, Network};

/// Points of a corner's arc.
const ARC_STEPS: usize = 7;

/// The border of a block, walked with the block on the left. `kerb_m[i]` lies opposite `back_m[i]`.
#[derive(Clone, Debug)]
pub struct Ring {
    /// Along the kerb.
    pub kerb_m: Vec<P2>,
    /// Along the back of the pavement.
    pub back_m: Vec<P2>,
    /// Height of the street there.
    pub height_m: Vec<f64>,
    /// Grass beside the road instead of a pavement.
    pub verge: Vec<bool>,
    /// Outside of the town: the block is the rest of the world.
    pub outside: bool,
}

/// The kerb from the left side of one arm round the corner to the right side of the next, and the pavement's back likewise.
#[derive(Clone, Debug)]
pub struct Corner {
    /// Along the kerb.
    pub kerb_m: Vec<P2>,
    /// Along the back of the pavement.
    pub back_m: Vec<P2>,
}

/// The corner behind arm `i` of a junction, counter-clockwise.
pub fn corner(network: &Network, junction: usize, i: usize) -> Corner {
    let arms = &network.junctions[junction].arms;
    let (a, b) = (&arms[i], &arms[(i + 1) % arms.len()]);
    let curve = |offset: fn(&crate::plan::Profile) -> f64, radius: f64| {
        let ((pa, ha), (pb, hb)) = (network.arm_end(a), network.arm_end(b));
        let from = pa + left(unit(ha)) * offset(&network.roads[a.road].profile);
        let to = pb - left(unit(hb)) * offset(&network.roads[b.road].profile);
        corner_points(&Path::corner((from, ha + PI), (to, hb), radius))
    };
    let pavement = |arm: &Arm| network.roads[arm.road].profile.pavement_m;
    let inner = (CORNER_RADIUS_M - pavement(a).max(pavement(b))).max(1.0);
    Corner { kerb_m: curve(|p| p.kerb_m(), CORNER_RADIUS_M), back_m: curve(|p| p.back_m(), inner) }
}

/// Always the same number of points, those of the arc where there is one.
fn corner_points(path: &Path) -> Vec<P2> {
    let length = path.length_m();
    let arcs: Vec<usize> = (0..path.segments.len()).filter(|&i| path.segments[i].curvature_per_m != 0.0).collect();
    let n = ARC_STEPS + 3;
    if let [arc] = arcs[..] {
        let arc = &path.segments[arc];
        let mut points = vec![path.at(0.0).0];
        points.extend((0..=ARC_STEPS).map(|k| arc.at(arc.length_m * k as f64 / ARC_STEPS as f64).0));
        points.push(path.at(length).0);
        return points;
    }
    (0..n).map(|k| path.at(length * k as f64 / (n - 1) as f64).0).collect()
}

/// Every block's ring, and the one round the town.
pub fn rings(network: &Network) -> Vec<Ring> {
    let mut seen: Vec<Vec<bool>> = network.junctions.iter().map(|j| vec![false; j.arms.len()]).collect();
    let mut rings = Vec::new();
    for start in 0..network.junctions.len() {
        for first in 0..network.junctions[start].arms.len() {
            if seen[start][first] {
                continue;
            }
            let mut ring = Ring { kerb_m: Vec::new(), back_m: Vec::new(), height_m: Vec::new(), verge: Vec::new(), outside: false };
            let (mut junction, mut arm) = (start, first);
            while !seen[junction][arm] {
                seen[junction][arm] = true;
                (junction, arm) = walk(network, junction, arm, &mut ring);
            }
            ring.outside = area(&ring.kerb_m) < 0.0;
            rings.push(ring);
        }
    }
    rings
}

/// Along the left side of a road to its other end and round the corner there; gives the next arm.
fn walk(network: &Network, junction: usize, arm_idx: usize, ring: &mut Ring) -> (usize, usize) {
    let arm = &network.junctions[junction].arms[arm_idx];
    let road = &network.roads[arm.road];
    let mut stations = road.stations();
    let sign = if arm.at_start { 1.0 } else { -1.0 };
    if !arm.at_start {
        stations.reverse();
    }
    ring.kerb_m.extend(stations.iter().map(|&s| road.path.beside(s, sign * road.profile.kerb_m())));
    ring.back_m.extend(stations.iter().map(|&s| road.path.beside(s, sign * road.profile.back_m())));
    ring.height_m.extend(stations.iter().map(|&s| road.elevation.at(s)));
    ring.verge.extend(stations.iter().map(|_| road.profile.verge));
    let there = road.ends[usize::from(arm.at_start)];
    let arms = &network.junctions[there].arms;
    let arrived = arms.iter().position(|a| a.road == arm.road && a.at_start != arm.at_start).expect("a road ends at the junction it names");
    let next = (arrived + arms.len() - 1) % arms.len();
    let corner = corner(network, there, next);
    let n = corner.kerb_m.len();
    // The ends of the corner are the ends of the roads.
    ring.kerb_m.extend(corner.kerb_m[1..n - 1].iter().rev());
    ring.back_m.extend(corner.back_m[1..n - 1].iter().rev());
    ring.height_m.extend(std::iter::repeat_n(network.junctions[there].height_m, n - 2));
    let verge = road.profile.verge && network.roads[arms[next].road].profile.verge;
    ring.verge.extend(std::iter::repeat_n(verge, n - 2));
    (there, next)
}

/// Signed area, counter-clockwise positive.
pub fn area(polygon: &[P2]) -> f64 {
    (0..polygon.len()).map(|i| 0.5 * cross(polygon[i], polygon[(i + 1) % polygon.len()])).sum()
}

/// Whether a point lies inside.
pub fn contains(polygon: &[P2], p: P2) -> bool {
    let mut inside = false;
    for i in 0..polygon.len() {
        let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
        if (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x) {
            inside = !inside;
        }
    }
    inside
}

/// Cuts a simple polygon (counter-clockwise) into triangles.
pub fn triangulate(polygon: &[P2]) -> Vec<[usize; 3]> {
    let mut left: Vec<usize> = (0..polygon.len()).filter(|&i| (polygon[i] - polygon[(i + 1) % polygon.len()]).norm() > 1e-6).collect();
    let mut triangles = Vec::new();
    while left.len() > 3 {
        let n = left.len();
        let corner = |k: usize| [left[(k + n - 1) % n], left[k], left[(k + 1) % n]];
        let is_ear = |k: usize| {
            let [a, b, c] = corner(k).map(|i| polygon[i]);
            let turn = |p: P2, q: P2, r: P2| cross(q - p, r - p);
            turn(a, b, c) > 1e-9
                && !left.iter().any(|&i| {
                    let p = polygon[i];
                    !corner(k).contains(&i) && turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0
                })
        };
        // A straight corner is dropped: it adds no area.
        let flat = |k: usize| {
            let [a, b, c] = corner(k).map(|i| polygon[i]);
            cross(b - a, c - a).abs() <= 1e-9
        };
        let quality = |k: usize| {
            let [a, b, c] = corner(k).map(|i| polygon[i]);
            cross(b - a, c - a) / ((c - a).norm_squared() + (b - a).norm_squared() + (c - b).norm_squared())
        };
        let Some(k) =
            (0..n).filter(|&k| is_ear(k)).max_by(|&a, &b| quality(a).total_cmp(&quality(b))).or_else(|| (0..n).find(|&k| flat(k)))
        else {
            break;
        };
        if !flat(k) {
            triangles.push(corner(k));
        }
        left.remove(k);
    }
    if let [a, b, c] = left[..] {
        triangles.push([a, b, c]);
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::town::plans;

    #[test]
    fn triangles_cover_a_polygon_exactly() {
        let polygon = [(0.0, 0.0), (4.0, 0.0), (8.0, 0.0), (8.0, 6.0), (5.0, 6.0), (5.0, 2.0), (2.0, 2.0), (2.0, 6.0), (0.0, 6.0)]
            .map(|(x, y)| P2::new(x, y));
        let sum: f64 = triangulate(&polygon).iter().map(|t| area(&t.map(|i| polygon[i]))).sum();
        assert!((sum - area(&polygon)).abs() < 1e-9);
    }

    #[test]
    fn pavements_never_fold_over() {
        for plan in (0..10).flat_map(plans) {
            let network = Network::build(&plan);
            let rings = rings(&network);
            assert_eq!(rings.iter().filter(|ring| ring.outside).count(), 1);
            for ring in &rings {
                let n = ring.kerb_m.len();
                assert_eq!(n, ring.back_m.len());
                for i in 0..n {
                    let k = (i + 1) % n;
                    let quad = [ring.kerb_m[i], ring.kerb_m[k], ring.back_m[k], ring.back_m[i]];
                    assert!(area(&quad) > -0.02, "{}: {quad:?} has area {}", plan.name, area(&quad));
                }
            }
        }
    }
}
