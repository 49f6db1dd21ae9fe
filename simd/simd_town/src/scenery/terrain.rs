//! Height of the ground at any place, looked up in triangles.

use std::collections::HashMap;

use crate::geometry::{P2, cross};

/// Side of the cells in which triangles are looked up.
const CELL_M: f64 = 12.0;
/// Triangles in more cells than this are looked up one by one.
const MAX_CELLS: usize = 400;

/// Heights at the corners of square cells, each cut from its first to its last corner.
#[derive(Clone, Debug, Default)]
pub struct Grid {
    /// The first corner.
    pub low_m: P2,
    /// Side of a cell.
    pub cell_m: f64,
    /// Corners along x.
    pub columns: usize,
    /// Corners along y.
    pub rows: usize,
    /// Heights, row after row.
    pub z_m: Vec<f64>,
}

impl Grid {
    /// Height at a point; beyond the rim, the height of the rim.
    pub fn at(&self, p: P2) -> f64 {
        let place = |x: f64, low: f64, n: usize| {
            ((x - low) / self.cell_m)
                .clamp(0.0, (n - 1) as f64 - 1e-6)
                .max(0.0)
        };
        let (x, y) = (
            place(p.x, self.low_m.x, self.columns),
            place(p.y, self.low_m.y, self.rows),
        );
        let (column, row) = (x as usize, y as usize);
        let (u, v) = (x - column as f64, y - row as f64);
        let z = |dx: usize, dy: usize| {
            self.z_m
                [(row + dy).min(self.rows - 1) * self.columns + (column + dx).min(self.columns - 1)]
        };
        let (a, b, c, d) = (z(0, 0), z(1, 0), z(1, 1), z(0, 1));
        if u >= v {
            a + u * (b - a) + v * (c - b)
        } else {
            a + u * (c - d) + v * (d - a)
        }
    }
}

/// Height of the ground at street level, without kerbs. Level ground holds no triangles.
#[derive(Default)]
pub struct Terrain {
    /// Heights everywhere, in place of triangles.
    grid: Option<Grid>,
    triangles: Vec<[[f64; 3]; 3]>,
    cells: HashMap<(i32, i32), Vec<usize>>,
    wide: Vec<usize>,
}

impl Terrain {
    /// The ground of a grid.
    pub fn of_grid(grid: Grid) -> Terrain {
        Terrain {
            grid: Some(grid),
            ..Terrain::default()
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
        if let Some(grid) = &self.grid {
            return grid.at(p);
        }
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
            // Distance of the point from the nearest edge, positive inside, metres.
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
