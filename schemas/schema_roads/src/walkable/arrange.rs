//! Outlines as segments on an integer grid that meet only at their ends, so that a constrained
//! triangulation takes them without rounding.

use std::collections::{BTreeMap, BTreeSet};

use super::outlines::Outline;

/// Steps of the grid per metre. Outlines that touch within half a step share their points.
pub const STEPS_PER_M: f64 = 1e3;
/// Width of the cells in which segments are compared, steps.
const CELL_STEPS: i64 = 10_000;
/// Most rounds of cutting. Rounding a crossing to the grid bends its segments, which can make new
/// crossings; each round finds far fewer.
const MOST_ROUNDS: usize = 12;

/// A place on the grid.
pub type Step = [i64; 2];

/// Points with their heights, metres, and the segments between them.
#[derive(Debug, Default)]
pub struct Arrangement {
    /// Height by place; where several outlines meet, that of the first one.
    pub heights_m: BTreeMap<Step, f64>,
    /// Ends in order of place.
    pub segments: BTreeSet<[Step; 2]>,
}

impl Arrangement {
    /// The sides of the outlines, cut where they cross.
    pub fn new(outlines: &[Outline]) -> Arrangement {
        let mut all = Arrangement::default();
        for outline in outlines {
            let ring: Vec<Step> = outline
                .corners_m
                .iter()
                .filter_map(|corner| all.place(*corner))
                .collect();
            for i in 0..ring.len() {
                all.join(ring[i], ring[(i + 1) % ring.len()]);
            }
        }
        for _ in 0..MOST_ROUNDS {
            let cuts = all.crossings();
            if cuts.is_empty() {
                break;
            }
            cuts.into_iter()
                .for_each(|(segment, places)| all.cut(segment, places));
        }
        all
    }

    fn place(&mut self, corner_m: [f64; 3]) -> Option<Step> {
        let in_reach = corner_m.iter().all(|x| x.is_finite() && x.abs() < 1e9);
        let place = [0, 1].map(|axis| (corner_m[axis] * STEPS_PER_M).round() as i64);
        in_reach.then(|| {
            self.heights_m.entry(place).or_insert(corner_m[2]);
            place
        })
    }

    fn join(&mut self, a: Step, b: Step) {
        if a != b {
            self.segments.insert([a.min(b), a.max(b)]);
        }
    }

    /// The places at which each segment must be cut.
    fn crossings(&self) -> BTreeMap<[Step; 2], BTreeSet<Step>> {
        let mut cells: BTreeMap<[i64; 2], Vec<[Step; 2]>> = BTreeMap::new();
        for [a, b] in &self.segments {
            let span = |axis: usize| {
                a[axis].min(b[axis]).div_euclid(CELL_STEPS)
                    ..=a[axis].max(b[axis]).div_euclid(CELL_STEPS)
            };
            for x in span(0) {
                for y in span(1) {
                    cells.entry([x, y]).or_default().push([*a, *b]);
                }
            }
        }
        let mut cuts: BTreeMap<[Step; 2], BTreeSet<Step>> = BTreeMap::new();
        for near in cells.values() {
            for (i, first) in near.iter().enumerate() {
                for second in &near[i + 1..] {
                    let Some(place) = crossing(*first, *second) else {
                        continue;
                    };
                    for segment in [first, second] {
                        if !segment.contains(&place) {
                            cuts.entry(*segment).or_default().insert(place);
                        }
                    }
                }
            }
        }
        cuts
    }

    fn cut(&mut self, segment: [Step; 2], places: BTreeSet<Step>) {
        let [a, b] = segment;
        let [along_x, along_y] = [0, 1].map(|axis| (b[axis] - a[axis]) as f64);
        let share = |place: Step| {
            let at = (place[0] - a[0]) as f64 * along_x + (place[1] - a[1]) as f64 * along_y;
            (at / (along_x * along_x + along_y * along_y)).clamp(0.0, 1.0)
        };
        let mut order: Vec<Step> = places.into_iter().collect();
        order.sort_by(|p, q| share(*p).total_cmp(&share(*q)).then(p.cmp(q)));
        let [low_m, high_m] = [a, b].map(|end| self.heights_m[&end]);
        self.segments.remove(&segment);
        let mut from = a;
        for place in order {
            self.heights_m
                .entry(place)
                .or_insert(low_m + share(place) * (high_m - low_m));
            self.join(from, place);
            from = place;
        }
        self.join(from, b);
    }
}

/// Twice the area of a triangle, exactly.
fn turn(a: Step, b: Step, c: Step) -> i128 {
    let [p, q] = [b, c].map(|end| [0, 1].map(|axis| i128::from(end[axis] - a[axis])));
    p[0] * q[1] - p[1] * q[0]
}

/// The place nearest to where two segments cross; `None` where they only touch or lie in one line.
fn crossing([a, b]: [Step; 2], [c, d]: [Step; 2]) -> Option<Step> {
    let (side_c, side_d) = (turn(a, b, c), turn(a, b, d));
    let (side_a, side_b) = (turn(c, d, a), turn(c, d, b));
    let differ = |p: i128, q: i128| p.signum() * q.signum() < 0;
    (differ(side_c, side_d) && differ(side_a, side_b)).then(|| {
        let share = side_a as f64 / (side_a - side_b) as f64;
        [0, 1].map(|axis| a[axis] + (share * (b[axis] - a[axis]) as f64).round() as i64)
    })
}

#[cfg(test)]
mod tests {
    use super::super::mesh::Ground;
    use super::*;

    /// Seeded rings through each other, many of them nearly along one another: afterwards nothing
    /// crosses, and each ring is still there.
    #[test]
    fn nothing_crosses_afterwards() {
        let mut state = 5u64;
        let mut random = |most: f64| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1u32 << 31) * most
        };
        for _ in 0..40 {
            let outlines: Vec<Outline> = (0..12)
                .map(|_| {
                    let (x, y, long, thin) = (
                        random(20.0),
                        random(20.0),
                        random(30.0),
                        0.002 + random(3.0),
                    );
                    let slope = if random(1.0) < 0.5 {
                        random(1e-3)
                    } else {
                        random(2.0)
                    };
                    let corners = [
                        [0.0, 0.0],
                        [long, long * slope],
                        [long, long * slope + thin],
                        [0.0, thin],
                    ];
                    Outline {
                        corners_m: corners.map(|[dx, dy]| [x + dx, y + dy, dx]).to_vec(),
                        ground: Ground::Sidewalk,
                    }
                })
                .collect();
            let all = Arrangement::new(&outlines);
            assert!(all.crossings().is_empty());
            assert!(all.segments.len() >= 12 * 3);
            let far = all
                .heights_m
                .values()
                .filter(|height| !(0.0..=30.0).contains(*height))
                .count();
            assert_eq!(far, 0, "heights lie between those of the ends");
        }
    }
}
