//! Lateral control: the path's curvature ahead, plus feedback on offset and direction that acts as
//! a second-order system over distance.
//!
//! With offset e and course error ψ of the point between the axles, e' = ψ and ψ' = κ − κ_path per
//! metre driven. κ = κ_path − 2ζ/ℓ·ψ − e/ℓ² gives a damped return over the length ℓ, whatever the
//! speed.

use crate::lanes::path::{Foot, Path};
use crate::plane::wrap;
use crate::traffic::Mover;

/// Damping of the return to the path.
const DAMPING: f64 = 0.9;
/// Delay between a steering command and the turning it causes, seconds; looking ahead compensates
/// it.
const PREVIEW_SECS: f64 = 0.15;
/// Gain of the integral of the offset in units of 1/ℓ³: slow beside the return itself at every
/// speed.
const INTEGRAL: f64 = 0.08;
/// Largest offset that the integral compensates, metres.
const INTEGRAL_OFFSET_M: f64 = 0.3;

/// What steering depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Distance between the axles, metres.
    pub wheelbase_m: f64,
    /// Largest steering angle, radians.
    pub max_steer_rad: f64,
}

/// Steering of one vehicle.
#[derive(Clone, Debug)]
pub struct Steering {
    wheelbase_m: f64,
    max_steer_rad: f64,
    integral_m: f64,
    last_ratio: f64,
}

impl Steering {
    /// Steering of a vehicle; the largest steering angle is a first guess that is corrected while
    /// driving.
    pub fn new(geometry: Geometry) -> Self {
        Steering {
            wheelbase_m: geometry.wheelbase_m.clamp(0.8, 12.0),
            max_steer_rad: geometry.max_steer_rad.clamp(0.15, 1.4),
            integral_m: 0.0,
            last_ratio: 0.0,
        }
    }

    /// Distance between the axles, metres.
    pub fn wheelbase_m(&self) -> f64 {
        self.wheelbase_m
    }

    /// Clears the integral.
    pub fn reset(&mut self) {
        self.integral_m = 0.0;
    }

    /// Steering ratio, positive to the left. `offset_m` is where to drive beside the path.
    pub fn ratio(
        &mut self,
        me: &Mover,
        path: &Path,
        foot: Foot,
        offset_m: f64,
        period_secs: f64,
    ) -> f64 {
        self.learn(me);
        let speed = me.speed_mps.max(0.0);
        let here = path.at(foot.arc_m).curvature_per_m;
        let ahead = path.at(foot.arc_m + speed * PREVIEW_SECS).curvature_per_m;
        // The point between the axles moves at half the steering angle to the body.
        let slip = (0.5 * self.wheelbase_m * here).clamp(-0.7, 0.7).asin();
        let course = wrap(me.yaw_rad + slip - foot.heading_rad).clamp(-1.2, 1.2);
        let length = 2.5 + 0.45 * speed;
        let error = (foot.offset_m - offset_m).clamp(-3.0, 3.0);
        if error.abs() < 1.0 {
            let step = INTEGRAL * error * speed * period_secs / length;
            self.integral_m = (self.integral_m + step).clamp(-INTEGRAL_OFFSET_M, INTEGRAL_OFFSET_M);
        }
        let feedback =
            -2.0 * DAMPING / length * course.sin() - (error + self.integral_m) / (length * length);
        let wanted = (self.wheelbase_m * (ahead + feedback)).atan();
        let ratio = (wanted / self.max_steer_rad).clamp(-1.0, 1.0);
        // The wheel takes about a third of a second from the middle to the stop.
        let most = 3.0 * period_secs;
        self.last_ratio += (ratio - self.last_ratio).clamp(-most, most);
        self.last_ratio
    }

    /// Moves the steering towards a fixed ratio, e.g. while reversing.
    pub fn hold(&mut self, ratio: f64, period_secs: f64) -> f64 {
        let most = 3.0 * period_secs;
        self.last_ratio += (ratio - self.last_ratio).clamp(-most, most);
        self.last_ratio
    }

    /// Learns the largest steering angle from the angle of the wheels and the applied ratio.
    fn learn(&mut self, me: &Mover) {
        // Only while the ratio is steady do the wheels stand where the ratio says.
        if me.steer_ratio.abs() > 0.05
            && (me.steer_ratio - self.last_ratio).abs() < 0.03
            && me.wheel_steer_rad.abs() > 0.01
        {
            let seen = (me.wheel_steer_rad / me.steer_ratio).clamp(0.15, 1.4);
            self.max_steer_rad += 0.05 * (seen - self.max_steer_rad);
        }
    }
}
