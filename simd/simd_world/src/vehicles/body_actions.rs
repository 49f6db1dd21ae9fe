//! What a command can do to a vehicle's body: physical data, pushes, switches, Ackermann control,
//! doors, telemetry.

use nalgebra::Vector3;
use rapier3d::math::Vector;
use schema_frames::{AckermannGains, PhysicsAction, PhysicsAnswer, VehiclePhysics};
use schema_types::ActorId;

use super::ackermann::Ackermann;
use super::factory_data;
use super::vehicle::Vehicle;
use crate::errors::{ActionError, ActorError};
use crate::physics::{Physics, narrow};
use crate::pushes::{MOST_MPS, Push, finite};

/// Wheels of most vehicles.
const FOUR: usize = 4;

/// The vehicle that an action is for.
pub(crate) struct Body<'w> {
    pub actor: ActorId,
    /// The vehicle, or why the actor is none. Actions with values of their own check those first.
    pub vehicle: Result<&'w mut Vehicle, ActorError>,
    pub physics: &'w mut Physics,
}

/// Carries out an action; a refused one changes nothing. `None` if there is nothing to answer.
pub(crate) fn act(
    body: Body<'_>,
    action: &PhysicsAction,
) -> Result<Option<PhysicsAnswer>, ActionError> {
    use PhysicsAction::*;
    let Body {
        actor,
        vehicle,
        physics,
    } = body;
    if let Some(push) = Push::of(actor, action)? {
        take(vehicle?, push, physics);
        return Ok(None);
    }
    match action {
        GetVehiclePhysics => {
            let data = vehicle?.physics.clone();
            return Ok(Some(PhysicsAnswer::VehiclePhysics(Box::new(
                (*data).clone(),
            ))));
        }
        GetAckermannGains => return Ok(Some(PhysicsAnswer::AckermannGains(vehicle?.gains))),
        GetTelemetry => {
            return Ok(Some(PhysicsAnswer::Telemetry(vehicle?.telemetry(physics))));
        }
        SetVehiclePhysics { physics: data } => set_physics(vehicle?, physics, data)?,
        SetAckermannGains { gains } => set_gains(vehicle?, *gains)?,
        ControlAckermann { control } => {
            let vehicle = vehicle?;
            vehicle.ackermann = Some(Ackermann::wish(
                vehicle.ackermann,
                *control,
                vehicle.steer_rad,
            ));
        }
        SetGravity { enabled } => vehicle?.switches.gravity = *enabled,
        SetSimulated { enabled } => vehicle?.set_simulated(physics, *enabled),
        SetCollisions { enabled } => vehicle?.set_collides(physics, *enabled),
        HoldVelocity {
            velocity_in_vehicle_mps,
        } => {
            let held = velocity_in_vehicle_mps
                .map(|held| finite(actor, "velocity", held, MOST_MPS))
                .transpose()?;
            vehicle?.switches.held_mps = held.map(|held| narrow(&held).to_array());
        }
        ShowWheelSteer { wheel, steer_rad } => {
            let angle = WheelAngle::Steer(*steer_rad);
            show_wheel(vehicle?, *wheel, angle)?;
        }
        ShowWheelRoll { wheel, roll_rad } => {
            let angle = WheelAngle::Roll(*roll_rad);
            show_wheel(vehicle?, *wheel, angle)?;
        }
        SetAngularVelocity { .. }
        | AddImpulse { .. }
        | AddAngularImpulse { .. }
        | AddForce { .. }
        | AddTorque { .. } => {}
    }
    Ok(None)
}

/// Takes a push.
fn take(vehicle: &mut Vehicle, push: Push, physics: &mut Physics) {
    let add = |sum: &mut [f32; 3], more: Vector| *sum = (Vector::from(*sum) + more).to_array();
    let engine_point = |point: Vector3<f64>| physics.engine_point(point.into());
    match push {
        Push::Velocity(velocity) => vehicle.set_velocity(physics, &velocity),
        Push::Spin(spin) => vehicle.set_angular_velocity(physics, &spin),
        Push::Impulse(impulse, point) => {
            let point = point.map(engine_point);
            let body = &mut physics.engine.bodies[vehicle.body];
            let at = point.unwrap_or_else(|| body.center_of_mass());
            body.apply_impulse_at_point(narrow(&impulse), at, true);
        }
        Push::AngularImpulse(impulse) => {
            physics.engine.bodies[vehicle.body].apply_torque_impulse(narrow(&impulse), true);
        }
        Push::Force(force, point) => {
            let (force, point) = (narrow(&force), point.map(engine_point));
            let centre = physics.engine.bodies[vehicle.body].center_of_mass();
            let torque = point.map_or(Vector::ZERO, |point| (point - centre).cross(force));
            add(&mut vehicle.force_n, force);
            add(&mut vehicle.torque_nm, torque);
        }
        Push::Torque(torque) => add(&mut vehicle.torque_nm, narrow(&torque)),
    }
}

/// Replaces a vehicle's physical data. For a vehicle with more than four wheels the first ones may
/// be given alone; the others stay as they are.
///
/// # Errors
/// A sentence that names the value and what is allowed.
pub(crate) fn set_physics(
    vehicle: &mut Vehicle,
    physics: &mut Physics,
    data: &VehiclePhysics,
) -> Result<(), ActionError> {
    let mut data = data.clone();
    let n_wheels = vehicle.wheels.len();
    if n_wheels > FOUR && (1..n_wheels).contains(&data.wheels.len()) {
        let others = &vehicle.physics.wheels[data.wheels.len()..];
        data.wheels.extend_from_slice(others);
    }
    factory_data::check(&data, n_wheels)?;
    vehicle.set_physics(physics, data);
    Ok(())
}

/// Gives a vehicle's origin a velocity; at most 300 m/s.
pub(crate) fn set_velocity(
    body: Body<'_>,
    velocity_in_world_mps: [f64; 3],
) -> Result<(), ActorError> {
    let push = Push::velocity(body.actor, velocity_in_world_mps)?;
    take(body.vehicle?, push, body.physics);
    Ok(())
}

/// Opens or shuts doors, one bit each: 1 front left, 2 front right, 4 rear left, 8 rear right.
pub(crate) fn set_doors(body: Body<'_>, doors: u8, open: bool) -> Result<(), ActorError> {
    let (actor, vehicle) = (body.actor, body.vehicle?);
    if !vehicle.model.has_dynamic_doors() {
        return Err(ActorError::WrongKind {
            actor,
            type_id: vehicle.model.type_id.to_owned(),
            needed: "vehicle whose has_dynamic_doors is true",
        });
    }
    if doors == 0 || doors > 15 {
        return Err(ActorError::Value {
            actor,
            what: "doors",
            problem: "must be a sum of 1, 2, 4 and 8 (front left to rear right)",
        });
    }
    vehicle.doors.ask(doors, open);
    Ok(())
}

fn set_gains(vehicle: &mut Vehicle, gains: AckermannGains) -> Result<(), ActionError> {
    match gains
        .speed
        .iter()
        .chain(&gains.acceleration)
        .find(|gain| !(-1e3..=1e3).contains(*gain))
    {
        Some(gain) => Err(ActionError::Value(format!(
            "a gain is {gain}, but must be -1000 to 1000"
        ))),
        None => {
            vehicle.gains = gains;
            Ok(())
        }
    }
}

/// An angle at which a wheel is shown, radians.
enum WheelAngle {
    Steer(f32),
    Roll(f32),
}

fn show_wheel(vehicle: &mut Vehicle, wheel: u8, angle: WheelAngle) -> Result<(), ActionError> {
    let n_wheels = vehicle.wheels.len();
    let wheel = vehicle.wheels.get_mut(usize::from(wheel)).ok_or_else(|| {
        ActionError::Value(format!(
            "wheel is {wheel}, but must be 0 to {}",
            n_wheels - 1
        ))
    })?;
    let (WheelAngle::Steer(angle_rad) | WheelAngle::Roll(angle_rad)) = angle;
    if !angle_rad.is_finite() {
        return Err(ActionError::Value(format!(
            "angle of a wheel is {angle_rad}, but must be finite"
        )));
    }
    match angle {
        WheelAngle::Roll(roll_rad) => {
            wheel.roll_rad = roll_rad.rem_euclid(std::f32::consts::TAU);
        }
        WheelAngle::Steer(steer_rad) => wheel.shown_steer_rad = Some(steer_rad),
    }
    Ok(())
}
