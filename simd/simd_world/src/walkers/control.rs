//! Controls and leads of walkers, and which values they may have.

use schema_frames::WalkerControl;
use schema_types::ActorId;

use crate::errors::ActorError;

/// Fastest that a control can ask for, m/s.
pub const MAX_SPEED_MPS: f32 = 15.0;

/// Where a leader (a client that moves a walker tick by tick) puts it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lead {
    /// The feet stand on the ground nearest to this point, world, metres.
    pub ground_point_m: [f64; 3],
    /// Heading, radians.
    pub yaw_rad: f64,
    /// Speed that the limbs show, m/s.
    pub speed_mps: f64,
}

/// Checks a control's numbers.
pub(crate) fn check_control(actor: ActorId, control: &WalkerControl) -> Result<(), ActorError> {
    let value = |problem| {
        Err(ActorError::Value {
            actor,
            what: "walker control",
            problem,
        })
    };
    if !control
        .direction
        .iter()
        .all(|x| x.is_finite() && x.abs() < 1e6)
    {
        return value("must have a finite direction");
    }
    if !(0.0..=MAX_SPEED_MPS).contains(&control.speed_mps) {
        return value("must have a speed of 0 to 15 m/s");
    }
    Ok(())
}

/// Checks the numbers of a lead.
pub(crate) fn check_lead(actor: ActorId, lead: &Lead) -> Result<(), ActorError> {
    let value = |what, problem| {
        Err(ActorError::Value {
            actor,
            what,
            problem,
        })
    };
    if !lead
        .ground_point_m
        .iter()
        .all(|x| x.is_finite() && x.abs() < 1e5)
        || !lead.yaw_rad.is_finite()
    {
        return value("place", "must be finite and within 100 km of the origin");
    }
    if !(0.0..=f64::from(MAX_SPEED_MPS)).contains(&lead.speed_mps) {
        return value("speed", "must be 0 to 15 m/s");
    }
    Ok(())
}
