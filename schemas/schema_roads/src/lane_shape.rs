//! Where a lane lies: from a place on it to the world, and from a point to the nearest place.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use crate::lane::{Lane, LanePosition};
use crate::raw::{RawMap, Road, Section};
use crate::station::{Edges, Station};

/// A lane together with its road and section in the file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LaneShape<'m> {
    pub lane: &'m Lane,
    pub road: &'m Road,
    pub section: &'m Section,
}

impl<'m> LaneShape<'m> {
    pub fn of(map: &'m RawMap, lane: &'m Lane) -> Self {
        let road = &map.roads[lane.road_idx as usize];
        LaneShape {
            lane,
            road,
            section: &road.sections[lane.key.section as usize],
        }
    }

    /// `s_m` within the lane's ends.
    pub fn clamped(&self, s_m: f64) -> f64 {
        s_m.clamp(0.0, self.lane.length_m)
    }

    /// The road's station and the lane's edges `s_m` after the lane's start.
    pub fn at(&self, s_m: f64) -> (Station<'m>, Edges) {
        let station_m = self.lane.station_m(s_m);
        (
            self.road.station(station_m),
            self.road.edges(self.section, self.lane.key.lane, station_m),
        )
    }

    pub fn middle_point(&self, s_m: f64) -> [f64; 3] {
        let (station, edges) = self.at(s_m);
        let middle = edges.middle().0;
        station.point(
            station.lane_offset_m + middle,
            self.lift(&station, &edges, middle).0,
        )
    }

    /// Height of the lane over its road at `t_m` (lane offset not included), metres, and its slope
    /// to the left.
    pub fn lift(&self, station: &Station<'_>, edges: &Edges, t_m: f64) -> (f64, f64) {
        match self.section.lane(self.lane.key.lane) {
            Some(raw) if !raw.heights.is_empty() => {
                edges.lift(raw, station.s_m - self.section.start_m, t_m)
            }
            _ => (0.0, 0.0),
        }
    }

    /// Pose `offset_m` to the left of the lane's middle, and the metres walked there per metre of
    /// station.
    pub fn pose(&self, s_m: f64, offset_m: f64) -> (Isometry3<f64>, f64) {
        let (station, edges) = self.at(s_m);
        let (middle, slope) = edges.middle();
        let t_m = middle
            + if self.lane.forward {
                offset_m
            } else {
                -offset_m
            };
        let lift = self.lift(&station, &edges, t_m);
        let t_m = station.lane_offset_m + t_m;
        let mut pose = station.pose(t_m, station.lane_offset_slope + slope, lift);
        if !self.lane.forward {
            pose.rotation *=
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
        }
        (pose, station.stretch(t_m))
    }

    /// The place on the lane nearest to `point`, found from `start_m` on by Newton's steps, or by
    /// search where a bend is so tight that these miss it.
    pub fn refine(&self, start_m: f64, point: [f64; 3]) -> LanePosition {
        let start_m = start_m.clamp(0.0, self.lane.length_m);
        let by_steps = self.step_to_foot(start_m, point);
        let s_m = match by_steps {
            Some(s_m)
                if self.squared_distance(s_m, point)
                    <= self.squared_distance(start_m, point) + 1e-6 =>
            {
                s_m
            }
            _ => self.search_foot(start_m, point),
        };
        let pose = self.pose(s_m, 0.0).0;
        let offset_m =
            (pose.rotation.inverse() * (Vector3::from(point) - pose.translation.vector)).y;
        LanePosition {
            lane: self.lane.key,
            s_m,
            offset_m,
        }
    }

    pub fn squared_distance(&self, s_m: f64, point: [f64; 3]) -> f64 {
        let p = self.middle_point(s_m);
        (0..3).map(|i| (p[i] - point[i]).powi(2)).sum()
    }

    /// `None` if the steps do not converge.
    fn step_to_foot(&self, start_m: f64, point: [f64; 3]) -> Option<f64> {
        let point = Vector3::from(point);
        let mut s_m = start_m;
        for _ in 0..6 {
            let (pose, stretch) = self.pose(s_m, 0.0);
            let local = pose.rotation.inverse() * (point - pose.translation.vector);
            let next = (s_m + local.x / stretch.max(0.2)).clamp(0.0, self.lane.length_m);
            let moved = (next - s_m).abs();
            s_m = next;
            if moved < 1e-4 {
                return Some(s_m);
            }
        }
        None
    }

    /// The nearest of places a quarter of a metre apart, then of ever closer ones around it.
    fn search_foot(&self, start_m: f64, point: [f64; 3]) -> f64 {
        const REACH_M: f64 = 3.0;
        const PIECES: u32 = 12;
        let (mut best_m, mut reach_m) = (start_m, REACH_M);
        while reach_m > 1e-6 {
            let around = (0..=2 * PIECES)
                .map(|i| best_m + reach_m * (f64::from(i) / f64::from(PIECES) - 1.0));
            let nearer = around
                .map(|s_m| s_m.clamp(0.0, self.lane.length_m))
                .min_by(|a, b| {
                    self.squared_distance(*a, point)
                        .total_cmp(&self.squared_distance(*b, point))
                });
            best_m = nearer.unwrap_or(best_m);
            reach_m /= f64::from(PIECES) / 2.0;
        }
        best_m
    }
}
