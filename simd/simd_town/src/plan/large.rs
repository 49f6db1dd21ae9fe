//! Plans of the large towns: hundreds of kilometres of roads in squares of a kilometre, each of
//! them centre, suburb or country.
//!
//! Only their streets are planned here; what stands beside them is grown along the roads as for any
//! map (`imported`), because scenery by blocks would take too long for so many.

use super::layout::{AVENUE, Edge, HIGHWAY, Houses, Plan, Profile, STREET};
use super::sketch::{BOULEVARD, COUNTRY, HIGH_STREET, LANE, Sketch};
use crate::geometry::{P2, left};

/// Side of a square, and of the smallest block.
const SQUARE_M: f64 = 1000.0;
const BLOCK_M: f64 = 125.0;
/// Blocks along a side of a square.
const N: usize = 8;
/// How far junctions are moved at random.
const MOVED_M: f64 = 9.0;
/// Least length of a street with speed-limit signs: thousands of them would be actors of every
/// tick.
const SIGNED_FROM_M: f64 = 300.0;

/// A street of a centre without parked cars.
const SIDE_STREET: Profile = Profile {
    edge: Edge::Gutter,
    edge_m: 0.6,
    ..STREET
};

/// What is in a square.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// Blocks of 125 m, every junction a crossing.
    Centre,
    /// Blocks of 250 m by 125 m, every junction a T.
    Town,
    /// Blocks of 250 m.
    Suburb,
    /// A crossing of lanes.
    Village,
    /// Nothing but the roads round it.
    Country,
}

/// Squares of a town, north first: C centre, T town, S suburb, V village, any other letter country.
struct Squares(&'static [&'static str]);

impl Squares {
    fn columns(&self) -> usize {
        self.0[0].len()
    }

    fn rows(&self) -> usize {
        self.0.len()
    }

    /// The square in this column and row from the south; country outside.
    fn at(&self, column: i64, row: i64) -> Kind {
        let row = self.rows() as i64 - 1 - row;
        let line = usize::try_from(row).ok().and_then(|row| self.0.get(row));
        let letter = line.and_then(|line| line.as_bytes().get(usize::try_from(column).ok()?));
        match letter {
            Some(b'C') => Kind::Centre,
            Some(b'T') => Kind::Town,
            Some(b'S') => Kind::Suburb,
            Some(b'V') => Kind::Village,
            _ => Kind::Country,
        }
    }
}

/// Town11: a small town in the open country.
const TOWN11: Squares = Squares(&["......", ".V..V.", "..TS..", "..CT..", ".VSS..", "......"]);
/// Town12: a city with suburbs and the country round it.
const TOWN12: Squares = Squares(&[
    ".......", ".V.S.V.", ".SSTS..", ".STCTS.", "..SCTS.", ".V.SS.V", ".......",
]);
/// Town13: several towns side by side.
const TOWN13: Squares = Squares(&[
    "..V.....", ".STS..V.", "VTCS..S.", ".SS..STS", "..V..STC", ".V....SS", ".SS.V...", ".ST..V..",
]);

/// The plan of a large town.
pub fn large(name: &str, seed: u64) -> Option<Plan> {
    let (squares, stream, place) = match name {
        "Town11" => (TOWN11, 0x111, (35.3, -116.9)),
        "Town12" => (TOWN12, 0x112, (39.74, -104.99)),
        "Town13" => (TOWN13, 0x113, (37.77, -97.33)),
        _ => return None,
    };
    let mut sketch = Sketch::new(name, seed, stream, place, Houses::Cottages);
    sketch.plan.limits_from_m = SIGNED_FROM_M;
    let nodes = nodes(&mut sketch, &squares);
    for column in 0..squares.columns() as i64 {
        for row in 0..squares.rows() as i64 {
            inside(&mut sketch, &nodes, &squares, column, row);
        }
    }
    lattice(&mut sketch, &nodes, &squares);
    sketch.drop_orphans();
    sketch.drop_passages();
    wind(&mut sketch);
    for (p, height) in sketch.plan.nodes_m.iter().zip(&mut sketch.plan.heights_m) {
        *height = 20.0
            + 9.0 * (p.x / 720.0).sin() * (p.y / 810.0).cos()
            + 14.0 * (p.x / 2100.0 + 1.0).sin() * (p.y / 1900.0 - 0.6).sin();
    }
    Some(sketch.plan)
}

/// Nodes of the whole lattice of blocks; those on its rim and at its corners stay in place.
struct Nodes {
    columns: usize,
    numbers: Vec<usize>,
}

impl Nodes {
    fn at(&self, column: usize, row: usize) -> usize {
        self.numbers[row * self.columns + column]
    }
}

fn nodes(sketch: &mut Sketch, squares: &Squares) -> Nodes {
    let (columns, rows) = (squares.columns() * N + 1, squares.rows() * N + 1);
    let low = P2::new(
        -0.5 * SQUARE_M * squares.columns() as f64,
        -0.5 * SQUARE_M * squares.rows() as f64,
    );
    let mut numbers = Vec::with_capacity(columns * rows);
    for row in 0..rows {
        for column in 0..columns {
            let mut moved = || sketch.random.between(-MOVED_M, MOVED_M);
            let by = P2::new(moved(), moved());
            let p = low + P2::new(column as f64, row as f64) * BLOCK_M + by;
            numbers.push(sketch.node(p.x, p.y));
        }
    }
    Nodes { columns, numbers }
}

/// Draws the streets inside a square.
fn inside(sketch: &mut Sketch, nodes: &Nodes, squares: &Squares, column: i64, row: i64) {
    let kind = squares.at(column, row);
    let step = match kind {
        Kind::Centre | Kind::Town => 1,
        Kind::Suburb => 2,
        Kind::Village => 4,
        Kind::Country => return,
    };
    let (x0, y0) = (column as usize * N, row as usize * N);
    for line in (step..N).step_by(step) {
        let profile = match (kind, line) {
            (Kind::Centre | Kind::Town, 4) => AVENUE,
            (Kind::Centre | Kind::Town, _) if line % 3 == 0 => HIGH_STREET,
            (Kind::Centre | Kind::Town, _) if line % 2 == 0 => STREET,
            (Kind::Centre | Kind::Town, _) => SIDE_STREET,
            (Kind::Suburb, 4) => HIGH_STREET,
            _ => LANE,
        };
        for k in (0..N).step_by(step) {
            sketch.chain(
                &[
                    nodes.at(x0 + k, y0 + line),
                    nodes.at(x0 + k + step, y0 + line),
                ],
                profile,
            );
            // Bricks: streets across meet each of these streets from one side only.
            let is_brick = kind == Kind::Town && line != 4 && (line + k) % 2 == 1;
            if !is_brick {
                sketch.chain(
                    &[
                        nodes.at(x0 + line, y0 + k),
                        nodes.at(x0 + line, y0 + k + step),
                    ],
                    profile,
                );
            }
        }
    }
}

/// Draws the roads between the squares.
fn lattice(sketch: &mut Sketch, nodes: &Nodes, squares: &Squares) {
    let (columns, rows) = (squares.columns(), squares.rows());
    let profile = |sides: [Kind; 2], line: usize, last: usize| {
        let has = |kind| sides.contains(&kind);
        let is_trunk = line.is_multiple_of(3) && line > 0 && line < last;
        match (
            is_trunk,
            has(Kind::Centre),
            has(Kind::Town) || has(Kind::Suburb),
        ) {
            (true, true, _) => BOULEVARD,
            (true, false, _) => HIGHWAY,
            (false, true, _) | (false, _, true) => AVENUE,
            _ => COUNTRY,
        }
    };
    for line in 0..=rows {
        for column in 0..columns {
            let sides = [line as i64 - 1, line as i64].map(|row| squares.at(column as i64, row));
            let profile = profile(sides, line, rows);
            for k in 0..N {
                let x = column * N + k;
                sketch.chain(&[nodes.at(x, line * N), nodes.at(x + 1, line * N)], profile);
            }
        }
    }
    for line in 0..=columns {
        for row in 0..rows {
            let sides = [line as i64 - 1, line as i64].map(|column| squares.at(column, row as i64));
            let profile = profile(sides, line, columns);
            for k in 0..N {
                let y = row * N + k;
                sketch.chain(&[nodes.at(line * N, y), nodes.at(line * N, y + 1)], profile);
            }
        }
    }
}

/// Lets the longest country roads wind.
fn wind(sketch: &mut Sketch) {
    for i in 0..sketch.plan.streets.len() {
        let street = &sketch.plan.streets[i];
        let (a, b) = (
            sketch.plan.nodes_m[street.from],
            sketch.plan.nodes_m[street.to],
        );
        let straight = (b - a).norm();
        if street.profile != COUNTRY || !(0.9 * SQUARE_M..=1.1 * SQUARE_M).contains(&straight) {
            continue;
        }
        let aside = left((b - a).normalize());
        let (first, second) = (
            sketch.random.between(-70.0, 70.0),
            sketch.random.between(-70.0, 70.0),
        );
        let bend = |share: f64, by_m: f64| crate::geometry::Bend {
            corner_m: a + (b - a) * share + aside * by_m,
            radius_m: 260.0,
        };
        sketch.plan.streets[i].bends = vec![bend(0.32, first), bend(0.68, second)];
    }
}
