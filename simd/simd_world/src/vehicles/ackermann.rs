//! Driving by angle and speed: two controllers, one from speed to acceleration and one from
//! acceleration to pedals.
//!
//! CARLA's controllers add their output to what they asked for before, once per frame at 20 Hz;
//! here the same per second, so that the tick's
//! length changes nothing.

use schema_frames::{AckermannControl, AckermannGains, VehicleControl};
use serde::{Deserialize, Serialize};

/// Tick that the gains are meant for, seconds.
const FRAME_SECS: f32 = 0.05;
/// Limits of acceleration, m/s².
const ACCELERATION_MPS2: (f32, f32) = (-8.0, 3.0);
/// Targets below this mean: stand, m/s.
const STAND_MPS: f32 = 0.1;
/// Below this the gear may change between forward and reverse, m/s.
const TURN_MPS: f32 = 0.3;

/// State of the controllers of one vehicle; part of a checkpoint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Ackermann {
    pub control: AckermannControl,
    /// Acceleration asked for, m/s².
    wanted_mps2: f32,
    /// Throttle (positive) or brake (negative).
    pedal: f32,
    /// Angle asked for so far, radians.
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
    /// New wishes; what was learnt stays if there were wishes before.
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

    /// Pedals and wheel for the next tick.
    pub fn step(&mut self, gains: &AckermannGains, seen: &Seen) -> VehicleControl {
        let steer_ratio = self.steer(seen);
        let target_mps = self.control.speed_mps;
        let frames = seen.dt_secs / FRAME_SECS;
        let measured = self
            .last_speed_mps
            .map_or(0.0, |last| (seen.speed_mps - last) / seen.dt_secs);
        self.last_speed_mps = Some(seen.speed_mps);
        // Keeps four fifths per frame.
        self.measured_mps2 += (measured - self.measured_mps2) * (1.0 - 0.8f32.powf(frames));
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
        // Everything from here on along the gear.
        let way = if self.reverse { -1.0 } else { 1.0 };
        let (speed, target, acceleration) = (
            way * seen.speed_mps,
            way * target_mps,
            way * self.measured_mps2,
        );
        self.aim(gains, target.max(0.0) - speed, frames, seen.dt_secs);
        let error = self.wanted_mps2 - acceleration;
        self.pedal += frames
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

    /// Acceleration to ask for, from the error of speed, within the wishes.
    fn aim(&mut self, gains: &AckermannGains, error_mps: f32, frames: f32, dt_secs: f32) {
        let before = self.wanted_mps2;
        let change = frames * controller(gains.speed, error_mps, &mut self.speed_error, dt_secs);
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

/// One controller: proportional, integral, derivative; `memory` is the last error and its integral.
fn controller([kp, ki, kd]: [f32; 3], error: f32, memory: &mut [f32; 2], dt_secs: f32) -> f32 {
    let rate = (error - memory[0]) / dt_secs;
    memory[1] += error * dt_secs;
    memory[0] = error;
    (kp * error + ki * memory[1] + kd * rate).clamp(-1.0, 1.0)
}
