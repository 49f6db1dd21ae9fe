//! Calls about walkers: control by scripts, and the state that a client's own crowd gives them.

use schema_frames::{Command, WalkerControl};

use crate::axes;
use crate::fields::{Fields, Wrong};
use crate::gateway::{Answer, Gateway, Outcome};
use crate::rpc::batch::{Commands, Item};
use crate::rpc::{Call, Calls};

/// Fastest that a walker goes, m/s; scripts that ask for more get this.
const MAX_SPEED_MPS: f32 = 15.0;

pub(crate) const CALLS: Calls = &[("apply_control_to_walker", Gateway::control_walker)];

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

/// A walker control, in our axes.
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

impl Gateway {
    fn control_walker(&self, call: &mut Call<'_>) -> Outcome {
        let actor_id = self.known_actor(call)?;
        let control = control(call)?;
        self.commander
            .tell(Command::ControlWalker { actor_id, control });
        Ok(Answer::Void)
    }
}
