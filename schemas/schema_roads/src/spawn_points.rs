//! Where vehicles may be put: a rule over driving lanes, since OpenDRIVE has no such places.

use std::collections::HashMap;

use nalgebra::{Isometry3, Vector3};
use schema_types::Pose;

use crate::lane::{Lane, LaneKind, LanePosition};
use crate::map::RoadMap;

/// Distance between spawn points of one lane: more than the longest vehicle.
const SPACING_M: f64 = 16.0;
/// Distance from a junction behind, and from a junction ahead.
const MARGINS_M: (f64, f64) = (6.0, 13.5);
/// Least width of a lane, and least distance beside each other.
const WIDTH_M: (f64, f64) = (2.4, 2.6);
/// Height over the road.
const ABOVE_M: f64 = 0.3;
/// Side of the cells in which neighbours are looked for.
const CELL_M: f64 = 16.0;
/// Greatest number of spawn points in a map; of a map with more places every n-th is taken.
const MAX_POINTS: usize = 5_000;
/// Greatest number of places that are looked at.
const MAX_TRIED: usize = 500_000;

impl RoadMap {
    /// Where vehicles may be put, in the order of the lanes: x along the lane, 0.3 m above it, no
    /// two nearer than a lorry is long. On driving lanes between junctions; on those in junctions
    /// only if there are no others.
    pub fn spawn_points(&self) -> Vec<Pose> {
        let is_road = |lane: &Lane| lane.kind == LaneKind::Driving && lane.junction.is_none();
        let mut points = on_lanes(self, is_road, MARGINS_M);
        if points.is_empty() {
            points = on_lanes(self, |lane| lane.kind == LaneKind::Driving, (2.5, 2.5));
        }
        if points.is_empty() {
            points = on_lanes(
                self,
                |lane| lane.kind.is_drivable() || lane.kind == LaneKind::Bus,
                (0.5, 0.5),
            );
        }
        points
    }
}

fn on_lanes(roads: &RoadMap, passes: impl Fn(&Lane) -> bool, margins_m: (f64, f64)) -> Vec<Pose> {
    let mut taken: HashMap<(i64, i64), Vec<Isometry3<f64>>> = HashMap::new();
    let mut points = Vec::new();
    for lane in roads.lanes().iter().filter(|lane| passes(lane)) {
        let ends_at_junction = roads.successors(lane.key).iter().any(|next| {
            roads
                .lane(*next)
                .is_some_and(|next| next.junction.is_some())
        });
        let begins_at_junction = roads.predecessors(lane.key).iter().any(|from| {
            roads
                .lane(*from)
                .is_some_and(|from| from.junction.is_some())
        });
        // A lane that goes on in a further section has no end to keep a distance from.
        let free = |at_end: bool| {
            roads.successors(lane.key).is_empty() && at_end
                || roads.predecessors(lane.key).is_empty() && !at_end
        };
        let from = if begins_at_junction || free(false) {
            margins_m.0
        } else {
            1.0
        };
        let to = lane.length_m
            - if ends_at_junction || free(true) {
                margins_m.1
            } else {
                1.0
            };
        let mut s_m = from;
        while s_m <= to && points.len() < MAX_TRIED {
            let at = LanePosition::new(lane.key, s_m);
            s_m += SPACING_M;
            if roads.width_m(at) < WIDTH_M.0 {
                continue;
            }
            let Some(pose) = roads.pose(at) else { continue };
            if !pose.translation.vector.iter().all(|x| x.is_finite()) || is_taken(&taken, &pose) {
                continue;
            }
            taken.entry(cell(&pose)).or_default().push(pose);
            points.push(Pose::from(pose * Isometry3::translation(0.0, 0.0, ABOVE_M)));
        }
    }
    let every = points.len().div_ceil(MAX_POINTS).max(1);
    points.into_iter().step_by(every).collect()
}

fn cell(pose: &Isometry3<f64>) -> (i64, i64) {
    let p = pose.translation.vector;
    ((p.x / CELL_M).floor() as i64, (p.y / CELL_M).floor() as i64)
}

/// Whether a vehicle at this pose would overlap one at a taken pose: nearer than a vehicle's length
/// along the lane, and nearer than a lane's width beside it.
fn is_taken(taken: &HashMap<(i64, i64), Vec<Isometry3<f64>>>, pose: &Isometry3<f64>) -> bool {
    let (x, y) = cell(pose);
    (x - 1..=x + 1)
        .flat_map(|x| (y - 1..=y + 1).map(move |y| (x, y)))
        .filter_map(|cell| taken.get(&cell))
        .flatten()
        .any(|other| {
            let away: Vector3<f64> = pose
                .inverse_transform_vector(&(other.translation.vector - pose.translation.vector));
            let crossing = (pose.rotation * Vector3::x())
                .dot(&(other.rotation * Vector3::x()))
                .abs()
                < 0.8;
            let beside_m = if crossing { 13.0 } else { WIDTH_M.1 };
            away.x.abs() < 13.0 && away.y.abs() < beside_m && away.z.abs() < 3.0
        })
}
