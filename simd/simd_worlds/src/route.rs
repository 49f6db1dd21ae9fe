//! The way ahead of a member: the middle of a chain of lanes, metre by metre.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector2, Vector3};
use schema_roads::{LaneKey, LanePosition, RoadMap};
use schema_types::noise::Noise;

/// Distance between the points of a route along its lanes, metres.
const STEP_M: f64 = 1.0;
/// Speed limit of lanes that say none, m/s: 50 km/h.
const NO_LIMIT_MPS: f64 = 50.0 / 3.6;

/// A point of a route.
#[derive(Clone, Copy, Debug)]
struct Point {
    world_from_road: Isometry3<f64>,
    /// Distance from the start of the route, metres.
    way_m: f64,
    half_width_m: f64,
    limit_mps: f64,
}

/// The middle of a chain of lanes.
#[derive(Debug)]
pub(crate) struct Route {
    points: Vec<Point>,
}

/// Where something is beside a route.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Foot {
    /// Point before it.
    pub idx: usize,
    /// Distance from the start of the route, metres.
    pub way_m: f64,
    /// Distance from the middle, metres, positive to the left.
    pub offset_m: f64,
    /// Direction of the route, radians.
    pub heading_rad: f64,
    /// Half the width of the lane, metres.
    pub half_width_m: f64,
    /// Speed limit, m/s.
    pub limit_mps: f64,
}

impl Route {
    /// A route of at least `length_m` from the beginning of a lane; branches are taken by lot.
    /// `None` at a dead end.
    pub fn along(roads: &RoadMap, from: LaneKey, length_m: f64, lot: Noise) -> Option<Route> {
        let mut points: Vec<Point> = Vec::new();
        let mut key = from;
        for n_lanes in 0.. {
            let lane = roads.lane(key)?;
            let n = (lane.length_m / STEP_M).ceil().max(1.0);
            // The end of a lane is the beginning of the next.
            for i in 0..n as usize {
                let at = LanePosition::new(key, lane.length_m * i as f64 / n);
                let pose = roads.pose(at)?;
                let way_m = points.last().map_or(0.0, |last: &Point| {
                    let before = last.world_from_road.translation.vector;
                    last.way_m + (pose.translation.vector - before).xy().norm()
                });
                if points.last().is_some_and(|last| way_m - last.way_m < 0.1) {
                    continue;
                }
                points.push(Point {
                    world_from_road: pose,
                    way_m,
                    half_width_m: 0.5 * roads.width_m(at),
                    limit_mps: roads.speed_limit_mps(at).unwrap_or(NO_LIMIT_MPS),
                });
                if way_m >= length_m {
                    return Some(Route { points });
                }
            }
            let next = roads.successors(key);
            let lot = lot.bits(n_lanes) as usize;
            key = *next.get(lot.checked_rem(next.len())?)?;
        }
        None
    }

    pub fn length_m(&self) -> f64 {
        self.points.last().map_or(0.0, |last| last.way_m)
    }

    /// Greatest change of direction within the first metres, radians.
    pub fn greatest_turn_rad(&self, within_m: f64) -> f64 {
        let first = heading(&self.points[0].world_from_road);
        let near = self.points.iter().take_while(|at| at.way_m <= within_m);
        near.map(|at| wrap(heading(&at.world_from_road) - first).abs())
            .fold(0.0, f64::max)
    }

    /// Half the width of its narrowest place, metres.
    pub fn least_half_width_m(&self) -> f64 {
        let widths = self.points.iter().map(|at| at.half_width_m);
        widths.fold(f64::INFINITY, f64::min)
    }

    /// The point before a place.
    pub fn before(&self, way_m: f64) -> usize {
        let after = self.points.partition_point(|at| at.way_m <= way_m);
        after.clamp(1, self.points.len() - 1) - 1
    }

    /// Pose on the road, x along the lane.
    pub fn pose(&self, way_m: f64, offset_m: f64) -> Isometry3<f64> {
        let [a, b] = self.pair(self.before(way_m));
        let share = ((way_m - a.way_m) / (b.way_m - a.way_m)).clamp(0.0, 1.0);
        let here = a.world_from_road.lerp_slerp(&b.world_from_road, share);
        here * Translation3::new(0.0, offset_m, 0.0)
    }

    /// The foot of a place on the middle.
    pub fn foot_at(&self, way_m: f64) -> Foot {
        self.foot(
            &self.pose(way_m, 0.0).translation.vector,
            self.before(way_m),
        )
    }

    /// The foot of a point; `near` is the last one, from which the search begins.
    pub fn foot(&self, at_m: &Vector3<f64>, near: usize) -> Foot {
        let mut idx = near.min(self.points.len() - 2);
        let along = |idx: usize| {
            let [a, b] = self.pair(idx);
            let from = a.world_from_road.translation.vector.xy();
            let chord = b.world_from_road.translation.vector.xy() - from;
            let length_m = chord.norm();
            let direction = chord / length_m;
            let to = at_m.xy() - from;
            (direction.dot(&to), length_m, direction.perp(&to), direction)
        };
        while along(idx).0 > along(idx).1 && idx + 2 < self.points.len() {
            idx += 1;
        }
        while along(idx).0 < 0.0 && idx > 0 {
            idx -= 1;
        }
        let (ahead_m, _, offset_m, direction): (f64, f64, f64, Vector2<f64>) = along(idx);
        let at = &self.points[idx];
        Foot {
            idx,
            way_m: at.way_m + ahead_m,
            offset_m,
            heading_rad: direction.y.atan2(direction.x),
            half_width_m: at.half_width_m,
            limit_mps: at.limit_mps,
        }
    }

    fn pair(&self, idx: usize) -> [&Point; 2] {
        [&self.points[idx], &self.points[idx + 1]]
    }
}

/// Direction of a pose's x axis, radians.
pub(crate) fn heading(pose: &Isometry3<f64>) -> f64 {
    let forward = pose.rotation * Vector3::x();
    forward.y.atan2(forward.x)
}

/// An angle between −π and π.
pub(crate) fn wrap(angle_rad: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    angle_rad - turn * (angle_rad / turn).round()
}

/// A pose turned about its own z axis.
pub(crate) fn turned(pose: Isometry3<f64>, by_rad: f64) -> Isometry3<f64> {
    pose * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), by_rad)
}
