//! The way ahead of one vehicle: a chain of lanes, as points one metre apart.

use schema_roads::{Lane, LaneKey, LanePosition, RoadMap};
use schema_types::noise::Noise;

/// Distance between points, metres.
const STEP_M: f64 = 1.0;
/// Speed limit where the map states none (30 km/h, as in CARLA's towns), m/s.
const DEFAULT_LIMIT_MPS: f64 = 30.0 / 3.6;
/// No reach is larger than this, metres: points farther away need no exact test.
const FARTHEST_REACH_M: f64 = 8.0;
/// Length that is kept behind the vehicle, metres.
const KEPT_BEHIND_M: f64 = 30.0;

/// A point of the path.
#[derive(Clone, Copy, Debug)]
pub struct PathPoint {
    /// World position, metres.
    pub position_m: [f64; 2],
    /// Direction, radians.
    pub heading_rad: f64,
    /// Curvature, 1/m, positive to the left.
    pub curvature_per_m: f64,
    /// Speed limit, m/s.
    pub limit_mps: f64,
    /// Length of the path up to here, metres.
    pub arc_m: f64,
}

/// A lane of the path.
#[derive(Clone, Debug)]
pub struct Leg {
    /// The lane.
    pub lane: LaneKey,
    /// Junction it crosses.
    pub junction: Option<u32>,
    /// Path length at which it begins and ends, metres.
    pub arc_m: [f64; 2],
    /// Lane s at which it begins and ends, metres.
    s_m: [f64; 2],
}

impl Leg {
    /// Path length at a place on the lane.
    pub fn arc_at_m(&self, s_m: f64) -> f64 {
        let span = (self.s_m[1] - self.s_m[0]).max(1e-6);
        self.arc_m[0] + (self.arc_m[1] - self.arc_m[0]) * (s_m - self.s_m[0]) / span
    }
}

/// The place of a path that is nearest to a point.
#[derive(Clone, Copy, Debug, Default)]
pub struct Foot {
    /// Path length there, metres.
    pub arc_m: f64,
    /// Distance of the point from the path, metres, positive to the left of it.
    pub offset_m: f64,
    /// Direction of the path, radians.
    pub heading_rad: f64,
}

impl Foot {
    /// On which side of the path the point lies.
    pub fn side(&self) -> Side {
        if self.offset_m > 0.0 {
            Side::Left
        } else {
            Side::Right
        }
    }
}

/// A side of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// To the left, in the direction of the path.
    Left,
    /// To the right.
    Right,
}

/// Where a path ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathEnd {
    /// Path length there, metres.
    pub arc_m: f64,
    /// Whether no lane follows.
    pub is_dead_end: bool,
}

/// The way ahead.
#[derive(Clone, Debug)]
pub struct Path {
    points: Vec<PathPoint>,
    legs: Vec<Leg>,
    /// Whether the last lane leads nowhere.
    ends: bool,
    choices: Noise,
    n_choices: u64,
}

impl Path {
    /// A path from a place on a lane. `choices` decides at junctions, counted from `n_choices`.
    pub fn new(map: &RoadMap, from: LanePosition, choices: Noise, n_choices: u64) -> Option<Path> {
        let lane = map.lane(from.lane)?;
        let mut path = Path {
            points: Vec::new(),
            legs: Vec::new(),
            ends: false,
            choices,
            n_choices,
        };
        path.append(map, lane, from.s_m.min(lane.length_m - 0.1).max(0.0));
        path.lead_in(map);
        Some(path)
    }

    /// Number of choices made so far.
    pub fn n_choices(&self) -> u64 {
        self.n_choices
    }

    /// Points by rising length.
    pub fn points(&self) -> &[PathPoint] {
        &self.points
    }

    /// Lanes in order.
    pub fn legs(&self) -> &[Leg] {
        &self.legs
    }

    /// Where the path ends, as far as it is planned.
    pub fn end(&self) -> PathEnd {
        PathEnd {
            arc_m: self.points.last().map_or(0.0, |p| p.arc_m),
            is_dead_end: self.ends,
        }
    }

    /// Index of the leg at a path length.
    pub fn leg_at(&self, arc_m: f64) -> usize {
        self.legs
            .partition_point(|leg| leg.arc_m[1] <= arc_m)
            .min(self.legs.len().saturating_sub(1))
    }

    /// Extends the path as far as `until_m` and drops what lies far behind `now_m`.
    pub fn extend(&mut self, map: &RoadMap, now_m: f64, until_m: f64) {
        while !self.ends && self.end().arc_m < until_m {
            match self.choose(map) {
                Some(next) => self.append(map, next, 0.0),
                None => self.ends = true,
            }
        }
        let keep = self
            .legs
            .partition_point(|leg| leg.arc_m[1] < now_m - KEPT_BEHIND_M);
        if keep > 0 {
            let from_m = self.legs[keep].arc_m[0];
            self.legs.drain(..keep);
            let first = self.points.partition_point(|p| p.arc_m < from_m);
            self.points.drain(..first);
        }
    }

    /// Chooses one of the lanes that follow; a lane that leads nowhere only if there is no other.
    fn choose<'m>(&mut self, map: &'m RoadMap) -> Option<&'m Lane> {
        let last = self.legs.last()?.lane;
        let open: Vec<&Lane> = map
            .successors(last)
            .iter()
            .filter_map(|key| map.lane(*key))
            .filter(|lane| lane.kind.is_drivable())
            .collect();
        let goes_on = |lane: &&Lane| !map.successors(lane.key).is_empty();
        let better: Vec<&Lane> = open.iter().copied().filter(goes_on).collect();
        let list = if better.is_empty() { open } else { better };
        if list.len() > 1 {
            self.n_choices += 1;
        }
        let number = self.choices.bits(self.n_choices) as usize;
        (!list.is_empty()).then(|| list[number % list.len()])
    }

    fn append(&mut self, map: &RoadMap, lane: &Lane, from_s_m: f64) {
        let length = lane.length_m - from_s_m;
        let pieces = (length / STEP_M).ceil().max(1.0) as usize;
        let start_m = self.end().arc_m;
        for i in 0..=pieces {
            let at = LanePosition::new(lane.key, from_s_m + length * i as f64 / pieces as f64);
            let Some(pose) = map.pose(at) else { continue };
            let position_m = [pose.translation.x, pose.translation.y];
            let arc_m = match self.points.last() {
                Some(last) => last.arc_m + distance(last.position_m, position_m),
                None => 0.0,
            };
            // The end of one lane is the start of the next.
            if i == 0
                && self
                    .points
                    .last()
                    .is_some_and(|last| arc_m - last.arc_m < 0.3)
            {
                continue;
            }
            self.points.push(PathPoint {
                position_m,
                heading_rad: pose.rotation.euler_angles().2,
                curvature_per_m: map.curvature_per_m(at),
                limit_mps: map.speed_limit_mps(at).unwrap_or(DEFAULT_LIMIT_MPS),
                arc_m,
            });
        }
        self.legs.push(Leg {
            lane: lane.key,
            junction: lane.junction,
            arc_m: [start_m, self.end().arc_m],
            s_m: [from_s_m, lane.length_m],
        });
    }

    /// Prepends a run-up, so that a vehicle behind the first point has a path too.
    fn lead_in(&mut self, map: &RoadMap) {
        let (Some(first), Some(leg)) = (self.points.first().copied(), self.legs.first_mut()) else {
            return;
        };
        let back_m = 8.0f64.min(leg.s_m[0]);
        let lane = leg.lane;
        let from_s = leg.s_m[0] - back_m;
        let pieces = back_m.ceil() as usize;
        let mut run_up = Vec::new();
        for i in 0..pieces {
            let at = LanePosition::new(lane, from_s + back_m * i as f64 / pieces as f64);
            let Some(pose) = map.pose(at) else { return };
            run_up.push(PathPoint {
                position_m: [pose.translation.x, pose.translation.y],
                heading_rad: pose.rotation.euler_angles().2,
                curvature_per_m: map.curvature_per_m(at),
                ..first
            });
        }
        run_up.append(&mut self.points);
        let mut arc_m = 0.0;
        for i in 0..run_up.len() {
            if i > 0 {
                arc_m += distance(run_up[i - 1].position_m, run_up[i].position_m);
            }
            run_up[i].arc_m = arc_m;
        }
        self.points = run_up;
        leg.s_m[0] = from_s;
        leg.arc_m = [0.0, arc_m];
    }

    /// The point at a path length, between its neighbours.
    pub fn at(&self, arc_m: f64) -> PathPoint {
        let after = self
            .points
            .partition_point(|p| p.arc_m <= arc_m)
            .clamp(1, self.points.len().max(2) - 1);
        let (a, b) = (
            self.points[after - 1],
            self.points[after.min(self.points.len() - 1)],
        );
        let share = ((arc_m - a.arc_m) / (b.arc_m - a.arc_m).max(1e-6)).clamp(0.0, 1.0);
        let mix = |x: f64, y: f64| x + share * (y - x);
        PathPoint {
            position_m: [
                mix(a.position_m[0], b.position_m[0]),
                mix(a.position_m[1], b.position_m[1]),
            ],
            heading_rad: a.heading_rad + share * wrap(b.heading_rad - a.heading_rad),
            curvature_per_m: mix(a.curvature_per_m, b.curvature_per_m),
            limit_mps: a.limit_mps,
            arc_m,
        }
    }

    /// The nearest place between two path lengths.
    pub fn project(&self, point: [f64; 2], from_m: f64, to_m: f64) -> Foot {
        let first = self
            .points
            .partition_point(|p| p.arc_m < from_m)
            .saturating_sub(1);
        let mut best = (f64::INFINITY, Foot::default());
        for pair in self.points[first..].windows(2) {
            if pair[0].arc_m > to_m {
                break;
            }
            let foot = foot_on(&pair[0], &pair[1], point);
            let d = distance(foot.1, point);
            if d < best.0 {
                best = (d, foot.0);
            }
        }
        best.1
    }

    /// The first place between `from_m` and `to_m` at which the path comes within reach of a point.
    /// `reach_m` returns the reach at a path length, on one side.
    pub fn first_within(
        &self,
        point: [f64; 2],
        from_m: f64,
        to_m: f64,
        reach_m: impl Fn(f64, Side) -> f64,
    ) -> Option<Foot> {
        let first = self
            .points
            .partition_point(|p| p.arc_m < from_m)
            .saturating_sub(1);
        for pair in self.points[first..].windows(2) {
            if pair[0].arc_m > to_m {
                break;
            }
            // Cheap test before the exact one.
            let d = [
                point[0] - pair[0].position_m[0],
                point[1] - pair[0].position_m[1],
            ];
            if d[0].abs() > FARTHEST_REACH_M || d[1].abs() > FARTHEST_REACH_M {
                continue;
            }
            let (foot, at) = foot_on(&pair[0], &pair[1], point);
            if foot.arc_m >= from_m && distance(at, point) < reach_m(foot.arc_m, foot.side()) {
                return Some(foot);
            }
        }
        None
    }
}

fn foot_on(a: &PathPoint, b: &PathPoint, point: [f64; 2]) -> (Foot, [f64; 2]) {
    let d = [
        b.position_m[0] - a.position_m[0],
        b.position_m[1] - a.position_m[1],
    ];
    let r = [point[0] - a.position_m[0], point[1] - a.position_m[1]];
    let length2 = (d[0] * d[0] + d[1] * d[1]).max(1e-12);
    let share = ((r[0] * d[0] + r[1] * d[1]) / length2).clamp(0.0, 1.0);
    let at = [
        a.position_m[0] + share * d[0],
        a.position_m[1] + share * d[1],
    ];
    let heading_rad = a.heading_rad + share * wrap(b.heading_rad - a.heading_rad);
    let (sin, cos) = heading_rad.sin_cos();
    // Along the normal of the curve instead of the chord, so that the offset has no steps.
    let offset_m = -sin * (point[0] - at[0]) + cos * (point[1] - at[1]);
    (
        Foot {
            arc_m: a.arc_m + share * (b.arc_m - a.arc_m),
            offset_m,
            heading_rad,
        },
        at,
    )
}

/// Distance in the plane.
pub fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// An angle in (−π, π].
pub fn wrap(angle_rad: f64) -> f64 {
    let turns = (angle_rad / std::f64::consts::TAU).round();
    angle_rad - turns * std::f64::consts::TAU
}
