//! Positions on lanes: poses, widths, limits, the nearest lane, ways along the graph, polylines.

use nalgebra::Isometry3;

use crate::chords::Chord;
use crate::graph;
use crate::lane::{Lane, LaneKey, LanePosition};
use crate::lane_shape::LaneShape;
use crate::map::RoadMap;
use crate::marks::{MarkKind, MarkLine, MarkRecord, mark_at};
use crate::raw::{Road, Section};

/// Most positions [`RoadMap::advance`] returns.
const MAX_BRANCHES: usize = 64;
/// Most lanes that one call of [`RoadMap::advance`] visits.
const MAX_VISITS: usize = 4096;
/// Most points of a polyline.
const MAX_POINTS: f64 = 1.0e6;

impl RoadMap {
    pub(crate) fn shape<'m>(&'m self, lane: &'m Lane) -> LaneShape<'m> {
        LaneShape::of(&self.raw, lane)
    }

    /// Pose on the road surface: x along the driving direction, y left, z off the surface. `None`
    /// for an unknown lane. An `s_m` beyond the lane's ends counts as the end.
    pub fn pose(&self, at: LanePosition) -> Option<Isometry3<f64>> {
        let shape = self.shape(self.lane(at.lane)?);
        Some(shape.pose(shape.clamped(at.s_m), at.offset_m).0)
    }

    /// Curvature of the lane's middle in driving direction, 1/m, positive to the left; 0 for an
    /// unknown lane.
    pub fn curvature_per_m(&self, at: LanePosition) -> f64 {
        let Some(lane) = self.lane(at.lane) else {
            return 0.0;
        };
        let shape = self.shape(lane);
        let (station, edges) = shape.at(shape.clamped(at.s_m));
        let stretch = station
            .stretch(station.lane_offset_m + edges.middle().0)
            .max(0.05);
        let curvature = station.plan.curvature_per_m / stretch;
        if lane.forward { curvature } else { -curvature }
    }

    /// Width of the lane, metres; 0 for an unknown lane.
    pub fn width_m(&self, at: LanePosition) -> f64 {
        self.lane(at.lane).map_or(0.0, |lane| {
            let shape = self.shape(lane);
            shape.at(shape.clamped(at.s_m)).1.width_m()
        })
    }

    /// Speed limit, m/s: the lane's own, else the road's; `None` if there is none.
    pub fn speed_limit_mps(&self, at: LanePosition) -> Option<f64> {
        let lane = self.lane(at.lane)?;
        let shape = self.shape(lane);
        let LaneShape { road, section, .. } = shape;
        let station_m = lane.station_m(shape.clamped(at.s_m));
        let in_force = |list: &[(f64, Option<f64>)], s: f64| {
            let after = list.partition_point(|(from, _)| *from <= s + 1e-9);
            list.get(after.checked_sub(1)?).map(|(_, limit)| *limit)
        };
        let own = section
            .lane(lane.key.lane)
            .and_then(|raw| in_force(&raw.speeds, station_m - section.start_m));
        own.or_else(|| in_force(&road.speeds, station_m)).flatten()
    }

    /// The lane whose middle is nearest to a world point, among the lanes that `filter` accepts,
    /// and the place on it.
    pub fn nearest(&self, point: [f64; 3], filter: impl Fn(&Lane) -> bool) -> Option<LanePosition> {
        if !point.iter().all(|x| x.is_finite()) {
            return None;
        }
        // Chords lie within the slack of their lanes, so the nearest lane is among these.
        let near = self
            .chords
            .near(point, |idx| filter(&self.lanes[idx as usize]));
        let place = |(chord, share): &(Chord, f64)| {
            let shape = self.shape(&self.lanes[chord.lane as usize]);
            let start_m = chord.s_m[0] + share * (chord.s_m[1] - chord.s_m[0]);
            let at = shape.refine(start_m, point);
            (shape.squared_distance(at.s_m, point), at)
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
        let shape = self.shape(lane);
        let distance = |s: f64| shape.squared_distance(s, point);
        let best = (0..=pieces)
            .map(|i| lane.length_m * i as f64 / pieces as f64)
            .min_by(|a, b| distance(*a).total_cmp(&distance(*b)))?;
        Some(shape.refine(best, point))
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
        let section = self.shape(lane).section;
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

    /// Places that lie `distance_m` ahead (behind if negative): one per branch, none beyond a dead
    /// end, at most 64.
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
        let shape = self.shape(lane);
        stations(0.0, lane.length_m, step_m)
            .map(|s| shape.middle_point(s))
            .collect()
    }

    /// Left and right edge of the lane in driving direction, sampled like [`RoadMap::centreline`].
    pub fn boundaries(&self, key: LaneKey, step_m: f64) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
        let Some(lane) = self.lane(key) else {
            return Default::default();
        };
        let shape = self.shape(lane);
        let edge_points = |s: f64| {
            let (station, edges) = shape.at(s);
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
                    shape.lift(&station, &edges, t_m).0,
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
                let edge = |lane, records| MarkedEdge {
                    road,
                    section,
                    lane,
                    records,
                };
                lines.extend(edge(None, section.centre_marks.as_slice()).lines(step_m));
                for lane in section.left.iter().chain(&section.right) {
                    lines.extend(edge(Some(lane.id), &lane.marks).lines(step_m));
                }
            }
        }
        lines
    }

    /// Whether the lane's height differs from its road's elevation: by superelevation, shape,
    /// crossfall or a height of its own.
    pub fn is_tilted(&self, lane: LaneKey) -> bool {
        let Some(lane) = self.lane(lane) else {
            return false;
        };
        let LaneShape { road, section, .. } = self.shape(lane);
        let own = section
            .lane(lane.key.lane)
            .is_some_and(|raw| !raw.heights.is_empty());
        own || !road.superelevation.is_zero() || !road.lateral.is_plane()
    }

    /// World point on the surface of road number `road` at station `s_m`, `t_m` to the left of its
    /// reference line.
    pub fn road_point(&self, road: u32, s_m: f64, t_m: f64) -> Option<[f64; 3]> {
        let road = self.raw.roads.iter().find(|r| r.number == road)?;
        Some(road.station(s_m.clamp(0.0, road.length_m)).point(t_m, 0.0))
    }

    /// Index of a lane in [`RoadMap::lanes`].
    pub fn lane_idx(&self, key: LaneKey) -> Option<usize> {
        graph::find(&self.lanes, key)
    }
}

/// The outer edge of a lane in one section, or the centre line, with its marks.
struct MarkedEdge<'m> {
    road: &'m Road,
    section: &'m Section,
    /// OpenDRIVE's id of the lane; `None` for the centre line.
    lane: Option<i8>,
    records: &'m [MarkRecord],
}

impl MarkedEdge<'_> {
    fn lines(&self, step_m: f64) -> impl Iterator<Item = MarkLine> {
        let Section { start_m, end_m, .. } = *self.section;
        self.records
            .iter()
            .enumerate()
            .filter_map(move |(idx, mark)| {
                let from = (start_m + mark.s_offset_m).max(start_m);
                let to = self
                    .records
                    .get(idx + 1)
                    .map_or(end_m, |next| start_m + next.s_offset_m)
                    .min(end_m);
                if mark.kind == MarkKind::None || to - from < 1e-6 {
                    return None;
                }
                Some(MarkLine {
                    kind: mark.kind,
                    colour: mark.colour,
                    width_m: mark.width_m,
                    road: self.road.number,
                    lane: self.lane.unwrap_or(0),
                    to_greater: mark.to_greater,
                    to_smaller: mark.to_smaller,
                    points: stations(from, to, step_m)
                        .map(|s_m| self.point(s_m))
                        .collect(),
                })
            })
    }

    fn point(&self, s_m: f64) -> [f64; 3] {
        let station = self.road.station(s_m);
        let edge = self
            .lane
            .map_or(0.0, |id| self.road.edges(self.section, id, s_m).outer_m);
        station.point(station.lane_offset_m + edge, 0.0)
    }
}

/// Evenly spread stations from `from` to `to`, both included.
fn stations(from: f64, to: f64, step_m: f64) -> impl Iterator<Item = f64> {
    let pieces = ((to - from) / step_m.max(0.01))
        .ceil()
        .clamp(1.0, MAX_POINTS) as usize;
    (0..=pieces).map(move |i| from + (to - from) * i as f64 / pieces as f64)
}
