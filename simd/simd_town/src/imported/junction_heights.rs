//! One surface for the lanes of a junction that lie over each other.
//!
//! Every connecting road of a file has heights of its own, and where two cross they often differ by
//! some decimetres: vehicles would run into steps that no road has. Here each point of a lane gets
//! the weighted mean of all lanes of its junction there. A road counts less towards its sides and
//! more towards its ends, so that the mean has no steps either and fits the roads outside. What is
//! left of ridges is smoothed.

use std::collections::HashMap;

use schema_roads::{LaneSurface, SectionSurface};

use super::cover::is_for_vehicles;
use super::fairing::{Fairing, LEVEL_M};
use crate::geometry::{P2, cross, flat};

/// Heights that differ less are left alone, metres.
const SAME_M: f64 = 0.03;
/// Distance of the points on which the common surface is laid, metres.
const STEP_M: f64 = 0.7;
/// How far from its ends a road's own height counts most, metres, and how much more.
const END_M: f64 = 3.0;
const END_WEIGHT: f64 = 60.0;
/// Weight of a road at its sides; it is 1 in its middle.
const SIDE_WEIGHT: f64 = 0.01;
/// Side of the cells in which pieces are looked up, metres.
const CELL_M: f64 = 4.0;
/// Most points that are added to a map.
const MAX_ADDED: usize = 2_000_000;
/// Most cells in which one piece, and all pieces of a junction, are listed.
const MAX_CELLS: usize = 64;
const MAX_LISTED: usize = 4_000_000;

/// A piece of a lane for vehicles between two rows.
struct Piece {
    /// Counter-clockwise from above: right, right, left, left.
    corners_m: [[f64; 3]; 4],
    section: usize,
    /// The sides of the whole road here, each from row to row.
    sides_m: [[P2; 2]; 2],
    /// Distance of the two rows from the nearer end of the road, metres.
    to_end_m: [f64; 2],
}

/// The pieces of one junction by place.
struct Pieces {
    pieces: Vec<Piece>,
    cells: HashMap<(i32, i32), Vec<u32>>,
    n_listed: usize,
}

/// Gives the lanes of each junction one surface.
pub(super) fn level(sections: &mut [SectionSurface]) {
    let mut members: Vec<(u32, usize)> = sections
        .iter()
        .enumerate()
        .filter_map(|(idx, section)| Some((section.junction?, idx)))
        .collect();
    members.sort_unstable();
    let mut n_added = 0;
    for group in members.chunk_by(|a, b| a.0 == b.0) {
        let of_it: Vec<usize> = group.iter().map(|(_, idx)| *idx).collect();
        let pieces = Pieces::new(sections, &of_it);
        if !of_it.iter().any(|idx| pieces.differ(&sections[*idx], *idx)) {
            continue;
        }
        let mut all_finer: Vec<SectionSurface> = Vec::new();
        for idx in &of_it {
            let section = finer(&sections[*idx]);
            let lanes = section.lanes.iter();
            n_added += lanes.map(|lane| lane.points_m.len()).sum::<usize>();
            if n_added > MAX_ADDED {
                return;
            }
            all_finer.push(section);
        }
        let mut fairing = Fairing::default();
        for lane in all_finer.iter_mut().flat_map(lanes_for_vehicles) {
            for point in &mut lane.points_m {
                point[2] = pieces.height(*point);
                fairing.add(*point);
            }
            let ends = [lane.columns, lane.points_m.len()];
            for point in ends
                .iter()
                .flat_map(|end| &lane.points_m[end - lane.columns..*end])
            {
                fairing.add_mouth(*point);
            }
        }
        for lane in all_finer.iter_mut().flat_map(lanes_for_vehicles) {
            for point in &mut lane.points_m {
                point[2] = fairing.height(*point);
            }
        }
        for (idx, section) in of_it.into_iter().zip(all_finer) {
            sections[idx] = section;
        }
    }
}

fn lanes_for_vehicles(section: &mut SectionSurface) -> impl Iterator<Item = &mut LaneSurface> {
    section
        .lanes
        .iter_mut()
        .filter(|lane| is_for_vehicles(lane.kind))
}

impl Pieces {
    fn new(sections: &[SectionSurface], of_it: &[usize]) -> Pieces {
        let mut all = Pieces {
            pieces: Vec::new(),
            cells: HashMap::new(),
            n_listed: 0,
        };
        for idx in of_it {
            let section = &sections[*idx];
            let lanes = || {
                section
                    .lanes
                    .iter()
                    .filter(|lane| is_for_vehicles(lane.kind))
            };
            let (Some(right), Some(left)) = (lanes().next(), lanes().next_back()) else {
                continue;
            };
            let stations = &section.stations_m;
            let ends = [stations[0], stations[stations.len() - 1]];
            let to_end = |row: usize| (stations[row] - ends[0]).min(ends[1] - stations[row]);
            for row in 1..stations.len() {
                let rows = [row - 1, row];
                let sides_m = [
                    rows.map(|row| flat(right.row(row)[0])),
                    rows.map(|row| flat(left.row(row)[left.columns - 1])),
                ];
                for lane in lanes() {
                    let (a, b) = (lane.row(row - 1), lane.row(row));
                    for k in 1..lane.columns {
                        all.add(Piece {
                            corners_m: [a[k - 1], b[k - 1], b[k], a[k]],
                            section: *idx,
                            sides_m,
                            to_end_m: rows.map(to_end),
                        });
                    }
                }
            }
        }
        all
    }

    fn add(&mut self, piece: Piece) {
        let span = |axis: usize| {
            let values = piece.corners_m.map(|p| p[axis]);
            let low = values.into_iter().fold(f64::INFINITY, f64::min);
            let high = values.into_iter().fold(f64::NEG_INFINITY, f64::max);
            let cell = |x: f64| (x / CELL_M).floor() as i32;
            cell(low)..=cell(high).min(cell(low).saturating_add(64))
        };
        let n_cells = span(0).count() * span(1).count();
        if n_cells > MAX_CELLS || self.n_listed + n_cells > MAX_LISTED {
            return;
        }
        self.n_listed += n_cells;
        let idx = self.pieces.len() as u32;
        for x in span(0) {
            for y in span(1) {
                self.cells.entry((x, y)).or_default().push(idx);
            }
        }
        self.pieces.push(piece);
    }

    /// The pieces at a place on the same level, with their heights.
    fn at(&self, point: [f64; 3]) -> impl Iterator<Item = (&Piece, f64)> {
        let cell = |x: f64| (x / CELL_M).floor() as i32;
        let near = self.cells.get(&(cell(point[0]), cell(point[1])));
        near.into_iter()
            .flatten()
            .map(|idx| &self.pieces[*idx as usize])
            .filter_map(move |piece| Some((piece, piece.height_at(flat(point))?)))
            .filter(move |(_, z)| (z - point[2]).abs() < LEVEL_M)
    }

    /// Whether another road of the junction has another height somewhere on this one.
    fn differ(&self, section: &SectionSurface, idx: usize) -> bool {
        let lanes = section
            .lanes
            .iter()
            .filter(|lane| is_for_vehicles(lane.kind));
        lanes.flat_map(samples).any(|point| {
            self.at(point)
                .any(|(piece, z)| piece.section != idx && (z - point[2]).abs() > SAME_M)
        })
    }

    fn height(&self, point: [f64; 3]) -> f64 {
        // A road counts once, even where two of its pieces share an edge.
        let mut found: Vec<(usize, f64, f64)> = self
            .at(point)
            .map(|(piece, z)| (piece.section, z, piece.weight(flat(point))))
            .collect();
        found.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        found.dedup_by_key(|it| it.0);
        let sum: f64 = found.iter().map(|(_, _, weight)| weight).sum();
        if sum > 0.0 {
            found.iter().map(|(_, z, weight)| z * weight).sum::<f64>() / sum
        } else {
            point[2]
        }
    }
}

impl Piece {
    fn height_at(&self, p: P2) -> Option<f64> {
        let [a, b, c, d] = self.corners_m;
        super::cover::height_in([a, b, c], p).or_else(|| super::cover::height_in([a, c, d], p))
    }

    fn weight(&self, p: P2) -> f64 {
        let aside = self.sides_m.map(|side| from_line(p, side));
        let half_m = 0.5 * (aside[0] + aside[1]);
        let inward = (aside[0].min(aside[1]) / half_m.max(0.1)).clamp(0.0, 1.0);
        // How far from the first row to the second.
        let [a, b, _, _] = self.corners_m.map(flat);
        let along = b - a;
        let share = ((p - a).dot(&along) / along.norm_squared().max(1e-9)).clamp(0.0, 1.0);
        let to_end = self.to_end_m[0] + share * (self.to_end_m[1] - self.to_end_m[0]);
        (SIDE_WEIGHT + inward) * (1.0 + END_WEIGHT * (-to_end / END_M).exp())
    }
}

/// Distance from the line through two points.
fn from_line(p: P2, [a, b]: [P2; 2]) -> f64 {
    let along = b - a;
    match along.norm() {
        length if length > 1e-6 => (cross(along, p - a) / length).abs(),
        _ => (p - a).norm(),
    }
}

/// The points of a lane, and the middles between rows.
fn samples(lane: &LaneSurface) -> impl Iterator<Item = [f64; 3]> + '_ {
    let n_rows = lane.points_m.len() / lane.columns;
    let middles = (1..n_rows).map(|row| {
        let (a, b) = (lane.row(row - 1), lane.row(row));
        let last = lane.columns - 1;
        std::array::from_fn(|i| 0.25 * (a[0][i] + a[last][i] + b[0][i] + b[last][i]))
    });
    lane.points_m.iter().copied().chain(middles)
}

/// The same section with points at most a step apart.
fn finer(section: &SectionSurface) -> SectionSurface {
    let stations = &section.stations_m;
    // Sections under a millimetre have a single row.
    if stations.len() < 2 {
        return section.clone();
    }
    // Row before and share of the way to the next one.
    let mut rows: Vec<(usize, f64)> = Vec::new();
    for row in 1..stations.len() {
        let longest = section
            .lanes
            .iter()
            .flat_map(|lane| {
                let (a, b) = (lane.row(row - 1), lane.row(row));
                [0, lane.columns - 1].map(|k| (flat(b[k]) - flat(a[k])).norm())
            })
            .fold(0.0, f64::max);
        let n = pieces(longest);
        rows.extend((0..n).map(|i| (row - 1, i as f64 / n as f64)));
    }
    rows.push((stations.len() - 2, 1.0));
    let mix = |a: f64, b: f64, share: f64| a + share * (b - a);
    let between = |a: [f64; 3], b: [f64; 3], share: f64| -> [f64; 3] {
        std::array::from_fn(|i| mix(a[i], b[i], share))
    };
    let lanes = section.lanes.iter().map(|lane| {
        let n_rows = stations.len();
        let widest = (0..n_rows)
            .flat_map(|row| lane.row(row).windows(2))
            .map(|pair| (flat(pair[1]) - flat(pair[0])).norm())
            .fold(0.0, f64::max);
        let n = if is_for_vehicles(lane.kind) {
            pieces(widest)
        } else {
            1
        };
        let columns = (lane.columns - 1) * n + 1;
        let mut points_m = Vec::with_capacity(rows.len() * columns);
        for (row, share) in &rows {
            let (a, b) = (lane.row(*row), lane.row(*row + 1));
            let line: Vec<[f64; 3]> = a
                .iter()
                .zip(b)
                .map(|(a, b)| between(*a, *b, *share))
                .collect();
            points_m.push(line[0]);
            for pair in line.windows(2) {
                let steps = (1..=n).map(|i| between(pair[0], pair[1], i as f64 / n as f64));
                points_m.extend(steps);
            }
        }
        LaneSurface {
            columns,
            points_m,
            ..lane.clone()
        }
    });
    SectionSurface {
        stations_m: rows
            .iter()
            .map(|(row, share)| mix(stations[*row], stations[row + 1], *share))
            .collect(),
        lanes: lanes.collect(),
        centre_m: rows
            .iter()
            .map(|(row, share)| between(section.centre_m[*row], section.centre_m[row + 1], *share))
            .collect(),
        ..section.clone()
    }
}

fn pieces(length_m: f64) -> usize {
    ((length_m / STEP_M).ceil() as usize).clamp(1, 64)
}
