//! The walkable mesh of a map, the signals that guard its crosswalks, and ways over it.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use nalgebra::Vector2;

use super::mesh::{Ground, WalkMesh};
use crate::map::RoadMap;
use crate::signals::{SignalKind, SignalStop};

/// Farthest destination of a stroll, metres in a straight line.
pub const REACH_M: f64 = 160.0;
/// Farthest distance of a light's stop line from the crosswalk that it guards, metres.
const GUARD_M: f64 = 16.0;
/// Distance that ways keep from the ends of the edges they cross, metres.
const ASIDE_M: f64 = 0.3;

/// Metres on a pavement that a metre on a carriageway counts for: people cross roads, but do not
/// walk along them.
pub const ROAD_COST: f64 = 3.0;

/// The walkable mesh with indices for finding faces and crosswalk signals.
#[derive(Clone, Debug)]
pub struct Pavements {
    /// The mesh.
    pub mesh: WalkMesh,
    /// Middle of each face, metres.
    pub middles_m: Vec<[f64; 3]>,
    /// Pavement faces with the cumulative sum of their areas, for drawing places by lot.
    places: Vec<(usize, f64)>,
    /// For each crosswalk face, the OpenDRIVE ids of the signals for the traffic over it.
    pub guards: BTreeMap<usize, Vec<String>>,
    /// Faces by the grid squares that they may reach into, by rising number.
    squares: BTreeMap<(i64, i64), Vec<usize>>,
}

/// Side of the grid squares in which faces are looked up, metres.
const SQUARE_M: f64 = 8.0;

fn square([x, y, _]: [f64; 3]) -> (i64, i64) {
    ((x / SQUARE_M).floor() as i64, (y / SQUARE_M).floor() as i64)
}

fn squares(mesh: &WalkMesh) -> BTreeMap<(i64, i64), Vec<usize>> {
    let mut squares: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for face in 0..mesh.faces.len() {
        let start = ([f64::MAX; 3], [f64::MIN; 3]);
        let wider = |(low, high): ([f64; 3], [f64; 3]), p: [f64; 3]| {
            (
                [0, 1, 2].map(|i| low[i].min(p[i])),
                [0, 1, 2].map(|i| high[i].max(p[i])),
            )
        };
        let (low, high) = mesh.corners_m(face).fold(start, wider);
        let (low, high) = (square(low), square(high));
        for x in low.0..=high.0 {
            (low.1..=high.1).for_each(|y| squares.entry((x, y)).or_default().push(face));
        }
    }
    squares
}

impl Pavements {
    /// Those of a map; `with_roads` adds the carriageways beside them.
    pub fn new(roads: &RoadMap, with_roads: bool) -> Pavements {
        let mesh = roads.walkable(with_roads);
        let middles_m: Vec<[f64; 3]> = (0..mesh.faces.len())
            .map(|face| mesh.middle_m(face))
            .collect();
        let mut places = Vec::new();
        let mut sum_m2 = 0.0;
        let parts = parts(&mesh);
        for face in (0..mesh.faces.len())
            .filter(|face| mesh.faces[*face].ground == Ground::Sidewalk && parts[*face])
        {
            sum_m2 += mesh.area_m2(face);
            places.push((face, sum_m2));
        }
        let lights = || {
            roads
                .signals()
                .iter()
                .filter(|signal| signal.kind == SignalKind::TrafficLight)
        };
        let mut guards: BTreeMap<usize, Vec<String>> = BTreeMap::new();
        for face in
            (0..mesh.faces.len()).filter(|face| mesh.faces[*face].ground == Ground::Crosswalk)
        {
            // The lights of the road that the crosswalk lies on, at this end of it.
            let Some(lane) = roads.nearest(middles_m[face], |lane| {
                lane.kind.is_drivable() && lane.junction.is_none()
            }) else {
                continue;
            };
            let guards_it = |stop: &SignalStop| {
                let line = roads
                    .pose(stop.stop)
                    .filter(|_| stop.stop.lane.road == lane.lane.road);
                line.is_some_and(|line| {
                    (line.translation.x - middles_m[face][0])
                        .hypot(line.translation.y - middles_m[face][1])
                        < GUARD_M
                })
            };
            let ids = lights()
                .filter(|signal| signal.stops.iter().any(guards_it))
                .map(|signal| signal.id.clone())
                .collect();
            guards.insert(face, ids);
        }
        let squares = squares(&mesh);
        Pavements {
            mesh,
            middles_m,
            places,
            guards,
            squares,
        }
    }

    /// Draws a pavement face, larger ones more often.
    pub fn place(&self, lot: f64) -> Option<usize> {
        let (_, all_m2) = self.places.last()?;
        let idx = self.places.partition_point(|(_, sum)| *sum < lot * all_m2);
        self.places
            .get(idx.min(self.places.len() - 1))
            .map(|(face, _)| *face)
    }

    /// The face under a walker's feet.
    pub fn face_at(&self, at: [f64; 3]) -> Option<usize> {
        let faces = self.squares.get(&square(at))?.iter().copied();
        let is_level = |face: &usize| (self.middles_m[*face][2] - at[2]).abs() < 3.0;
        faces
            .filter(is_level)
            .find(|face| self.mesh.contains(*face, at))
    }

    /// The face under a walker's feet, or the nearest within 3 m.
    pub fn face_near(&self, at: [f64; 3]) -> Option<usize> {
        self.face_at(at).or_else(|| {
            let away = |face: &usize| {
                (self.middles_m[*face][0] - at[0]).powi(2)
                    + (self.middles_m[*face][1] - at[1]).powi(2)
            };
            (0..self.middles_m.len())
                .min_by(|a, b| away(a).total_cmp(&away(b)))
                .filter(|face| away(face) < 9.0)
        })
    }

    /// The faces of the shortest way from one face to another, over their middles. Carriageways are
    /// part of it only if `over_roads`, and count [`ROAD_COST`] times their length.
    pub fn way(&self, from: usize, to: usize, over_roads: bool) -> Option<Vec<usize>> {
        let away = |a: usize, b: usize| {
            let (p, q) = (self.middles_m[a], self.middles_m[b]);
            (p[0] - q[0]).hypot(p[1] - q[1])
        };
        let is_road = |face: usize| self.mesh.faces[face].ground == Ground::Road;
        let mut best: BTreeMap<usize, (f64, usize)> = BTreeMap::from([(from, (0.0, from))]);
        // Keys are whole tenths of a millimetre, because `f64` has no total order.
        let key = |metres: f64| (metres * 1e4) as u64;
        let mut open = BinaryHeap::from([Reverse((key(away(from, to)), from))]);
        while let Some(Reverse((_, face))) = open.pop() {
            if face == to {
                let mut way = vec![to];
                while way[way.len() - 1] != from {
                    way.push(best[&way[way.len() - 1]].1);
                }
                way.reverse();
                return Some(way);
            }
            let so_far = best[&face].0;
            for next in self.mesh.faces[face]
                .neighbours
                .iter()
                .flatten()
                .map(|next| *next as usize)
                .filter(|next| over_roads || !is_road(*next))
            {
                let cost = if is_road(next) { ROAD_COST } else { 1.0 };
                let length = so_far + cost * away(face, next);
                if length < 4.0 * REACH_M
                    && best
                        .get(&next)
                        .is_none_or(|(known, _)| length < known - 1e-9)
                {
                    best.insert(next, (length, face));
                    open.push(Reverse((key(length + away(next, to)), next)));
                }
            }
        }
        None
    }

    /// Corners of a way through faces: the point of each crossed edge that is nearest to the
    /// straight line, then the end.
    pub fn corners(&self, way: &[usize], from: [f64; 2]) -> Vec<([f64; 2], u32)> {
        let end = self.middles_m[way[way.len() - 1]];
        let mut at = Vector2::from(from);
        let end = Vector2::new(end[0], end[1]);
        let mut corners = Vec::new();
        for pair in way.windows(2) {
            let face = &self.mesh.faces[pair[0]];
            let Some(i) = face
                .neighbours
                .iter()
                .position(|next| *next == Some(pair[1] as u32))
            else {
                continue;
            };
            let corner = |k: usize| {
                let p = self.mesh.vertices_m[face.corners[k % face.corners.len()] as usize];
                Vector2::new(p[0], p[1])
            };
            let (a, b) = (corner(i), corner(i + 1));
            let length = (b - a).norm();
            let margin = (ASIDE_M / length.max(1e-6)).min(0.5);
            // Where the straight line to the end crosses the edge, kept off its ends.
            let (edge, ahead) = (b - a, end - at);
            let across = edge.perp(&ahead);
            let share = if across.abs() > 1e-9 {
                (at - a).perp(&ahead) / across
            } else {
                0.5
            };
            at = a + edge * share.clamp(margin, 1.0 - margin);
            corners.push((at.into(), pair[1] as u32));
        }
        corners.push((end.into(), u32::MAX));
        corners
    }
}

/// For each face, whether it belongs to the largest part that hangs together without carriageways.
fn parts(mesh: &WalkMesh) -> Vec<bool> {
    let mut of = vec![usize::MAX; mesh.faces.len()];
    let mut largest = (0.0, usize::MAX);
    for start in 0..mesh.faces.len() {
        if of[start] != usize::MAX || mesh.faces[start].ground == Ground::Road {
            continue;
        }
        let (mut open, mut area_m2) = (vec![start], 0.0);
        of[start] = start;
        while let Some(face) = open.pop() {
            area_m2 += mesh.area_m2(face);
            for next in mesh.faces[face]
                .neighbours
                .iter()
                .flatten()
                .map(|next| *next as usize)
            {
                if of[next] == usize::MAX && mesh.faces[next].ground != Ground::Road {
                    of[next] = start;
                    open.push(next);
                }
            }
        }
        if area_m2 > largest.0 {
            largest = (area_m2, start);
        }
    }
    of.into_iter().map(|part| part == largest.1).collect()
}
