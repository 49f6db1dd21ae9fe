//! Outlines of what can be walked on.

use std::collections::BTreeMap;

use super::mesh::{Ground, turn};
use crate::lane::{Lane, LaneKind};
use crate::map::RoadMap;

/// Distance that pavements of the mesh keep from the pavement's edges, metres; narrow pavements
/// keep a quarter of their width.
pub const CLEAR_M: f64 = 0.35;

/// Samples along lanes, metres.
const STEP_M: f64 = 1.0;
/// Points nearer than this to the line between their neighbours are left out, metres.
const TOLERANCE_M: f64 = 0.03;
/// How far a crosswalk reaches onto a pavement, metres.
const REACH_M: f64 = 1.1;
/// Widest gap between two arms of a junction that is bridged, metres.
const MAX_GAP_M: f64 = 60.0;
/// Pieces of a curve round a corner.
const CURVE_PIECES: usize = 8;

type Point = [f64; 3];

/// A closed outline and the ground in it.
#[derive(Clone, Debug)]
pub struct Outline {
    /// Corners in order, not closed.
    pub corners_m: Vec<Point>,
    /// The ground.
    pub ground: Ground,
}

/// An end of a road at a junction, looking away from the junction.
struct Arm {
    /// Pavement on the left and on the right.
    sides: [Option<Edge>; 2],
    middle_m: Point,
}

/// The end of a pavement: its points at the kerb and at the back, inside the clear distance and
/// outside it, and its direction.
#[derive(Clone, Copy)]
struct Edge {
    kerb_m: Point,
    back_m: Point,
    full_kerb_m: Point,
    full_back_m: Point,
    outward: [f64; 2],
}

/// All outlines, pavements first.
pub fn outlines(map: &RoadMap, with_roads: bool) -> Vec<Outline> {
    let walks: Vec<&Lane> = map
        .lanes()
        .iter()
        .filter(|lane| lane.kind == LaneKind::Sidewalk)
        .collect();
    let mut found: Vec<Outline> = Vec::new();
    // Pavements in their full width, to find where crosswalks end.
    let mut full: Vec<Vec<Point>> = Vec::new();
    for lane in &walks {
        let (left, right) = map.boundaries(lane.key, STEP_M);
        let (inner_left, inner_right) = inset(&left, &right);
        found.push(Outline {
            corners_m: ring(&inner_left, &inner_right),
            ground: Ground::Sidewalk,
        });
        full.push(ring(&left, &right));
    }
    let mut junction_rings = Vec::new();
    for arms in junctions(map).into_values() {
        let (corners, rings) = corners(&arms);
        junction_rings.extend(junction_ring(&arms, &corners));
        found.extend(corners.into_iter().flatten().map(|corner| Outline {
            corners_m: corner.ring,
            ground: Ground::Sidewalk,
        }));
        full.extend(rings);
    }
    for walk in map.crosswalks() {
        found.extend(crosswalk(&walk.corners, &full));
    }
    if with_roads {
        found.extend(carriageways(map));
        found.extend(junction_rings.into_iter().map(|corners_m| Outline {
            corners_m,
            ground: Ground::Road,
        }));
    }
    found.retain(|outline| outline.corners_m.len() >= 3);
    found
}

/// Both edges moved towards each other by the clear distance.
fn inset(left: &[Point], right: &[Point]) -> (Vec<Point>, Vec<Point>) {
    let pairs = || left.iter().zip(right);
    let (a, b) = pairs().map(|(l, r)| inset_pair(*l, *r)).unzip();
    (a, b)
}

fn inset_pair(left: Point, right: Point) -> (Point, Point) {
    let width_m = (left[0] - right[0]).hypot(left[1] - right[1]);
    let share = if width_m > 1e-6 {
        CLEAR_M.min(0.25 * width_m) / width_m
    } else {
        0.0
    };
    (mix(left, right, share), mix(right, left, share))
}

fn mix(a: Point, b: Point, share: f64) -> Point {
    std::array::from_fn(|i| a[i] + share * (b[i] - a[i]))
}

/// The left edge forwards and the right edge backwards, without points on straight lines, in either
/// direction of rotation.
fn ring(left: &[Point], right: &[Point]) -> Vec<Point> {
    let mut corners = thinned(left);
    corners.extend(thinned(right).into_iter().rev());
    corners
}

/// Leaves out points that lie on the line between others.
fn thinned(line: &[Point]) -> Vec<Point> {
    let mut keep = vec![false; line.len()];
    let mut open = vec![(0, line.len().saturating_sub(1))];
    while let Some((from, to)) = open.pop() {
        keep[from] = true;
        keep[to] = true;
        let off = |i: usize| {
            let share = (i - from) as f64 / (to - from) as f64;
            let along = mix(line[from], line[to], share);
            let length = (line[to][0] - line[from][0])
                .hypot(line[to][1] - line[from][1])
                .max(1e-9);
            // Heights count a tenth, because walkers find the height of the ground themselves.
            (turn(line[from], line[to], line[i]).abs() / length)
                .max(0.1 * (along[2] - line[i][2]).abs())
        };
        let worst = (from + 1..to).max_by(|a, b| off(*a).total_cmp(&off(*b)));
        if let Some(worst) = worst.filter(|i| off(*i) > TOLERANCE_M) {
            open.extend([(from, worst), (worst, to)]);
        }
    }
    line.iter()
        .zip(keep)
        .filter_map(|(point, keep)| keep.then_some(*point))
        .collect()
}

/// Roads that end at each junction, sorted counter-clockwise round it.
fn junctions(map: &RoadMap) -> BTreeMap<u32, Vec<Arm>> {
    let mut ends: BTreeMap<u32, Vec<(u32, bool)>> = BTreeMap::new();
    for lane in map.lanes() {
        let Some(junction) = lane.junction else {
            continue;
        };
        let before = lane
            .predecessors
            .iter()
            .filter_map(|key| map.lane(*key))
            .map(|from| (from, !from.forward));
        let after = lane
            .successors
            .iter()
            .filter_map(|key| map.lane(*key))
            .map(|to| (to, to.forward));
        for (other, at_start) in before
            .chain(after)
            .filter(|(other, _)| other.junction.is_none())
        {
            ends.entry(junction)
                .or_default()
                .push((other.key.road, at_start));
        }
    }
    let arms = |mut list: Vec<(u32, bool)>| {
        list.sort_unstable();
        list.dedup();
        let mut arms: Vec<Arm> = list
            .into_iter()
            .filter_map(|(road, at_start)| arm(map, road, at_start))
            .collect();
        let n = arms.len().max(1) as f64;
        let centre = arms.iter().fold([0.0; 2], |sum, arm| {
            [sum[0] + arm.middle_m[0] / n, sum[1] + arm.middle_m[1] / n]
        });
        let angle = |arm: &Arm| (arm.middle_m[1] - centre[1]).atan2(arm.middle_m[0] - centre[0]);
        arms.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        arms
    };
    ends.into_iter()
        .map(|(junction, list)| (junction, arms(list)))
        .collect()
}

fn arm(map: &RoadMap, road: u32, at_start: bool) -> Option<Arm> {
    let lanes: Vec<&Lane> = map
        .lanes()
        .iter()
        .filter(|lane| lane.key.road == road)
        .collect();
    let sections = lanes.iter().map(|lane| lane.key.section);
    let section = if at_start {
        sections.min()
    } else {
        sections.max()
    }?;
    let of_section: Vec<&&Lane> = lanes
        .iter()
        .filter(|lane| lane.key.section == section)
        .collect();
    let mut sides = [None, None];
    for lane in of_section
        .iter()
        .filter(|lane| lane.kind == LaneKind::Sidewalk)
    {
        // Looking away from the junction along the road's own direction, positive lanes are on the
        // left.
        let side = usize::from((lane.key.lane > 0) != at_start);
        sides[side] = edge(map, lane, at_start);
    }
    let ends: Vec<Point> = of_section
        .iter()
        .filter(|lane| lane.kind.is_drivable())
        .filter_map(|lane| end_points(map, lane, at_start))
        .map(|(l, r, _)| mix(l, r, 0.5))
        .collect();
    let n = ends.len() as f64;
    (!ends.is_empty()).then(|| Arm {
        sides,
        middle_m: ends.iter().fold([0.0; 3], |sum, p| {
            std::array::from_fn(|i| sum[i] + p[i] / n)
        }),
    })
}

/// Left and right edge (in driving direction) at an end of the road, and the direction away from
/// the end.
fn end_points(map: &RoadMap, lane: &Lane, at_start: bool) -> Option<(Point, Point, [f64; 2])> {
    let (left, right) = map.boundaries(lane.key, STEP_M);
    let first = lane.forward == at_start;
    let n = left.len();
    if n < 2 {
        return None;
    }
    let (end, next) = if first { (0, 1) } else { (n - 1, n - 2) };
    let (a, b) = (
        mix(left[end], right[end], 0.5),
        mix(left[next], right[next], 0.5),
    );
    let length = (b[0] - a[0]).hypot(b[1] - a[1]);
    (length > 1e-6).then(|| {
        (
            left[end],
            right[end],
            [(b[0] - a[0]) / length, (b[1] - a[1]) / length],
        )
    })
}

fn edge(map: &RoadMap, lane: &Lane, at_start: bool) -> Option<Edge> {
    let (left, right, outward) = end_points(map, lane, at_start)?;
    // The kerb is on the side of the road's middle line: for a positive lane on the right, along
    // the road.
    let kerb_is_right = (lane.key.lane > 0) == lane.forward;
    let (kerb, back) = if kerb_is_right {
        (right, left)
    } else {
        (left, right)
    };
    let (kerb_m, back_m) = inset_pair(kerb, back);
    Some(Edge {
        kerb_m,
        back_m,
        full_kerb_m: kerb,
        full_back_m: back,
        outward,
    })
}

/// A pavement round a junction's corner.
struct Corner {
    ring: Vec<Point>,
    /// From this arm's left pavement to the next arm's right one.
    kerb_m: Vec<Point>,
}

/// Per arm the corner between it and the next one, and the corners in their full width.
fn corners(arms: &[Arm]) -> (Vec<Option<Corner>>, Vec<Vec<Point>>) {
    let mut full = Vec::new();
    let corners = (0..arms.len())
        .map(|i| {
            let (from, to) = (arms[i].sides[0]?, arms[(i + 1) % arms.len()].sides[1]?);
            let gap_m = (from.kerb_m[0] - to.kerb_m[0]).hypot(from.kerb_m[1] - to.kerb_m[1]);
            if gap_m > MAX_GAP_M || arms.len() < 2 {
                return None;
            }
            let (kerb_m, back_m) = (
                curve(from.kerb_m, from.outward, to.kerb_m, to.outward),
                curve(from.back_m, from.outward, to.back_m, to.outward),
            );
            let wide = |a, b| curve(a, from.outward, b, to.outward);
            full.push(ring(
                &wide(from.full_kerb_m, to.full_kerb_m),
                &wide(from.full_back_m, to.full_back_m),
            ));
            Some(Corner {
                ring: ring(&kerb_m, &back_m),
                kerb_m,
            })
        })
        .collect();
    (corners, full)
}

/// A smooth curve into a junction at `a` and out of it at `b`, close to an arc if both ends are
/// equally far from the point where their lines meet.
fn curve(a: Point, a_outward: [f64; 2], b: Point, b_outward: [f64; 2]) -> Vec<Point> {
    let chord = [b[0] - a[0], b[1] - a[1]];
    let length = chord[0].hypot(chord[1]);
    let cross = a_outward[0] * b_outward[1] - a_outward[1] * b_outward[0];
    let dot = a_outward[0] * b_outward[0] + a_outward[1] * b_outward[1];
    // Distance from each end, against its outward direction, to the point where the lines meet.
    let mut handles = [length / 3.0; 2];
    if cross.abs() > 0.05 {
        let to_meet = |p: [f64; 2], q: [f64; 2]| {
            (chord[0] * q[1] - chord[1] * q[0]) / (p[0] * q[1] - p[1] * q[0])
        };
        let ways = [
            -to_meet(a_outward, b_outward),
            to_meet(b_outward, a_outward),
        ];
        let bend = std::f64::consts::PI - dot.clamp(-1.0, 1.0).acos();
        let share = 4.0 / 3.0 * (0.25 * bend).tan() / (0.5 * bend).tan().max(1e-6);
        if ways.iter().all(|way| *way > 0.0 && *way < 3.0 * length) {
            handles = ways.map(|way| way * share);
        }
    }
    let p1 = [
        a[0] - a_outward[0] * handles[0],
        a[1] - a_outward[1] * handles[0],
    ];
    let p2 = [
        b[0] - b_outward[0] * handles[1],
        b[1] - b_outward[1] * handles[1],
    ];
    (0..=CURVE_PIECES)
        .map(|i| {
            let t = i as f64 / CURVE_PIECES as f64;
            let s = 1.0 - t;
            let w = [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t];
            let xy = |k: usize| w[0] * a[k] + w[1] * p1[k] + w[2] * p2[k] + w[3] * b[k];
            [xy(0), xy(1), a[2] + t * (b[2] - a[2])]
        })
        .collect()
}

/// The inside of a junction, from kerb line to kerb line; `None` if it has no corner.
fn junction_ring(arms: &[Arm], corners: &[Option<Corner>]) -> Option<Vec<Point>> {
    corners.iter().any(Option::is_some).then(|| {
        let mut ring: Vec<Point> = Vec::new();
        for (arm, corner) in arms.iter().zip(corners) {
            ring.extend(arm.sides[1].map(|side| side.kerb_m));
            match corner {
                Some(corner) => ring.extend(thinned(&corner.kerb_m)),
                None => ring.extend(arm.sides[0].map(|side| side.kerb_m)),
            }
        }
        ring.dedup();
        ring
    })
}

/// A crosswalk, lengthened by [`REACH_M`] over the edges behind which a pavement begins.
fn crosswalk(corners_m: &[Point], pavements: &[Vec<Point>]) -> Vec<Outline> {
    let mut corners = corners_m.to_vec();
    if corners.first() == corners.last() {
        corners.pop();
    }
    let n = corners.len();
    if n < 3 {
        return Vec::new();
    }
    let area: f64 = (1..n - 1)
        .map(|i| turn(corners[0], corners[i], corners[i + 1]))
        .sum();
    if area < 0.0 {
        corners.reverse();
    }
    let mut found = vec![Outline {
        corners_m: corners.clone(),
        ground: Ground::Crosswalk,
    }];
    for i in 0..n {
        let (a, b) = (corners[i], corners[(i + 1) % n]);
        let length = (b[0] - a[0]).hypot(b[1] - a[1]);
        if length < 0.5 {
            continue;
        }
        let outward = [(b[1] - a[1]) / length, -(b[0] - a[0]) / length];
        let moved = |p: Point, by: f64| [p[0] + outward[0] * by, p[1] + outward[1] * by, p[2]];
        let probe = moved(mix(a, b, 0.5), 0.5);
        if pavements.iter().any(|pavement| inside(pavement, probe)) {
            found.push(Outline {
                corners_m: vec![b, a, moved(a, REACH_M), moved(b, REACH_M)],
                ground: Ground::Crosswalk,
            });
        }
    }
    found
}

/// Carriageways of sections with a pavement, from kerb line to kerb line of the mesh.
fn carriageways(map: &RoadMap) -> Vec<Outline> {
    let mut sections: BTreeMap<(u32, u16), Vec<&Lane>> = BTreeMap::new();
    for lane in map.lanes().iter().filter(|lane| lane.junction.is_none()) {
        sections
            .entry((lane.key.road, lane.key.section))
            .or_default()
            .push(lane);
    }
    let mut found = Vec::new();
    for lanes in sections.into_values() {
        if !lanes.iter().any(|lane| lane.kind == LaneKind::Sidewalk) {
            continue;
        }
        let limit = |left: bool| {
            let of_side = |lane: &&&Lane| (lane.key.lane > 0) == left;
            // The innermost pavement's kerb line, or the outermost lane's outer edge.
            let pavement = lanes
                .iter()
                .filter(of_side)
                .filter(|lane| lane.kind == LaneKind::Sidewalk)
                .min_by_key(|lane| lane.key.lane.abs());
            let outermost = lanes
                .iter()
                .filter(of_side)
                .filter(|lane| lane.kind != LaneKind::Other)
                .max_by_key(|lane| lane.key.lane.abs());
            let lane = pavement.or(outermost)?;
            let (mut a, mut b) = map.boundaries(lane.key, STEP_M);
            let inner_is_right = left == lane.forward;
            if pavement.is_some() {
                (a, b) = inset(&a, &b);
            }
            let mut line = if (pavement.is_some()) == inner_is_right {
                b
            } else {
                a
            };
            if !lane.forward {
                line.reverse();
            }
            Some(line)
        };
        if let (Some(left), Some(right)) = (limit(true), limit(false)) {
            found.push(Outline {
                corners_m: ring(&left, &right),
                ground: Ground::Road,
            });
        }
    }
    found
}

/// Whether a point lies in an outline, seen from above.
pub fn inside(corners_m: &[Point], point: Point) -> bool {
    let mut odd = false;
    for (i, a) in corners_m.iter().enumerate() {
        let b = corners_m[(i + 1) % corners_m.len()];
        if (a[1] > point[1]) != (b[1] > point[1])
            && point[0] < a[0] + (point[1] - a[1]) * (b[0] - a[0]) / (b[1] - a[1])
        {
            odd = !odd;
        }
    }
    odd
}
