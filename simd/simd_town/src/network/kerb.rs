//! The kerb round a junction's corners: rounded where that leaves the lanes alone, else along the
//! outermost connecting lane.

use std::f64::consts::PI;

use crate::geometry::{P2, Path, cross, left, unit, wrap};
use crate::network::{Arm, CORNER_RADIUS_M, Link, Network};
use crate::plan::Profile;

/// Points of a corner's arc.
const ARC_STEPS: usize = 7;
/// Least distance of a kerb from the lanes that lead through its junction.
pub const CLEAR_M: f64 = 0.3;
/// Between the places of a kerb where its distance from lanes is looked at.
const PROBE_M: f64 = 0.5;
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
    // Where a carriageway only gains or loses a lane, its edges follow the lanes.
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
    // The left of one-way roads, where they do not turn back.
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

/// Always the same number of points, those of the arc where there is one.
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

/// Of a lane, as its drivers see it.
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

impl Link {
    /// How much of the change from one end to the other is done at a station: level at both ends,
    /// as the lane's width in OpenDRIVE.
    fn share_at(&self, s_m: f64) -> f64 {
        let u = (s_m / self.path.length_m()).clamp(0.0, 1.0);
        u * u * (3.0 - 2.0 * u)
    }

    /// Width of the lane at a station.
    pub fn width_at(&self, s_m: f64) -> f64 {
        self.width_m.0 + (self.width_m.1 - self.width_m.0) * self.share_at(s_m)
    }

    /// Least distance of a line from the lane; negative where the line enters it.
    pub fn clearance_m(&self, line_m: &[P2]) -> f64 {
        let probes = line_m.windows(2).flat_map(|pair| {
            let n = ((pair[1] - pair[0]).norm() / PROBE_M).ceil().max(1.0) as usize;
            (0..=n).map(move |k| pair[0] + (pair[1] - pair[0]) * (k as f64 / n as f64))
        });
        probes.map(|p| self.away_m(p)).fold(f64::INFINITY, f64::min)
    }

    /// The nearest place that is clear of the lane.
    fn moved_off(&self, p: P2) -> P2 {
        if self.away_m(p) >= CLEAR_M {
            return p;
        }
        let (s, _) = self.path.nearest(p);
        let (q, heading) = self.path.at(s);
        let (rightward, width) = (cross(p - q, unit(heading)), self.width_at(s));
        let wanted = if rightward < 0.5 * width {
            -CLEAR_M
        } else {
            width + CLEAR_M
        };
        p - left(unit(heading)) * (wanted - rightward)
    }

    /// Distance of a point from the lane, negative inside it.
    fn away_m(&self, p: P2) -> f64 {
        let (s, _) = self.path.nearest(p);
        let (q, heading) = self.path.at(s);
        let (forward, rightward) = (
            (p - q).dot(&unit(heading)).abs(),
            cross(p - q, unit(heading)),
        );
        let aside = (rightward - self.width_at(s)).max(-rightward);
        // Before its start or behind its end.
        if forward > 1e-3 {
            aside.max(0.0).hypot(forward)
        } else {
            aside
        }
    }
}
