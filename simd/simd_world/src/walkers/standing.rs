//! How a walker's body moves: it slides along walls and vehicles, steps over kerbs, falls and
//! jumps.

use nalgebra::Vector3;
use rapier3d::math::{Pose as EnginePose, Vector};
use rapier3d::parry::query::ShapeCastOptions;
use rapier3d::parry::shape::Capsule;
use rapier3d::prelude::*;

use crate::physics::{Physics, narrow, widen};

/// Highest step that a walker climbs, and deepest that it steps down without falling, metres.
pub const STEP_M: f64 = 0.32;
/// How fast feet go up or down a step, m/s.
const CLIMB_MPS: f64 = 1.6;
/// Distance kept from walls, metres.
const SKIN_M: f32 = 0.01;
/// Feet nearer to the ground than this stand on it, metres.
const STANDS_M: f64 = 2e-4;
/// Upward speed of a jump, m/s.
pub const JUMP_MPS: f64 = 5.0;
/// Longest time that is moved at once, seconds.
pub const MAX_PIECE_SECS: f64 = 0.05;

/// What walls and vehicles do to a body that moves into them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Walls {
    /// They stop it, and it slides along them.
    Stop,
    /// It passes through them.
    Pass,
}

/// An upright body: feet, size, vertical speed.
#[derive(Clone, Copy, Debug)]
pub struct Standing {
    /// Point between the feet, world, metres.
    pub feet_m: Vector3<f64>,
    /// Radius, metres.
    pub radius_m: f64,
    /// Height, metres.
    pub height_m: f64,
    /// Upward speed, m/s; 0 on the ground.
    pub rise_mps: f64,
    /// Whether the feet are on the ground.
    pub on_ground: bool,
    /// How fast it falls, m/s².
    pub gravity_mps2: f64,
}

impl Standing {
    /// Moves by `walk_mps` (horizontal) for `dt_secs`; falls and lands.
    pub fn step(&mut self, physics: &Physics, walk_mps: Vector3<f64>, dt_secs: f64, walls: Walls) {
        let way = Vector3::new(walk_mps.x, walk_mps.y, 0.0) * dt_secs;
        self.feet_m += match walls {
            Walls::Stop => self.slide(physics, way),
            Walls::Pass => way,
        };
        let down_m = ground_below(
            physics,
            &self.feet_m,
            STEP_M,
            if self.on_ground { STEP_M } else { 2.0 },
        );
        if self.on_ground {
            match down_m {
                Some(down_m) => {
                    let most = CLIMB_MPS * dt_secs;
                    // Rays are exact only to micrometres; standing feet do not follow that noise.
                    self.feet_m.z -= if down_m.abs() < STANDS_M {
                        0.0
                    } else {
                        down_m.clamp(-most, most)
                    };
                }
                None => self.on_ground = false,
            }
            return;
        }
        let rise_m = (self.rise_mps - 0.5 * self.gravity_mps2 * dt_secs) * dt_secs;
        self.rise_mps -= self.gravity_mps2 * dt_secs;
        match down_m {
            Some(down_m) if rise_m <= 0.0 && -rise_m >= down_m => {
                self.feet_m.z -= down_m;
                (self.rise_mps, self.on_ground) = (0.0, true);
            }
            _ => self.feet_m.z += rise_m,
        }
    }

    /// Jumps, if the feet are on the ground.
    pub fn jump(&mut self) {
        if self.on_ground {
            (self.rise_mps, self.on_ground) = (JUMP_MPS, false);
        }
    }

    /// The part of `way` that remains when walls and vehicles are slid along.
    fn slide(&self, physics: &Physics, way: Vector3<f64>) -> Vector3<f64> {
        let (shape, mut at) = self.upper_body(physics);
        let start = at.translation;
        let pipeline = physics
            .engine
            .query_pipeline_with_filter(QueryFilter::default().exclude_sensors());
        let mut left = narrow(&way);
        for _ in 0..3 {
            if left.length() < 1e-6 {
                break;
            }
            let options = ShapeCastOptions {
                max_time_of_impact: 1.0,
                target_distance: SKIN_M,
                stop_at_penetration: false,
                ..Default::default()
            };
            let Some((_, hit)) = pipeline.cast_shape(&at, left, &shape, options) else {
                at.translation += left;
                break;
            };
            let done = hit.time_of_impact.clamp(0.0, 1.0);
            at.translation += left * done;
            left *= 1.0 - done;
            let mut normal = hit.normal1;
            normal.z = 0.0;
            let Some(normal) = normal.try_normalize() else {
                break;
            };
            // The rest points slightly away from the wall, so that the next cast does not begin in
            // contact.
            left -= normal * (1.05 * left.dot(normal).min(0.0));
        }
        let gone = at.translation - start;
        widen(Vector::new(gone.x, gone.y, 0.0))
    }

    /// The part of the body that obstacles stop; lower obstacles are stepped over.
    fn upper_body(&self, physics: &Physics) -> (Capsule, EnginePose) {
        let radius = self.radius_m;
        let low = (STEP_M + radius).min(self.height_m - radius);
        let high = self.height_m - radius;
        let shape = Capsule::new_z((0.5 * (high - low)) as f32, radius as f32);
        let middle = self.feet_m + Vector3::z() * (0.5 * (low + high));
        (
            shape,
            physics.engine_pose(&nalgebra::Isometry3::from_parts(
                middle.into(),
                nalgebra::UnitQuaternion::identity(),
            )),
        )
    }

    /// The whole body as an engine shape.
    pub fn whole_body(&self, physics: &Physics) -> (Capsule, EnginePose) {
        let half = (0.5 * self.height_m - self.radius_m).max(0.01);
        let shape = Capsule::new_z(half as f32, self.radius_m as f32);
        let middle = self.feet_m + Vector3::z() * (0.5 * self.height_m);
        (
            shape,
            physics.engine_pose(&nalgebra::Isometry3::from_parts(
                middle.into(),
                nalgebra::UnitQuaternion::identity(),
            )),
        )
    }

    /// Whether the upper body overlaps scenery.
    pub fn is_stuck(&self, physics: &Physics) -> bool {
        let (shape, at) = self.upper_body(physics);
        physics.touches_scenery(&at, &shape)
    }
}

/// How far the ground is below `point` (negative if above), searched from `above_m` above it to
/// `below_m` below it.
pub fn ground_below(
    physics: &Physics,
    point: &Vector3<f64>,
    above_m: f64,
    below_m: f64,
) -> Option<f64> {
    let from = physics
        .engine_pose(&nalgebra::Isometry3::translation(
            point.x,
            point.y,
            point.z + above_m,
        ))
        .translation;
    let pipeline = physics
        .engine
        .query_pipeline_with_filter(QueryFilter::only_fixed().exclude_sensors());
    let ray = Ray::new(from, -Vector::Z);
    let (_, way) = pipeline.cast_ray(&ray, (above_m + below_m) as f32, false)?;
    Some(f64::from(way) - above_m)
}
