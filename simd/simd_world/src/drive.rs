//! Engine, gearbox and clutch of one vehicle: pedals and wheel speed in, force at the wheels out.
//!
//! A quasi-static engine: torque follows the curve at once, the clutch slips while the wheels ask for less than the engine's launch speed.
//! The automatic gearbox shifts at engine speeds that rise with the throttle and waits between shifts, so it does not hunt.

use schema_frames::VehicleControl;
use serde::{Deserialize, Serialize};

/// Least time between two automatic shifts, seconds.
const SHIFT_PAUSE_SECS: f32 = 0.8;
const RADPS_PER_RPM: f32 = std::f32::consts::TAU / 60.0;

/// An engine with its gearbox. Torques in N·m at the crankshaft, ratios engine to gearbox output.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EngineSpec {
    /// Full-throttle torque over engine speed: (rpm, N·m), rising rpm.
    pub torque_curve: &'static [(f32, f32)],
    /// Speed at which it idles, rpm; 0 for electric motors.
    pub idle_rpm: f32,
    /// Speed the slipping clutch holds at full throttle, rpm.
    pub launch_rpm: f32,
    /// Beyond this it gives no torque, rpm.
    pub max_rpm: f32,
    /// Forward gears.
    pub ratios: &'static [f32],
    /// Reverse gear, as a positive ratio.
    pub reverse_ratio: f32,
    /// Final drive.
    pub final_ratio: f32,
    /// Share of the torque that reaches the wheels.
    pub efficiency_ratio: f32,
    /// Time without torque during a shift, seconds.
    pub shift_secs: f32,
    /// Braking torque of the closed throttle per engine speed, N·m·s/rad.
    pub drag_nm_s: f32,
}

impl EngineSpec {
    /// Full-throttle torque, N·m; 0 beyond the last point and beyond `max_rpm`.
    pub fn torque_nm(&self, rpm: f32) -> f32 {
        if rpm > self.max_rpm {
            return 0.0;
        }
        let after = self.torque_curve.partition_point(|(at, _)| *at < rpm);
        match (after.checked_sub(1).and_then(|i| self.torque_curve.get(i)), self.torque_curve.get(after)) {
            (None, Some((_, torque))) => *torque,
            (Some((a, low)), Some((b, high))) => low + (high - low) * (rpm - a) / (b - a),
            (_, None) => 0.0,
        }
    }

    /// Engine turns per wheel turn in a gear; negative in reverse, 0 in neutral.
    pub fn overall_ratio(&self, gear: i32) -> f32 {
        match gear {
            -1 => -self.reverse_ratio * self.final_ratio,
            1.. => self.ratios.get(gear as usize - 1).copied().unwrap_or(0.0) * self.final_ratio,
            _ => 0.0,
        }
    }
}

/// What the drive train is asked in one sub-step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveInput {
    /// Pedals and gear lever, clamped.
    pub control: VehicleControl,
    /// Speed of the driven wheels, rad/s, positive forwards.
    pub wheel_radps: f32,
    /// Radius of the driven wheels, metres.
    pub wheel_radius_m: f32,
    /// Length of the sub-step, seconds.
    pub dt_secs: f32,
}

/// What reaches the road, before tyres limit it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DriveOutput {
    /// Driving force, N, positive forwards.
    pub drive_n: f32,
    /// Force that opposes rolling (engine braking), N, at least 0.
    pub resist_n: f32,
}

/// State of engine and gearbox.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DriveTrain {
    /// Gear engaged: −1 reverse, 0 neutral, 1.. forward.
    pub gear: i32,
    /// Engine speed, rad/s.
    pub engine_radps: f32,
    shift_left_secs: f32,
    pause_left_secs: f32,
}

impl DriveTrain {
    /// Engine idling in first gear.
    pub fn new(spec: &EngineSpec) -> Self {
        DriveTrain { gear: 1, engine_radps: spec.idle_rpm * RADPS_PER_RPM, shift_left_secs: 0.0, pause_left_secs: 0.0 }
    }

    /// Advances by one sub-step.
    pub fn step(&mut self, spec: &EngineSpec, input: &DriveInput) -> DriveOutput {
        let throttle = input.control.throttle_ratio;
        self.shift_left_secs = (self.shift_left_secs - input.dt_secs).max(0.0);
        self.pause_left_secs = (self.pause_left_secs - input.dt_secs).max(0.0);
        self.choose_gear(spec, input);
        let ratio = spec.overall_ratio(self.gear);
        if ratio == 0.0 {
            self.rev_freely(spec, throttle, input.dt_secs);
            return DriveOutput::default();
        }
        // Wheels that turn against the gear only make the clutch slip.
        let geared_rpm = (input.wheel_radps * ratio).max(0.0) / RADPS_PER_RPM;
        let clutch_rpm = spec.idle_rpm + throttle * (spec.launch_rpm - spec.idle_rpm);
        let rpm = geared_rpm.max(clutch_rpm.min(spec.max_rpm));
        self.engine_radps = rpm * RADPS_PER_RPM;
        let lever = ratio * spec.efficiency_ratio / input.wheel_radius_m;
        let drive_n = if self.shift_left_secs > 0.0 { 0.0 } else { spec.torque_nm(rpm) * throttle * lever };
        let engaged = geared_rpm > spec.idle_rpm * 1.1 && self.shift_left_secs == 0.0;
        let drag_nm = if engaged { spec.drag_nm_s * self.engine_radps * (1.0 - throttle) } else { 0.0 };
        DriveOutput { drive_n, resist_n: drag_nm * lever.abs() }
    }

    fn choose_gear(&mut self, spec: &EngineSpec, input: &DriveInput) {
        let n_gears = spec.ratios.len() as i32;
        if input.control.manual_gear_shift {
            let wanted = (input.control.gear as i32).clamp(-1, n_gears);
            if wanted != self.gear {
                self.shift(wanted, spec.shift_secs);
            }
            return;
        }
        if input.control.reverse {
            self.gear = -1;
            return;
        }
        self.gear = self.gear.max(1);
        if self.pause_left_secs > 0.0 {
            return;
        }
        let rpm_in = |gear: i32| (input.wheel_radps * spec.overall_ratio(gear)).max(0.0) / RADPS_PER_RPM;
        let throttle = input.control.throttle_ratio;
        let span = spec.max_rpm - spec.idle_rpm;
        let up_rpm = spec.idle_rpm + span * (0.35 + 0.57 * throttle);
        let down_rpm = spec.idle_rpm + span * (0.08 + 0.30 * throttle);
        if self.gear < n_gears && rpm_in(self.gear) > up_rpm {
            self.shift(self.gear + 1, spec.shift_secs);
        } else if self.gear > 1 && rpm_in(self.gear) < down_rpm && rpm_in(self.gear - 1) < up_rpm * 0.9 {
            self.shift(self.gear - 1, spec.shift_secs);
        }
    }

    fn shift(&mut self, gear: i32, shift_secs: f32) {
        self.gear = gear;
        self.shift_left_secs = shift_secs;
        self.pause_left_secs = SHIFT_PAUSE_SECS;
    }

    fn rev_freely(&mut self, spec: &EngineSpec, throttle: f32, dt_secs: f32) {
        let target = (spec.idle_rpm + throttle * (spec.max_rpm - spec.idle_rpm)) * RADPS_PER_RPM;
        // First order with 0.3 s, explicit and stable for any sub-step.
        self.engine_radps += (target - self.engine_radps) * (dt_secs / 0.3).min(1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle_models;

    fn input(throttle_ratio: f32, wheel_radps: f32) -> DriveInput {
        let control = VehicleControl { throttle_ratio, ..Default::default() };
        DriveInput { control, wheel_radps, wheel_radius_m: 0.33, dt_secs: 0.01 }
    }

    #[test]
    fn force_is_torque_times_ratio_over_radius() {
        let spec = &vehicle_models()[0].engine;
        let mut train = DriveTrain::new(spec);
        let force_n = train.step(spec, &input(1.0, 0.0)).drive_n;
        let expected_n = spec.torque_nm(spec.launch_rpm) * spec.ratios[0] * spec.final_ratio * spec.efficiency_ratio / 0.33;
        assert!((force_n / expected_n - 1.0).abs() < 1e-4, "{force_n} {expected_n}");
    }

    #[test]
    fn gearbox_climbs_one_gear_at_a_time_and_does_not_hunt() {
        for model in vehicle_models() {
            let spec = &model.engine;
            let mut train = DriveTrain::new(spec);
            let mut shifts = 0;
            for step in 0..6000 {
                let before = train.gear;
                // Speed rises for 20 s, then stays.
                let wheel_radps = (step as f32 * 0.01).min(20.0) * 4.0;
                train.step(spec, &input(0.6, wheel_radps));
                assert!((train.gear - before).abs() <= 1);
                shifts += (train.gear != before) as usize;
            }
            assert!(shifts < spec.ratios.len(), "{}: {shifts} shifts", model.type_id);
        }
    }

    #[test]
    fn reverse_pushes_backwards_and_neutral_does_not_push() {
        let spec = &vehicle_models()[0].engine;
        let mut train = DriveTrain::new(spec);
        let mut reverse = input(0.5, 0.0);
        reverse.control.reverse = true;
        assert!(train.step(spec, &reverse).drive_n < -100.0);
        let mut neutral = input(0.5, 0.0);
        neutral.control.manual_gear_shift = true;
        assert_eq!(train.step(spec, &neutral), DriveOutput::default());
    }
}
