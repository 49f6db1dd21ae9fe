//! Paint on roads: lines, stop lines, zebras, arrows, parking bays.

use schema_types::{Class, ObjectId};
use sensor_core::Material;
use sensor_core::mesh::Surface;

use crate::geometry::wrap;
use crate::network::lane_lines::{self, LaneLine};
use crate::network::{Arm, CROSSWALK_M, Network, Road, STOP_M};
use crate::plan::Edge;
use crate::scenery::{Chunks, Layer, Levels};

/// Height of paint over the road: enough for depth buffers, too little to notice.
const PAINT_M: f64 = 0.005;

fn white(object: ObjectId) -> Surface {
    Surface::new(Class::ROAD_LINES, Material::Paint, [226, 226, 220]).of(object)
}

fn yellow(object: ObjectId) -> Surface {
    Surface::new(Class::ROAD_LINES, Material::Paint, [222, 172, 52]).of(object)
}

/// All paint of a road.
pub fn road(chunks: &mut Chunks, network: &Network, road: &Road, object: ObjectId) {
    let idx = road.id as usize - 1;
    let arm_at = |end: usize| {
        let arms = &network.junctions[road.ends[end]].arms;
        *arms
            .iter()
            .find(|arm| arm.road == idx && arm.at_start == (end == 0))
            .expect("a road ends at the junction it names")
    };
    let arms = [arm_at(0), arm_at(1)];
    long_lines(chunks, road, &arms, object);
    for arm in &arms {
        across(chunks, network, arm, road, object);
    }
    if road.profile.edge == Edge::Parking {
        bays(chunks, road, object);
    }
}

/// All paint of a junction: lines of a motorway that goes on, arrows before lights.
pub fn junction(chunks: &mut Chunks, network: &Network, idx: usize, object: ObjectId) {
    let junction = &network.junctions[idx];
    carriageway_lines(chunks, network, idx, object);
    for (i, arm) in junction.arms.iter().enumerate() {
        if network.roads[arm.road].profile.main && arm.waits {
            arrows(chunks, network, idx, i);
        }
    }
}

/// A painted stripe along the road.
fn stripe(
    chunks: &mut Chunks,
    levels: Levels,
    road: &Road,
    surface: Surface,
    (from_m, to_m): (f64, f64),
    t_m: f64,
    width_m: f64,
) {
    for pair in road.stations_between(from_m, to_m).windows(2) {
        let at = |s: f64, side: f64| road.point(s, t_m + 0.5 * side * width_m, PAINT_M);
        let corners = [
            at(pair[0], -1.0),
            at(pair[1], -1.0),
            at(pair[1], 1.0),
            at(pair[0], 1.0),
        ];
        chunks.sheet(Layer::Ground, levels.clone(), surface, &corners);
    }
}

fn dashes(
    chunks: &mut Chunks,
    road: &Road,
    surface: Surface,
    (from_m, to_m): (f64, f64),
    t_m: f64,
) {
    let (dash, period) = (3.0, 7.5);
    let n = ((to_m - from_m + period - dash) / period) as usize;
    for k in 0..n {
        let s = from_m + k as f64 * period;
        stripe(
            chunks,
            0..=1,
            road,
            surface,
            (s, (s + dash).min(to_m)),
            t_m,
            0.12,
        );
    }
}

fn long_lines(chunks: &mut Chunks, road: &Road, arms: &[Arm; 2], object: ObjectId) {
    let margin = |arm: &Arm| if arm.crosswalk { STOP_M + 0.2 } else { 0.0 };
    let span = (margin(&arms[0]), road.path.length_m() - margin(&arms[1]));
    let profile = &road.profile;
    if profile.one_way {
        for k in 1..profile.n_lanes {
            dashes(
                chunks,
                road,
                white(object),
                span,
                profile.driving_m() - k as f64 * profile.lane_m,
            );
        }
    } else if profile.main {
        for t in [-0.12, 0.12] {
            stripe(chunks, 0..=1, road, yellow(object), span, t, 0.12);
        }
    } else {
        dashes(chunks, road, yellow(object), span, 0.0);
    }
    for side in [1.0, -1.0] {
        for k in 1..if profile.one_way { 1 } else { profile.n_lanes } {
            dashes(
                chunks,
                road,
                white(object),
                span,
                side * k as f64 * profile.lane_m,
            );
        }
        stripe(
            chunks,
            0..=1,
            road,
            white(object),
            span,
            side * profile.driving_m(),
            0.12,
        );
    }
}

/// Stop line and zebra crossing of one end of a road.
fn across(chunks: &mut Chunks, network: &Network, arm: &Arm, road: &Road, object: ObjectId) {
    let span = |a: f64, b: f64| {
        let (a, b) = (network.arm_station(arm, a), network.arm_station(arm, b));
        (a.min(b), a.max(b))
    };
    if arm.waits {
        // Traffic towards the junction: right of the line at a road's end, left of it at its start.
        let side = if arm.at_start { 1.0 } else { -1.0 };
        let outer = road.profile.driving_m() - 0.08;
        let inner = if road.profile.one_way { -outer } else { 0.2 };
        stripe(
            chunks,
            0..=1,
            road,
            white(object),
            span(STOP_M - 0.2, STOP_M + 0.2),
            side * 0.5 * (inner + outer),
            outer - inner,
        );
    }
    if arm.crosswalk {
        let half = road.profile.kerb_m() - 0.3;
        let n = (2.0 * half / 1.0).floor();
        for k in 0..n as usize {
            let t = (k as f64 - 0.5 * (n - 1.0)) * 1.0;
            stripe(
                chunks,
                0..=0,
                road,
                white(object),
                span(CROSSWALK_M.0, CROSSWALK_M.1),
                t,
                0.5,
            );
        }
    }
}

/// Arrows on the lanes of main roads before lights: every way that the lane has.
fn arrows(chunks: &mut Chunks, network: &Network, junction: usize, arm_idx: usize) {
    let arms = &network.junctions[junction].arms;
    let arm = &arms[arm_idx];
    let road = &network.roads[arm.road];
    let object = ObjectId::scenery(road.id);
    let side = if arm.at_start { 1.0 } else { -1.0 };
    for lane in 1..=road.profile.n_lanes as i32 {
        let id = if arm.at_start { lane } else { -lane };
        let middle =
            side * (road.profile.lane_left_m(lane as usize - 1) + 0.5 * road.profile.lane_m);
        // (forward, left) in driving direction, from the arrow's tail.
        let at = |(forward, left): (f64, f64)| {
            road.point(
                network.arm_station(arm, STOP_M + 8.5 - forward),
                middle - side * left,
                PAINT_M,
            )
        };
        let turns: Vec<f64> = (network.links.iter())
            .filter(|link| link.junction == junction && link.from == (arm_idx, id))
            .map(|link| wrap(arms[link.to.0].heading_rad - arm.heading_rad - std::f64::consts::PI))
            .collect();
        let straight = turns.iter().any(|turn| turn.abs() < 0.6);
        let tip = if straight { 3.2 } else { 1.55 };
        let mut shapes: Vec<Vec<(f64, f64)>> =
            vec![vec![(0.0, -0.08), (tip, -0.08), (tip, 0.08), (0.0, 0.08)]];
        if straight {
            shapes.push(vec![(3.2, -0.26), (4.2, 0.0), (3.2, 0.26)]);
        }
        for turn in turns.iter().filter(|turn| turn.abs() >= 0.6) {
            let branch = [
                vec![(1.55, 0.08), (2.3, 0.62), (2.15, 0.75), (1.30, 0.08)],
                vec![(2.39, 0.47), (2.77, 1.12), (2.05, 0.91)],
            ];
            shapes.extend(branch.map(|mut corners| {
                if *turn < 0.0 {
                    corners.iter_mut().for_each(|corner| corner.1 = -corner.1);
                    corners.reverse();
                }
                corners
            }));
        }
        for corners in shapes {
            let corners: Vec<[f64; 3]> = corners.into_iter().map(at).collect();
            chunks.sheet(Layer::Ground, 0..=0, white(object), &corners);
        }
    }
}

/// Station of the first parking bay's start, and length of a bay.
pub const BAYS_M: (f64, f64) = (13.0, 6.0);

/// Number of parking bays on one side.
pub fn n_bays(road: &Road) -> usize {
    ((road.path.length_m() - 2.0 * BAYS_M.0) / BAYS_M.1).max(0.0) as usize
}

fn bays(chunks: &mut Chunks, road: &Road, object: ObjectId) {
    let n = n_bays(road);
    for side in [1.0, -1.0] {
        for k in 0..=n {
            let s = BAYS_M.0 + k as f64 * BAYS_M.1;
            let t = side * (road.profile.driving_m() + 0.5 * road.profile.edge_m);
            stripe(
                chunks,
                0..=0,
                road,
                white(object),
                (s - 0.05, s + 0.05),
                t,
                road.profile.edge_m - 0.25,
            );
        }
    }
}

/// Longest chord of a line through a junction: on the sharpest bend of a motorway it is off by less
/// than half a line's width.
const LINE_CHORD_M: f64 = 2.5;

/// Lines of a motorway inside a junction, where ramps leave and arrive or lanes begin and end: they
/// continue the lines of its roads.
fn carriageway_lines(chunks: &mut Chunks, network: &Network, idx: usize, object: ObjectId) {
    let junction = &network.junctions[idx];
    for link in network.links.iter().filter(|link| link.junction == idx) {
        let length = link.path.length_m();
        let mut stripe = |span: (f64, f64), aside: &dyn Fn(f64) -> f64| {
            let n = ((span.1 - span.0) / LINE_CHORD_M).ceil().max(1.0) as usize;
            let station = |k: usize| span.0 + (span.1 - span.0) * k as f64 / n as f64;
            for k in 0..n {
                let at = |s: f64, half: f64| {
                    let p = link.path.beside(s, aside(s) + half);
                    [p.x, p.y, junction.height_m + PAINT_M]
                };
                let (a, b) = (station(k), station(k + 1));
                chunks.sheet(
                    Layer::Ground,
                    0..=1,
                    white(object),
                    &[at(a, -0.06), at(b, -0.06), at(b, 0.06), at(a, 0.06)],
                );
            }
        };
        let asides: [&dyn Fn(f64) -> f64; 2] = [&|_| 0.0, &|s| -link.width_at(s)];
        for (line, aside) in lane_lines::lines(network, link).into_iter().zip(asides) {
            match line {
                Some(LaneLine::Solid) => stripe((0.0, length), aside),
                Some(LaneLine::Broken) => {
                    for k in 0..((length + 4.5) / 7.5) as usize {
                        let from = 7.5 * k as f64;
                        stripe((from, (from + 3.0).min(length)), aside);
                    }
                }
                None => {}
            }
        }
    }
}
