//! Turns CARLA's description of an actor into the command that spawns it.

pub mod optics;
pub mod sensor_spec;

use schema_frames::{Attachment, Command};

use crate::state::blueprints;
use crate::wire::axes::{self, Transform};
use crate::wire::description::Description;
use crate::wire::fields::Wrong;

/// The command that spawns the actor of a description.
///
/// # Errors
/// For sensors that the simulator does not have.
pub fn spawn_command(
    description: &Description,
    transform: &Transform,
    parent: Option<u32>,
    attachment: Attachment,
) -> Result<Command, Wrong> {
    if description.type_id.starts_with("sensor.") {
        return sensor_spec::command(
            description,
            axes::pose(transform).into(),
            parent,
            attachment,
        );
    }
    Ok(Command::Spawn {
        type_id: description.type_id.clone(),
        pose: axes::pose(transform).into(),
        parent_id: parent,
        role: description
            .attribute("role_name")
            .unwrap_or_default()
            .to_owned(),
        attributes: blueprints::settable(description),
    })
}
