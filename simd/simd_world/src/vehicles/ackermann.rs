//! Ackermann control: driving by steering angle and speed. One controller goes from speed to
//! acceleration, another from acceleration to pedals.
//!
//! CARLA's controllers add their output to the previous one once per tick at 20 Hz. Here the same
//! amount is added per second, so the result does not depend on the length of a tick.

use schema_frames::{AckermannControl, AckermannGains, VehicleControl};
use serde::{Deserialize, Serialize};

/// Length of the tick for which CARLA's gains are meant, seconds.
const CARLA_TICK_SECS: f32 = 0.05;
/// Limits of acceleration, m/s².
const ACCELERATION_MPS2: (f32, f32) = (-8.0, 3.0);
/// A target speed below this means: stand still, m/s.
const STAND_MPS: f32 = 0.1;
/// Below this the gear may change between forward and reverse, m/s.
const TURN_MPS: f32 = 0.3;

/// State of one vehicle's controllers; part of a checkpoint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Ackermann {
    pub control: AckermannControl,
    /// Acceleration asked for, m/s².
    wanted_mps2: f32,
    /// Throttle (positive) or brake (negative).
    pedal: f32,
    /// Steering angle asked for at present, radians.
    steer_rad: f32,
    reverse: bool,
    last_speed_mps: Option<f32>,
    measured_mps2: f32,
    speed_error: [f32; 2],
    acceleration_error: [f32; 2],
}

/// What the controllers see.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    /// Forward speed, m/s.
    pub speed_mps: f32,
    /// Largest mean angle at this speed, radians.
    pub max_steer_rad: f32,
    /// Length of the tick, seconds.
    pub dt_secs: f32,
}

impl Ackermann {
    /// Takes a new control. If there was one before, the controllers keep their state.
    pub fn wish(before: Option<Ackermann>, control: AckermannControl, steer_rad: f32) -> Ackermann {
        let clean = |x: f32, most: f32| {
            if x.is_finite() {
                x.clamp(-most, most)
            } else {
                0.0
            }
        };
        let control = AckermannControl {
            steer_rad: clean(control.steer_rad, 1.6),
            steer_rate_radps: clean(control.steer_rate_radps, 1e3).abs(),
            speed_mps: clean(control.speed_mps, 300.0),
            acceleration_mps2: clean(control.acceleration_mps2, 1e3).abs(),
            jerk_mps3: clean(control.jerk_mps3, 1e3).abs(),
        };
        match before {
            Some(before) => Ackermann { control, ..before },
            None => Ackermann {
                control,
                steer_rad,
                ..Ackermann::default()
            },
        }
    }

    /// Pedals and steering for the next tick.
    pub fn step(&mut self, gains: &AckermannGains, seen: &Seen) -> VehicleControl {
        let steer_ratio = self.steer(seen);
        let target_mps = self.control.speed_mps;
        let ticks = seen.dt_secs / CARLA_TICK_SECS;
        let measured = self
            .last_speed_mps
            .map_or(0.0, |last| (seen.speed_mps - last) / seen.dt_secs);
        self.last_speed_mps = Some(seen.speed_mps);
        // Low-pass filter that keeps four fifths per tick of 0.05 s.
        self.measured_mps2 += (measured - self.measured_mps2) * (1.0 - 0.8f32.powf(ticks));
        let stands = seen.speed_mps.abs() < TURN_MPS;
        if target_mps.abs() < STAND_MPS && stands {
            self.forget();
            return VehicleControl {
                steer_ratio,
                brake_ratio: 1.0,
                reverse: self.reverse,
                ..VehicleControl::default()
            };
        }
        if stands && target_mps.abs() >= STAND_MPS && self.reverse != (target_mps < 0.0) {
            self.forget();
            self.reverse = target_mps < 0.0;
        }
        // From here on, speeds and accelerations are along the engaged gear's direction.
        let way = if self.reverse { -1.0 } else { 1.0 };
        let (speed, target, acceleration) = (
            way * seen.speed_mps,
            way * target_mps,
            way * self.measured_mps2,
        );
        self.aim(gains, target.max(0.0) - speed, ticks, seen.dt_secs);
        let error = self.wanted_mps2 - acceleration;
        self.pedal += ticks
            * controller(
                gains.acceleration,
                error,
                &mut self.acceleration_error,
                seen.dt_secs,
            );
        self.pedal = self.pedal.clamp(-1.0, 1.0);
        VehicleControl {
            throttle_ratio: self.pedal.max(0.0),
            steer_ratio,
            brake_ratio: (-self.pedal).max(0.0),
            reverse: self.reverse,
            ..VehicleControl::default()
        }
    }

    /// Updates the acceleration to ask for from the error in speed, within the control's limits.
    fn aim(&mut self, gains: &AckermannGains, error_mps: f32, ticks: f32, dt_secs: f32) {
        let before = self.wanted_mps2;
        let change = ticks * controller(gains.speed, error_mps, &mut self.speed_error, dt_secs);
        let limit = match self.control.acceleration_mps2 {
            0.0 => ACCELERATION_MPS2,
            most => (
                (-most).max(ACCELERATION_MPS2.0),
                most.min(ACCELERATION_MPS2.1),
            ),
        };
        self.wanted_mps2 = (before + change).clamp(limit.0, limit.1);
        if self.control.jerk_mps3 > 0.0 {
            let most = self.control.jerk_mps3 * dt_secs;
            self.wanted_mps2 = self.wanted_mps2.clamp(before - most, before + most);
        }
    }

    fn steer(&mut self, seen: &Seen) -> f32 {
        let wanted = self
            .control
            .steer_rad
            .clamp(-seen.max_steer_rad, seen.max_steer_rad);
        let most = if self.control.steer_rate_radps > 0.0 {
            self.control.steer_rate_radps * seen.dt_secs
        } else {
            f32::INFINITY
        };
        self.steer_rad += (wanted - self.steer_rad).clamp(-most, most);
        (self.steer_rad / seen.max_steer_rad.max(1e-3)).clamp(-1.0, 1.0)
    }

    fn forget(&mut self) {
        self.wanted_mps2 = 0.0;
        self.pedal = 0.0;
        self.speed_error = [0.0; 2];
        self.acceleration_error = [0.0; 2];
    }
}

/// One PID controller; `memory` holds the last error and the integral.
fn controller([kp, ki, kd]: [f32; 3], error: f32, memory: &mut [f32; 2], dt_secs: f32) -> f32 {
    let rate = (error - memory[0]) / dt_secs;
    memory[1] += error * dt_secs;
    memory[0] = error;
    (kp * error + ki * memory[1] + kd * rate).clamp(-1.0, 1.0)
}
