//! Heights: along a road, and of the ground between the roads.

use std::collections::HashMap;

use crate::geometry::{P2, cross};
use crate::network::Network;
use crate::ring::Ring;

/// A cubic of the distance from its start, level at both ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// Station where it begins.
    pub s_m: f64,
    /// Height there.
    pub a_m: f64,
    /// Factor of the square, 1/m.
    pub c: f64,
    /// Factor of the cube, 1/m².
    pub d: f64,
}

/// Height of a road's reference line over its length; level at both ends, so that junctions can be
/// level.
#[derive(Clone, Debug, PartialEq)]
pub struct Elevation {
    /// In order; the first begins at 0.
    pub pieces: Vec<Piece>,
}

impl Elevation {
    /// From one height to another over `length_m`; on the way this much above the straight line
    /// between both, at shares of the length.
    pub fn between(length_m: f64, from_m: f64, to_m: f64, rises_m: &[(f64, f64)]) -> Elevation {
        let mut knots = vec![(0.0, from_m)];
        knots.extend(
            rises_m.iter().map(|&(share, rise_m)| {
                (share * length_m, from_m + (to_m - from_m) * share + rise_m)
            }),
        );
        knots.push((length_m, to_m));
        let piece = |pair: &[(f64, f64)]| {
            let ((s_m, a_m), (end_m, b_m)) = (pair[0], pair[1]);
            let (length, rise) = (end_m - s_m, b_m - a_m);
            Piece {
                s_m,
                a_m,
                c: 3.0 * rise / length.powi(2),
                d: -2.0 * rise / length.powi(3),
            }
        };
        Elevation {
            pieces: knots.windows(2).map(piece).collect(),
        }
    }

    /// Height at a station.
    pub fn at(&self, s_m: f64) -> f64 {
        let piece = self
            .pieces
            .iter()
            .rev()
            .find(|piece| piece.s_m <= s_m)
            .unwrap_or(&self.pieces[0]);
        let u = s_m - piece.s_m;
        piece.a_m + u * u * (piece.c + u * piece.d)
    }

    /// Stations whose chords deviate by at most 3 mm in height, each with the distance to its
    /// neighbours; both ends included.
    pub fn steps(&self, length_m: f64) -> Vec<(f64, f64)> {
        let mut steps = vec![(0.0, 0.0)];
        for (i, piece) in self.pieces.iter().enumerate() {
            let end = self.pieces.get(i + 1).map_or(length_m, |next| next.s_m);
            let length = end - piece.s_m;
            // Of a cubic that is level at both ends, the ends are bent most.
            let wanted = (8.0 * 0.003 / (2.0 * piece.c.abs()).max(1e-9))
                .sqrt()
                .clamp(2.5, 16.0);
            let n = (length / wanted).ceil().max(1.0);
            steps.extend((1..=n as usize).map(|k| (piece.s_m + length * k as f64 / n, length / n)));
        }
        steps
    }

    /// Whether the whole road has one height.
    pub fn is_level(&self) -> bool {
        self.pieces
            .iter()
            .all(|piece| piece.c == 0.0 && piece.d == 0.0)
    }
}

/// Side of the cells in which triangles are looked up.
const CELL_M: f64 = 12.0;
/// Triangles in more cells than this are looked up one by one.
const MAX_CELLS: usize = 400;

/// Height of the ground at street level, without kerbs. Level ground holds no triangles.
#[derive(Default)]
pub struct Terrain {
    triangles: Vec<[[f64; 3]; 3]>,
    cells: HashMap<(i32, i32), Vec<usize>>,
    wide: Vec<usize>,
}

impl Terrain {
    /// The ground under a network with its blocks; decks are not ground.
    pub fn build(network: &Network, rings: &[Ring], hills_m: f64) -> Terrain {
        let mut terrain = Terrain::default();
        if network.is_level() && hills_m == 0.0 && rings.iter().all(|ring| ring.ponds.is_empty()) {
            return terrain;
        }
        for road in &network.roads {
            let kerb = road.profile.kerb_m();
            for (from, to) in road.on_ground() {
                for pair in road.stations_between(from, to).windows(2) {
                    let at = |s: f64, t: f64| lifted(road.path.beside(s, t), road.elevation.at(s));
                    terrain.polygon(&[
                        at(pair[0], -kerb),
                        at(pair[1], -kerb),
                        at(pair[1], kerb),
                        at(pair[0], kerb),
                    ]);
                }
            }
        }
        for junction in 0..network.junctions.len() {
            let border: Vec<[f64; 3]> = network
                .border(junction)
                .into_iter()
                .map(|p| lifted(p, network.junctions[junction].height_m))
                .collect();
            terrain.polygon(&border);
        }
        for ring in rings {
            terrain.block(ring);
        }
        terrain
    }

    fn block(&mut self, ring: &Ring) {
        let n = ring.kerb_m.len();
        let back = |i: usize| lifted(ring.back_m[i], ring.height_m[i]);
        for i in (0..n).filter(|&i| !ring.seam[i]) {
            let k = (i + 1) % n;
            self.polygon(&[
                lifted(ring.kerb_m[i], ring.height_m[i]),
                lifted(ring.kerb_m[k], ring.height_m[k]),
                back(k),
                back(i),
            ]);
        }
        for triangle in &ring.ground.triangles {
            self.polygon(
                &triangle.map(|i| lifted(ring.ground.points_m[i], ring.ground.heights_m[i])),
            );
        }
    }

    /// Adds a convex polygon, counter-clockwise from above.
    pub fn polygon(&mut self, corners: &[[f64; 3]]) {
        for i in 1..corners.len() - 1 {
            let t = [corners[0], corners[i], corners[i + 1]];
            let idx = self.triangles.len();
            let span = |axis: usize| {
                let (low, high) = t.iter().fold((f64::MAX, f64::MIN), |(l, h), p| {
                    (l.min(p[axis]), h.max(p[axis]))
                });
                ((low - 0.1) / CELL_M).floor() as i32..=((high + 0.1) / CELL_M).floor() as i32
            };
            self.triangles.push(t);
            if span(0).count().saturating_mul(span(1).count()) > MAX_CELLS {
                self.wide.push(idx);
                continue;
            }
            for x in span(0) {
                span(1).for_each(|y| self.cells.entry((x, y)).or_default().push(idx));
            }
        }
    }

    /// Height at a point; 0 where there is no ground.
    pub fn at(&self, p: P2) -> f64 {
        let cell = ((p.x / CELL_M).floor() as i32, (p.y / CELL_M).floor() as i32);
        let near = self.cells.get(&cell).map_or(&[][..], Vec::as_slice);
        let mut best = (-0.05, 0.0);
        for &idx in near.iter().chain(&self.wide) {
            let [a, b, c] = self.triangles[idx].map(|q| P2::new(q[0], q[1]));
            let area = cross(b - a, c - a);
            if area < 1e-6 {
                continue;
            }
            let w = [
                cross(c - b, p - b) / area,
                cross(a - c, p - c) / area,
                cross(b - a, p - a) / area,
            ];
            // How far inside: metres from the nearest edge.
            let inside = (w[0] * area / (c - b).norm())
                .min(w[1] * area / (a - c).norm())
                .min(w[2] * area / (b - a).norm());
            if inside > best.0 {
                best = (
                    inside,
                    (0..3).map(|i| w[i] * self.triangles[idx][i][2]).sum(),
                );
            }
        }
        best.1
    }
}

fn lifted(p: P2, z_m: f64) -> [f64; 3] {
    [p.x, p.y, z_m]
}
