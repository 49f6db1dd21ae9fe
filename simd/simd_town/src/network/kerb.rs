//! The kerb round a junction's corners: rounded where that stays clear of the lanes, otherwise
//! along the outermost connecting lane.

use std::f64::consts::PI;

use super::model::{Arm, CLEAR_M, CORNER_RADIUS_M, Link, Network};
use crate::geometry::{P2, Path, left, unit, wrap};
use crate::plan::Profile;

/// Points of a corner's arc.
const ARC_STEPS: usize = 7;
/// Longest chord of a kerb along a lane.
const CHORD_M: f64 = 6.0;

/// The kerb from the left side of one arm round the corner to the right side of the next, and the
/// pavement's back likewise.
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
    let next = (i + 1) % arms.len();
    let rounded = rounded(network, &arms[i], &arms[next]);
    let links = || {
        network
            .links
            .iter()
            .filter(|link| link.junction == junction)
    };
    // In a junction where a carriageway only gains or loses a lane, the edges follow the lanes.
    let is_taper = arms.len() == 2;
    if !is_taper && links().all(|link| link.clearance_m(&rounded.kerb_m) >= CLEAR_M) {
        return rounded;
    }
    let profile = |arm: usize| &network.roads[arms[arm].road].profile;
    let lane = |end: (usize, i32), arm: usize, lane: usize| {
        end.0 == arm && end.1.unsigned_abs() as usize == lane
    };
    let right = || {
        links().find(|link| {
            lane(link.from, i, profile(i).n_lanes) && lane(link.to, next, profile(next).n_lanes)
        })
    };
    // The left side of one-way roads whose directions agree.
    let one_way = profile(i).one_way
        && profile(next).one_way
        && wrap(arms[i].heading_rad - arms[next].heading_rad - PI).abs() < 1.2;
    let left = || links().find(|link| one_way && lane(link.from, next, 1) && lane(link.to, i, 1));
    if let Some(link) = right() {
        return along(link, [profile(i), profile(next)], Side::Right);
    }
    if let Some(link) = left() {
        return along(link, [profile(next), profile(i)], Side::Left);
    }
    let mut moved = rounded;
    let inner = 1..moved.kerb_m.len() - 1;
    for link in links() {
        moved.kerb_m[inner.clone()]
            .iter_mut()
            .for_each(|p| *p = link.moved_off(*p));
    }
    moved
}

/// Kerb and back each as a line, an arc and a line.
fn rounded(network: &Network, a: &Arm, b: &Arm) -> Corner {
    let curve = |offset: fn(&Profile) -> f64, radius: f64| {
        let ((pa, ha), (pb, hb)) = (network.arm_end(a), network.arm_end(b));
        let from = pa + left(unit(ha)) * offset(&network.roads[a.road].profile);
        let to = pb - left(unit(hb)) * offset(&network.roads[b.road].profile);
        corner_points(&Path::corner((from, ha + PI), (to, hb), radius))
    };
    let pavement = |arm: &Arm| network.roads[arm.road].profile.pavement_m;
    let inner = (CORNER_RADIUS_M - pavement(a).max(pavement(b))).max(1.0);
    Corner {
        kerb_m: curve(|p| p.kerb_m(), CORNER_RADIUS_M),
        back_m: curve(|p| p.back_m(), inner),
    }
}

/// Points along the corner, always the same number; where there is an arc, its points.
fn corner_points(path: &Path) -> Vec<P2> {
    let length = path.length_m();
    let arcs: Vec<usize> = (0..path.segments.len())
        .filter(|&i| path.segments[i].curvature_per_m != 0.0)
        .collect();
    let n = ARC_STEPS + 3;
    if let [arc] = arcs[..] {
        let arc = &path.segments[arc];
        let mut points = vec![path.at(0.0).0];
        points
            .extend((0..=ARC_STEPS).map(|k| arc.at(arc.length_m * k as f64 / ARC_STEPS as f64).0));
        points.push(path.at(length).0);
        return points;
    }
    (0..n)
        .map(|k| path.at(length * k as f64 / (n - 1) as f64).0)
        .collect()
}

/// Side of a lane as its drivers see it.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    Left,
    Right,
}

/// Beside a lane that leads round the corner: the strip beside it and the pavement change from one
/// road's widths to the other's.
fn along(link: &Link, [from, to]: [&Profile; 2], side: Side) -> Corner {
    let aside = |s_m: f64, width: fn(&Profile) -> f64| {
        let (a, b) = (width(from), width(to));
        let beside = a + (b - a) * link.share_at(s_m);
        link.path.beside(
            s_m,
            if side == Side::Left {
                beside
            } else {
                -(link.width_at(s_m) + beside)
            },
        )
    };
    let mut stations = link.path.stations(CHORD_M);
    if side == Side::Left {
        stations.reverse();
    }
    Corner {
        kerb_m: stations
            .iter()
            .map(|&s| aside(s, |profile| profile.edge_m))
            .collect(),
        back_m: stations
            .iter()
            .map(|&s| aside(s, |profile| profile.edge_m + profile.pavement_m))
            .collect(),
    }
}

/// The edge of a junction's surface, counter-clockwise.
pub fn border(network: &Network, junction: usize) -> Vec<P2> {
    let arms = 0..network.junctions[junction].arms.len();
    let mut border: Vec<P2> = arms
        .flat_map(|i| corner(network, junction, i).kerb_m)
        .collect();
    border.dedup_by(|a, b| (*a - *b).norm() < 1e-6);
    border
}
