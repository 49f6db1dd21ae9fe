//! The way ahead of one vehicle: a chain of lanes, as points one metre apart.

use std::collections::VecDeque;
use std::sync::Arc;

use schema_types::noise::Noise;

use crate::lanes::network::{LanePlace, Network, TURN_RAD, Way};
use crate::parameters::RoadOption;
use crate::plane::{PathPoint, Side, distance, wrap};
use crate::speed;

/// Length that is kept behind the vehicle, metres.
const KEPT_BEHIND_M: f64 = 30.0;
/// Length of the run-up before the first place, metres.
const RUN_UP_M: f64 = 8.0;

/// A lane of the path.
#[derive(Clone, Debug)]
pub struct Leg {
    /// The lane, by its index in the map.
    pub lane: u32,
    /// Path length at which it begins and ends, metres.
    pub arc_m: [f64; 2],
    pub(crate) way: Arc<Way>,
    /// Lane s at which it begins and ends, metres.
    pub(crate) s_m: [f64; 2],
}

impl Leg {
    /// Junction it crosses, or several that are crossed as one.
    pub fn zone(&self) -> Option<u32> {
        self.way.zone
    }

    /// Path length at a place on the lane.
    pub fn arc_at_m(&self, s_m: f64) -> f64 {
        let span = (self.s_m[1] - self.s_m[0]).max(1e-6);
        self.arc_m[0] + (self.arc_m[1] - self.arc_m[0]) * (s_m - self.s_m[0]) / span
    }

    /// Place on the lane at a path length.
    pub fn s_at_m(&self, arc_m: f64) -> f64 {
        let span = (self.arc_m[1] - self.arc_m[0]).max(1e-6);
        self.s_m[0] + (self.s_m[1] - self.s_m[0]) * (arc_m - self.arc_m[0]) / span
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

/// A place between two points of the path.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Near {
    /// Index of the point before it.
    pub segment: usize,
    /// How far on to the next point, 0..=1.
    share: f64,
    /// Distance from the point for which it was searched, metres.
    pub apart_m: f64,
}

/// Where a path ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathEnd {
    /// Path length there, metres.
    pub arc_m: f64,
    /// Whether no lane follows.
    pub is_dead_end: bool,
}

/// What decides where a path goes on.
#[derive(Clone, Debug, Default)]
pub struct Guide {
    /// Decisions at the next junctions; the first ones are taken first.
    pub route: VecDeque<RoadOption>,
    /// Lanes to come through, as a route found them; a lane that is not among them is left to
    /// chance.
    pub lanes: VecDeque<u32>,
}

/// A piece of the path on which it goes from one lane to the next, or round something.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shift {
    /// Path length at which it begins and ends, metres.
    pub arc_m: [f64; 2],
    /// Side to which it goes.
    pub side: Side,
    /// Lane that is left.
    pub(crate) from: u32,
    /// Lane s on the lane that is left, less the path length, metres.
    pub(crate) from_s_less_arc_m: f64,
}

/// The way ahead.
#[derive(Clone, Debug)]
pub struct Path {
    points: Vec<PathPoint>,
    /// Their positions alone: searches touch many of them, and little else of each.
    places: Vec<[f64; 2]>,
    legs: Vec<Leg>,
    /// Whether the last lane leads nowhere.
    ends: bool,
    shift: Option<Shift>,
    choices: Noise,
    n_choices: u64,
    guide: Guide,
}

impl Path {
    /// A path from a place on a lane. `choices` decides at junctions, counted from `n_choices`,
    /// where the guide does not.
    pub(crate) fn new(
        net: &mut Network,
        from: LanePlace,
        choices: Noise,
        n_choices: u64,
        guide: Guide,
    ) -> Path {
        let way = net.way(from.lane);
        let mut path = Path {
            points: Vec::new(),
            places: Vec::new(),
            legs: Vec::new(),
            ends: false,
            shift: None,
            choices,
            n_choices,
            guide,
        };
        let s_m = from.s_m.min(way.span_m - 0.1).max(0.0);
        path.append(from.lane, way, (s_m - RUN_UP_M).max(0.0));
        path
    }

    /// Number of choices made so far.
    pub fn n_choices(&self) -> u64 {
        self.n_choices
    }

    /// What is left of the decisions.
    pub fn guide(&self) -> &Guide {
        &self.guide
    }

    /// Points by rising length.
    pub fn points(&self) -> &[PathPoint] {
        &self.points
    }

    /// The positions of the points.
    pub(crate) fn places(&self) -> &[[f64; 2]] {
        &self.places
    }

    /// Lanes in order.
    pub fn legs(&self) -> &[Leg] {
        &self.legs
    }

    /// The change of lanes that is under way or ahead.
    pub fn shift(&self) -> Option<Shift> {
        self.shift
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

    /// Index of the first point at or after a path length.
    pub(crate) fn point_idx(&self, arc_m: f64) -> usize {
        // Points lie about a metre apart, so that the guess is near.
        let first = self.points.first().map_or(0.0, |p| p.arc_m);
        let last = self.points.len() - 1;
        let mut idx = ((arc_m - first).max(0.0) as usize).min(last);
        while idx > 0 && self.points[idx - 1].arc_m >= arc_m {
            idx -= 1;
        }
        while idx < last && self.points[idx].arc_m < arc_m {
            idx += 1;
        }
        idx
    }

    /// Extends the path as far as `until_m` and drops what lies far behind `now_m`.
    pub(crate) fn extend(&mut self, net: &mut Network, now_m: f64, until_m: f64) {
        while !self.ends && self.end().arc_m < until_m {
            match self.choose(net) {
                Some(next) => {
                    let way = net.way(next);
                    self.append(next, way, 0.0);
                }
                None => self.ends = true,
            }
        }
        if self.shift.is_some_and(|shift| shift.arc_m[1] < now_m) {
            self.shift = None;
        }
        let keep = self
            .legs
            .partition_point(|leg| leg.arc_m[1] < now_m - KEPT_BEHIND_M);
        if keep > 0 {
            self.legs.drain(..keep);
        }
        // Rarely, because the rest moves up.
        let until_m = now_m - KEPT_BEHIND_M;
        if self.points.get(60).is_some_and(|p| p.arc_m < until_m) {
            let first = self.points.partition_point(|p| p.arc_m < until_m);
            self.points.drain(..first);
            self.places.drain(..first);
        }
    }

    /// Forgets what lies behind the leg at `arc_m` and, if that one crosses a junction, behind the
    /// junction; the rest is planned anew.
    pub(crate) fn replan(&mut self, arc_m: f64, choices: Noise, guide: Guide) {
        let mut last = self.leg_at(arc_m);
        let shift_end = self.shift.map_or(arc_m, |shift| shift.arc_m[1]);
        while last + 1 < self.legs.len()
            && (self.legs[last + 1].zone().is_some() && self.legs[last].zone().is_some()
                || self.legs[last].arc_m[1] < shift_end)
        {
            last += 1;
        }
        self.legs.truncate(last + 1);
        let end_m = self.legs[last].arc_m[1];
        self.points.retain(|p| p.arc_m <= end_m + 1e-9);
        self.places.truncate(self.points.len());
        self.ends = false;
        self.choices = choices;
        self.guide = guide;
    }

    /// Chooses one of the lanes that follow; a lane that leads nowhere only if there is no other.
    fn choose(&mut self, net: &mut Network) -> Option<u32> {
        let last = self.legs.last()?.lane;
        let way = net.way(last);
        let open = &way.successors;
        if open.is_empty() {
            return None;
        }
        while self.guide.lanes.front().is_some_and(|lane| *lane == last) {
            self.guide.lanes.pop_front();
        }
        if let Some(wanted) = self.guide.lanes.front().filter(|lane| open.contains(lane)) {
            return Some(*wanted);
        }
        let better: Vec<u32> = open.iter().copied().filter(|l| net.goes_on(*l)).collect();
        let list: &[u32] = if better.is_empty() { open } else { &better };
        if list.len() == 1 {
            return list.first().copied();
        }
        if let Some(option) = self.guide.route.pop_front() {
            return list.iter().copied().min_by(|a, b| {
                let cost = |lane: u32, net: &mut Network| misses(option, net.way(lane).turn_rad);
                let (a, b) = (cost(*a, net), cost(*b, net));
                a.total_cmp(&b)
            });
        }
        self.n_choices += 1;
        let number = self.choices.bits(self.n_choices) as usize;
        Some(list[number % list.len()])
    }

    fn append(&mut self, lane: u32, way: Arc<Way>, from_s_m: f64) {
        let from_arc = way.arc_at(from_s_m);
        let start_m = self.end().arc_m;
        for (idx, point) in way.points.iter().enumerate() {
            if point.arc_m < from_arc - 1e-9 {
                continue;
            }
            let arc_m = match self.points.last() {
                Some(last) => last.arc_m + distance(last.position_m, point.position_m),
                None => 0.0,
            };
            // The end of one lane is the start of the next.
            let is_seam = idx == 0 && self.points.last().is_some_and(|p| arc_m - p.arc_m < 0.3);
            if !is_seam {
                self.points.push(PathPoint { arc_m, ..*point });
                self.places.push(point.position_m);
            }
        }
        self.legs.push(Leg {
            lane,
            arc_m: [start_m, self.end().arc_m],
            s_m: [from_s_m, way.span_m],
            way,
        });
    }

    /// Goes over to the lane beside the one at `from_m`, over `length_m`; false if the two do not
    /// run side by side for so long.
    pub(crate) fn change_lane(
        &mut self,
        net: &mut Network,
        from_m: f64,
        length_m: f64,
        side: Side,
    ) -> bool {
        let idx = self.leg_at(from_m);
        let leg = self.legs[idx].clone();
        let own = net.way(leg.lane);
        let target = match side {
            Side::Left => own.left,
            Side::Right => own.right,
        };
        let Some(target) = target else { return false };
        let s_m = leg.s_at_m(from_m).clamp(0.0, own.span_m);
        let mut other = self.clone();
        let keep = self.point_idx(from_m);
        other.points.truncate(keep.max(1));
        other.legs.truncate(idx + 1);
        other.legs[idx].arc_m[1] = from_m;
        other.legs[idx].s_m[1] = s_m;
        other.ends = false;
        other.guide.lanes.clear();
        let start_m = from_m;
        // Points of the target lanes first, moved onto the curve afterwards.
        let mut chain = Path {
            points: Vec::new(),
            places: Vec::new(),
            legs: Vec::new(),
            ends: false,
            shift: None,
            choices: self.choices,
            n_choices: self.n_choices,
            guide: Guide {
                route: self.guide.route.clone(),
                lanes: VecDeque::new(),
            },
        };
        let way = net.way(target);
        let from_s_m = s_m.min(way.span_m - 0.1).max(0.0);
        chain.append(target, way, from_s_m);
        chain.extend(net, 0.0, length_m + 20.0);
        if chain.end().arc_m < length_m + 1.0 {
            return false;
        }
        let base = other.points.last().copied();
        let Some(base) = base else { return false };
        let mut last = base;
        let mut hint = from_m;
        let mut first_bent = other.points.len();
        for point in &chain.points {
            let share = (point.arc_m / length_m).clamp(0.0, 1.0);
            // Quintic: no jump of direction or curvature at the ends.
            let weight = share * share * share * (10.0 + share * (6.0 * share - 15.0));
            let mut moved = *point;
            if weight < 1.0 {
                let foot = self.project(point.position_m, hint - 5.0, hint + 10.0);
                hint = foot.arc_m;
                let own = self.at(foot.arc_m);
                if foot.offset_m.abs() > 6.0 {
                    return false;
                }
                for axis in 0..2 {
                    moved.position_m[axis] = own.position_m[axis]
                        + weight * (point.position_m[axis] - own.position_m[axis]);
                }
                moved.height_m = own.height_m + weight * (point.height_m - own.height_m);
            }
            let step = distance(last.position_m, moved.position_m);
            if step < 0.3 {
                continue;
            }
            moved.arc_m = last.arc_m + step;
            other.points.push(moved);
            last = moved;
        }
        // Legs follow the lengths of the moved points.
        let stretch = (last.arc_m - base.arc_m) / chain.end().arc_m.max(1e-6);
        for leg in &chain.legs {
            other.legs.push(Leg {
                arc_m: leg.arc_m.map(|arc| start_m + arc * stretch),
                ..leg.clone()
            });
        }
        first_bent = first_bent.saturating_sub(1);
        bend(
            &mut other.points,
            first_bent,
            start_m + length_m * stretch + 3.0,
        );
        other.ends = chain.ends;
        other.n_choices = chain.n_choices;
        other.guide = chain.guide;
        other.shift = Some(Shift {
            arc_m: [start_m, start_m + length_m * stretch],
            side,
            from: leg.lane,
            from_s_less_arc_m: s_m - from_m,
        });
        *self = other;
        self.note_places();
        true
    }

    /// Goes round something: `offset_m` to the left between two path lengths, over `length_m` on
    /// either side.
    pub(crate) fn swerve(&mut self, between_m: [f64; 2], offset_m: f64, length_m: f64) {
        let range = [between_m[0] - length_m, between_m[1] + length_m];
        let first = self.point_idx(range[0]);
        for point in &mut self.points[first..] {
            if point.arc_m > range[1] {
                break;
            }
            let outside = (between_m[0] - point.arc_m)
                .max(point.arc_m - between_m[1])
                .max(0.0);
            let share = 1.0 - (outside / length_m).min(1.0);
            let weight = share * share * share * (10.0 + share * (6.0 * share - 15.0));
            let (sin, cos) = point.heading_rad.sin_cos();
            point.position_m[0] -= sin * offset_m * weight;
            point.position_m[1] += cos * offset_m * weight;
        }
        bend(&mut self.points, first, range[1] + 2.0);
        self.note_places();
    }

    fn note_places(&mut self) {
        self.places.clear();
        self.places.extend(self.points.iter().map(|p| p.position_m));
    }

    /// The point at a path length, between its neighbours.
    pub fn at(&self, arc_m: f64) -> PathPoint {
        let after = self.point_idx(arc_m).clamp(1, self.points.len().max(2) - 1);
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
            height_m: mix(a.height_m, b.height_m),
            heading_rad: a.heading_rad + share * wrap(b.heading_rad - a.heading_rad),
            curvature_per_m: mix(a.curvature_per_m, b.curvature_per_m),
            limit_mps: a.limit_mps,
            bend_mps: a.bend_mps.min(b.bend_mps),
            arc_m,
        }
    }

    /// The nearest place between two path lengths.
    pub fn project(&self, point: [f64; 2], from_m: f64, to_m: f64) -> Foot {
        let first = self.point_idx(from_m).saturating_sub(1);
        let mut best = (f64::INFINITY, Foot::default());
        for pair in self.points[first..].windows(2) {
            if pair[0].arc_m > to_m {
                break;
            }
            let (foot, at) = foot_on(&pair[0], &pair[1], point);
            let d = distance(at, point);
            if d < best.0 {
                best = (d, foot);
            }
        }
        best.1
    }

    /// The nearest place to a point, found downhill from the point with index `start`.
    /// Returns its distance too, metres.
    pub(crate) fn descend(&self, point: [f64; 2], start: usize) -> (Foot, f64) {
        let near = self.nearest(point, start);
        (self.foot(near, point), near.apart_m)
    }

    /// The same without the direction there, which costs more than all the rest.
    pub(crate) fn nearest(&self, point: [f64; 2], start: usize) -> Near {
        let last = self.places.len() - 2;
        let square = |idx: usize| {
            let [x, y] = self.places[idx];
            (x - point[0]) * (x - point[0]) + (y - point[1]) * (y - point[1])
        };
        let mut idx = start.min(last + 1);
        let mut least = square(idx);
        loop {
            let up = if idx <= last {
                square(idx + 1)
            } else {
                f64::INFINITY
            };
            let down = if idx > 0 {
                square(idx - 1)
            } else {
                f64::INFINITY
            };
            if up < least && up <= down {
                (idx, least) = (idx + 1, up);
            } else if down < least {
                (idx, least) = (idx - 1, down);
            } else {
                break;
            }
        }
        let before = idx.saturating_sub(1).min(last);
        let after = idx.min(last);
        let on = |segment: usize| {
            let (share, at) = nearest_on(self.places[segment], self.places[segment + 1], point);
            Near {
                segment,
                share,
                apart_m: distance(at, point),
            }
        };
        let (a, b) = (on(before), on(after));
        if a.apart_m < b.apart_m { a } else { b }
    }

    /// The place between two points, as seen from a point beside it.
    pub(crate) fn foot(&self, near: Near, point: [f64; 2]) -> Foot {
        let (a, b) = (&self.points[near.segment], &self.points[near.segment + 1]);
        foot_at(a, b, near.share, point)
    }

    /// Path length of a place between two points.
    pub(crate) fn arc_at(&self, near: Near) -> f64 {
        let (a, b) = (&self.points[near.segment], &self.points[near.segment + 1]);
        a.arc_m + near.share * (b.arc_m - a.arc_m)
    }
}

/// How badly a turn fits a decision.
fn misses(option: RoadOption, turn_rad: f64) -> f64 {
    match option {
        RoadOption::Left => (TURN_RAD + 0.4 - turn_rad).max(0.0),
        RoadOption::Right => (turn_rad + TURN_RAD + 0.4).max(0.0),
        _ => turn_rad.abs(),
    }
}

/// Recomputes lengths, directions and curvatures of points that were moved, from index `first` to
/// the path length `until_m`.
fn bend(points: &mut [PathPoint], first: usize, until_m: f64) {
    let n = points.len();
    let mut last = first;
    for idx in first.max(1)..n {
        points[idx].arc_m =
            points[idx - 1].arc_m + distance(points[idx - 1].position_m, points[idx].position_m);
        if points[idx].arc_m <= until_m {
            last = idx;
        }
    }
    let heading = |a: &PathPoint, b: &PathPoint| {
        (b.position_m[1] - a.position_m[1]).atan2(b.position_m[0] - a.position_m[0])
    };
    let headings: Vec<f64> = (first..=last)
        .map(|idx| {
            let (a, b) = (idx.saturating_sub(2), (idx + 2).min(n - 1));
            heading(&points[a], &points[b])
        })
        .collect();
    for (k, idx) in (first..=last).enumerate() {
        let (a, b) = (k.saturating_sub(2), (k + 2).min(headings.len() - 1));
        let run = points[first + b].arc_m - points[first + a].arc_m;
        let curvature = wrap(headings[b] - headings[a]) / run.max(0.5);
        points[idx].heading_rad = headings[k];
        points[idx].curvature_per_m = curvature;
        points[idx].bend_mps = speed::on_bend(curvature);
    }
}

fn foot_on(a: &PathPoint, b: &PathPoint, point: [f64; 2]) -> (Foot, [f64; 2]) {
    let (share, at) = nearest_on(a.position_m, b.position_m, point);
    (foot_at(a, b, share, point), at)
}

/// How far from one point to the next the nearest place to a third is, 0..=1, and where.
fn nearest_on(a: [f64; 2], b: [f64; 2], point: [f64; 2]) -> (f64, [f64; 2]) {
    let d = [b[0] - a[0], b[1] - a[1]];
    let r = [point[0] - a[0], point[1] - a[1]];
    let length2 = (d[0] * d[0] + d[1] * d[1]).max(1e-12);
    let share = ((r[0] * d[0] + r[1] * d[1]) / length2).clamp(0.0, 1.0);
    (share, [a[0] + share * d[0], a[1] + share * d[1]])
}

fn foot_at(a: &PathPoint, b: &PathPoint, share: f64, point: [f64; 2]) -> Foot {
    let at = [
        a.position_m[0] + share * (b.position_m[0] - a.position_m[0]),
        a.position_m[1] + share * (b.position_m[1] - a.position_m[1]),
    ];
    let heading_rad = a.heading_rad + share * wrap(b.heading_rad - a.heading_rad);
    let (sin, cos) = heading_rad.sin_cos();
    // Along the normal of the curve instead of the chord, so that the offset has no steps.
    let offset_m = -sin * (point[0] - at[0]) + cos * (point[1] - at[1]);
    Foot {
        arc_m: a.arc_m + share * (b.arc_m - a.arc_m),
        offset_m,
        heading_rad,
    }
}
