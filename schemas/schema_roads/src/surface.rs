//! Road surfaces as rows of points, for meshes: every lane of a section at the same stations, so
//! that neighbours share their edge.

use crate::error::MapError;
use crate::lane::LaneKind;
use crate::lateral::lane_height;
use crate::map::RoadMap;
use crate::marks::{MarkKind, MarkRecord, MarkStripe};
use crate::raw::{Extent, RawLane, Road, Section};

/// Shortest step between two rows, metres.
const MIN_STEP_M: f64 = 0.2;
/// Columns of a lane whose cross-section is curved.
const CURVED_COLUMNS: usize = 6;

/// How finely surfaces are sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceSteps {
    /// Longest distance between rows, metres.
    pub max_step_m: f64,
    /// Greatest distance of the rows' chords from the surface, metres.
    pub tolerance_m: f64,
    /// Metres by which lanes for cars in junctions are wider on both sides.
    pub junction_extra_m: f64,
    /// Most points of the whole map.
    pub max_points: usize,
}

impl Default for SurfaceSteps {
    fn default() -> Self {
        SurfaceSteps {
            max_step_m: 6.0,
            tolerance_m: 0.003,
            junction_extra_m: 0.0,
            max_points: 500_000,
        }
    }
}

/// One section of a road.
#[derive(Clone, Debug)]
pub struct SectionSurface {
    /// Number of the road.
    pub road: u32,
    /// Index of the section.
    pub section: u16,
    /// Junction that the road belongs to.
    pub junction: Option<u32>,
    /// Stations of the rows, rising, metres.
    pub stations_m: Vec<f64>,
    /// Lanes by rising id: from right to left.
    pub lanes: Vec<LaneSurface>,
    /// The middle line's points, one per row.
    pub centre_m: Vec<[f64; 3]>,
    /// Marks of the middle line.
    pub centre_marks: Vec<SurfaceMark>,
}

/// One lane of a section.
#[derive(Clone, Debug)]
pub struct LaneSurface {
    /// OpenDRIVE's lane id.
    pub lane: i8,
    /// What it is for.
    pub kind: LaneKind,
    /// Whether the file states a height over the road for it.
    pub has_height: bool,
    /// Points of a row, from the lane's right to its left edge (looking along rising s).
    pub columns: usize,
    /// Points row after row, world, metres.
    pub points_m: Vec<[f64; 3]>,
    /// Marks on its outer edge.
    pub marks: Vec<SurfaceMark>,
}

impl LaneSurface {
    /// The points of one row from right to left.
    pub fn row(&self, row: usize) -> &[[f64; 3]] {
        &self.points_m[row * self.columns..(row + 1) * self.columns]
    }
}

/// A stretch of a mark.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceMark {
    /// Station at which it begins, metres.
    pub from_m: f64,
    /// Station at which it ends, metres.
    pub to_m: f64,
    /// How it is painted.
    pub kind: MarkKind,
    /// Its lines.
    pub stripes: Vec<MarkStripe>,
}

impl RoadMap {
    /// The surfaces of all roads.
    ///
    /// # Errors
    /// [`MapError::TooLarge`] if they need more than `steps.max_points` points.
    pub fn surfaces(&self, steps: &SurfaceSteps) -> Result<Vec<SectionSurface>, MapError> {
        let mut all = Vec::new();
        let mut left = steps.max_points;
        let numbers = self.raw.junction_numbers();
        for road in &self.raw.roads {
            let junction = road.junction_number(&numbers);
            for (idx, section) in road.sections.iter().enumerate() {
                let sampler = Sampler {
                    road,
                    section,
                    steps,
                    extra_m: if junction.is_some() {
                        steps.junction_extra_m
                    } else {
                        0.0
                    },
                };
                let per_row = 2 + section.left.len() + section.right.len();
                let stations_m = sampler.stations(left / per_row);
                let surface = sampler.surface(idx as u16, junction, stations_m);
                let used: usize = surface.lanes.iter().map(|lane| lane.points_m.len()).sum();
                left = left
                    .checked_sub(used.max(1))
                    .filter(|left| *left > per_row)
                    .ok_or_else(|| {
                        let most = steps.max_points;
                        MapError::TooLarge(format!(
                            "its surface needs more than {most} points, counted up to road \"{}\"",
                            road.id
                        ))
                    })?;
                all.push(surface);
            }
        }
        Ok(all)
    }
}

struct Sampler<'m> {
    road: &'m Road,
    section: &'m Section,
    steps: &'m SurfaceSteps,
    extra_m: f64,
}

impl Sampler<'_> {
    /// Lateral edges of the lanes before the lane offset: those on the right outwards, then those
    /// on the left.
    fn edges(&self, s_m: f64) -> [Vec<f64>; 2] {
        let ds = s_m - self.section.start_m;
        [(&self.section.right, -1.0), (&self.section.left, 1.0)].map(|(lanes, sign)| {
            let mut at = 0.0f64;
            let outermost = lanes.iter().rposition(|lane| lane.kind.is_drivable());
            let mut edges: Vec<f64> = lanes
                .iter()
                .map(|lane| {
                    match &lane.extent {
                        Extent::Width(profile) => at += sign * profile.at(ds).0.max(0.0),
                        Extent::Border(profile) => at = profile.at(ds).0,
                    }
                    at
                })
                .collect();
            if let Some(from) = outermost.filter(|_| self.extra_m > 0.0) {
                edges[from..]
                    .iter_mut()
                    .for_each(|edge| *edge += sign * self.extra_m);
            }
            edges
        })
    }

    /// The outermost points and the middle one.
    fn profile(&self, s_m: f64) -> [[f64; 3]; 3] {
        let station = self.road.station(s_m);
        let [right, left] = self.edges(s_m);
        let point = |t: f64| station.point(station.lane_offset_m + t, 0.0);
        [
            point(right.last().copied().unwrap_or(0.0)),
            point(0.0),
            point(left.last().copied().unwrap_or(0.0)),
        ]
    }

    /// Stations of the rows: the start of every record, and between these as many as the bends of
    /// the surface need.
    fn stations(&self, most: usize) -> Vec<f64> {
        let (start, end) = (self.section.start_m, self.section.end_m);
        let road = self.road;
        let mut breaks: Vec<f64> = road.plan.iter().map(|g| g.s_m).collect();
        breaks.extend(
            road.elevation
                .starts()
                .chain(road.superelevation.starts())
                .chain(road.lane_offset.starts()),
        );
        breaks.extend(road.lateral.stations());
        for lane in self.section.left.iter().chain(&self.section.right) {
            let (Extent::Width(profile) | Extent::Border(profile)) = &lane.extent;
            breaks.extend(profile.starts().map(|s| start + s));
            breaks.extend(lane.heights.iter().map(|h| start + h.s_offset_m));
        }
        breaks.retain(|s| *s > start + 1e-3 && *s < end - 1e-3);
        breaks.extend([start, end]);
        breaks.sort_by(f64::total_cmp);
        breaks.dedup_by(|b, a| *b - *a < 1e-3);
        // The section's end is kept, not a station just before it.
        if let Some(last) = breaks.last_mut() {
            *last = end;
        }
        let mut stations = vec![start];
        for pair in breaks.windows(2) {
            let ends = (self.profile(pair[0]), self.profile(pair[1]));
            self.divide((pair[0], &ends.0), (pair[1], &ends.1), most, &mut stations);
        }
        stations
    }

    fn divide(
        &self,
        a: (f64, &[[f64; 3]; 3]),
        b: (f64, &[[f64; 3]; 3]),
        most: usize,
        stations: &mut Vec<f64>,
    ) {
        let length = b.0 - a.0;
        let s = 0.5 * (a.0 + b.0);
        let middle = self.profile(s);
        let distance = |i: usize| {
            (0..3)
                .map(|k| (middle[i][k] - 0.5 * (a.1[i][k] + b.1[i][k])).powi(2))
                .sum::<f64>()
                .sqrt()
        };
        let bends = (0..3).any(|i| distance(i) > self.steps.tolerance_m);
        let twist =
            (a.1[0][2] - a.1[2][2] - b.1[0][2] + b.1[2][2]).abs() > 6.0 * self.steps.tolerance_m;
        if stations.len() < most
            && (length > self.steps.max_step_m || (length > 2.0 * MIN_STEP_M && (bends || twist)))
        {
            self.divide(a, (s, &middle), most, stations);
            self.divide((s, &middle), b, most, stations);
        } else {
            stations.push(b.0);
        }
    }

    fn surface(&self, section: u16, junction: Option<u32>, stations_m: Vec<f64>) -> SectionSurface {
        let Section { left, right, .. } = self.section;
        let is_plane = self.road.lateral.is_plane();
        let empty = |lane: &RawLane| LaneSurface {
            lane: lane.id,
            kind: lane.kind,
            has_height: !lane.heights.is_empty(),
            columns: if is_plane { 2 } else { CURVED_COLUMNS },
            points_m: Vec::new(),
            marks: self.marks(&lane.marks),
        };
        let mut lanes: Vec<LaneSurface> = right.iter().rev().chain(left).map(empty).collect();
        let mut centre_m = Vec::with_capacity(stations_m.len());
        for s_m in &stations_m {
            let station = self.road.station(*s_m);
            let ds = s_m - self.section.start_m;
            let edges = self.edges(*s_m);
            centre_m.push(station.point(station.lane_offset_m, 0.0));
            for (place, out) in lanes.iter_mut().enumerate() {
                let on_right = place < right.len();
                let idx = if on_right {
                    right.len() - 1 - place
                } else {
                    place - right.len()
                };
                let (lane, list) = if on_right {
                    (&right[idx], &edges[0])
                } else {
                    (&left[idx], &edges[1])
                };
                let (inner, outer) = (if idx == 0 { 0.0 } else { list[idx - 1] }, list[idx]);
                let (inner_lift, outer_lift) = lane_height(&lane.heights, ds);
                for column in 0..out.columns {
                    let share = column as f64 / (out.columns - 1) as f64;
                    let share = if on_right { 1.0 - share } else { share };
                    let lift = inner_lift + share * (outer_lift - inner_lift);
                    out.points_m.push(station.point(
                        station.lane_offset_m + inner + share * (outer - inner),
                        lift,
                    ));
                }
            }
        }
        let centre_marks = self.marks(&self.section.centre_marks);
        SectionSurface {
            road: self.road.number,
            section,
            junction,
            stations_m,
            lanes,
            centre_m,
            centre_marks,
        }
    }

    fn marks(&self, records: &[MarkRecord]) -> Vec<SurfaceMark> {
        let (start, end) = (self.section.start_m, self.section.end_m);
        let mut marks = Vec::new();
        for (idx, mark) in records.iter().enumerate() {
            let from_m = (start + mark.s_offset_m).max(start);
            let to_m = records
                .get(idx + 1)
                .map_or(end, |next| start + next.s_offset_m)
                .min(end);
            if mark.kind != MarkKind::None && to_m - from_m > 1e-3 {
                marks.push(SurfaceMark {
                    from_m,
                    to_m,
                    kind: mark.kind,
                    stripes: mark.stripes(),
                });
            }
        }
        marks
    }
}
