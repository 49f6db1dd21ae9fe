//! One wheel: its place on the vehicle, its spring, its contact with the ground, and its tyre.
//!
//! A tyre is a spring between rim and road that relaxes as it rolls: its deflection u follows du/dt
//! = slip speed − |v|/σ · u with the relaxation length σ. While rolling, that gives the usual
//! stiffness per slip (force = C · slip speed / |v|); while standing, it is a spring that holds
//! without creeping. The force is linear in slip up to the friction of the load, for both
//! directions combined.
//! |v|); standing, it is a spring that holds
//! without creeping. Force is linear in slip up to the friction of the load, combined over both
//! directions.

use rapier3d::math::Vector;
use rapier3d::parry::query::ShapeCastOptions;
use rapier3d::prelude::*;
use schema_frames::WheelPhysics;
use serde::{Deserialize, Serialize};

use super::footing::{Feeler, Felt};
use super::wheel_solver::Softness;
use crate::physics::GRAVITY_MPS2;

/// Length of the unloaded spring, metres.
const SPRING_M: f32 = 0.30;
/// Damping as a share of critical damping.
const DAMPING_RATIO: f32 = 0.5;
/// Compression beyond rest at which the bump stop begins, metres.
const BUMP_M: f32 = 0.12;
/// Stiffness of the bump stop over that of the spring.
const BUMP_STIFFNESS: f32 = 10.0;
/// Relaxation lengths along and across the wheel, metres.
const RELAXATION_M: [f32; 2] = [0.15, 0.30];
/// Below this speed the tyre's own damping is added, m/s.
const CALM_MPS: f32 = 1.0;
/// Rolling resistance: torque per load and radius.
pub(crate) const ROLLING_RATIO: f32 = 0.012;
/// Half width of a wheel, for sweeping its cylinder, metres.
const HALF_WIDTH_M: f32 = 0.10;

/// Constants of a wheel, from the vehicle's model and its physical data.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct WheelSpec {
    pub physics: WheelPhysics,
    /// Load at rest, N.
    pub rest_load_n: f32,
    /// Compression at rest, metres.
    pub sag_m: f32,
    /// Moment of inertia about the axle, kg·m².
    pub inertia_kgm2: f32,
    pub driven: bool,
}

/// A wheel with its state; all of it is part of a checkpoint.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Wheel {
    pub spec: WheelSpec,
    /// Steering angle, radians, positive to the left.
    pub steer_rad: f32,
    /// Steering angle to show instead, radians.
    pub shown_steer_rad: Option<f32>,
    /// Angle about the axle, radians in 0..2π.
    pub roll_rad: f32,
    /// Speed about the axle, rad/s, forwards.
    pub roll_radps: f32,
    /// Compression of the spring; negative in the air, metres.
    pub compression_m: f32,
    pub on_ground: bool,
    /// Deflection of the tyre along and across, metres.
    pub deflection_m: [f32; 2],
    /// Forces of the last sub-step (its impulses over its length): load, along and across the wheel
    /// (N), and torque of the brakes (N·m).
    pub load_n: f32,
    pub force_n: [f32; 2],
    pub brake_nm: f32,
    /// Torque of the engine, N·m.
    pub drive_nm: f32,
    /// Slip of the last sub-step: ratio along, radians across.
    pub slip: [f32; 2],
    /// Friction in force.
    pub friction: f32,
}

/// The ground under a wheel.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Ground {
    pub point: Vector,
    pub normal: Vector,
    /// Compression of the spring, metres.
    pub compression_m: f32,
}

/// Where a wheel is and where it looks for the ground, engine coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WheelPose {
    /// Upper end of the spring.
    pub top: Vector,
    pub up: Vector,
    /// Axle, to the left.
    pub axle: Vector,
    pub rotation: rapier3d::math::Rotation,
}

impl Wheel {
    pub fn new(spec: WheelSpec) -> Wheel {
        Wheel {
            spec,
            steer_rad: 0.0,
            shown_steer_rad: None,
            roll_rad: 0.0,
            roll_radps: 0.0,
            compression_m: 0.0,
            on_ground: false,
            deflection_m: [0.0; 2],
            load_n: 0.0,
            force_n: [0.0; 2],
            brake_nm: 0.0,
            drive_nm: 0.0,
            slip: [0.0; 2],
            friction: spec.physics.friction,
        }
    }

    /// Resets the tyre and the forces, e.g. after a teleport.
    pub fn lift(&mut self) {
        self.deflection_m = [0.0; 2];
        self.load_n = 0.0;
        self.force_n = [0.0; 2];
        self.brake_nm = 0.0;
    }

    /// Upper end of the spring above the origin's ground, metres.
    pub fn top_m(&self) -> f32 {
        self.spec.physics.radius_m + SPRING_M - self.spec.sag_m
    }

    /// Compression beyond that at rest, metres.
    pub fn travel_m(&self) -> f32 {
        self.compression_m.max(0.0) - self.spec.sag_m
    }

    /// The steering angle at which it is shown.
    pub fn visible_steer_rad(&self) -> f32 {
        self.shown_steer_rad.unwrap_or(self.steer_rad)
    }

    /// Its pose on a vehicle whose axes point forward, left and up.
    pub fn pose(
        &self,
        vehicle: rapier3d::math::Pose,
        [forward, left, up]: [Vector; 3],
    ) -> WheelPose {
        let [x_m, y_m, _] = self.spec.physics.position_m;
        let top = vehicle * Vector::new(x_m, y_m, self.top_m());
        let (sin, cos) = self.steer_rad.sin_cos();
        WheelPose {
            top,
            up,
            axle: left * cos - forward * sin,
            rotation: vehicle.rotation,
        }
    }

    /// The ray that looks for ground within the spring's reach and `reach_m` further.
    pub fn feeler(&self, wheel_pose: &WheelPose, reach_m: f32) -> Feeler {
        Feeler::new(
            wheel_pose.top,
            -wheel_pose.up,
            SPRING_M + self.spec.physics.radius_m + reach_m,
        )
    }

    /// The ground from what the feeler hit.
    pub fn ground(&self, wheel_pose: &WheelPose, felt: &Felt) -> Ground {
        let normal = if felt.normal.dot(wheel_pose.up) < 0.0 {
            -felt.normal
        } else {
            felt.normal
        };
        let point = wheel_pose.top - wheel_pose.up * felt.distance_m;
        Ground {
            point,
            normal,
            compression_m: SPRING_M + self.spec.physics.radius_m - felt.distance_m,
        }
    }

    /// The ground by a cylinder of the wheel's size that is swept down along the spring.
    pub fn sweep(
        &self,
        wheel_pose: &WheelPose,
        query: &QueryPipeline<'_>,
        reach_m: f32,
    ) -> Option<Ground> {
        let radius = self.spec.physics.radius_m;
        // The engine's cylinders stand along y, which is a wheel's axle.
        let shape = Cylinder::new(HALF_WIDTH_M, radius);
        let turn = rapier3d::math::Rotation::from_axis_angle(wheel_pose.up, self.steer_rad)
            * wheel_pose.rotation;
        let place = rapier3d::math::Pose::from_parts(wheel_pose.top, turn);
        let options = ShapeCastOptions {
            max_time_of_impact: SPRING_M + reach_m,
            stop_at_penetration: true,
            ..ShapeCastOptions::default()
        };
        let (_, hit) = query.cast_shape(&place, -wheel_pose.up, &shape, options)?;
        let middle = wheel_pose.top - wheel_pose.up * hit.time_of_impact;
        // The engine may report the normal either way; the road pushes upwards.
        let normal = if hit.normal1.dot(wheel_pose.up) < 0.0 {
            -hit.normal1
        } else {
            hit.normal1
        };
        Some(Ground {
            point: middle - wheel_pose.up * radius,
            normal,
            compression_m: SPRING_M - hit.time_of_impact,
        })
    }

    /// Spring and damper along the ground's normal, and the largest load. `cosine` is that between
    /// spring and normal; `rise_mps` is the speed away from the ground.
    pub fn spring(
        &self,
        ground: &Ground,
        cosine: f32,
        rise_mps: f32,
        dt_secs: f32,
    ) -> (Softness, f32) {
        let spec = &self.spec;
        let stiffness = spec.rest_load_n / spec.sag_m;
        let mass_kg = spec.rest_load_n / GRAVITY_MPS2 as f32;
        let half = if rise_mps < 0.0 { 0.8 } else { 1.2 };
        let touches = if ground.compression_m >= 0.0 {
            1.0
        } else {
            0.0
        };
        let damping = touches * half * 2.0 * DAMPING_RATIO * (stiffness * mass_kg).sqrt();
        let beyond = (ground.compression_m - spec.sag_m - BUMP_M).max(0.0);
        let bump = if beyond > 0.0 {
            BUMP_STIFFNESS * stiffness
        } else {
            0.0
        };
        let push_n = (stiffness * ground.compression_m + bump * beyond) / cosine;
        let damping = (damping + (stiffness + bump) * dt_secs) / (cosine * cosine);
        (
            Softness { push_n, damping },
            20.0 * spec.rest_load_n * dt_secs,
        )
    }

    /// Stiffness (force over slip) along and across at the load of the last sub-step, N.
    pub fn slip_stiffness_n(&self) -> [f32; 2] {
        let (physics, rest) = (&self.spec.physics, self.spec.rest_load_n);
        let load_ratio = self.load_n / rest;
        let rest_of = (1.0 - load_ratio / physics.lat_load_limit).max(0.0);
        let long = physics.long_stiffness_kg * GRAVITY_MPS2 as f32 * load_ratio;
        [
            long,
            physics.lat_stiffness_per_rad * rest * (1.0 - rest_of * rest_of * rest_of),
        ]
    }

    /// The tyre along (0) and across (1) as a spring-damper against slip speed, at `speed_mps` over
    /// ground.
    pub fn tyre(&self, axis: usize, speed_mps: f32, dt_secs: f32) -> Softness {
        let stiffness = self.slip_stiffness_n()[axis] / RELAXATION_M[axis];
        let rolled = 1.0 + dt_secs * speed_mps / RELAXATION_M[axis];
        let calm = (1.0 - speed_mps / CALM_MPS).max(0.0);
        let mass_kg = self.spec.rest_load_n / GRAVITY_MPS2 as f32;
        let damping = stiffness * dt_secs / rolled + calm * (stiffness * mass_kg).sqrt();
        Softness {
            push_n: stiffness * self.deflection_m[axis] / rolled,
            damping,
        }
    }

    /// After the sub-step: the tyre's deflection follows the slip speeds (m/s, of the rim over the
    /// road), within friction.
    pub fn deflect(&mut self, slip_mps: [f32; 2], speed_mps: f32, dt_secs: f32) {
        let stiffness = self.slip_stiffness_n();
        let mut force = [0.0; 2];
        for axis in 0..2 {
            let rolled = 1.0 + dt_secs * speed_mps / RELAXATION_M[axis];
            self.deflection_m[axis] = (self.deflection_m[axis] + dt_secs * slip_mps[axis]) / rolled;
            force[axis] = self.deflection_m[axis] * stiffness[axis] / RELAXATION_M[axis];
        }
        let (size, grip) = (
            (force[0] * force[0] + force[1] * force[1]).sqrt(),
            self.friction * self.load_n,
        );
        if size > grip {
            self.deflection_m = self.deflection_m.map(|u| u * grip / size);
        }
    }

    /// Turns the wheel by its speed for a sub-step.
    pub fn roll(&mut self, dt_secs: f32) {
        self.roll_rad =
            (self.roll_rad + self.roll_radps * dt_secs).rem_euclid(std::f32::consts::TAU);
    }
}
