//! Painted lines of lanes: OpenLane's F1 in the vehicle's plane.
//!
//! Truth are the painted lines of the OpenDRIVE map, joined over sections and roads, from 3 m to the
//! limit ahead of the vehicle, where they lie in the image. A line of which the exact depth shows
//! less than half is ignored; so are lines of kerbs and grass, which nobody painted. Lines that cross
//! the driving direction (stop lines of other roads) are no truth.

mod marks;

use std::sync::Arc;

use consumer_metrics::lanes::{Collector, Line, Settings};
use nalgebra::{Isometry3, Point3};
use schema_frames::{Keypoint, KeypointSet, PathPoint, ResultType};
use schema_roads::RoadMap;

use self::marks::{STEP_M, painted};
use crate::evidence::moment::{Moment, View};
use crate::picture::Picture;
use crate::tasks::Unreadable;
use crate::tasks::objects::detect::records;
use crate::tasks::spaces::{EgoPoses, is_finite};
use crate::tasks::{Bad, Context, Drawn, Headline, Measure, Reading, Spec, Tally as _};

/// Nearest place ahead that counts, and the usual farthest, metres.
const AHEAD_M: (f64, f64) = (3.0, 40.0);

/// Farthest place to the side, metres.
const ASIDE_M: f64 = 15.0;

/// How much nearer than a point of a line something must be to hide it: share, and metres.
const SLACK: (f64, f64) = (0.03, 0.3);

/// What a moment and a result gave.
pub struct Part {
    truths: Vec<Line>,
    ignored: Vec<bool>,
    results: Vec<Line>,
}

/// The measure.
pub struct Lanes {
    spec: Spec,
    poses: EgoPoses,
    /// Painted lines of the map, world, metres.
    lines: Vec<Vec<[f64; 3]>>,
    map: Option<Arc<str>>,
}

impl Lanes {
    /// For a task.
    pub fn new(spec: &Spec) -> Lanes {
        Lanes {
            spec: spec.clone(),
            poses: EgoPoses::default(),
            lines: Vec::new(),
            map: None,
        }
    }

    fn settings(&self) -> Settings {
        let to_m = self.spec.rules.distance_or(AHEAD_M.1);
        Settings {
            from_m: AHEAD_M.0,
            to_m,
            n_samples: ((to_m - AHEAD_M.0) / STEP_M).max(2.0) as usize,
            use_height: false,
            ..Settings::default()
        }
    }

    /// Lines ahead of the vehicle in its space, and which of them are ignored; `None` if truth is not
    /// asked for at this moment.
    pub fn truths(&self, moment: &Moment<'_>) -> Option<(Vec<Line>, Vec<bool>)> {
        let ego = moment.ego().filter(|_| moment.is_query)?;
        let view = moment.view(&self.spec.truth)?;
        let ego_from_world = ego.world_from_ego.inverse();
        let eye = ego.world_from_ego.translation.vector;
        let far = self.spec.rules.distance_or(AHEAD_M.1);
        let (mut lines, mut ignored) = (Vec::new(), Vec::new());
        for line in &self.lines {
            let reach = far + 10.0;
            let is_near = |point: &&[f64; 3]| (point[0] - eye.x).hypot(point[1] - eye.y) < reach;
            if !line.iter().any(|point| is_near(&point)) {
                continue;
            }
            for piece in ahead(line, &ego_from_world, far) {
                let shown: Vec<Option<bool>> = piece
                    .iter()
                    .map(|at| shows(view, &(ego.world_from_ego * Point3::from(*at))))
                    .collect();
                let Some(first) = shown.iter().position(Option::is_some) else {
                    continue;
                };
                let last = shown.iter().rposition(Option::is_some).unwrap_or(first);
                if last < first + 3 {
                    continue;
                }
                let within = &shown[first..=last];
                let n_seen = within.iter().filter(|shown| **shown == Some(true)).count();
                lines.push(piece[first..=last].to_vec());
                ignored.push(n_seen * 2 < within.len());
            }
        }
        Some((lines, ignored))
    }
}

/// Whether the image shows a point of the world: `None` if it lies outside of it, `false` if
/// something stands before it.
fn shows(view: &View, at: &Point3<f64>) -> Option<bool> {
    let in_camera = view.camera.world_from_camera.inverse() * at;
    if in_camera.z < 0.5 {
        return None;
    }
    let [x, y] = view.camera.project(&in_camera);
    let (width, height) = (view.camera.width, view.camera.height);
    if !(0.0..f64::from(width)).contains(&x) || !(0.0..f64::from(height)).contains(&y) {
        return None;
    }
    let depth = view.depth.get(y as usize * width as usize + x as usize);
    let limit = in_camera.z * (1.0 - SLACK.0) - SLACK.1;
    Some(depth.is_none_or(|depth| f64::from(*depth) >= limit))
}

/// The stretches of a line that lead ahead, in the vehicle's space, nearest point first.
fn ahead(line: &[[f64; 3]], ego_from_world: &Isometry3<f64>, far: f64) -> Vec<Line> {
    let mut pieces: Vec<Line> = Vec::new();
    let mut piece: Line = Vec::new();
    let mut rises: Option<bool> = None;
    let mut end = |piece: &mut Line| {
        let mut done = std::mem::take(piece);
        if done.len() > 1 {
            if done[0][0] > done[done.len() - 1][0] {
                done.reverse();
            }
            pieces.push(done);
        }
    };
    for point in line {
        let at = ego_from_world * Point3::from(*point);
        let at = [at.x, at.y, at.z];
        // What lies on a bridge above or a road below belongs to another road.
        let is_level = at[2].abs() <= 2.0 + 0.1 * at[0].abs();
        let inside = (AHEAD_M.0..=far).contains(&at[0]) && at[1].abs() <= ASIDE_M && is_level;
        if !inside {
            end(&mut piece);
            rises = None;
            continue;
        }
        if let Some(last) = piece.last() {
            let (dx, dy) = (at[0] - last[0], at[1] - last[1]);
            // Beyond 60° to the side a line is no function of the way ahead.
            let crosses = dx.abs() < dy.abs() * 0.577;
            if crosses || rises.is_some_and(|rises| rises != (dx > 0.0)) {
                end(&mut piece);
                rises = None;
            } else {
                rises = Some(dx > 0.0);
            }
        }
        piece.push(at);
    }
    end(&mut piece);
    pieces
}

/// Splits a path into lines where a point has no place.
fn lines_of_path(points: &[PathPoint], world_from_space: &Isometry3<f64>) -> Vec<Line> {
    let mut lines = vec![Line::new()];
    for point in points {
        if !is_finite(&point.pose) {
            lines.push(Line::new());
            continue;
        }
        let at = world_from_space * Point3::from(point.pose.translation_m);
        if let Some(line) = lines.last_mut() {
            line.push([at.x, at.y, at.z]);
        }
    }
    lines.retain(|line| line.len() > 1);
    lines
}

impl Lanes {
    /// Lines in the image, put onto the plane on which the vehicle stands; world, metres.
    fn lines_of_keypoints(&self, reading: &Reading<'_>) -> Result<Vec<Line>, Unreadable> {
        let header = &reading.result.header;
        let split = header.n_items as usize * size_of::<KeypointSet>();
        let (list, tail) = reading.body.split_at(split.min(reading.body.len()));
        let points: Vec<Keypoint> = records(tail);
        let world_from_ego = self.poses.of(header)?;
        let [fx, fy, cx, cy] = header.intrinsics_px;
        if !(fx > 0.0 && fy > 0.0) {
            return Err("has no intrinsics; let it answer an image".into());
        }
        let world_from_camera =
            self.poses.said(header)? * schema_types::space::sensor_from_camera();
        let ego_from_camera = world_from_ego.inverse() * world_from_camera;
        let eye = ego_from_camera.translation.vector;
        let on_ground = |point: &Keypoint| {
            let [x, y] = point.at_px.map(f64::from);
            let ray = nalgebra::Vector3::new((x - cx) / fx, (y - cy) / fy, 1.0);
            let ray = ego_from_camera.rotation * ray;
            let share = -eye.z / ray.z;
            let at = eye + ray * share;
            let is_there = share > 0.0 && at.x.is_finite() && at.x < 200.0;
            is_there.then(|| world_from_ego * Point3::from(at))
        };
        let mut lines = Vec::new();
        for set in records::<KeypointSet>(list) {
            let first = set.first_point as usize;
            let own = first.checked_add(set.n_points as usize);
            let own = own.and_then(|behind| points.get(first..behind));
            let own = own.ok_or("has a set whose points lie outside of the list")?;
            let line: Line = own
                .iter()
                .filter_map(on_ground)
                .map(|at| [at.x, at.y, at.z])
                .collect();
            if line.len() > 1 {
                lines.push(line);
            }
        }
        Ok(lines)
    }
}

impl Measure for Lanes {
    type Estimate = Vec<Line>;
    type Part = Part;
    type Total = Collector;

    fn headline(&self) -> Headline {
        Headline {
            metric: "F1",
            unit: "",
            higher_is_better: true,
        }
    }

    fn begin(&mut self, context: &Context<'_>) -> anyhow::Result<()> {
        self.poses.begin(context);
        let text = context.scenario.opendrive.as_ref().ok_or_else(|| {
            anyhow::anyhow!(
                "the task {} needs the map, which the recording does not hold",
                self.spec.name
            )
        })?;
        if self.map.as_ref() != Some(text) {
            self.lines = painted(&RoadMap::parse(text)?);
            self.map = Some(text.clone());
        }
        Ok(())
    }

    fn watch(&mut self, moment: &Moment<'_>) {
        self.poses.watch(moment);
    }

    fn empty(&self) -> Collector {
        Collector::new(self.settings())
    }

    fn read(&self, reading: &Reading<'_>) -> Result<Vec<Line>, Unreadable> {
        match reading.result.header.kind() {
            Some(ResultType::Keypoints) => self.lines_of_keypoints(reading),
            _ => {
                let world_from_space = self.poses.world_from_space(&reading.result.header)?;
                let points: Vec<PathPoint> = records(reading.body);
                Ok(lines_of_path(&points, &world_from_space))
            }
        }
    }

    fn part(&self, moment: &Moment<'_>, estimate: Option<&Vec<Line>>) -> Option<Part> {
        let (truths, ignored) = self.truths(moment)?;
        let ego_from_world = moment.ego()?.world_from_ego.inverse();
        let place = |line: &Line| -> Line {
            let placed = line.iter().map(|at| ego_from_world * Point3::from(*at));
            placed.map(|at| [at.x, at.y, at.z]).collect()
        };
        Some(Part {
            truths,
            ignored,
            results: estimate.into_iter().flatten().map(place).collect(),
        })
    }

    fn add(&self, total: &mut Collector, part: &Part) {
        let added = total.add(&part.truths, &part.ignored, &part.results);
        debug_assert!(added.is_ok(), "the lists belong together");
    }

    fn bad(&self, part: &Part) -> Option<Bad> {
        let mut one = self.empty();
        self.add(&mut one, part);
        let f1 = *one.named().get("F1")?;
        (f1 < 1.0).then(|| Bad {
            badness: 1.0 - f1,
            why: format!("F1 {f1:.2} of {} lines", part.truths.len()),
        })
    }

    fn draw(&self, picture: &mut Picture, moment: &Moment<'_>, what: Drawn<'_, Vec<Line>>) {
        match what {
            Drawn::Truth => {
                let Some((lines, ignored)) = self.truths(moment) else {
                    return;
                };
                let Some(ego) = moment.ego() else { return };
                for (line, ignored) in lines.iter().zip(ignored) {
                    let placed = line
                        .iter()
                        .map(|at| ego.world_from_ego * Point3::from(*at))
                        .collect::<Vec<_>>();
                    picture.line_in_world(&placed, !ignored);
                }
            }
            Drawn::Result(lines) => {
                for line in lines {
                    let placed: Vec<Point3<f64>> =
                        line.iter().map(|at| Point3::from(*at)).collect();
                    picture.line_in_world(&placed, true);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_ahead_is_cut_to_what_counts_and_runs_away_from_the_vehicle() {
        let ego_from_world = Isometry3::translation(-100.0, 0.0, 0.0);
        let line: Vec<[f64; 3]> = (0..200).rev().map(|x| [f64::from(x), 2.0, 0.0]).collect();
        let pieces = ahead(&line, &ego_from_world, 40.0);
        assert_eq!(pieces.len(), 1);
        assert_eq!((pieces[0][0], pieces[0].len()), ([3.0, 2.0, 0.0], 38));
        let across: Vec<[f64; 3]> = (-10..10).map(|y| [120.0, f64::from(y), 0.0]).collect();
        assert!(ahead(&across, &ego_from_world, 40.0).is_empty());
    }
}
