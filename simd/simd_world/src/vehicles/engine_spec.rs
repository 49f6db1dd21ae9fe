//! The constants of an engine with its gearbox.

/// An engine with its gearbox. Torques are in N·m at the crankshaft; ratios are engine speed over
/// gearbox output.
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
    /// Share of `max_rpm` at which the gearbox shifts down at full throttle.
    pub down_ratio: f32,
    /// Share of `max_rpm` at which the gearbox shifts up at full throttle.
    pub up_ratio: f32,
    /// Reverse gear, as a positive ratio.
    pub reverse_ratio: f32,
    /// Ratio of the final drive.
    pub final_ratio: f32,
    /// Share of the torque that reaches the wheels.
    pub efficiency_ratio: f32,
    /// Time without torque during a shift, seconds.
    pub shift_secs: f32,
    /// Braking torque of the closed throttle per engine speed, N·m·s/rad.
    pub drag_nm_s: f32,
    /// Moment of inertia of engine and flywheel, kg·m².
    pub inertia_kgm2: f32,
}
