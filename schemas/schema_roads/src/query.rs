//! Positions: poses, widths, limits, nearest lanes, walking along the graph, polylines.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use crate::graph;
use crate::index::Chord;
use crate::lane::{Lane, LaneKey, LanePosition};
use crate::map::RoadMap;
use crate::marks::{MarkLine, MarkRecord, mark_at};
use crate::raw::{Road, Section};
use crate::road::{Edges, Station};

/// Most positions [`RoadMap::advance`] returns.
const MAX_BRANCHES: usize = 64;
/// Most lanes one walk looks at.
const MAX_VISITS: usize = 4096;
/// How far the index's chords may lie off the lanes they stand for, metres.
pub(crate) const CHORD_SLACK_M: f64 = 0.15;
/// Most points of a polyline.
const MAX_POINTS: f64 = 1.0e6;

impl RoadMap {
    pub(crate) fn place(&self, lane: &Lane) -> (&Road, &Section) {
        let road = &self.raw.roads[lane.road_idx as usize];
        (road, &road.sections[lane.key.section as usize])
    }

    fn at(&self, lane: &Lane, s_m: f64) -> (Station<'_>, Edges) {
        let (road, section) = self.place(lane);
        let station_m = lane.station_m(s_m);
        (
            road.station(station_m),
            road.edges(section, lane.key.lane, station_m),
        )
    }

    pub(crate) fn middle_point(&self, lane: &Lane, s_m: f64) -> [f64; 3] {
        let (station, edges) = self.at(lane, s_m);
        let middle = edges.middle().0;
        station.point(
            station.lane_offset_m + middle,
            self.lift(lane, &station, &edges, middle).0,
        )
    }

    /// Height of a lane over its road at `t_m` before the lane offset, and its slope to the left.
    fn lift(&self, lane: &Lane, station: &Station<'_>, edges: &Edges, t_m: f64) -> (f64, f64) {
        let (_, section) = self.place(lane);
        match section.lane(lane.key.lane) {
            Some(raw) if !raw.heights.is_empty() => {
                edges.lift(raw, station.s_m - section.start_m, t_m)
            }
            _ => (0.0, 0.0),
        }
    }

    fn lane_pose(&self, lane: &Lane, s_m: f64, offset_m: f64) -> (Isometry3<f64>, f64) {
        let (station, edges) = self.at(lane, s_m);
        let (middle, slope) = edges.middle();
        let t_m = middle + if lane.forward { offset_m } else { -offset_m };
        let lift = self.lift(lane, &station, &edges, t_m);
        let t_m = station.lane_offset_m + t_m;
        let mut frame = station.frame(t_m, station.lane_offset_slope + slope, lift);
        if !lane.forward {
            frame.rotation *=
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
        }
        (frame, station.stretch(t_m))
    }

    /// Pose on the road surface: x along the driving direction, y left, z off the surface. `None`
    /// for an unknown lane.
    /// `s_m` beyond the lane's ends is taken as its end.
    pub fn pose(&self, at: LanePosition) -> Option<Isometry3<f64>> {
        let lane = self.lane(at.lane)?;
        Some(
            self.lane_pose(lane, at.s_m.clamp(0.0, lane.length_m), at.offset_m)
                .0,
        )
    }

    /// Curvature of the lane's middle in driving direction, 1/m, positive to the left; 0 for an
    /// unknown lane.
    pub fn curvature_per_m(&self, at: LanePosition) -> f64 {
        let Some(lane) = self.lane(at.lane) else {
            return 0.0;
        };
        let (station, edges) = self.at(lane, at.s_m.clamp(0.0, lane.length_m));
        let stretch = station
            .stretch(station.lane_offset_m + edges.middle().0)
            .max(0.05);
        let curvature = station.plan.curvature_per_m / stretch;
        if lane.forward { curvature } else { -curvature }
    }

    /// Width of the lane, metres; 0 for an unknown lane.
    pub fn width_m(&self, at: LanePosition) -> f64 {
        self.lane(at.lane).map_or(0.0, |lane| {
            self.at(lane, at.s_m.clamp(0.0, lane.length_m)).1.width_m()
        })
    }

    /// Speed limit, m/s: the lane's own, else the road's; `None` if there is none.
    pub fn speed_limit_mps(&self, at: LanePosition) -> Option<f64> {
        let lane = self.lane(at.lane)?;
        let (road, section) = self.place(lane);
        let station_m = lane.station_m(at.s_m.clamp(0.0, lane.length_m));
        let in_force = |list: &[(f64, Option<f64>)], s: f64| {
            let after = list.partition_point(|(from, _)| *from <= s + 1e-9);
            list.get(after.checked_sub(1)?).map(|(_, limit)| *limit)
        };
        let own = section
            .lane(lane.key.lane)
            .and_then(|raw| in_force(&raw.speeds, station_m - section.start_m));
        own.or_else(|| in_force(&road.speeds, station_m)).flatten()
    }

    /// The lane whose middle is nearest to a world point, among those `filter` lets pass, and the
    /// place on it.
    pub fn nearest(&self, point: [f64; 3], filter: impl Fn(&Lane) -> bool) -> Option<LanePosition> {
        if !point.iter().all(|x| x.is_finite()) {
            return None;
        }
        // Chords cut bends by less than the slack, so the nearest lane is among these.
        let near = self
            .grid
            .near(point, self.chord_reach_m, CHORD_SLACK_M, |idx| {
                filter(&self.lanes[idx as usize])
            });
        let place = |(chord, share): &(Chord, f64)| {
            let lane = &self.lanes[chord.lane as usize];
            let at = self.refine(
                lane,
                chord.s_m[0] + share * (chord.s_m[1] - chord.s_m[0]),
                point,
            );
            (self.squared_distance(lane, at.s_m, point), at)
        };
        let best = near
            .iter()
            .map(place)
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.lane.cmp(&b.1.lane)));
        best.map(|(_, at)| at)
    }

    /// The nearest place on one lane; `None` for an unknown lane.
    pub fn project(&self, key: LaneKey, point: [f64; 3]) -> Option<LanePosition> {
        let lane = self
            .lane(key)
            .filter(|_| point.iter().all(|x| x.is_finite()))?;
        let pieces = (lane.length_m / 4.0).ceil().clamp(1.0, 500.0) as usize;
        let distance = |s: f64| self.squared_distance(lane, s, point);
        let best = (0..=pieces)
            .map(|i| lane.length_m * i as f64 / pieces as f64)
            .min_by(|a, b| distance(*a).total_cmp(&distance(*b)))?;
        Some(self.refine(lane, best, point))
    }

    /// The foot of the perpendicular near `start_m`: by Newton's steps, or by search where a bend
    /// is so tight that these miss.
    fn refine(&self, lane: &Lane, start_m: f64, point: [f64; 3]) -> LanePosition {
        let start_m = start_m.clamp(0.0, lane.length_m);
        let by_steps = self.step_to_foot(lane, start_m, point);
        let s_m = match by_steps {
            Some(s_m)
                if self.squared_distance(lane, s_m, point)
                    <= self.squared_distance(lane, start_m, point) + 1e-6 =>
            {
                s_m
            }
            _ => self.search_foot(lane, start_m, point),
        };
        let pose = self.lane_pose(lane, s_m, 0.0).0;
        let offset_m =
            (pose.rotation.inverse() * (Vector3::from(point) - pose.translation.vector)).y;
        LanePosition {
            lane: lane.key,
            s_m,
            offset_m,
        }
    }

    fn squared_distance(&self, lane: &Lane, s_m: f64, point: [f64; 3]) -> f64 {
        let p = self.middle_point(lane, s_m);
        (0..3).map(|i| (p[i] - point[i]).powi(2)).sum()
    }

    /// `None` if the steps do not come to rest.
    fn step_to_foot(&self, lane: &Lane, start_m: f64, point: [f64; 3]) -> Option<f64> {
        let point = Vector3::from(point);
        let mut s_m = start_m;
        for _ in 0..6 {
            let (pose, stretch) = self.lane_pose(lane, s_m, 0.0);
            let local = pose.rotation.inverse() * (point - pose.translation.vector);
            let next = (s_m + local.x / stretch.max(0.2)).clamp(0.0, lane.length_m);
            let moved = (next - s_m).abs();
            s_m = next;
            if moved < 1e-4 {
                return Some(s_m);
            }
        }
        None
    }

    /// The best of places every quarter of a metre, then closer and closer around it.
    fn search_foot(&self, lane: &Lane, start_m: f64, point: [f64; 3]) -> f64 {
        const REACH_M: f64 = 3.0;
        const PIECES: u32 = 12;
        let (mut best_m, mut reach_m) = (start_m, REACH_M);
        while reach_m > 1e-6 {
            let around = (0..=2 * PIECES)
                .map(|i| best_m + reach_m * (f64::from(i) / f64::from(PIECES) - 1.0));
            let nearer = around
                .map(|s_m| s_m.clamp(0.0, lane.length_m))
                .min_by(|a, b| {
                    self.squared_distance(lane, *a, point)
                        .total_cmp(&self.squared_distance(lane, *b, point))
                });
            best_m = nearer.unwrap_or(best_m);
            reach_m /= f64::from(PIECES) / 2.0;
        }
        best_m
    }

    /// Whether marks allow a change to the lane on the left.
    pub fn may_change_left(&self, at: LanePosition) -> bool {
        self.lane(at.lane)
            .is_some_and(|lane| lane.left.is_some() && self.may_cross(lane, at.s_m, lane.forward))
    }

    /// Whether marks allow a change to the lane on the right.
    pub fn may_change_right(&self, at: LanePosition) -> bool {
        self.lane(at.lane)
            .is_some_and(|lane| lane.right.is_some() && self.may_cross(lane, at.s_m, !lane.forward))
    }

    /// Whether the mark towards greater or smaller ids may be crossed.
    fn may_cross(&self, lane: &Lane, s_m: f64, to_greater: bool) -> bool {
        let (_, section) = self.place(lane);
        let ds = lane.station_m(s_m.clamp(0.0, lane.length_m)) - section.start_m;
        let id = lane.key.lane;
        // A lane's own record is its outer edge: the greater side of a positive id, the smaller
        // side of a negative one.
        let records = if to_greater == (id > 0) {
            section.lane(id).map(|raw| &raw.marks)
        } else if id.abs() == 1 {
            Some(&section.centre_marks)
        } else {
            section.lane(id - id.signum()).map(|raw| &raw.marks)
        };
        let allowed = |mark: &MarkRecord| {
            if to_greater {
                mark.to_greater
            } else {
                mark.to_smaller
            }
        };
        records
            .and_then(|records| mark_at(records, ds))
            .is_none_or(allowed)
    }

    /// Where one can be after `distance_m` (backwards if negative): one place per branch, none past
    /// a dead end. At most 64.
    pub fn advance(&self, at: LanePosition, distance_m: f64) -> Vec<LanePosition> {
        let mut found = Vec::new();
        if !distance_m.is_finite() || self.lane(at.lane).is_none() {
            return found;
        }
        let mut open = vec![(at.lane, at.s_m + distance_m)];
        let mut visits = 0;
        while let Some((key, s_m)) = open.pop() {
            visits += 1;
            if visits > MAX_VISITS || found.len() >= MAX_BRANCHES {
                break;
            }
            let Some(lane) = self.lane(key) else { continue };
            if s_m > lane.length_m {
                open.extend(
                    lane.successors
                        .iter()
                        .rev()
                        .map(|next| (*next, s_m - lane.length_m)),
                );
            } else if s_m < 0.0 {
                let before = lane
                    .predecessors
                    .iter()
                    .rev()
                    .filter_map(|key| Some((*key, s_m + self.lane(*key)?.length_m)));
                open.extend(before);
            } else {
                found.push(LanePosition {
                    lane: key,
                    s_m,
                    offset_m: at.offset_m,
                });
            }
        }
        found
    }

    /// Points of the lane's middle in driving direction, both ends included, at most `step_m` apart
    /// along the reference line.
    pub fn centreline(&self, key: LaneKey, step_m: f64) -> Vec<[f64; 3]> {
        let Some(lane) = self.lane(key) else {
            return Vec::new();
        };
        stations(0.0, lane.length_m, step_m)
            .map(|s| self.middle_point(lane, s))
            .collect()
    }

    /// Left and right edge of the lane in driving direction, as [`RoadMap::centreline`].
    pub fn boundaries(&self, key: LaneKey, step_m: f64) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
        let Some(lane) = self.lane(key) else {
            return Default::default();
        };
        let edge_points = |s: f64| {
            let (station, edges) = self.at(lane, s);
            let (low, high) = (
                edges.inner_m.min(edges.outer_m),
                edges.inner_m.max(edges.outer_m),
            );
            let (left, right) = if lane.forward {
                (high, low)
            } else {
                (low, high)
            };
            let point = |t_m: f64| {
                station.point(
                    station.lane_offset_m + t_m,
                    self.lift(lane, &station, &edges, t_m).0,
                )
            };
            (point(left), point(right))
        };
        stations(0.0, lane.length_m, step_m)
            .map(edge_points)
            .unzip()
    }

    /// All painted lines of all roads, for drawing.
    pub fn mark_lines(&self, step_m: f64) -> Vec<MarkLine> {
        let mut lines = Vec::new();
        for road in &self.raw.roads {
            for section in &road.sections {
                self.section_marks(
                    road,
                    section,
                    &section.centre_marks,
                    None,
                    step_m,
                    &mut lines,
                );
                for lane in section.left.iter().chain(&section.right) {
                    self.section_marks(
                        road,
                        section,
                        &lane.marks,
                        Some(lane.id),
                        step_m,
                        &mut lines,
                    );
                }
            }
        }
        lines
    }

    fn section_marks(
        &self,
        road: &Road,
        section: &Section,
        records: &[MarkRecord],
        lane: Option<i8>,
        step_m: f64,
        lines: &mut Vec<MarkLine>,
    ) {
        for (idx, mark) in records.iter().enumerate() {
            let from = (section.start_m + mark.s_offset_m).max(section.start_m);
            let to = records
                .get(idx + 1)
                .map_or(section.end_m, |next| section.start_m + next.s_offset_m)
                .min(section.end_m);
            if mark.kind == crate::MarkKind::None || to - from < 1e-6 {
                continue;
            }
            let point = |s: f64| {
                let station = road.station(s);
                let edge = lane.map_or(0.0, |id| road.edges(section, id, s).outer_m);
                station.point(station.lane_offset_m + edge, 0.0)
            };
            let points = stations(from, to, step_m).map(point).collect();
            lines.push(MarkLine {
                kind: mark.kind,
                colour: mark.colour,
                width_m: mark.width_m,
                road: road.number,
                lane: lane.unwrap_or(0),
                to_greater: mark.to_greater,
                to_smaller: mark.to_smaller,
                points,
            });
        }
    }

    /// Index of a lane in [`RoadMap::lanes`].
    pub fn lane_idx(&self, key: LaneKey) -> Option<usize> {
        graph::find(&self.lanes, key)
    }
}

/// Evenly spread stations from `from` to `to`, both included.
fn stations(from: f64, to: f64, step_m: f64) -> impl Iterator<Item = f64> {
    let pieces = ((to - from) / step_m.max(0.01))
        .ceil()
        .clamp(1.0, MAX_POINTS) as usize;
    (0..=pieces).map(move |i| from + (to - from) * i as f64 / pieces as f64)
}
