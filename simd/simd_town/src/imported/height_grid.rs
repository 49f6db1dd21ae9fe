//! The ground between and around the roads: a grid of heights that stays under every road and is
//! smooth elsewhere.

use schema_roads::SectionSurface;

use crate::geometry::P2;
use crate::scenery::{Grid, Terrain};

/// Least side of a cell.
const CELL_M: f64 = 8.0;
/// Greatest number of cells.
const MAX_CELLS: f64 = 250_000.0;
/// Width of the ground round the roads, and of the apron beyond it.
const MARGIN_M: f64 = 140.0;
const HORIZON_M: f64 = 1500.0;
/// Depth of the ground under the lowest road near it.
const CLEARANCE_M: f64 = 0.06;

/// Heights at the corners of square cells.
pub(super) struct HeightGrid {
    grid: Grid,
}

impl HeightGrid {
    /// Side of a cell, metres.
    pub fn cell_m(&self) -> f64 {
        self.grid.cell_m
    }

    /// The ground under these lanes.
    pub fn new(sections: &[SectionSurface]) -> HeightGrid {
        let points = || {
            sections.iter().flat_map(|s| {
                s.lanes
                    .iter()
                    .flat_map(|lane| lane.points_m.iter())
                    .chain(&s.centre_m)
            })
        };
        let (mut low, mut high) = (P2::repeat(f64::INFINITY), P2::repeat(f64::NEG_INFINITY));
        for p in points() {
            (low, high) = (
                low.inf(&P2::new(p[0], p[1])),
                high.sup(&P2::new(p[0], p[1])),
            );
        }
        if !(low.x.is_finite() && high.x.is_finite()) {
            (low, high) = (P2::zeros(), P2::zeros());
        }
        (low, high) = (low.add_scalar(-MARGIN_M), high.add_scalar(MARGIN_M));
        let size = high - low;
        let cell_m = CELL_M
            .max((size.x * size.y / MAX_CELLS).sqrt())
            .max(size.x.max(size.y) / MAX_CELLS);
        let (columns, rows) = (
            (size.x / cell_m).ceil() as usize + 1,
            (size.y / cell_m).ceil() as usize + 1,
        );
        let mut ground = HeightGrid {
            grid: Grid {
                low_m: low,
                cell_m,
                columns,
                rows,
                z_m: vec![f64::INFINITY; columns * rows],
            },
        };
        for section in sections {
            for lane in &section.lanes {
                for row in 1..section.stations_m.len() {
                    let (a, b) = (lane.row(row - 1), lane.row(row));
                    for p in a.iter().chain(b) {
                        ground.press(*p);
                    }
                    // Lanes wider than a cell and rows farther apart than a cell are rare; the
                    // middle point covers both.
                    let last = lane.columns - 1;
                    ground.press(std::array::from_fn(|i| {
                        0.25 * (a[0][i] + a[last][i] + b[0][i] + b[last][i])
                    }));
                }
            }
        }
        ground.fill();
        ground
    }

    /// Keeps the grid's corners near a point of a road under that point.
    fn press(&mut self, p: [f64; 3]) {
        let (x, y) = (
            ((p[0] - self.grid.low_m.x) / self.grid.cell_m).floor() as i64,
            ((p[1] - self.grid.low_m.y) / self.grid.cell_m).floor() as i64,
        );
        for row in (y - 1).max(0)..=(y + 2).min(self.grid.rows as i64 - 1) {
            for column in (x - 1).max(0)..=(x + 2).min(self.grid.columns as i64 - 1) {
                let z = &mut self.grid.z_m[row as usize * self.grid.columns + column as usize];
                *z = z.min(p[2] - CLEARANCE_M);
            }
        }
    }

    /// Heights where there is no road: layer by layer outwards from the roads, then smoothed.
    fn fill(&mut self) {
        let fixed: Vec<bool> = self.grid.z_m.iter().map(|z| z.is_finite()).collect();
        let mut known = fixed.clone();
        let mut edge: Vec<usize> = (0..known.len()).filter(|i| known[*i]).collect();
        if edge.is_empty() {
            self.grid.z_m.fill(-CLEARANCE_M);
            return;
        }
        while !edge.is_empty() {
            let mut next: Vec<usize> = edge
                .iter()
                .flat_map(|i| self.around(*i))
                .filter(|i| !known[*i])
                .collect();
            next.sort_unstable();
            next.dedup();
            let heights: Vec<f64> = next
                .iter()
                .map(|i| self.mean_of(*i, |k| known[k]))
                .collect();
            for (i, z) in next.iter().zip(heights) {
                (self.grid.z_m[*i], known[*i]) = (z, true);
            }
            edge = next;
        }
        for _ in 0..24 {
            for i in (0..fixed.len()).filter(|i| !fixed[*i]) {
                self.grid.z_m[i] = self.mean_of(i, |_| true);
            }
        }
    }

    fn around(&self, i: usize) -> impl Iterator<Item = usize> + use<> {
        let (columns, rows) = (self.grid.columns as i64, self.grid.rows as i64);
        let (x, y) = (
            (i % self.grid.columns) as i64,
            (i / self.grid.columns) as i64,
        );
        [(-1, 0), (1, 0), (0, -1), (0, 1)]
            .into_iter()
            .map(move |(dx, dy)| (x + dx, y + dy))
            .filter(move |(x, y)| (0..columns).contains(x) && (0..rows).contains(y))
            .map(move |(x, y)| (y * columns + x) as usize)
    }

    fn mean_of(&self, i: usize, counts: impl Fn(usize) -> bool) -> f64 {
        let (mut sum, mut n) = (0.0, 0);
        for k in self.around(i).filter(|k| counts(*k)) {
            sum += self.grid.z_m[k];
            n += 1;
        }
        if n == 0 {
            self.grid.z_m[i]
        } else {
            sum / f64::from(n)
        }
    }

    fn corner(&self, column: usize, row: usize) -> [f64; 3] {
        let (x, y) = (
            self.grid.low_m.x + column as f64 * self.grid.cell_m,
            self.grid.low_m.y + row as f64 * self.grid.cell_m,
        );
        [x, y, self.grid.z_m[row * self.grid.columns + column]]
    }

    /// Height at a point; beyond the rim, the height of the rim.
    pub fn at(&self, p: P2) -> f64 {
        self.grid.at(p)
    }

    /// The same heights as a [`Terrain`].
    pub fn terrain(&self) -> Terrain {
        Terrain::of_grid(self.grid.clone())
    }

    /// Coarse cells in square pieces: the middle of a piece, and its quads, counter-clockwise from
    /// above, nowhere higher than the grid near them.
    pub fn coarse(&self, piece_m: f64, coarse_m: f64) -> Vec<(P2, Vec<[[f64; 3]; 4]>)> {
        let step = (coarse_m / self.grid.cell_m).ceil().max(1.0) as usize;
        let per_piece = (piece_m / self.grid.cell_m).ceil().max(1.0) as usize / step * step;
        let per_piece = per_piece.max(step);
        let (columns, rows) = (self.grid.columns, self.grid.rows);
        // A corner is as low as the lowest of the cells round it.
        let low = |column: usize, row: usize| {
            let mut z = f64::INFINITY;
            for r in row.saturating_sub(step)..=(row + step).min(rows - 1) {
                for c in column.saturating_sub(step)..=(column + step).min(columns - 1) {
                    z = z.min(self.grid.z_m[r * columns + c]);
                }
            }
            let [x, y, _] = self.corner(column, row);
            [x, y, z]
        };
        let ends = |from: usize, n: usize| (from + step).min(n - 1);
        let mut pieces = Vec::new();
        for row in (0..rows - 1).step_by(per_piece) {
            for column in (0..columns - 1).step_by(per_piece) {
                let mut quads = Vec::new();
                for r in (row..(row + per_piece).min(rows - 1)).step_by(step) {
                    for c in (column..(column + per_piece).min(columns - 1)).step_by(step) {
                        let (c1, r1) = (ends(c, columns), ends(r, rows));
                        quads.push([low(c, r), low(c1, r), low(c1, r1), low(c, r1)]);
                    }
                }
                let half = 0.5 * per_piece as f64 * self.grid.cell_m;
                let [x, y, _] = self.corner(column, row);
                pieces.push((P2::new(x + half, y + half), quads));
            }
        }
        pieces
    }

    pub fn cells(&self, mut visit: impl FnMut([[f64; 3]; 3])) {
        for row in 1..self.grid.rows {
            for column in 1..self.grid.columns {
                let [a, b] = [
                    self.corner(column - 1, row - 1),
                    self.corner(column, row - 1),
                ];
                let [c, d] = [self.corner(column, row), self.corner(column - 1, row)];
                visit([a, b, c]);
                visit([a, c, d]);
            }
        }
    }

    /// Quads from the rim to the horizon.
    pub fn apron(&self, mut visit: impl FnMut([[f64; 3]; 4])) {
        let (right, top) = (self.grid.columns - 1, self.grid.rows - 1);
        let mut rim: Vec<[f64; 3]> = (0..right).map(|x| self.corner(x, 0)).collect();
        rim.extend((0..top).map(|y| self.corner(right, y)));
        rim.extend((0..right).map(|x| self.corner(right - x, top)));
        rim.extend((0..top).map(|y| self.corner(0, top - y)));
        let middle = self.grid.low_m + P2::new(right as f64, top as f64) * (0.5 * self.grid.cell_m);
        let out = |p: [f64; 3]| {
            let away = P2::new(p[0], p[1]) - middle;
            let far = away * (1.0 + HORIZON_M / away.norm().max(1.0)) + middle;
            [far.x, far.y, p[2] - 0.5]
        };
        for i in 0..rim.len() {
            let (a, b) = (rim[i], rim[(i + 1) % rim.len()]);
            visit([a, out(a), out(b), b]);
        }
    }
}
