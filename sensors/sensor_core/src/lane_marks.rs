//! Lane invasion: painted lines of the roads, and which of them a moving box went over.
//!
//! Plain geometry: the four lower corners of the box go in straight lines from where they were to
//! where they are, and a corner whose way crosses a line in the plan invades. Lines above or below
//! (a bridge, a tunnel) do not count.

use std::collections::BTreeMap;

use schema_frames::LaneCrossing;

/// Side of a cell of the search grid, metres.
const CELL_M: f64 = 8.0;
/// Corners and lines farther apart in height do not meet, metres.
const SAME_LEVEL_M: f64 = 1.5;
/// A longer way within a tick is a jump and no drive, metres.
const LONGEST_WAY_M: f64 = 50.0;

/// One painted line of a map.
#[derive(Clone, Debug, PartialEq)]
pub struct PaintedLine {
    /// What it is, as [`LaneCrossing`] has it: time and place are left zero.
    pub what: LaneCrossing,
    /// Points along it, world, metres.
    pub points: Vec<[f64; 3]>,
}

/// All painted lines of a map.
#[derive(Clone, Debug, Default)]
pub struct PaintedLines {
    lines: Vec<PaintedLine>,
    /// (line, index of its first point) by cell.
    cells: BTreeMap<(i64, i64), Vec<(u32, u32)>>,
}

/// Lower corners of a box in the world.
pub type Corners = [[f64; 3]; 4];

impl PaintedLines {
    /// Sorts lines into a grid.
    pub fn new(lines: Vec<PaintedLine>) -> Self {
        let mut cells = BTreeMap::<_, Vec<_>>::new();
        for (line_idx, line) in lines.iter().enumerate() {
            for (idx, ends) in line.points.windows(2).enumerate() {
                for cell in cells_of(ends[0], ends[1]) {
                    cells
                        .entry(cell)
                        .or_default()
                        .push((line_idx as u32, idx as u32));
                }
            }
        }
        PaintedLines { lines, cells }
    }

    /// Lines that some corner went over on its way, each once, by the time of its first crossing.
    pub fn crossings(
        &self,
        before: &Corners,
        now: &Corners,
        window_nanos: u64,
    ) -> Vec<LaneCrossing> {
        let mut first = BTreeMap::<u32, (f64, [f64; 3])>::new();
        for (from, to) in before.iter().zip(now) {
            let way_m = (to[0] - from[0]).hypot(to[1] - from[1]);
            // NaN is no way either.
            if !(way_m > 0.0 && way_m <= LONGEST_WAY_M) {
                continue;
            }
            let near = cells_of(*from, *to)
                .filter_map(|cell| self.cells.get(&cell))
                .flatten();
            for (line_idx, idx) in near {
                let points = &self.lines[*line_idx as usize].points;
                let Some((share, place)) =
                    crossing(*from, *to, points[*idx as usize], points[*idx as usize + 1])
                else {
                    continue;
                };
                let known = first.entry(*line_idx).or_insert((share, place));
                if share < known.0 {
                    *known = (share, place);
                }
            }
        }
        let mut found: Vec<LaneCrossing> = first
            .into_iter()
            .map(|(line_idx, (share, place))| LaneCrossing {
                nanos_in_window: (share * window_nanos as f64).min(u32::MAX as f64) as u32,
                crossing_in_world_m: place.map(|x| x as f32),
                ..self.lines[line_idx as usize].what
            })
            .collect();
        found.sort_by_key(|crossing| crossing.nanos_in_window);
        found
    }
}

/// Cells that the box about a segment touches.
fn cells_of(a: [f64; 3], b: [f64; 3]) -> impl Iterator<Item = (i64, i64)> {
    let cell = |x: f64| (x / CELL_M).floor() as i64;
    let (x0, x1) = (cell(a[0].min(b[0])), cell(a[0].max(b[0])));
    let (y0, y1) = (cell(a[1].min(b[1])), cell(a[1].max(b[1])));
    (y0..=y1).flat_map(move |y| (x0..=x1).map(move |x| (x, y)))
}

/// Share of the way from `from` to `to` at which it crosses the segment `a`–`b` in the plan, and
/// where.
///
/// A way that begins on the line has crossed it already; one that ends on it crosses now.
fn crossing(from: [f64; 3], to: [f64; 3], a: [f64; 3], b: [f64; 3]) -> Option<(f64, [f64; 3])> {
    let way = [to[0] - from[0], to[1] - from[1]];
    let line = [b[0] - a[0], b[1] - a[1]];
    let cross = way[0] * line[1] - way[1] * line[0];
    if cross == 0.0 {
        return None;
    }
    let gap = [a[0] - from[0], a[1] - from[1]];
    let share = (gap[0] * line[1] - gap[1] * line[0]) / cross;
    let along = (gap[0] * way[1] - gap[1] * way[0]) / cross;
    if !(share > 0.0 && share <= 1.0 && (0.0..=1.0).contains(&along)) {
        return None;
    }
    let place = std::array::from_fn(|axis| from[axis] + share * (to[axis] - from[axis]));
    let height_m = a[2] + along * (b[2] - a[2]);
    ((place[2] - height_m).abs() <= SAME_LEVEL_M).then_some((share, place))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(lane: i8, points: Vec<[f64; 3]>) -> PaintedLine {
        PaintedLine {
            what: LaneCrossing {
                lane,
                mark: 2,
                width_m: 0.15,
                ..bytemuck::Zeroable::zeroed()
            },
            points,
        }
    }

    /// A box 4 m long and 2 m wide, its axes the world's.
    fn corners(x: f64, y: f64, z: f64) -> Corners {
        [
            [x + 2.0, y + 1.0, z],
            [x + 2.0, y - 1.0, z],
            [x - 2.0, y - 1.0, z],
            [x - 2.0, y + 1.0, z],
        ]
    }

    #[test]
    fn a_lane_change_crosses_the_line_between_once_per_tick_and_at_its_time() {
        let lines = PaintedLines::new(vec![
            line(-1, (-20..20).map(|i| [i as f64 * 5.0, 1.75, 0.0]).collect()),
            line(1, vec![[-100.0, -1.75, 0.0], [100.0, -1.75, 0.0]]),
        ]);
        // The left wheels drift from y = 1 to 2: both left corners cross 1.75 at three quarters of
        // the way.
        let found = lines.crossings(&corners(0.0, 0.0, 0.1), &corners(1.0, 1.0, 0.1), 40_000_000);
        assert_eq!(found.len(), 1);
        assert_eq!(
            (found[0].lane, found[0].mark, found[0].nanos_in_window),
            (-1, 2, 30_000_000)
        );
        assert!((found[0].crossing_in_world_m[1] - 1.75).abs() < 1e-6);
        assert!(
            lines
                .crossings(&corners(1.0, 1.0, 0.1), &corners(2.0, 1.1, 0.1), 40_000_000)
                .is_empty(),
            "astride is no crossing"
        );
    }

    #[test]
    fn driving_along_a_line_or_standing_crosses_nothing() {
        let lines = PaintedLines::new(vec![line(-1, vec![[-100.0, 1.0, 0.0], [100.0, 1.0, 0.0]])]);
        assert!(
            lines
                .crossings(&corners(0.0, 0.0, 0.0), &corners(5.0, 0.0, 0.0), 1)
                .is_empty()
        );
        assert!(
            lines
                .crossings(&corners(0.0, 0.5, 0.0), &corners(0.0, 0.5, 0.0), 1)
                .is_empty()
        );
    }

    #[test]
    fn a_line_on_a_bridge_above_and_a_jump_do_not_count() {
        let lines = PaintedLines::new(vec![line(-1, vec![[0.0, -100.0, 6.0], [0.0, 100.0, 6.0]])]);
        assert!(
            lines
                .crossings(&corners(-3.0, 0.0, 0.0), &corners(-1.0, 0.0, 0.0), 1)
                .is_empty()
        );
        assert_eq!(
            lines
                .crossings(&corners(-3.0, 0.0, 5.9), &corners(-1.0, 0.0, 5.9), 1)
                .len(),
            1
        );
        assert!(
            lines
                .crossings(&corners(-300.0, 0.0, 5.9), &corners(300.0, 0.0, 5.9), 1)
                .is_empty()
        );
    }

    #[test]
    fn random_ways_cross_a_straight_line_exactly_when_their_ends_lie_on_both_sides() {
        let (a, b) = ([-40.0, 3.0, 0.0], [35.0, -7.0, 0.0]);
        let points: Vec<[f64; 3]> = (0..=30)
            .map(|i| std::array::from_fn(|k| a[k] + (b[k] - a[k]) * i as f64 / 30.0))
            .collect();
        let lines = PaintedLines::new(vec![line(-1, points)]);
        let side =
            |p: [f64; 3]| ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])).signum();
        let mut rng = fastrand::Rng::with_seed(4);
        for _ in 0..2000 {
            let from = [rng.f64() * 40.0 - 20.0, rng.f64() * 20.0 - 10.0, 0.0];
            let to = [
                from[0] + rng.f64() * 8.0 - 4.0,
                from[1] + rng.f64() * 8.0 - 4.0,
                0.0,
            ];
            let found = lines.crossings(&[from; 4], &[to; 4], 1000);
            assert_eq!(
                found.len(),
                (side(from) != side(to)) as usize,
                "{from:?} {to:?}"
            );
        }
    }
}
