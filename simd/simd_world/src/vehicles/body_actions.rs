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

/// Largest push: N·s, N, N·m·s or N·m, whichever it is.
const MOST_PUSH: f64 = 1e9;
/// Largest angular velocity, rad/s.
const MOST_RADPS: f64 = 100.0;
/// Largest velocity, m/s.
const MOST_MPS: f64 = 300.0;

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
    let pushed = |what, value| finite(actor, what, value, MOST_PUSH).map(|push| narrow(&push));
    let place = |point: Option<[f64; 3]>| {
        point
            .map(|point| finite(actor, "point", point, 1e6))
            .transpose()
    };
    match action {
        GetVehiclePhysics => {
            let data = vehicle?.physics.clone();
            return Ok(Some(PhysicsAnswer::VehiclePhysics(data)));
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
        SetAngularVelocity {
            angular_velocity_in_world_radps,
        } => {
            let spin = finite(
                actor,
                "angular velocity",
                *angular_velocity_in_world_radps,
                MOST_RADPS,
            )?;
            vehicle?.set_angular_velocity(physics, &spin);
        }
        AddImpulse {
            impulse_in_world_ns,
            point_in_world_m,
        } => {
            let (impulse, point) = (
                pushed("impulse", *impulse_in_world_ns)?,
                place(*point_in_world_m)?,
            );
            let vehicle = vehicle?;
            let point = point.map(|point| physics.engine_point(point.into()));
            let body = &mut physics.engine.bodies[vehicle.body];
            let at = point.unwrap_or_else(|| body.center_of_mass());
            body.apply_impulse_at_point(impulse, at, true);
        }
        AddAngularImpulse {
            angular_impulse_in_world_nms,
        } => {
            let impulse = pushed("angular impulse", *angular_impulse_in_world_nms)?;
            physics.engine.bodies[vehicle?.body].apply_torque_impulse(impulse, true);
        }
        AddForce {
            force_in_world_n,
            point_in_world_m,
        } => {
            let (force, point) = (
                pushed("force", *force_in_world_n)?,
                place(*point_in_world_m)?,
            );
            let vehicle = vehicle?;
            let point = point.map(|point| physics.engine_point(point.into()));
            let centre = physics.engine.bodies[vehicle.body].center_of_mass();
            let torque = point.map_or(Vector::ZERO, |point| (point - centre).cross(force));
            vehicle.force_n = (Vector::from(vehicle.force_n) + force).to_array();
            vehicle.torque_nm = (Vector::from(vehicle.torque_nm) + torque).to_array();
        }
        AddTorque { torque_in_world_nm } => {
            let torque = pushed("torque", *torque_in_world_nm)?;
            let vehicle = vehicle?;
            vehicle.torque_nm = (Vector::from(vehicle.torque_nm) + torque).to_array();
        }
    }
    Ok(None)
}

/// Replaces a vehicle's physical data.
///
/// # Errors
/// A sentence that names the value and what is allowed.
pub(crate) fn set_physics(
    vehicle: &mut Vehicle,
    physics: &mut Physics,
    data: &VehiclePhysics,
) -> Result<(), ActionError> {
    factory_data::check(data, vehicle.wheels.len()).map_err(ActionError::Value)?;
    vehicle.set_physics(physics, data.clone());
    Ok(())
}

/// Gives a vehicle's origin a velocity; at most 300 m/s.
pub(crate) fn set_velocity(
    body: Body<'_>,
    velocity_in_world_mps: [f64; 3],
) -> Result<(), ActorError> {
    let velocity = finite(body.actor, "velocity", velocity_in_world_mps, MOST_MPS)?;
    body.vehicle?.set_velocity(body.physics, &velocity);
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

/// `value` as a vector, if it is finite and at most `most` long.
fn finite(
    actor: ActorId,
    what: &'static str,
    value: [f64; 3],
    most: f64,
) -> Result<Vector3<f64>, ActorError> {
    let value = Vector3::from(value);
    if value.norm() <= most {
        return Ok(value);
    }
    let problem = match what {
        "angular velocity" => "must be finite and at most 100 rad/s",
        "velocity" => "must be finite and at most 300 m/s",
        "point" => "must be finite and within 1000 km",
        _ => "must be finite and at most 1e9",
    };
    Err(ActorError::Value {
        actor,
        what,
        problem,
    })
}
