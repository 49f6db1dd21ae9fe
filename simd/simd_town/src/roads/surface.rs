//! Road surface, paint, kerbs, pavements and what lies inside the blocks.

use schema_types::{Class, ObjectId};
use sensor_core::Material;
use sensor_core::mesh::Surface;

use crate::carriageway::{self, LaneLine};
use crate::chunk::{ALL, Chunks, Key, Layer, Levels};
use crate::fill::{Border, Fill, Pond};
use crate::geometry::{P2, unit, wrap};
use crate::network::{Arm, CROSSWALK_M, Network, Road, STOP_M};
use crate::open_drive::KERB_HEIGHT_M;
use crate::plan::Edge;
use crate::ring::Ring;
use crate::town::CollisionMesh;

/// Height of paint over the road: far enough for depth buffers, too thin to notice.
const PAINT_M: f64 = 0.005;
/// Width of the kerb stone's top.
const STONE_M: f64 = 0.16;

/// Triangles of the ground that vehicles feel.
#[derive(Default)]
pub struct Floor {
    /// Road.
    pub road: CollisionMesh,
    /// Pavement, kerbs, yards.
    pub raised: CollisionMesh,
}

fn asphalt(object: ObjectId) -> Surface {
    Surface::new(Class::ROADS, Material::Asphalt, [74, 74, 77]).of(object)
}

fn white(object: ObjectId) -> Surface {
    Surface::new(Class::ROAD_LINES, Material::Paint, [226, 226, 220]).of(object)
}

fn yellow(object: ObjectId) -> Surface {
    Surface::new(Class::ROAD_LINES, Material::Paint, [222, 172, 52]).of(object)
}

/// Surface and paint of a road.
pub fn road(
    chunks: &mut Chunks,
    floor: &mut Floor,
    network: &Network,
    road: &Road,
    object: ObjectId,
) {
    let kerb = road.profile.kerb_m();
    for pair in road.stations.windows(2) {
        let at = |s: f64, t: f64| road.point(s, t, 0.0);
        let corners = [
            at(pair[0], -kerb),
            at(pair[1], -kerb),
            at(pair[1], kerb),
            at(pair[0], kerb),
        ];
        chunks.sheet(Layer::Ground, ALL, asphalt(object), &corners);
        floor.road.polygon(object, &corners);
    }
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

impl Road {
    /// A point of the road's surface, `up_m` over it.
    pub fn point(&self, s_m: f64, t_m: f64, up_m: f64) -> [f64; 3] {
        let p = self.path.beside(s_m, t_m);
        [p.x, p.y, self.elevation.at(s_m) + up_m]
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

/// Stop line and zebra of one end.
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

/// The area between the roads' ends.
pub fn junction(
    chunks: &mut Chunks,
    floor: &mut Floor,
    network: &Network,
    idx: usize,
    object: ObjectId,
) {
    let junction = &network.junctions[idx];
    let border = network.border(idx);
    let heights = vec![junction.height_m; border.len()];
    let fill = Fill::of(
        &Border {
            points_m: &border,
            heights_m: &heights,
            outside: false,
        },
        false,
        0.0,
        &[],
    );
    for triangle in &fill.triangles {
        let corners = triangle.map(|i| [fill.points_m[i].x, fill.points_m[i].y, junction.height_m]);
        chunks.sheet(Layer::Ground, ALL, asphalt(object), &corners);
        floor.road.polygon(object, &corners);
    }
    carriageway_lines(chunks, network, idx, object);
    for (i, arm) in junction.arms.iter().enumerate() {
        if network.roads[arm.road].profile.main && arm.waits {
            arrows(chunks, network, idx, i);
        }
    }
}

/// Longest chord of a line through a junction: on the sharpest bend of a motorway it is off by less
/// than half a line's width.
const LINE_CHORD_M: f64 = 2.5;

/// Lines of a motorway where ramps leave and arrive and where lanes begin and end: those of its
/// roads go on.
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
        for (line, aside) in carriageway::lines(network, link).into_iter().zip(asides) {
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

/// Kerb and pavement round a block.
pub fn pavement(chunks: &mut Chunks, floor: &mut Floor, ring: &Ring, object: ObjectId) {
    let slabs = Surface::new(Class::SIDEWALKS, Material::Concrete, [158, 154, 147]).of(object);
    let stone = Surface::new(Class::SIDEWALKS, Material::Concrete, [186, 184, 178]).of(object);
    let n = ring.kerb_m.len();
    let pavement = (slabs, stone);
    let grass = Surface::new(Class::TERRAIN, Material::Grass, [95, 111, 66]).of(object);
    for i in (0..n).filter(|&i| !ring.seam[i]) {
        let (slabs, stone) = if ring.verge[i] && ring.verge[(i + 1) % n] {
            (grass, grass)
        } else {
            pavement
        };
        let k = (i + 1) % n;
        let (a, b) = (ring.kerb_m[i], ring.kerb_m[k]);
        if (a - b).norm() < 1e-6 && (ring.back_m[i] - ring.back_m[k]).norm() < 1e-6 {
            continue;
        }
        let lift = |p: P2, i: usize, up: f64| [p.x, p.y, ring.height_m[i] + up];
        let kerb = |i: usize| lift(ring.kerb_m[i], i, ring.rise_m[i]);
        let back = |i: usize| lift(ring.back_m[i], i, KERB_HEIGHT_M);
        // The stone lies along the slope from kerb to back.
        let inner = |i: usize| {
            let across = ring.back_m[i] - ring.kerb_m[i];
            let share = (STONE_M / across.norm()).min(0.5);
            lift(
                ring.kerb_m[i] + across * share,
                i,
                ring.rise_m[i] + (KERB_HEIGHT_M - ring.rise_m[i]) * share,
            )
        };
        let whole = [kerb(i), kerb(k), back(k), back(i)];
        chunks.sheet(
            Layer::Ground,
            0..=0,
            stone,
            &[kerb(i), kerb(k), inner(k), inner(i)],
        );
        chunks.sheet(
            Layer::Ground,
            0..=0,
            slabs,
            &[inner(i), inner(k), back(k), back(i)],
        );
        chunks.sheet(Layer::Ground, 1..=2, slabs, &whole);
        floor.raised.polygon(object, &whole);
        if (a - b).norm() > 1e-6 {
            let key = Key::at(Layer::Ground, 0.5 * (a + b));
            let face = [lift(a, i, -0.08), lift(b, k, -0.08), kerb(k), kerb(i)];
            let (length, height) = ((b - a).norm() as f32, KERB_HEIGHT_M as f32 + 0.08);
            chunks.polygon(
                key,
                0..=1,
                stone,
                &face,
                &[[0.0, 0.0], [length, 0.0], [length, height], [0.0, height]],
            );
            floor.raised.polygon(object, &face);
        }
    }
}

/// Yard, lawn or open country behind the pavements, with its ponds.
pub fn block(chunks: &mut Chunks, floor: &mut Floor, ring: &Ring, green: bool, object: ObjectId) {
    let surface = if green {
        Surface::new(
            Class::TERRAIN,
            Material::Grass,
            if ring.outside {
                [100, 114, 70]
            } else {
                [92, 113, 63]
            },
        )
    } else {
        Surface::new(Class::GROUND, Material::Concrete, [128, 124, 116])
    };
    let ground = &ring.ground;
    for triangle in &ground.triangles {
        let corners = triangle.map(|i| {
            [
                ground.points_m[i].x,
                ground.points_m[i].y,
                ground.heights_m[i] + KERB_HEIGHT_M,
            ]
        });
        chunks.sheet(Layer::Ground, ALL, surface.of(object), &corners);
        floor.raised.polygon(object, &corners);
    }
}

/// The surface of a pond, a little wider than its shore.
pub fn pond(chunks: &mut Chunks, pond: &Pond, object: ObjectId) {
    let water = Surface::new(Class::WATER, Material::Water, [38, 62, 66]).of(object);
    let at = |k: usize| {
        let p =
            pond.middle_m + unit(std::f64::consts::TAU * k as f64 / 24.0) * (pond.radius_m + 8.0);
        [p.x, p.y, pond.level_m + KERB_HEIGHT_M]
    };
    let middle = [
        pond.middle_m.x,
        pond.middle_m.y,
        pond.level_m + KERB_HEIGHT_M,
    ];
    for k in 0..24 {
        chunks.sheet(
            Layer::Ground,
            ALL,
            water,
            &[middle, at(k), at((k + 1) % 24)],
        );
    }
}
