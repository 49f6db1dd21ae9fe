//! The powertrain of one vehicle (engine, clutch, gearbox): pedals and wheel speed in, torque at
//! the wheels out.
//!
//! The engine is a flywheel that follows its torque curve. While the clutch is locked, the engine
//! turns with the wheels and adds its inertia to theirs. While the clutch slips, it passes a
//! friction torque that does not depend on the speed difference, so nothing is stiff. Below idle
//! speed the clutch opens by itself, and it closes with rising engine speed, as a driver or an
//! automatic would do it. Electric motors and a cyclist's legs have no idle speed and stay locked.
//! The automatic gearbox shifts at each gear's own share of the largest engine speed, earlier with
//! less throttle, and waits between shifts so that it does not hunt.

use schema_frames::{VehicleControl, VehiclePhysics};
use serde::{Deserialize, Serialize};

use super::curve::along;
use super::engine_spec::EngineSpec;

/// Least time between two automatic shifts, seconds.
const SHIFT_PAUSE_SECS: f32 = 0.8;
pub(crate) const RADPS_PER_RPM: f32 = std::f32::consts::TAU / 60.0;
/// Slip at which `clutch_strength_nms` gives the largest torque that a clutch carries, rad/s.
pub(crate) const CLUTCH_SLIP_RADPS: f32 = 60.0;
/// Slip below which a closed clutch locks, rad/s.
const LOCK_RADPS: f32 = 2.0;
/// Longest step in which a slipping clutch is integrated, seconds.
const SLIP_STEP_SECS: f32 = 0.002;
/// With the throttle shut the gearbox shifts up at this share of the speed at full throttle.
const EARLY_SHIFT_RATIO: f32 = 0.45;

/// Full-throttle torque at an engine speed, N·m; 0 beyond the curve's last point and beyond
/// `max_rpm`.
fn torque_nm(physics: &VehiclePhysics, rpm: f32) -> f32 {
    let beyond = physics
        .torque_curve
        .last()
        .is_none_or(|[last, _]| rpm > *last);
    if rpm > physics.max_rpm || beyond {
        0.0
    } else {
        along(&physics.torque_curve, rpm, 0.0)
    }
}

/// Input of one sub-step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PowertrainInput {
    /// Pedals and gear lever, clamped.
    pub control: VehicleControl,
    /// Mean speed of the driven wheels, rad/s, positive forwards.
    pub wheel_radps: f32,
    /// Length of the sub-step, seconds.
    pub dt_secs: f32,
}

/// What reaches all driven wheels together, before tyres limit it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PowertrainOutput {
    /// Torque, N·m, positive forwards.
    pub torque_nm: f32,
    /// Torque against rolling per wheel speed (engine braking), N·m·s.
    pub damping_nms: f32,
    /// Inertia that turns with the wheels, kg·m².
    pub inertia_kgm2: f32,
}

/// State of engine, clutch and gearbox; all of it is part of a checkpoint.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Powertrain {
    /// Gear engaged: −1 reverse, 0 neutral, 1.. forward.
    pub gear: i32,
    /// Engine speed, rad/s.
    pub engine_radps: f32,
    locked: bool,
    shift_left_secs: f32,
    pause_left_secs: f32,
}

/// Engine turns per wheel turn in a gear; negative in reverse, 0 in neutral.
pub(crate) fn overall_ratio(spec: &EngineSpec, physics: &VehiclePhysics, gear: i32) -> f32 {
    match gear {
        -1 => -spec.reverse_ratio * physics.final_ratio,
        1.. => {
            physics
                .forward_gears
                .get(gear as usize - 1)
                .map_or(0.0, |gear| gear.ratio)
                * physics.final_ratio
        }
        _ => 0.0,
    }
}

impl Powertrain {
    /// A powertrain with the engine idling in first gear.
    pub fn new(spec: &EngineSpec) -> Self {
        let engine_radps = spec.idle_rpm * RADPS_PER_RPM;
        Powertrain {
            gear: 1,
            engine_radps,
            locked: spec.idle_rpm == 0.0,
            shift_left_secs: 0.0,
            pause_left_secs: 0.0,
        }
    }

    /// Advances by one sub-step.
    pub fn step(
        &mut self,
        spec: &EngineSpec,
        physics: &VehiclePhysics,
        input: &PowertrainInput,
    ) -> PowertrainOutput {
        self.shift_left_secs = (self.shift_left_secs - input.dt_secs).max(0.0);
        self.pause_left_secs = (self.pause_left_secs - input.dt_secs).max(0.0);
        self.choose_gear(spec, physics, input);
        let ratio = overall_ratio(spec, physics, self.gear);
        let throttle = input.control.throttle_ratio;
        if ratio == 0.0 || self.shift_left_secs > 0.0 {
            self.locked = false;
            // During a shift the throttle is shut; in neutral the engine revs.
            self.rev(
                spec,
                physics,
                if ratio == 0.0 { throttle } else { 0.0 },
                0.0,
                input.dt_secs,
            );
            return PowertrainOutput::default();
        }
        let idle_radps = spec.idle_rpm * RADPS_PER_RPM;
        let geared_radps = input.wheel_radps * ratio;
        let may_lock = idle_radps == 0.0 || geared_radps >= idle_radps;
        let torque_nm = torque_nm(physics, geared_radps.abs() / RADPS_PER_RPM) * throttle;
        let capacity_nm = physics.clutch_strength_nms * CLUTCH_SLIP_RADPS;
        self.locked = may_lock && (self.locked || idle_radps == 0.0) && torque_nm <= capacity_nm;
        if self.locked {
            self.engine_radps = geared_radps;
            let damping = lerp(
                physics.damping_closed_engaged_nms,
                physics.damping_full_throttle_nms,
                throttle,
            );
            return PowertrainOutput {
                torque_nm: torque_nm * ratio * spec.efficiency_ratio,
                damping_nms: damping * ratio * ratio,
                inertia_kgm2: physics.engine_inertia_kgm2 * ratio * ratio,
            };
        }
        let passed_nm = self.slip(
            spec,
            physics,
            throttle,
            geared_radps,
            may_lock,
            input.dt_secs,
        );
        PowertrainOutput {
            torque_nm: passed_nm * ratio * spec.efficiency_ratio,
            ..PowertrainOutput::default()
        }
    }

    /// Integrates a slipping clutch and returns the mean torque that it passes on. The clutch locks
    /// when both sides turn at the same speed.
    fn slip(
        &mut self,
        spec: &EngineSpec,
        physics: &VehiclePhysics,
        throttle: f32,
        geared_radps: f32,
        may_lock: bool,
        dt_secs: f32,
    ) -> f32 {
        let n_steps = (dt_secs / SLIP_STEP_SECS).ceil().max(1.0);
        let step_secs = dt_secs / n_steps;
        let capacity_nm = physics.clutch_strength_nms * CLUTCH_SLIP_RADPS;
        let [idle, launch] = [spec.idle_rpm, spec.launch_rpm].map(|rpm| rpm * RADPS_PER_RPM);
        let peak_nm = torque_nm(physics, spec.launch_rpm.min(physics.max_rpm)).max(1.0);
        let mut sum_nm = 0.0;
        for _ in 0..n_steps as u32 {
            let slip_radps = self.engine_radps - geared_radps;
            if may_lock && slip_radps.abs() < LOCK_RADPS {
                self.locked = true;
                self.engine_radps = geared_radps;
                sum_nm += torque_nm(physics, geared_radps / RADPS_PER_RPM) * throttle;
                continue;
            }
            // The clutch closes between idle and launch speed, and fully once the wheels turn fast
            // enough.
            let closed = if may_lock {
                f32::INFINITY
            } else {
                1.2 * (self.engine_radps - idle).max(0.0) / (launch - idle).max(1.0)
            };
            let passed_nm = capacity_nm.min(peak_nm * closed) * slip_radps.signum();
            let before = self.engine_radps;
            self.rev(spec, physics, throttle, passed_nm, step_secs);
            if may_lock
                && (before - geared_radps).signum() != (self.engine_radps - geared_radps).signum()
            {
                self.engine_radps = geared_radps;
            }
            sum_nm += passed_nm;
        }
        sum_nm / n_steps
    }

    /// Integrates the engine alone against `load_nm`; a governor keeps it at idle.
    fn rev(
        &mut self,
        spec: &EngineSpec,
        physics: &VehiclePhysics,
        throttle: f32,
        load_nm: f32,
        dt_secs: f32,
    ) {
        let torque_nm =
            torque_nm(physics, self.engine_radps.abs() / RADPS_PER_RPM) * throttle - load_nm;
        let damping_nms = lerp(
            physics.damping_closed_open_nms,
            physics.damping_full_throttle_nms,
            throttle,
        );
        let inertia = physics.engine_inertia_kgm2;
        let revved =
            (inertia * self.engine_radps + dt_secs * torque_nm) / (inertia + dt_secs * damping_nms);
        let [idle, most] =
            [spec.idle_rpm.min(physics.max_rpm), physics.max_rpm].map(|rpm| rpm * RADPS_PER_RPM);
        // If the engine is above its largest speed, for example after a shift down, only the clutch
        // slows it down to there.
        self.engine_radps = revved.clamp(idle, most.max(self.engine_radps));
    }

    fn choose_gear(
        &mut self,
        spec: &EngineSpec,
        physics: &VehiclePhysics,
        input: &PowertrainInput,
    ) {
        let n_gears = physics.forward_gears.len() as i32;
        let control = &input.control;
        if control.manual_gear_shift {
            return self.shift((control.gear as i32).clamp(-1, n_gears), physics);
        }
        if control.reverse {
            self.gear = -1;
            return;
        }
        self.gear = self.gear.clamp(1, n_gears);
        if self.pause_left_secs > 0.0 || !physics.automatic_gearbox {
            return;
        }
        let share_in = |gear: i32| {
            let geared =
                (input.wheel_radps * overall_ratio(spec, physics, gear)).max(0.0) / RADPS_PER_RPM;
            geared / physics.max_rpm
        };
        let early = lerp(EARLY_SHIFT_RATIO, 1.0, control.throttle_ratio);
        let data = |gear: i32| physics.forward_gears[gear as usize - 1];
        let gear = self.gear;
        if gear < n_gears && share_in(gear) > data(gear).up_ratio * early {
            self.shift(gear + 1, physics);
        } else if gear > 1
            && share_in(gear) < data(gear).down_ratio * early
            && share_in(gear - 1) < 0.9 * data(gear - 1).up_ratio * early
        {
            self.shift(gear - 1, physics);
        }
    }

    fn shift(&mut self, gear: i32, physics: &VehiclePhysics) {
        if gear != self.gear {
            self.gear = gear;
            self.shift_left_secs = physics.gear_switch_secs;
            self.pause_left_secs = SHIFT_PAUSE_SECS.max(physics.gear_switch_secs);
        }
    }
}

fn lerp(a: f32, b: f32, share: f32) -> f32 {
    a + (b - a) * share
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicles::vehicle_models;

    fn input(throttle_ratio: f32, wheel_radps: f32) -> PowertrainInput {
        let control = VehicleControl {
            throttle_ratio,
            ..Default::default()
        };
        PowertrainInput {
            control,
            wheel_radps,
            dt_secs: 0.01,
        }
    }

    #[test]
    fn torque_of_a_locked_clutch_is_the_curve_times_the_ratio() {
        for model in vehicle_models() {
            let (spec, physics) = (&model.engine, model.physics());
            let mut train = Powertrain::new(spec);
            let ratio = overall_ratio(spec, &physics, 1);
            let rpm = spec.launch_rpm.max(0.3 * spec.max_rpm);
            let mut shut = input(1.0, rpm * RADPS_PER_RPM / ratio);
            shut.control.manual_gear_shift = true;
            shut.control.gear = 1;
            let out = (0..200)
                .map(|_| train.step(spec, &physics, &shut))
                .last()
                .unwrap();
            let expected_nm = torque_nm(&physics, rpm) * ratio * spec.efficiency_ratio;
            assert!(
                (out.torque_nm / expected_nm - 1.0).abs() < 1e-4,
                "{}: {out:?}, expected {expected_nm}",
                model.type_id
            );
            assert!((out.inertia_kgm2 - spec.inertia_kgm2 * ratio * ratio).abs() < 1e-3);
        }
    }

    #[test]
    fn a_standing_engine_pulls_away_near_its_launch_speed() {
        for model in vehicle_models()
            .iter()
            .filter(|model| model.engine.idle_rpm > 0.0)
        {
            let (spec, physics) = (&model.engine, model.physics());
            let mut train = Powertrain::new(spec);
            assert_eq!(
                train.step(spec, &physics, &input(0.0, 0.0)).torque_nm,
                0.0,
                "idles without creeping"
            );
            let out = (0..100)
                .map(|_| train.step(spec, &physics, &input(1.0, 0.0)))
                .last()
                .unwrap();
            let rpm = train.engine_radps / RADPS_PER_RPM;
            assert!(
                rpm > 0.7 * spec.launch_rpm && rpm < 1.1 * spec.launch_rpm,
                "{}: {rpm} rpm",
                model.type_id
            );
            // In equilibrium the clutch passes the torque that the engine gives.
            let given_nm =
                torque_nm(&physics, rpm) * overall_ratio(spec, &physics, 1) * spec.efficiency_ratio;
            assert!(
                (out.torque_nm / given_nm - 1.0).abs() < 0.02,
                "{}: {} of {given_nm}",
                model.type_id,
                out.torque_nm
            );
        }
    }

    #[test]
    fn a_weak_clutch_passes_only_what_it_carries() {
        let model = vehicle_models()
            .iter()
            .find(|model| model.engine.idle_rpm > 0.0)
            .unwrap();
        let mut physics = model.physics();
        physics.clutch_strength_nms = 1.0;
        let mut train = Powertrain::new(&model.engine);
        let out = (0..100)
            .map(|_| train.step(&model.engine, &physics, &input(1.0, 0.0)))
            .last()
            .unwrap();
        let expected_nm = CLUTCH_SLIP_RADPS
            * overall_ratio(&model.engine, &physics, 1)
            * model.engine.efficiency_ratio;
        assert!(
            (out.torque_nm / expected_nm - 1.0).abs() < 1e-4,
            "{} {expected_nm}",
            out.torque_nm
        );
    }

    #[test]
    fn gearbox_climbs_one_gear_at_a_time_and_does_not_hunt() {
        for model in vehicle_models() {
            let (spec, physics) = (&model.engine, model.physics());
            let mut train = Powertrain::new(spec);
            let mut shifts = 0;
            for step in 0..6000 {
                let before = train.gear;
                // Speed rises for 20 s, then stays.
                let wheel_radps = (step as f32 * 0.01).min(20.0) * 4.0;
                train.step(spec, &physics, &input(0.6, wheel_radps));
                assert!((train.gear - before).abs() <= 1);
                shifts += (train.gear != before) as usize;
            }
            assert!(
                shifts < spec.ratios.len(),
                "{}: {shifts} shifts",
                model.type_id
            );
        }
    }

    #[test]
    fn reverse_pushes_backwards_neutral_does_not_and_a_manual_box_keeps_its_gear() {
        let model = &vehicle_models()[0];
        let (spec, mut physics) = (&model.engine, model.physics());
        let mut train = Powertrain::new(spec);
        let mut reverse = input(0.5, 0.0);
        reverse.control.reverse = true;
        assert!(train.step(spec, &physics, &reverse).torque_nm < -30.0);
        let mut neutral = input(0.5, 0.0);
        neutral.control.manual_gear_shift = true;
        assert_eq!(
            train.step(spec, &physics, &neutral),
            PowertrainOutput::default()
        );
        let petrol = vehicle_models()
            .iter()
            .find(|model| model.engine.ratios.len() > 1)
            .unwrap();
        (physics, train) = (petrol.physics(), Powertrain::new(&petrol.engine));
        physics.automatic_gearbox = false;
        for _ in 0..500 {
            train.step(&petrol.engine, &physics, &input(1.0, 80.0));
        }
        assert_eq!(train.gear, 1);
    }
}
