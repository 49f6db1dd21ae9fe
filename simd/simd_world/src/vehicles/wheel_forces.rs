//! From a wheel's state to the rows of the solver, and from the solver's result back to the wheel.

use super::body_state::BodyState;
use super::wheel::{Ground, Wheel, WheelPose};
use super::wheel_solver::{Chassis, Contact, Row, WheelRows};
use crate::physics::GRAVITY_MPS2;

/// Slip, as a multiple of the slip with the most grip, at which anti-lock brakes and traction
/// control begin, and the further slip over which they let go by half.
const SLIP_CONTROL: [f32; 2] = [1.2, 1.0];
/// Slip speed below which neither acts, m/s.
const SLIP_CONTROL_MPS: f32 = 0.5;

/// Rows of a wheel that does not exist.
#[inline]
pub(crate) fn no_wheel() -> WheelRows {
    let nothing = 0.0;
    WheelRows {
        contact: None,
        radps: nothing,
        inertia: 1.0,
        most_brake: nothing,
        brake_impulse: nothing,
        damping: nothing,
        damping_impulse: nothing,
    }
}

/// Largest torques that traction control allows the engine and anti-lock allows the brakes at a
/// wheel, N·m: what the road takes at this load plus what the wheel itself takes to change its
/// speed as fast; less where the wheel slips more than it grips.
#[inline]
pub(crate) fn grip_torques(wheel: &Wheel, inertia_kgm2: f32, forward_mps: f32) -> (f32, f32) {
    if !wheel.on_ground || wheel.load_n <= 0.0 {
        return (f32::INFINITY, f32::INFINITY);
    }
    let radius = wheel.spec.physics.radius_m;
    let grip_n = wheel.friction * wheel.load_n;
    let mass_kg = wheel.spec.rest_load_n / GRAVITY_MPS2 as f32;
    let most_nm = grip_n * radius * (1.0 + inertia_kgm2 / (mass_kg * radius * radius));
    let stiffness_n = wheel.slip_stiffness_n()[0].max(1.0);
    let slip_mps = wheel.roll_radps * radius - forward_mps;
    let over = slip_mps.abs() / forward_mps.abs().max(2.0) / (grip_n / stiffness_n).max(1e-3);
    let eased = (1.0 - 0.5 * (over - SLIP_CONTROL[0]) / SLIP_CONTROL[1]).clamp(0.3, 1.0);
    let slips = slip_mps.abs() > SLIP_CONTROL_MPS;
    // Slip in the direction of travel comes from the engine, slip against it from the brakes.
    let spins = slips && slip_mps * forward_mps >= 0.0;
    let blocks = slips && slip_mps * forward_mps < 0.0;
    (
        if spins { eased * most_nm } else { most_nm },
        if blocks { eased * most_nm } else { most_nm },
    )
}

/// The rows of a wheel on the ground, which begin with the forces of the last sub-step.
#[inline]
pub(crate) fn contact(
    wheel: &Wheel,
    ground: &Ground,
    wheel_pose: &WheelPose,
    start: &BodyState,
    chassis: &mut Chassis,
    rows: &mut WheelRows,
    dt_secs: f32,
) -> Contact {
    let lever = ground.point - start.center;
    let normal = ground.normal;
    let along = wheel_pose.axle.cross(normal).normalize_or(start.forward);
    let across = normal.cross(along);
    let radius = wheel.spec.physics.radius_m;
    let velocity = chassis.linear + chassis.angular.cross(lever);
    let (vx, vy) = (velocity.dot(along), velocity.dot(across));
    let speed_mps = (vx * vx + vy * vy).sqrt().max((rows.radps * radius).abs());
    let cosine = normal.dot(wheel_pose.up).clamp(0.3, 1.0);
    let (spring, most_load) = wheel.spring(ground, cosine, velocity.dot(normal), dt_secs);
    let [long_n, lat_n] = wheel.force_n;
    let (tyre_long, tyre_lat) = (
        wheel.tyre(0, speed_mps, dt_secs),
        wheel.tyre(1, speed_mps, dt_secs),
    );
    let radps = &mut rows.radps;
    let spring = Row::at(chassis, normal, lever, 0.0, 0.0).soft(
        spring,
        dt_secs,
        wheel.load_n * dt_secs,
        chassis,
        radps,
    );
    let long = Row::at(chassis, along, lever, radius, 1.0 / rows.inertia).soft(
        tyre_long,
        dt_secs,
        long_n * dt_secs,
        chassis,
        radps,
    );
    let lat = Row::at(chassis, across, lever, 0.0, 0.0).soft(
        tyre_lat,
        dt_secs,
        lat_n * dt_secs,
        chassis,
        radps,
    );
    Contact {
        spring,
        long,
        lat,
        most_load,
        friction: wheel.friction,
    }
}

/// Takes the solver's result over into the wheel's state.
#[inline]
pub(crate) fn take_over(wheel: &mut Wheel, rows: &WheelRows, chassis: &Chassis, dt_secs: f32) {
    wheel.roll_radps = rows.radps;
    wheel.brake_nm = rows.brake_impulse / dt_secs;
    wheel.roll(dt_secs);
    let Some(contact) = &rows.contact else {
        wheel.lift();
        wheel.slip = [0.0; 2];
        return;
    };
    wheel.load_n = contact.spring.impulse / dt_secs;
    wheel.force_n = [
        contact.long.impulse / dt_secs,
        contact.lat.impulse / dt_secs,
    ];
    let slip_mps = [
        -contact.long.speed(chassis, rows.radps),
        -contact.lat.speed(chassis, rows.radps),
    ];
    let rim_mps = rows.radps * wheel.spec.physics.radius_m;
    let travel_mps = (rim_mps - slip_mps[0]).abs();
    wheel.slip = [
        slip_mps[0] / travel_mps.max(0.5),
        (-slip_mps[1]).atan2(travel_mps.max(0.5)),
    ];
    let speed_mps = (travel_mps * travel_mps + slip_mps[1] * slip_mps[1]).sqrt();
    wheel.deflect(slip_mps, speed_mps.max(rim_mps.abs()), dt_secs);
}
