//! Houses, trees and lamps beside the roads, drawn by lot where there is room.

use std::collections::HashMap;

use schema_roads::{LaneKey, LaneKind, LanePosition, SectionSurface};
use schema_types::Class;
use sensor_core::MeshId;

use super::builder::ImportBuilder;
use super::surface::is_pavement;
use crate::buildings::{self, Lot};
use crate::geometry::{P2, contains, cross, flat, heading, left};
use crate::meshes::{street_lamps, trees};
use crate::plan::Houses;
use crate::random::Random;
use crate::scenery::SceneryLamp;

/// Streams of random numbers.
const HOUSES: u64 = 0x81;
const TREES: u64 = 0x82;
/// Greatest numbers in a map of ordinary size.
const MAX_HOUSES: usize = 2_500;
const MAX_TREES: usize = 6_000;
const MAX_LAMPS: usize = 4_000;
/// Greatest number of places that are tried in a map of ordinary size.
const MAX_TRIES: usize = 100_000;
/// Length of verges up to which a map is of ordinary size, metres; a longer map may have that many
/// times more of everything, up to [`MOST_TIMES`].
const ORDINARY_M: f64 = 50_000.0;
const MOST_TIMES: f64 = 6.0;
/// Length of verge that a house takes, about, metres.
const HOUSE_M: f64 = 18.0;
/// Side of the squares in which houses are looked up.
const SQUARE_M: f64 = 40.0;

/// Houses by the square of their middle.
#[derive(Default)]
struct Lots {
    lots: Vec<Lot>,
    squares: HashMap<(i64, i64), Vec<usize>>,
}

impl Lots {
    fn square(p: P2) -> (i64, i64) {
        (
            (p.x / SQUARE_M).floor() as i64,
            (p.y / SQUARE_M).floor() as i64,
        )
    }

    fn add(&mut self, lot: Lot) {
        let square = Lots::square(middle_of(&lot));
        self.squares
            .entry(square)
            .or_default()
            .push(self.lots.len());
        self.lots.push(lot);
    }

    /// Houses whose middle is within a square's side of a place, and some others.
    fn near(&self, p: P2) -> impl Iterator<Item = &Lot> {
        let (x, y) = Lots::square(p);
        (x - 1..=x + 1)
            .flat_map(move |x| (y - 1..=y + 1).map(move |y| (x, y)))
            .filter_map(|square| self.squares.get(&square))
            .flatten()
            .map(|idx| &self.lots[*idx])
    }
}

fn middle_of(lot: &Lot) -> P2 {
    lot.footprint_m.iter().sum::<P2>() / 4.0
}
/// Distance between street lamps.
const LAMPS_M: f64 = 26.0;
/// Fastest road with houses beside it, m/s.
const TOWN_MPS: f64 = 17.0;
/// Room between a house and any lane.
const ROOM_M: f64 = 1.2;

/// One outer edge of a road, walked with the road on its right.
struct Verge {
    points: Vec<[f64; 3]>,
    lengths_m: Vec<f64>,
    pavement: bool,
    /// Whether the speed limit is that of a town.
    slow: bool,
}

impl Verge {
    fn length_m(&self) -> f64 {
        self.lengths_m.last().copied().unwrap_or(0.0)
    }

    fn at(&self, l_m: f64) -> [f64; 3] {
        let l = l_m.clamp(0.0, self.length_m());
        let i = self
            .lengths_m
            .partition_point(|x| *x <= l)
            .clamp(1, self.points.len() - 1);
        let share =
            (l - self.lengths_m[i - 1]) / (self.lengths_m[i] - self.lengths_m[i - 1]).max(1e-9);
        std::array::from_fn(|k| {
            self.points[i - 1][k] + share * (self.points[i][k] - self.points[i - 1][k])
        })
    }

    /// Direction away from the road.
    fn out(&self, l_m: f64) -> P2 {
        let along = flat(self.at(l_m + 0.5)) - flat(self.at(l_m - 0.5));
        left(along.try_normalize(1e-6).unwrap_or(P2::x()))
    }
}

/// Adds houses, lamps and trees beside all roads.
pub(super) fn build(builder: &mut ImportBuilder, sections: &[SectionSurface]) {
    let verges = verges(builder, sections);
    let length_m: f64 = verges.iter().map(Verge::length_m).sum();
    let times = (length_m / ORDINARY_M).clamp(1.0, MOST_TIMES);
    let most = |n: usize| (n as f64 * times) as usize;
    // What there is not enough of for the whole map is thinned out everywhere alike.
    let share = (most(MAX_HOUSES) as f64 / (length_m / HOUSE_M)).min(1.0);
    let mut lots = Lots::default();
    let mut budget = Budget {
        objects: most(MAX_HOUSES),
        tries: most(MAX_TRIES),
    };
    for (i, verge) in verges.iter().enumerate().filter(|(_, verge)| verge.slow) {
        let mut random = Random::new(builder.seed, HOUSES, i as u64);
        houses(builder, verge, &mut lots, &mut budget, share, &mut random);
    }
    lamps(builder, sections, most(MAX_LAMPS));
    let kinds: Vec<MeshId> = (0..trees::N_KINDS)
        .map(|kind| builder.assets.add_mesh(trees::tree(kind)))
        .collect();
    let mut budget = Budget {
        objects: most(MAX_TREES),
        tries: most(MAX_TRIES),
    };
    for (i, verge) in verges.iter().enumerate() {
        let mut random = Random::new(builder.seed, TREES, i as u64);
        trees(builder, verge, &lots, &kinds, &mut budget, &mut random);
    }
}

fn verges(builder: &ImportBuilder, sections: &[SectionSurface]) -> Vec<Verge> {
    let mut verges = Vec::new();
    for section in sections.iter().filter(|section| section.junction.is_none()) {
        let (Some(first), Some(last)) = (section.lanes.first(), section.lanes.last()) else {
            continue;
        };
        let slow = section
            .lanes
            .iter()
            .find(|lane| lane.kind.is_drivable())
            .is_some_and(|lane| {
                let key = LaneKey {
                    road: section.road,
                    section: section.section,
                    lane: lane.lane,
                };
                builder
                    .roads
                    .speed_limit_mps(LanePosition::new(key, 0.0))
                    .is_none_or(|limit| limit < TOWN_MPS)
            });
        let n = section.stations_m.len();
        let left_edge: Vec<[f64; 3]> = (0..n).map(|row| last.row(row)[last.columns - 1]).collect();
        let right_edge: Vec<[f64; 3]> = (0..n).rev().map(|row| first.row(row)[0]).collect();
        for (points, lane) in [(left_edge, last), (right_edge, first)] {
            let mut lengths_m = vec![0.0];
            for pair in points.windows(2) {
                lengths_m
                    .push(lengths_m[lengths_m.len() - 1] + (flat(pair[1]) - flat(pair[0])).norm());
            }
            if lengths_m[lengths_m.len() - 1] > 12.0 {
                verges.push(Verge {
                    points,
                    lengths_m,
                    pavement: is_pavement(lane.kind),
                    slow,
                });
            }
        }
    }
    verges
}

/// The middle of a lot and points along its rim.
fn probes(lot: &Lot) -> Vec<P2> {
    let f = &lot.footprint_m;
    let mut points = vec![f.iter().sum::<P2>() / 4.0];
    for i in 0..4 {
        points.extend((0..5).map(|k| f[i] + (f[(i + 1) % 4] - f[i]) * (f64::from(k) / 5.0)));
    }
    points
}

/// How many objects may still be made for the whole map, and how many places tried.
struct Budget {
    objects: usize,
    tries: usize,
}

fn houses(
    builder: &mut ImportBuilder,
    verge: &Verge,
    lots: &mut Lots,
    budget: &mut Budget,
    share: f64,
    random: &mut Random,
) {
    let style = if verge.pavement {
        Houses::Terraces
    } else {
        Houses::Cottages
    };
    let (setback, gap) = if verge.pavement {
        (0.3, 1.5)
    } else {
        (5.0, 9.0)
    };
    let mut l = random.between(4.0, 12.0);
    while l < verge.length_m() - 8.0 && budget.objects > 0 && budget.tries > 0 {
        budget.tries -= 1;
        let (width, depth) = (random.between(9.0, 15.0), random.between(8.0, 11.0));
        let (a, b) = (verge.at(l), verge.at((l + width).min(verge.length_m())));
        let chord = flat(b) - flat(a);
        let bowed = (flat(verge.at(l + 0.5 * width)) - 0.5 * (flat(a) + flat(b))).norm() > 0.8;
        if chord.norm() < 0.9 * width || bowed {
            l += 3.0;
            continue;
        }
        let inward = left(chord.normalize());
        let (p, q) = (flat(a) + inward * setback, flat(b) + inward * setback);
        let lot = Lot {
            footprint_m: [p, q, q + inward * depth, p + inward * depth],
        };
        let points = probes(&lot);
        let heights: Vec<f64> = points.iter().map(|p| builder.ground.at(*p)).collect();
        let (low, high) = heights
            .iter()
            .fold((f64::MAX, f64::MIN), |(l, h), z| (l.min(*z), h.max(*z)));
        let level = high - low < 2.0 && (a[2] - high).abs() < 2.0;
        let free = level
            && !points
                .iter()
                .any(|p| builder.cover.is_near(*p, ROOM_M.min(setback * 0.9)))
            && !lots
                .near(points[0])
                .any(|other| (points[0] - middle_of(other)).norm() < 26.0 && overlap(&lot, other));
        if !free {
            l += 3.0;
            continue;
        }
        if share < 1.0 && !random.chance(share) {
            l += width;
            continue;
        }
        budget.objects -= 1;
        let object = builder.object(Class::BUILDINGS, "building");
        let height_m = buildings::build(
            &mut builder.chunks,
            &mut builder.solid,
            &lot,
            style,
            object,
            random,
        );
        let middle = middle_of(&lot);
        builder.lamps.push(SceneryLamp::windows(
            object,
            [middle.x, middle.y, high + 0.5 * height_m],
        ));
        lots.add(lot);
        l += width
            + if random.chance(0.3) {
                gap * random.between(2.0, 5.0)
            } else {
                gap
            };
    }
}

fn overlap(a: &Lot, b: &Lot) -> bool {
    let separated = |p: &[P2; 4], q: &[P2; 4]| {
        (0..4).any(|i| {
            let edge = p[(i + 1) % 4] - p[i];
            q.iter().all(|corner| cross(edge, corner - p[i]) < -0.5)
        })
    };
    !separated(&a.footprint_m, &b.footprint_m) && !separated(&b.footprint_m, &a.footprint_m)
}

/// Adds street lamps on pavements, at the kerb.
fn lamps(builder: &mut ImportBuilder, sections: &[SectionSurface], most: usize) {
    let mesh = builder.assets.add_mesh(street_lamps::street_lamp());
    let mut n = 0;
    for section in sections.iter().filter(|section| section.junction.is_none()) {
        for lane in section
            .lanes
            .iter()
            .filter(|lane| lane.kind == LaneKind::Sidewalk)
        {
            let mut next = section.stations_m[0] + 9.0;
            for (row, station) in section.stations_m.iter().enumerate() {
                if *station < next || n >= most {
                    continue;
                }
                next = station + LAMPS_M;
                let points = lane.row(row);
                let (inner, outer) = if lane.lane > 0 {
                    (points[0], points[lane.columns - 1])
                } else {
                    (points[lane.columns - 1], points[0])
                };
                let Some(out) = (flat(outer) - flat(inner)).try_normalize(1.0) else {
                    continue;
                };
                let at = flat(inner) + out * 0.5;
                if builder.cover.vehicles_at(at).is_some() {
                    continue;
                }
                n += 1;
                builder.street_lamp(mesh, "street lamp", [at.x, at.y, inner[2]], heading(-out));
            }
        }
    }
}

fn trees(
    builder: &mut ImportBuilder,
    verge: &Verge,
    lots: &Lots,
    kinds: &[MeshId],
    budget: &mut Budget,
    random: &mut Random,
) {
    let (near, far) = if verge.slow { (2.6, 16.0) } else { (7.0, 45.0) };
    let mut l = random.between(2.0, 9.0);
    while l < verge.length_m() && budget.objects > 0 && budget.tries > 0 {
        budget.tries -= 1;
        let p = flat(verge.at(l)) + verge.out(l) * random.between(near, far);
        let mesh = random.pick(kinds);
        let yaw = random.between(0.0, std::f64::consts::TAU);
        l += random.between(6.0, 17.0);
        let in_the_way = lots
            .near(p)
            .any(|lot| (p - middle_of(lot)).norm() < 14.0 && contains(&grown(lot, 2.6), p));
        if in_the_way || builder.cover.is_near(p, 2.2) {
            continue;
        }
        budget.objects -= 1;
        let at = [p.x, p.y, builder.ground.at(p)];
        let tree = builder.stand(mesh, Class::VEGETATION, "tree", at, yaw);
        builder.post(tree, at, 0.17, 4.0);
    }
}

fn grown(lot: &Lot, by: f64) -> [P2; 4] {
    let middle = middle_of(lot);
    lot.footprint_m
        .map(|p| middle + (p - middle) * (1.0 + by / (p - middle).norm().max(1.0)))
}
