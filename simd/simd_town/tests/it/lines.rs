//! Lines inside junctions: the map names exactly those that are painted.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};
use schema_roads::{MarkKind, RoadMap};
use schema_types::Class;
use simd_town::Town;

/// Longest gap of a broken line, metres: it may be the end of the line.
const GAP_M: f64 = 4.5;

fn flat(p: [f64; 3]) -> (i64, i64) {
    ((p[0] / 8.0).floor() as i64, (p[1] / 8.0).floor() as i64)
}

/// Points in cells of eight metres.
struct Near(BTreeMap<(i64, i64), Vec<[f64; 3]>>);

impl Near {
    fn of(points: impl Iterator<Item = [f64; 3]>) -> Near {
        let mut cells: BTreeMap<_, Vec<_>> = BTreeMap::new();
        points.for_each(|p| cells.entry(flat(p)).or_default().push(p));
        Near(cells)
    }

    /// Distance to the nearest point within eight metres.
    fn away_m(&self, p: [f64; 3]) -> f64 {
        let (x, y) = flat(p);
        let cells = (x - 1..=x + 1).flat_map(|x| (y - 1..=y + 1).map(move |y| (x, y)));
        let all = cells.filter_map(|cell| self.0.get(&cell)).flatten();
        all.map(|q| (Vector3::from(p) - Vector3::from(*q)).norm())
            .fold(f64::INFINITY, f64::min)
    }
}

/// Painted triangles in the world.
fn paint(town: &Town) -> Vec<[Point3<f64>; 3]> {
    let mut triangles = Vec::new();
    for instance in &town.assets.statics {
        for (corners, vertex) in town.assets.mesh(instance.mesh).triangles() {
            if vertex.class != Class::ROAD_LINES.0 {
                continue;
            }
            triangles.push(
                corners
                    .map(|corner| instance.world_from_mesh * Point3::from(corner.map(f64::from))),
            );
        }
    }
    triangles
}

/// Places all over a triangle, a decimetre apart or less.
fn spread([a, b, c]: [Point3<f64>; 3]) -> Vec<[f64; 3]> {
    let (ab, ac) = (b - a, c - a);
    let n = (ab.norm().max(ac.norm()) / 0.1).ceil().max(1.0) as usize;
    let places =
        (0..=n).flat_map(|i| (0..=n - i).map(move |k| (i as f64 / n as f64, k as f64 / n as f64)));
    places
        .map(|(i, k)| (a + ab * i + ac * k).coords.into())
        .collect()
}

#[test]
fn paint_in_junctions_is_that_of_the_map() {
    let mut n_lines = BTreeMap::new();
    for name in Town::NAMES {
        let town = Town::generate(name, 2).expect("a name of the list");
        let roads = RoadMap::parse(&town.open_drive).expect("our own text");
        let connecting: BTreeMap<u32, u32> = roads
            .lanes()
            .iter()
            .filter_map(|lane| Some((lane.key.road, lane.junction?)))
            .collect();
        let lengths_m: BTreeMap<_, _> = roads
            .lanes()
            .iter()
            .map(|lane| (lane.key, lane.length_m))
            .collect();
        let marks = roads.mark_lines(0.1);
        let triangles = paint(&town);
        let painted = Near::of(triangles.iter().flat_map(|triangle| spread(*triangle)));
        for mark in marks
            .iter()
            .filter(|mark| connecting.contains_key(&mark.road))
        {
            *n_lines.entry((name, mark.kind as u8)).or_insert(0) += 1;
            let reach_m = if mark.kind == MarkKind::Solid {
                0.1
            } else {
                GAP_M + 0.1
            };
            assert!(
                matches!(mark.kind, MarkKind::Solid | MarkKind::Broken),
                "{name}: {:?}",
                mark.kind
            );
            for point in &mark.points {
                let away_m = painted.away_m(*point);
                assert!(
                    away_m < reach_m,
                    "{name}: the map has a line at {point:.2?}, the nearest paint is {away_m:.2} m away: {:?}",
                    mark.kind
                );
            }
        }
        let said = Near::of(marks.iter().flat_map(|mark| mark.points.iter().copied()));
        for [a, b, c] in triangles {
            let point: [f64; 3] = ((a.coords + b.coords + c.coords) / 3.0).into();
            // Only paint half a metre inside a junction counts: stripes of roads end at its edge,
            // square to the road.
            let inside = roads
                .nearest(point, |lane| lane.kind.is_drivable())
                .filter(|at| connecting.contains_key(&at.lane.road))
                .filter(|at| {
                    let length_m = lengths_m[&at.lane];
                    at.s_m > 0.5 && at.s_m < length_m - 0.5
                });
            assert!(
                inside.is_none() || said.away_m(point) < 0.12,
                "{name}: paint at {point:.2?} of which the map does not know"
            );
        }
    }
    // Motorways go on past their ramps; in other towns nothing is painted inside junctions.
    let n =
        |town: &'static str, kind: MarkKind| n_lines.get(&(town, kind as u8)).copied().unwrap_or(0);
    assert!(
        n("Town04", MarkKind::Solid) > 10 && n("Town04", MarkKind::Broken) > 10,
        "{n_lines:?}"
    );
    assert!(
        n_lines
            .keys()
            .all(|(name, _)| !["Town01", "Town02", "Town07"].contains(name)),
        "{n_lines:?}"
    );
}
