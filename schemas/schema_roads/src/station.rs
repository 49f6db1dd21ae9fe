//! Evaluating a road: reference line, lane edges, poses in the world.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::curve::PlanPoint;
use crate::lateral::{Lateral, lane_height};
use crate::raw::{Extent, RawLane, Road, Section};

/// The reference line at one station.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Station<'r> {
    pub s_m: f64,
    pub plan: PlanPoint,
    pub z_m: f64,
    pub grade: f64,
    /// Superelevation, radians; positive lifts the left side.
    pub roll_rad: f64,
    /// Change of the superelevation, radians per metre of station.
    pub roll_rate: f64,
    lateral: &'r Lateral,
    pub lane_offset_m: f64,
    pub lane_offset_slope: f64,
}

/// Lateral positions of a lane's edges from the reference line (left positive), and their slopes
/// along s.
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
        (
            0.5 * (self.inner_m + self.outer_m),
            0.5 * (self.inner_slope + self.outer_slope),
        )
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
    /// The reference line at `s_m`; beyond the road's ends its geometry continues.
    pub fn station(&self, s_m: f64) -> Station<'_> {
        let after = self.plan.partition_point(|g| g.s_m <= s_m);
        let geometry = &self.plan[after.saturating_sub(1)];
        let (z_m, grade) = self.elevation.at(s_m);
        let (lane_offset_m, lane_offset_slope) = self.lane_offset.at(s_m);
        let (roll_rad, roll_rate) = self.superelevation.at(s_m);
        Station {
            s_m,
            plan: geometry.at(s_m - geometry.s_m),
            z_m,
            grade,
            roll_rad,
            roll_rate,
            lateral: &self.lateral,
            lane_offset_m,
            lane_offset_slope,
        }
    }

    /// Index of the section at `s_m`.
    pub fn section_at(&self, s_m: f64) -> usize {
        self.sections
            .partition_point(|section| section.start_m <= s_m)
            .saturating_sub(1)
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
                    // A width below zero comes from rounding in the file: the lane has ended there.
                    if width > 0.0 {
                        at += sign * width;
                        slope += sign * width_slope;
                    }
                }
                Extent::Border(profile) => (at, slope) = profile.at(ds),
            }
            if lane.id == id {
                return Edges {
                    inner_m: inner,
                    outer_m: at,
                    inner_slope,
                    outer_slope: slope,
                };
            }
        }
        Edges {
            inner_m: at,
            outer_m: at,
            inner_slope: slope,
            outer_slope: slope,
        }
    }
}

impl Edges {
    /// Height of a lane over the road at `t_m` from the reference line (lane offset not included),
    /// metres, and its slope to the left.
    pub fn lift(&self, lane: &RawLane, ds_m: f64, t_m: f64) -> (f64, f64) {
        let (inner, outer) = lane_height(&lane.heights, ds_m);
        let across = self.outer_m - self.inner_m;
        if across.abs() < 1e-6 {
            return (0.5 * (inner + outer), 0.0);
        }
        let share = ((t_m - self.inner_m) / across).clamp(0.0, 1.0);
        (inner + share * (outer - inner), (outer - inner) / across)
    }
}

impl Station<'_> {
    /// World point `t_m` to the left of the reference line (lane offset not included) and `lift_m`
    /// off the surface.
    pub fn point(&self, t_m: f64, lift_m: f64) -> [f64; 3] {
        let (sin, cos) = self.plan.heading_rad.sin_cos();
        let (roll_sin, roll_cos) = self.roll_rad.sin_cos();
        let height = self.lateral.at(self.s_m, t_m).0 + lift_m;
        let flat = t_m * roll_cos - height * roll_sin;
        [
            self.plan.x_m - sin * flat,
            self.plan.y_m + cos * flat,
            self.z_m + t_m * roll_sin + height * roll_cos,
        ]
    }

    /// Metres walked at offset `t_m` per metre of station.
    pub fn stretch(&self, t_m: f64) -> f64 {
        1.0 - self.plan.curvature_per_m * t_m
    }

    /// Pose at offset `t_m` of a line that drifts by `t_slope` per metre: x along rising s, y left,
    /// z off the surface. `lift` is the lane's height over the road there and its slope to the
    /// left.
    pub fn pose(&self, t_m: f64, t_slope: f64, lift: (f64, f64)) -> Isometry3<f64> {
        let (sin, cos) = self.plan.heading_rad.sin_cos();
        let (roll_sin, roll_cos) = self.roll_rad.sin_cos();
        let (shape, shape_slope) = self.lateral.at(self.s_m, t_m);
        let height = shape + lift.0;
        // A bend tighter than the road is wide would fold over; there the heading is that of the
        // reference line.
        let stretch =
            (1.0 - self.plan.curvature_per_m * (t_m * roll_cos - height * roll_sin)).max(0.05);
        let tangent = Vector3::new(cos, sin, 0.0);
        let side = Vector3::new(-sin * roll_cos, cos * roll_cos, roll_sin);
        let normal = Vector3::new(sin * roll_sin, -cos * roll_sin, roll_cos);
        const H_M: f64 = 0.01;
        let height_rate = if self.lateral.is_plane() {
            0.0
        } else {
            (self.lateral.at(self.s_m + H_M, t_m).0 - self.lateral.at(self.s_m - H_M, t_m).0)
                / (2.0 * H_M)
        };
        let along = tangent * stretch
            + Vector3::z() * self.grade
            + normal * (t_m * self.roll_rate + height_rate)
            - side * (height * self.roll_rate);
        let across = side + normal * (shape_slope + lift.1);
        let x = (along + across * t_slope).normalize();
        let y = (across - x * across.dot(&x)).normalize();
        let rotation =
            Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)]));
        Isometry3::from_parts(
            Translation3::from(self.point(t_m, lift.0)),
            UnitQuaternion::from_rotation_matrix(&rotation),
        )
    }
}
