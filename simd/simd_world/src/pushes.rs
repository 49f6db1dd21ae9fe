//! Pushes on actors: velocities, impulses, forces and torques from outside, with their limits.

use nalgebra::Vector3;
use schema_frames::PhysicsAction;
use schema_types::ActorId;

use crate::errors::ActorError;

/// Largest push: N·s, N, N·m·s or N·m, whichever it is.
const MOST_PUSH: f64 = 1e9;
/// Largest angular velocity, rad/s.
pub(crate) const MOST_RADPS: f64 = 100.0;
/// Largest velocity, m/s.
pub(crate) const MOST_MPS: f64 = 300.0;
/// Farthest point at which a push can act, metres from the map's zero.
const MOST_M: f64 = 1e6;

/// A push that was checked; vectors are in world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Push {
    /// Sets the velocity, m/s.
    Velocity(Vector3<f64>),
    /// Sets the angular velocity, rad/s.
    Spin(Vector3<f64>),
    /// Impulse, N·s, at a point in the world or at the centre of mass.
    Impulse(Vector3<f64>, Option<Vector3<f64>>),
    /// Angular impulse, N·m·s.
    AngularImpulse(Vector3<f64>),
    /// Force during the next tick, N, at a point in the world or at the centre of mass.
    Force(Vector3<f64>, Option<Vector3<f64>>),
    /// Torque during the next tick, N·m.
    Torque(Vector3<f64>),
}

impl Push {
    /// The push that an action is; `None` for an action that is none.
    ///
    /// # Errors
    /// A value that is not finite or too large.
    pub fn of(actor: ActorId, action: &PhysicsAction) -> Result<Option<Push>, ActorError> {
        use PhysicsAction::*;
        let push = |what, value: &[f64; 3]| finite(actor, what, *value, MOST_PUSH);
        let place = |point: &Option<[f64; 3]>| {
            point
                .map(|point| finite(actor, "point", point, MOST_M))
                .transpose()
        };
        Ok(Some(match action {
            SetAngularVelocity {
                angular_velocity_in_world_radps: spin,
            } => Push::Spin(finite(actor, "angular velocity", *spin, MOST_RADPS)?),
            AddImpulse {
                impulse_in_world_ns: impulse,
                point_in_world_m: point,
            } => Push::Impulse(push("impulse", impulse)?, place(point)?),
            AddAngularImpulse {
                angular_impulse_in_world_nms: impulse,
            } => Push::AngularImpulse(push("angular impulse", impulse)?),
            AddForce {
                force_in_world_n: force,
                point_in_world_m: point,
            } => Push::Force(push("force", force)?, place(point)?),
            AddTorque {
                torque_in_world_nm: torque,
            } => Push::Torque(push("torque", torque)?),
            _ => return Ok(None),
        }))
    }

    /// The push that sets a velocity.
    ///
    /// # Errors
    /// A velocity that is not finite or too large.
    pub fn velocity(actor: ActorId, velocity_in_world_mps: [f64; 3]) -> Result<Push, ActorError> {
        finite(actor, "velocity", velocity_in_world_mps, MOST_MPS).map(Push::Velocity)
    }
}

/// `value` as a vector, if it is finite and at most `most` long.
pub(crate) fn finite(
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
