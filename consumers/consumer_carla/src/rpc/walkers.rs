//! Calls about walkers: control by scripts, and the state that a client's own crowd gives them.

use schema_frames::{Command, WalkerControl};

use crate::gateway::Gateway;
use crate::rpc::batch_item::{Commands, Item};
use crate::rpc::call::{Call, Calls};
use crate::wire::axes;
use crate::wire::fields::{Fields, Structures as _, Wrong};
use crate::wire::requests::{Answer, Outcome};

/// Fastest walker, m/s; scripts that ask for more get this.
const MAX_SPEED_MPS: f32 = 15.0;

pub(crate) const CALLS: Calls = &[("apply_control_to_walker", control_walker)];

pub(crate) const BATCH: Commands = &[
    (4, |actor, fields| {
        Ok(Item::ask(
            actor,
            Command::ControlWalker {
                actor_id: actor,
                control: control(fields)?,
            },
        ))
    }),
    (7, |actor, fields| {
        let (transform, speed_mps) = (fields.transform()?, fields.f32()?);
        let yaw_rad = axes::pose(&transform).yaw_rad();
        let speed_mps = f64::from(speed_mps.clamp(0.0, MAX_SPEED_MPS));
        let ground_point_m = axes::mirror(transform.location_m);
        Ok(Item::ask(
            actor,
            Command::LeadWalker {
                actor_id: actor,
                ground_point_m,
                yaw_rad,
                speed_mps,
            },
        ))
    }),
];

/// Reads a walker control into Gantry's axes.
fn control(fields: &mut Fields<'_>) -> Result<WalkerControl, Wrong> {
    let mut control = fields.fields("a walker control")?;
    let direction = axes::mirror(control.vector()?).map(|x| (x as f32).clamp(-1e5, 1e5));
    let speed_mps = control.f32()?.clamp(0.0, MAX_SPEED_MPS);
    Ok(WalkerControl {
        direction,
        speed_mps,
        jump: control.bool()?,
    })
}

fn control_walker(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let actor_id = call.known_actor(gateway)?;
    let control = control(call)?;
    gateway
        .commander
        .tell(Command::ControlWalker { actor_id, control });
    Ok(Answer::Void)
}
