//! Nearest lane: a grid over short chords of all lane middles.

use crate::lane::Lane;
use crate::lane_shape::LaneShape;
use crate::raw::RawMap;

/// Side of a cell, metres.
const CELL_M: f64 = 8.0;
/// Most cells; a sparser map gets larger cells.
const MAX_CELLS: f64 = 4.0e6;

/// Number of chords beyond which chords become longer.
const MAX_CHORDS: f64 = 2.0e6;
/// Length of a chord in maps of ordinary size, metres.
const CHORD_M: f64 = 2.0;
/// Most chords that are cut in two for a tight bend; a map that has more such bends is no road
/// network.
const MAX_HALVINGS: u32 = 100_000;
/// How far a chord may lie off the lane it stands for, metres.
const SLACK_M: f64 = 0.15;

/// A chord of one lane's middle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Chord {
    pub from_m: [f64; 3],
    pub to_m: [f64; 3],
    pub lane: u32,
    /// Lane s at both ends.
    pub s_m: [f64; 2],
}

impl Chord {
    /// Squared distance of `p` from the chord, and the share of the chord before the foot of the
    /// perpendicular.
    pub fn foot(&self, p: [f64; 3]) -> (f64, f64) {
        let d: [f64; 3] = std::array::from_fn(|i| self.to_m[i] - self.from_m[i]);
        let r: [f64; 3] = std::array::from_fn(|i| p[i] - self.from_m[i]);
        let length2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        let share = if length2 > 0.0 {
            ((r[0] * d[0] + r[1] * d[1] + r[2] * d[2]) / length2).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let e: [f64; 3] = std::array::from_fn(|i| r[i] - share * d[i]);
        (e[0] * e[0] + e[1] * e[1] + e[2] * e[2], share)
    }
}

/// Grid of chords.
#[derive(Clone, Debug)]
pub(crate) struct Grid {
    chords: Vec<Chord>,
    origin_m: [f64; 2],
    cell_m: f64,
    columns: i64,
    rows: i64,
    /// Start of each cell's list in `entries`, and the end of the last.
    starts: Vec<u32>,
    entries: Vec<u32>,
}

impl Grid {
    /// The grid over these chords. All coordinates must be finite.
    pub fn new(chords: Vec<Chord>) -> Grid {
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for chord in &chords {
            for p in [chord.from_m, chord.to_m] {
                for axis in 0..2 {
                    low[axis] = low[axis].min(p[axis]);
                    high[axis] = high[axis].max(p[axis]);
                }
            }
        }
        if chords.is_empty() {
            (low, high) = ([0.0; 2], [0.0; 2]);
        }
        let area = (high[0] - low[0] + CELL_M) * (high[1] - low[1] + CELL_M);
        let longest = (high[0] - low[0]).max(high[1] - low[1]);
        let cell_m = CELL_M
            .max((area / MAX_CELLS).sqrt())
            .max(longest / (MAX_CELLS / 4.0));
        let columns = ((high[0] - low[0]) / cell_m) as i64 + 1;
        let rows = ((high[1] - low[1]) / cell_m) as i64 + 1;
        let mut grid = Grid {
            chords,
            origin_m: low,
            cell_m,
            columns,
            rows,
            starts: Vec::new(),
            entries: Vec::new(),
        };
        grid.fill();
        grid
    }

    fn cell(&self, x_m: f64, y_m: f64) -> (i64, i64) {
        (
            ((x_m - self.origin_m[0]) / self.cell_m).floor() as i64,
            ((y_m - self.origin_m[1]) / self.cell_m).floor() as i64,
        )
    }

    /// Counting sort of the chords by the cell of their middle.
    fn fill(&mut self) {
        let cell_of = |chord: &Chord| {
            let (column, row) = self.cell(
                0.5 * (chord.from_m[0] + chord.to_m[0]),
                0.5 * (chord.from_m[1] + chord.to_m[1]),
            );
            (row.clamp(0, self.rows - 1) * self.columns + column.clamp(0, self.columns - 1))
                as usize
        };
        let cells: Vec<usize> = self.chords.iter().map(cell_of).collect();
        let mut starts = vec![0u32; (self.columns * self.rows) as usize + 1];
        for cell in &cells {
            starts[cell + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut next = starts.clone();
        let mut entries = vec![0u32; cells.len()];
        for (idx, cell) in cells.iter().enumerate() {
            entries[next[*cell] as usize] = idx as u32;
            next[*cell] += 1;
        }
        (self.starts, self.entries) = (starts, entries);
    }

    /// The nearest chord of each lane that passes, for lanes within `slack_m` of the nearest, with
    /// the share of the chord before the foot. Chords are shorter than `reach_m`, so a chord listed
    /// in a cell reaches at most half of that beyond it.
    pub fn near(
        &self,
        p: [f64; 3],
        reach_m: f64,
        slack_m: f64,
        mut passes: impl FnMut(u32) -> bool,
    ) -> Vec<(Chord, f64)> {
        let (column, row) = self.cell(p[0], p[1]);
        // Rings are counted from the cell inside the grid that is nearest to the point.
        let (column, row) = (
            column.clamp(0, self.columns - 1),
            row.clamp(0, self.rows - 1),
        );
        let mut limit = f64::INFINITY;
        let mut found: Vec<(f64, Chord, f64)> = Vec::new();
        for ring in 0..=self.columns.max(self.rows) {
            if self.ring_distance(p, column, row, ring) - 0.5 * reach_m > limit {
                break;
            }
            self.visit_ring(column, row, ring, |chord| {
                let (distance2, share) = chord.foot(p);
                let distance = distance2.sqrt();
                if distance > limit || !passes(chord.lane) {
                    return;
                }
                limit = limit.min(distance + slack_m);
                match found.iter_mut().find(|f| f.1.lane == chord.lane) {
                    Some(known) if known.0 <= distance => {}
                    Some(known) => *known = (distance, *chord, share),
                    None => found.push((distance, *chord, share)),
                }
                found.retain(|f| f.0 <= limit);
            });
        }
        found
            .into_iter()
            .map(|(_, chord, share)| (chord, share))
            .collect()
    }

    /// Least horizontal distance from `p` to the cells of the ring and beyond it. Sides on which
    /// the grid has no such cells do not count.
    fn ring_distance(&self, p: [f64; 3], column: i64, row: i64, ring: i64) -> f64 {
        let side = |x: f64, origin: f64, cell: i64, cells: i64| {
            let low = if cell - ring < 0 {
                f64::INFINITY
            } else {
                x - (origin + (cell - ring + 1) as f64 * self.cell_m)
            };
            let high = if cell + ring >= cells {
                f64::INFINITY
            } else {
                origin + (cell + ring) as f64 * self.cell_m - x
            };
            low.min(high)
        };
        side(p[0], self.origin_m[0], column, self.columns).min(side(
            p[1],
            self.origin_m[1],
            row,
            self.rows,
        ))
    }

    /// Visits the cells whose larger distance in columns or rows is exactly `ring`.
    fn visit_ring(&self, column: i64, row: i64, ring: i64, mut visit: impl FnMut(&Chord)) {
        let columns = (column - ring).max(0)..=(column + ring).min(self.columns - 1);
        let rows = (row - ring).max(0)..=(row + ring).min(self.rows - 1);
        let sides = if ring == 0 { &[0][..] } else { &[-1, 1][..] };
        for r in sides
            .iter()
            .map(|side| row + side * ring)
            .filter(|r| rows.contains(r))
        {
            columns
                .clone()
                .for_each(|c| self.visit_cell(c, r, &mut visit));
        }
        for c in sides
            .iter()
            .map(|side| column + side * ring)
            .filter(|c| ring > 0 && columns.contains(c))
        {
            // The corners belong to the rows above.
            let between = rows.clone().filter(|r| (r - row).abs() < ring);
            between.for_each(|r| self.visit_cell(c, r, &mut visit));
        }
    }

    fn visit_cell(&self, column: i64, row: i64, visit: &mut impl FnMut(&Chord)) {
        let cell = (row * self.columns + column) as usize;
        for entry in &self.entries[self.starts[cell] as usize..self.starts[cell + 1] as usize] {
            visit(&self.chords[*entry as usize]);
        }
    }
}

/// The chords of all lanes of a map.
#[derive(Clone, Debug)]
pub(crate) struct LaneChords {
    grid: Grid,
    /// Greatest horizontal extent of a chord, metres.
    reach_m: f64,
}

impl LaneChords {
    /// Chords of these lanes, which belong to this map.
    pub fn new(map: &RawMap, lanes: &[Lane]) -> LaneChords {
        let total_m: f64 = lanes.iter().map(|lane| lane.length_m).sum();
        let step_m = CHORD_M.max(total_m / MAX_CHORDS);
        let mut chords: Vec<Chord> = Vec::new();
        let mut halvings = MAX_HALVINGS;
        for (idx, lane) in lanes.iter().enumerate() {
            let pieces = (lane.length_m / step_m).ceil().max(1.0) as usize;
            let at = |i: usize| lane.length_m * i as f64 / pieces as f64;
            let shape = LaneShape::of(map, lane);
            let mut from_m = shape.middle_point(0.0);
            for i in 0..pieces {
                let to_m = shape.middle_point(at(i + 1));
                let chord = Chord {
                    from_m,
                    to_m,
                    lane: idx as u32,
                    s_m: [at(i), at(i + 1)],
                };
                add_chords(&shape, &mut chords, chord, &mut halvings);
                from_m = to_m;
            }
        }
        let reach = |c: &Chord| (c.to_m[0] - c.from_m[0]).hypot(c.to_m[1] - c.from_m[1]);
        LaneChords {
            reach_m: chords.iter().map(reach).fold(0.0, f64::max),
            grid: Grid::new(chords),
        }
    }

    /// The nearest chord of each lane that passes, for lanes that may be the nearest, with the
    /// share of the chord before the foot.
    pub fn near(&self, p: [f64; 3], passes: impl FnMut(u32) -> bool) -> Vec<(Chord, f64)> {
        self.grid.near(p, self.reach_m, SLACK_M, passes)
    }
}

/// Adds the chord. Where the lane's middle is farther from it than half the slack, because the bend
/// is tight, adds chords of its two halves instead.
fn add_chords(shape: &LaneShape<'_>, chords: &mut Vec<Chord>, chord: Chord, halvings: &mut u32) {
    const SHORTEST_M: f64 = 0.05;
    let half_s_m = 0.5 * (chord.s_m[0] + chord.s_m[1]);
    if *halvings > 0 && chord.s_m[1] - chord.s_m[0] > SHORTEST_M {
        let half_m = shape.middle_point(half_s_m);
        if chord.foot(half_m).0.sqrt() > 0.5 * SLACK_M {
            *halvings -= 1;
            add_chords(
                shape,
                chords,
                Chord {
                    to_m: half_m,
                    s_m: [chord.s_m[0], half_s_m],
                    ..chord
                },
                halvings,
            );
            add_chords(
                shape,
                chords,
                Chord {
                    from_m: half_m,
                    s_m: [half_s_m, chord.s_m[1]],
                    ..chord
                },
                halvings,
            );
            return;
        }
    }
    if chord
        .from_m
        .iter()
        .chain(&chord.to_m)
        .all(|x| x.is_finite() && x.abs() < 1e9)
    {
        chords.push(chord);
    }
}
