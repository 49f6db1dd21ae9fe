//! Heights: along a road, and of the ground between the roads.

use std::collections::HashMap;

use crate::geometry::{P2, cross};
use crate::network::Network;
use crate::ring::{Ring, triangulate};

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

/// Height of a road's reference line over its length; level at both ends, so that junctions can be level.
#[derive(Clone, Debug, PartialEq)]
pub struct Elevation {
    /// In order; the first begins at 0.
    pub pieces: Vec<Piece>,
}

impl Elevation {
    /// From one height to another over `length_m`; on the way `crest_m` above (below) the mean of both.
    pub fn between(length_m: f64, from_m: f64, to_m: f64, crest_m: f64) -> Elevation {
        let piece = |s_m: f64, length: f64, a_m: f64, b_m: f64| {
            let rise = b_m - a_m;
            Piece { s_m, a_m, c: 3.0 * rise / length.powi(2), d: -2.0 * rise / length.powi(3) }
        };
        if crest_m == 0.0 {
            return Elevation { pieces: vec![piece(0.0, length_m, from_m, to_m)] };
        }
        let (half, top) = (0.5 * length_m, 0.5 * (from_m + to_m) + crest_m);
        Elevation { pieces: vec![piece(0.0, half, from_m, top), piece(half, half, top, to_m)] }
    }

    /// Height at a station.
    pub fn at(&self, s_m: f64) -> f64 {
        let piece = self.pieces.iter().rev().find(|piece| piece.s_m <= s_m).unwrap_or(&self.pieces[0]);
        let u = s_m - piece.s_m;
        piece.a_m + u * u * (piece.c + u * piece.d)
    }

    /// Whether the whole road has one height.
    pub fn is_level(&self) -> bool {
        self.pieces.iter().all(|piece| piece.c == 0.0 && piece.d == 0.0)
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
    /// The ground under a network with its blocks.
    pub fn build(network: &Network, rings: &[Ring], hills_m: f64) -> Terrain {
        let mut terrain = Terrain::default();
        if network.is_level() && hills_m == 0.0 {
            return terrain;
        }
        for road in &network.roads {
            let kerb = road.profile.kerb_m();
            for pair in road.stations().windows(2) {
                let at = |s: f64, t: f64| lifted(road.path.beside(s, t), road.elevation.at(s));
                terrain.polygon(&[at(pair[0], -kerb), at(pair[1], -kerb), at(pair[1], kerb), at(pair[0], kerb)]);
            }
        }
        for junction in 0..network.junctions.len() {
            let border: Vec<[f64; 3]> =
                network.border(junction).into_iter().map(|p| lifted(p, network.junctions[junction].height_m)).collect();
            terrain.polygon(&border);
        }
        for ring in rings {
            terrain.block(ring, hills_m);
        }
        terrain
    }

    fn block(&mut self, ring: &Ring, hills_m: f64) {
        let n = ring.kerb_m.len();
        let back = |i: usize| lifted(ring.back_m[i], ring.height_m[i]);
        for i in 0..n {
            let k = (i + 1) % n;
            self.polygon(&[lifted(ring.kerb_m[i], ring.height_m[i]), lifted(ring.kerb_m[k], ring.height_m[k]), back(k), back(i)]);
            if ring.outside {
                for shares in OUTWARD.windows(2) {
                    let out = |i: usize, share: f64| {
                        let p = outward(ring.back_m[i], share);
                        lifted(p, hill(p, ring.height_m[i], share, hills_m))
                    };
                    self.polygon(&[out(i, shares[0]), out(k, shares[0]), out(k, shares[1]), out(i, shares[1])]);
                }
            }
        }
        if !ring.outside {
            for triangle in triangulate(&ring.back_m) {
                self.polygon(&triangle.map(back));
            }
        }
    }

    fn polygon(&mut self, corners: &[[f64; 3]]) {
        for i in 1..corners.len() - 1 {
            let t = [corners[0], corners[i], corners[i + 1]];
            let idx = self.triangles.len();
            let span = |axis: usize| {
                let (low, high) = t.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p[axis]), h.max(p[axis])));
                ((low - 0.1) / CELL_M).floor() as i32..=((high + 0.1) / CELL_M).floor() as i32
            };
            self.triangles.push(t);
            if span(0).count() * span(1).count() > MAX_CELLS {
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
            let w = [cross(c - b, p - b) / area, cross(a - c, p - c) / area, cross(b - a, p - a) / area];
            // How far inside: metres from the nearest edge.
            let inside = (w[0] * area / (c - b).norm()).min(w[1] * area / (a - c).norm()).min(w[2] * area / (b - a).norm());
            if inside > best.0 {
                best = (inside, (0..3).map(|i| w[i] * self.triangles[idx][i][2]).sum());
            }
        }
        best.1
    }
}

fn lifted(p: P2, z_m: f64) -> [f64; 3] {
    [p.x, p.y, z_m]
}

/// Where the ground outside the town has corners: shares of the way to the horizon.
pub const OUTWARD: [f64; 6] = [0.0, 0.06, 0.2, 0.4, 0.7, 1.0];

/// A point on the way from the town's border to the horizon.
pub fn outward(p: P2, share: f64) -> P2 {
    p + p.normalize() * (share * (1300.0 - p.norm()))
}

/// Height of the ground outside: what the border has, and hills farther away.
fn hill(p: P2, border_m: f64, share: f64, hills_m: f64) -> f64 {
    let wave = 0.5 + 0.3 * (p.x * 0.0061 + 1.0).sin() * (p.y * 0.0047).cos() + 0.2 * (p.x * 0.011 - p.y * 0.013).sin();
    let far = ((share - 0.05) / 0.35).clamp(0.0, 1.0);
    border_m * (1.0 - far) + hills_m * wave * far
}
