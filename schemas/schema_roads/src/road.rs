//! Evaluating a road: reference line, lane edges, frames in the world.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::curve::PlanPoint;
use crate::raw::{Extent, RawLane, Road, Section};

/// The reference line at one station.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Station {
    pub plan: PlanPoint,
    pub z_m: f64,
    pub grade: f64,
    /// Superelevation; positive lifts the left side.
    pub roll_rad: f64,
    pub lane_offset_m: f64,
    pub lane_offset_slope: f64,
}

/// Lateral positions of a lane's edges from the reference line (left positive), and their slopes along s.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Edges {
    pub inner_m: f64,
    pub outer_m: f64,
    pub inner_slope: f64,
    pub outer_slope: f64,
}

impl Edges {
    pub fn width_m(&self) -> f64 {
        (self.outer_m - self.inner_m).abs()
    }

    pub fn middle(&self) -> (f64, f64) {
        (0.5 * (self.inner_m + self.outer_m), 0.5 * (self.inner_slope + self.outer_slope))
    }
}

impl Section {
    /// Lanes of the side `id` is on, from the centre outwards.
    pub fn side(&self, id: i8) -> &[RawLane] {
        if id > 0 { &self.left } else { &self.right }
    }

    pub fn lane(&self, id: i8) -> Option<&RawLane> {
        self.side(id).iter().find(|lane| lane.id == id)
    }
}

impl Road {
    /// The reference line at `s_m`; beyond the ends its geometry goes on.
    pub fn station(&self, s_m: f64) -> Station {
        let after = self.plan.partition_point(|g| g.s_m <= s_m);
        let geometry = &self.plan[after.saturating_sub(1)];
        let (z_m, grade) = self.elevation.at(s_m);
        let (lane_offset_m, lane_offset_slope) = self.lane_offset.at(s_m);
        Station {
            plan: geometry.at(s_m - geometry.s_m),
            z_m,
            grade,
            roll_rad: self.superelevation.at(s_m).0,
            lane_offset_m,
            lane_offset_slope,
        }
    }

    /// Index of the section at `s_m`.
    pub fn section_at(&self, s_m: f64) -> usize {
        self.sections.partition_point(|section| section.start_m <= s_m).saturating_sub(1)
    }

    /// Edges of lane `id` of a section, without the lane offset.
    pub fn edges(&self, section: &Section, id: i8, s_m: f64) -> Edges {
        let ds = s_m - section.start_m;
        let sign = f64::from(id.signum());
        let (mut at, mut slope) = (0.0, 0.0);
        for lane in section.side(id) {
            let (inner, inner_slope) = (at, slope);
            match &lane.extent {
                Extent::Width(profile) => {
                    let (width, width_slope) = profile.at(ds);
                    // A width below zero is a file's rounding; the lane has ended.
                    if width > 0.0 {
                        at += sign * width;
                        slope += sign * width_slope;
                    }
                }
                Extent::Border(profile) => (at, slope) = profile.at(ds),
            }
            if lane.id == id {
                return Edges { inner_m: inner, outer_m: at, inner_slope, outer_slope: slope };
            }
        }
        Edges { inner_m: at, outer_m: at, inner_slope: slope, outer_slope: slope }
    }
}

impl Station {
    /// World point `t_m` to the left of the reference line (lane offset not included).
    pub fn point(&self, t_m: f64) -> [f64; 3] {
        let (sin, cos) = self.plan.heading_rad.sin_cos();
        let (roll_sin, roll_cos) = self.roll_rad.sin_cos();
        let flat = t_m * roll_cos;
        [self.plan.x_m - sin * flat, self.plan.y_m + cos * flat, self.z_m + t_m * roll_sin]
    }

    /// Metres walked at offset `t_m` per metre of station.
    pub fn stretch(&self, t_m: f64) -> f64 {
        1.0 - self.plan.curvature_per_m * t_m
    }

    /// Frame at offset `t_m` of a line that drifts by `t_slope` per metre: x along rising s, y left, z off the surface.
    pub fn frame(&self, t_m: f64, t_slope: f64) -> Isometry3<f64> {
        let (sin, cos) = self.plan.heading_rad.sin_cos();
        let (roll_sin, roll_cos) = self.roll_rad.sin_cos();
        // A road tighter than its width folds over; its heading is then that of the reference line.
        let stretch = self.stretch(t_m * roll_cos).max(0.05);
        let along = Vector3::new(cos * stretch, sin * stretch, self.grade);
        let across = Vector3::new(-sin * roll_cos, cos * roll_cos, roll_sin);
        let x = (along + across * t_slope).normalize();
        let y = (across - x * across.dot(&x)).normalize();
        let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)]));
        Isometry3::from_parts(Translation3::from(self.point(t_m)), UnitQuaternion::from_rotation_matrix(&rotation))
    }
}
