//! Lanes, kerbs, junction floors and embankments.

use std::collections::BTreeMap;

use schema_roads::{LaneKind, LaneSurface, SectionSurface};
use schema_types::{Class, ObjectId};
use sensor_core::Material;
use sensor_core::mesh::Surface;

use super::builder::ImportBuilder;
use super::cover::is_for_vehicles;
use crate::geometry::{P2, flat, left};
use crate::scenery::{ALL, Key, Layer, Levels};

/// Height of pavements for which the file gives none.
pub(super) const KERB_M: f64 = 0.12;
/// Least step between two lanes that gets an upright face.
const STEP_M: f64 = 0.005;
/// Depth of the floor that closes gaps between the lanes of a junction, and how far it reaches
/// beyond each.
const FLOOR_M: (f64, f64) = (0.012, 0.45);
/// Side of the cells in which holes of a junction are looked for, and the largest hole that is
/// closed.
const HOLE_CELL_M: f64 = 0.75;
const HOLE_M2: f64 = 140.0;
/// Greatest number of cells of all junctions together.
const MAX_HOLE_CELLS: usize = 4_000_000;
/// Height over the ground from which a road is a bridge.
const BRIDGE_M: f64 = 2.5;
/// Distances from the edge of a bridge at which another road means that it goes on there, metres.
const NEIGHBOUR_M: [f64; 4] = [-0.3, 0.05, 0.6, 1.2];
/// Thickness of a bridge, height of its parapets.
const DECK_M: (f64, f64) = (0.7, 0.9);

/// Widest lane without a use beside a pavement that is taken for its kerb.
const KERB_LANE_M: f64 = 0.8;

/// Marks narrow lanes between carriageway and pavement as kerbs, whatever the file calls them.
pub(super) fn name_kerbs(sections: &mut [SectionSurface]) {
    for section in sections {
        let pavements: Vec<bool> = section
            .lanes
            .iter()
            .map(|lane| lane.kind == LaneKind::Sidewalk)
            .collect();
        for (idx, lane) in section.lanes.iter_mut().enumerate() {
            let beside =
                idx > 0 && pavements[idx - 1] || pavements.get(idx + 1).copied().unwrap_or(false);
            let narrow = (0..section.stations_m.len())
                .all(|row| width(lane.row(row)[0], lane.row(row)[lane.columns - 1]) < KERB_LANE_M);
            if beside && narrow && matches!(lane.kind, LaneKind::Other | LaneKind::Border) {
                lane.kind = LaneKind::Kerb;
            }
        }
    }
}

/// Lifts pavements and kerbs that the file says nothing about.
pub(super) fn raise_pavements(sections: &mut [SectionSurface]) {
    for lane in sections.iter_mut().flat_map(|section| &mut section.lanes) {
        if is_pavement(lane.kind) && !lane.has_height {
            lane.points_m.iter_mut().for_each(|p| p[2] += KERB_M);
        }
    }
}

pub(super) fn is_pavement(kind: LaneKind) -> bool {
    matches!(kind, LaneKind::Sidewalk | LaneKind::Kerb)
}

/// What a lane is made of.
fn surface_of(kind: LaneKind, object: ObjectId) -> Surface {
    use LaneKind as K;
    let surface = match kind {
        K::Sidewalk => Surface::new(Class::SIDEWALKS, Material::Concrete, [104, 103, 102]),
        K::Kerb => Surface::new(Class::SIDEWALKS, Material::Concrete, [126, 125, 124]),
        K::Biking => Surface::new(Class::ROADS, Material::Asphalt, [112, 78, 72]),
        K::Median | K::Other => Surface::new(Class::TERRAIN, Material::Grass, [98, 120, 66]),
        K::Border => Surface::new(Class::GROUND, Material::Concrete, [116, 112, 104]),
        K::Rail => Surface::new(Class::RAIL_TRACK, Material::Concrete, [96, 90, 84]),
        K::Shoulder | K::Stop => Surface::new(Class::ROADS, Material::Asphalt, [88, 88, 89]),
        K::Parking => Surface::new(Class::ROADS, Material::Asphalt, [90, 88, 86]),
        K::Driving | K::Bidirectional | K::Bus | K::Taxi | K::Restricted => {
            Surface::new(Class::ROADS, Material::Asphalt, [80, 80, 81])
        }
    };
    surface.of(object)
}

/// Adds lanes, kerbs, embankments and the floors of junctions.
pub(super) fn build(builder: &mut ImportBuilder, sections: &[SectionSurface]) {
    let mut owners: BTreeMap<(bool, u32), ObjectId> = BTreeMap::new();
    for section in sections {
        let key = section
            .junction
            .map_or((false, section.road), |junction| (true, junction));
        let object = *owners.entry(key).or_insert_with(|| {
            let roads = builder.roads;
            let name = match section.junction {
                Some(junction) => {
                    format!("junction {}", roads.junction_id(junction).unwrap_or("?"))
                }
                None => format!("road {}", roads.road_id(section.road).unwrap_or("?")),
            };
            builder.object(Class::ROADS, &name)
        });
        lanes(builder, section, object);
        edges(builder, section, object);
    }
    let mut members: BTreeMap<u32, Vec<&SectionSurface>> = BTreeMap::new();
    for section in sections {
        members
            .entry(section.junction.unwrap_or(u32::MAX))
            .or_default()
            .extend(section.junction.map(|_| section));
    }
    let mut cells = MAX_HOLE_CELLS;
    for (junction, of_it) in members {
        if let Some(object) = owners.get(&(true, junction)) {
            floor(builder, &of_it, *object);
            holes(builder, &of_it, *object, &mut cells);
        }
    }
}

/// Adds a lying quad to the meshes and to the solids.
fn lay(
    builder: &mut ImportBuilder,
    levels: Levels,
    surface: Surface,
    corners: [[f64; 3]; 4],
    for_vehicles: bool,
) {
    let uv = corners.map(|c| [c[0] as f32, c[1] as f32]);
    let middle = 0.25 * (flat(corners[0]) + flat(corners[1]) + flat(corners[2]) + flat(corners[3]));
    builder.chunks.polygon(
        Key::at(Layer::Ground, middle),
        levels,
        surface,
        &corners,
        &uv,
    );
    if for_vehicles {
        &mut builder.road
    } else {
        &mut builder.raised
    }
    .polygon(surface.object, &corners);
}

/// Whether a piece of this pavement is left out because vehicles of another road drive there.
fn gives_way(
    builder: &ImportBuilder,
    section: &SectionSurface,
    lane: &LaneSurface,
    row: usize,
) -> bool {
    if is_for_vehicles(lane.kind) {
        return false;
    }
    let (a, b) = (lane.row(row - 1), lane.row(row));
    let last = lane.columns - 1;
    let middle: [f64; 3] =
        std::array::from_fn(|i| 0.25 * (a[0][i] + a[last][i] + b[0][i] + b[last][i]));
    [middle, a[0], a[last], b[0], b[last]]
        .iter()
        .filter(|p| {
            builder
                .cover
                .crossed_by_others(flat(**p), p[2], section.road)
        })
        .count()
        >= 2
}

fn lanes(builder: &mut ImportBuilder, section: &SectionSurface, object: ObjectId) {
    for lane in &section.lanes {
        let surface = surface_of(lane.kind, object);
        for row in 1..section.stations_m.len() {
            if gives_way(builder, section, lane, row) {
                continue;
            }
            let (a, b) = (lane.row(row - 1), lane.row(row));
            for k in 1..lane.columns {
                let corners = [a[k - 1], b[k - 1], b[k], a[k]];
                if width(a[k - 1], a[k]).max(width(b[k - 1], b[k])) > 1e-3 {
                    lay(builder, ALL, surface, corners, is_for_vehicles(lane.kind));
                }
            }
        }
    }
}

fn width(a: [f64; 3], b: [f64; 3]) -> f64 {
    (flat(a) - flat(b)).norm()
}

/// Adds faces between lanes of different height, and what joins the outer edges to the ground.
fn edges(builder: &mut ImportBuilder, section: &SectionSurface, object: ObjectId) {
    let stone = Surface::new(Class::SIDEWALKS, Material::Concrete, [126, 125, 124]).of(object);
    for pair in section.lanes.windows(2) {
        for row in 1..section.stations_m.len() {
            let skip = [&pair[0], &pair[1]].map(|lane| gives_way(builder, section, lane, row));
            if skip[0] || skip[1] {
                continue;
            }
            let edge = |lane: &LaneSurface, row: usize, left: bool| {
                lane.row(row)[if left { lane.columns - 1 } else { 0 }]
            };
            // The left edge of the lane on the right, and the right edge of the one on the left.
            let right = [edge(&pair[0], row - 1, true), edge(&pair[0], row, true)];
            let left = [edge(&pair[1], row - 1, false), edge(&pair[1], row, false)];
            let rise = 0.5 * (left[0][2] - right[0][2] + left[1][2] - right[1][2]);
            if rise > STEP_M {
                face(builder, stone, [right[1], right[0], left[0], left[1]]);
            } else if rise < -STEP_M {
                face(builder, stone, [left[0], left[1], right[1], right[0]]);
            }
        }
    }
    let (Some(first), Some(last)) = (section.lanes.first(), section.lanes.last()) else {
        return;
    };
    let edge = |lane: &LaneSurface, left: bool| -> Vec<[f64; 3]> {
        (0..section.stations_m.len())
            .map(|row| lane.row(row)[if left { lane.columns - 1 } else { 0 }])
            .collect()
    };
    let mut right_edge = edge(first, false);
    right_edge.reverse();
    for (points, lane, reversed) in [(edge(last, true), last, false), (right_edge, first, true)] {
        for k in 1..points.len() {
            let row = if reversed { points.len() - k } else { k };
            if !gives_way(builder, section, lane, row) {
                outer_edge(
                    builder,
                    section,
                    (points[k - 1], points[k]),
                    is_pavement(lane.kind),
                    object,
                );
            }
        }
    }
    walls(builder, section, &[edge(last, true), edge(first, false)]);
}

/// An upright quad: foot from a to b, top from b to a, seen from the right of that direction.
fn face(builder: &mut ImportBuilder, surface: Surface, corners: [[f64; 3]; 4]) {
    let length = width(corners[0], corners[1]) as f32;
    let height = (corners[2][2] - corners[1][2]).abs() as f32;
    let key = Key::at(Layer::Ground, flat(corners[0]));
    builder.chunks.polygon(
        key,
        0..=1,
        surface,
        &corners,
        &[[0.0, 0.0], [length, 0.0], [length, height], [0.0, height]],
    );
    builder.raised.polygon(surface.object, &corners);
}

/// Joins an outer edge (walked with the road on its right) to the ground.
fn outer_edge(
    builder: &mut ImportBuilder,
    section: &SectionSurface,
    (a, b): ([f64; 3], [f64; 3]),
    pavement: bool,
    object: ObjectId,
) {
    let along = flat(b) - flat(a);
    if along.norm() < 1e-3 {
        return;
    }
    let out = left(along.normalize());
    let (za, zb) = (builder.ground.at(flat(a)), builder.ground.at(flat(b)));
    let drop = (a[2] - za).max(b[2] - zb);
    let beyond = flat(a) + along * 0.5 + out * 0.3;
    if builder.cover.others_near(beyond, a[2], section.road) {
        return;
    }
    let bridge_m = BRIDGE_M.max(0.12 * builder.ground.cell_m());
    let earth = Surface::new(Class::TERRAIN, Material::Grass, [98, 118, 66]).of(object);
    let stone = Surface::new(Class::SIDEWALKS, Material::Concrete, [140, 138, 134]).of(object);
    let at = |p: [f64; 3], out_m: f64, z: f64| [p[0] + out.x * out_m, p[1] + out.y * out_m, z];
    if drop > bridge_m {
        // A parapet stands nowhere near the lanes of another road.
        let has_neighbour = [0.1, 0.5, 0.9].into_iter().any(|share| {
            let p = flat(a) + along * share;
            let mut beside = NEIGHBOUR_M.iter().map(|m| p + out * *m);
            beside.any(|p| builder.cover.others_near(p, a[2], section.road))
        });
        if !has_neighbour {
            bridge_edge(builder, (a, b), out, object);
        }
        return;
    }
    let slope_m = 1.6 * drop;
    let foot_is_free =
        |builder: &ImportBuilder, p: [f64; 3]| !builder.cover.is_covered(flat(p) + out * slope_m);
    if drop > 0.3 && !pavement && foot_is_free(builder, a) && foot_is_free(builder, b) {
        lay(
            builder,
            0..=1,
            earth,
            [b, a, at(a, slope_m, za - 0.15), at(b, slope_m, zb - 0.15)],
            false,
        );
        return;
    }
    // Seen from outside: the road lies on the right of a → b, so the face looks to the left.
    face(
        builder,
        if pavement { stone } else { earth },
        [[b[0], b[1], zb - 0.2], [a[0], a[1], za - 0.2], a, b],
    );
}

/// Side of a bridge: the deck's edge and a parapet that keeps vehicles on it.
fn bridge_edge(
    builder: &mut ImportBuilder,
    (a, b): ([f64; 3], [f64; 3]),
    out: P2,
    object: ObjectId,
) {
    let concrete = Surface::new(Class::BRIDGE, Material::Concrete, [150, 148, 142]).of(object);
    let at = |p: [f64; 3], out_m: f64, up_m: f64| {
        [p[0] + out.x * out_m, p[1] + out.y * out_m, p[2] + up_m]
    };
    let (low, high, thick) = (-DECK_M.0, DECK_M.1, 0.18);
    let mut quad = |corners: [[f64; 3]; 4]| {
        let key = Key::at(Layer::Ground, flat(corners[0]));
        let length = width(a, b) as f32;
        builder.chunks.polygon(
            key,
            ALL,
            concrete,
            &corners,
            &[[0.0, 0.0], [length, 0.0], [length, 1.0], [0.0, 1.0]],
        );
        builder.solid.polygon(object, &corners);
    };
    quad([
        at(b, thick, low),
        at(a, thick, low),
        at(a, thick, high),
        at(b, thick, high),
    ]);
    quad([
        at(a, 0.0, 0.0),
        at(b, 0.0, 0.0),
        at(b, 0.0, high),
        at(a, 0.0, high),
    ]);
    quad([
        at(a, 0.0, high),
        at(b, 0.0, high),
        at(b, thick, high),
        at(a, thick, high),
    ]);
    // Half of the deck's underside; the other edge adds the other half.
    quad([
        at(a, thick, low),
        at(b, thick, low),
        at(b, -2.5, low),
        at(a, -2.5, low),
    ]);
}

/// Walls along both outer edges, as high as the options say, open where other roads join.
fn walls(builder: &mut ImportBuilder, section: &SectionSurface, edges: &[Vec<[f64; 3]>; 2]) {
    let height = builder.options.wall_height_m;
    if height <= 0.0 {
        return;
    }
    let object = builder.object(Class::WALLS, "wall");
    let concrete = Surface::new(Class::WALLS, Material::Concrete, [152, 150, 146]).of(object);
    for pair in edges.iter().flat_map(|edge| edge.windows(2)) {
        let (a, b) = (pair[0], pair[1]);
        let middle = 0.5 * (flat(a) + flat(b));
        let along = flat(b) - flat(a);
        if along.norm() < 1e-3 {
            continue;
        }
        let side = left(along.normalize()) * 0.4;
        if [middle + side, middle - side]
            .iter()
            .all(|p| builder.cover.is_covered(*p))
            || builder.cover.others_near(middle, a[2], section.road)
        {
            continue;
        }
        let up = |p: [f64; 3]| [p[0], p[1], p[2] + height];
        for corners in [[a, b, up(b), up(a)], [b, a, up(a), up(b)]] {
            let key = Key::at(Layer::Ground, flat(a));
            let (u, v) = (along.norm() as f32, height as f32);
            builder.chunks.polygon(
                key,
                ALL,
                concrete,
                &corners,
                &[[0.0, 0.0], [u, 0.0], [u, v], [0.0, v]],
            );
            builder.solid.polygon(object, &corners);
        }
    }
}

/// A floor just under the lanes of a junction and a little wider, so that slits between them do not
/// show the ground.
fn floor(builder: &mut ImportBuilder, sections: &[&SectionSurface], object: ObjectId) {
    let asphalt = surface_of(LaneKind::Driving, object);
    for section in sections {
        for lane in section
            .lanes
            .iter()
            .filter(|lane| is_for_vehicles(lane.kind))
        {
            for row in 1..section.stations_m.len() {
                // Every column, because the lane need not be even across.
                let wider = |row: usize| -> Vec<[f64; 3]> {
                    let points = lane.row(row);
                    let across = flat(points[lane.columns - 1]) - flat(points[0]);
                    let out = across.try_normalize(1e-6).unwrap_or_default() * FLOOR_M.1;
                    let mut under: Vec<[f64; 3]> = points
                        .iter()
                        .map(|p| [p[0], p[1], p[2] - FLOOR_M.0])
                        .collect();
                    let beyond = |p: [f64; 3], by: P2| [p[0] + by.x, p[1] + by.y, p[2]];
                    under[0] = beyond(under[0], -out);
                    under[lane.columns - 1] = beyond(under[lane.columns - 1], out);
                    under
                };
                let (a, b) = (wider(row - 1), wider(row));
                for k in 1..lane.columns {
                    let quad = [a[k - 1], b[k - 1], b[k], a[k]];
                    lay(builder, ALL, asphalt, quad, true);
                }
            }
        }
    }
}

/// Closes holes between the lanes of a junction, up to the size of a small island.
fn holes(
    builder: &mut ImportBuilder,
    sections: &[&SectionSurface],
    object: ObjectId,
    cells: &mut usize,
) {
    let points = || {
        sections.iter().flat_map(|s| {
            s.lanes
                .iter()
                .filter(|l| is_for_vehicles(l.kind))
                .flat_map(|l| &l.points_m)
        })
    };
    let (mut low, mut high) = (P2::repeat(f64::INFINITY), P2::repeat(f64::NEG_INFINITY));
    points().for_each(|p| (low, high) = (low.inf(&flat(*p)), high.sup(&flat(*p))));
    let size = high - low;
    if !size.x.is_finite() || size.x.max(size.y) > 250.0 {
        return;
    }
    let (columns, rows) = (
        (size.x / HOLE_CELL_M).ceil() as usize + 2,
        (size.y / HOLE_CELL_M).ceil() as usize + 2,
    );
    let Some(left) = cells.checked_sub(columns * rows) else {
        return;
    };
    *cells = left;
    let at = |i: usize| {
        low + P2::new((i % columns) as f64 - 0.5, (i / columns) as f64 - 0.5) * HOLE_CELL_M
    };
    let heights: Vec<Option<f64>> = (0..columns * rows)
        .map(|i| builder.cover.vehicles_at(at(i)))
        .collect();
    let mut seen: Vec<bool> = heights.iter().map(Option::is_some).collect();
    let asphalt = surface_of(LaneKind::Driving, object);
    for start in 0..seen.len() {
        if seen[start] {
            continue;
        }
        let (mut part, mut open, mut enclosed, mut rim) =
            (Vec::new(), vec![start], true, Vec::new());
        seen[start] = true;
        while let Some(i) = open.pop() {
            part.push(i);
            let (x, y) = (i % columns, i / columns);
            if x == 0 || y == 0 || x + 1 == columns || y + 1 == rows {
                enclosed = false;
                continue;
            }
            for k in [i - 1, i + 1, i - columns, i + columns] {
                rim.extend(heights[k]);
                if !seen[k] {
                    seen[k] = true;
                    open.push(k);
                }
            }
        }
        let area = part.len() as f64 * HOLE_CELL_M * HOLE_CELL_M;
        if !enclosed || area > HOLE_M2 || rim.is_empty() {
            continue;
        }
        let mean = rim.iter().sum::<f64>() / rim.len() as f64;
        part.sort_unstable();
        // One strip per run of cells, half a cell wider so that it ends under the lanes.
        let mut from = 0;
        for k in 1..=part.len() {
            if k < part.len() && part[k] == part[k - 1] + 1 && part[k] % columns != 0 {
                continue;
            }
            // No higher than the lanes beside it, under which it ends.
            let beside = part[from..k]
                .iter()
                .flat_map(|i| [i - 1, i + 1, i - columns, i + columns])
                .filter_map(|i| heights[i]);
            let z = beside.fold(f64::INFINITY, f64::min);
            let z = if z.is_finite() { z } else { mean } - FLOOR_M.0;
            let (a, b) = (
                at(part[from]).add_scalar(-0.8 * HOLE_CELL_M),
                at(part[k - 1]).add_scalar(0.8 * HOLE_CELL_M),
            );
            lay(
                builder,
                ALL,
                asphalt,
                [[a.x, a.y, z], [b.x, a.y, z], [b.x, b.y, z], [a.x, b.y, z]],
                true,
            );
            from = k;
        }
    }
}
