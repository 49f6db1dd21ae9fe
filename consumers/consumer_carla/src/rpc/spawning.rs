//! Calls that make and remove actors.

use std::time::Duration;

use schema_frames::{Attachment, Command, CommandReply, StepMode};

use crate::axes::Transform;
use crate::blueprints;
use crate::fields::{Description, Wrong};
use crate::gateway::{Answer, Failure, Gateway, Outcome, lock};
use crate::rpc::actors::pose;
use crate::rpc::batch::{Commands, Item};
use crate::rpc::{Call, Calls};
use crate::sensors::spec;
use crate::shapes;
use crate::world::Own;

/// Longest wait for the first snapshot with a new actor in free-running mode.
const FIRST_SEEN: Duration = Duration::from_millis(1500);
/// Longest wait for the second snapshot without a destroyed one. Clients that wait 2 s for an
/// answer get theirs.
const ABSENCE_WAIT: Duration = Duration::from_millis(1500);

pub(crate) const CALLS: Calls = &[
    ("spawn_actor", |gateway, call| gateway.spawn(call, false)),
    ("spawn_actor_with_parent", |gateway, call| {
        gateway.spawn(call, true)
    }),
    ("destroy_actor", Gateway::destroy),
];

/// Spawning by a batch is in `batch`, which knows what follows.
pub(crate) const BATCH: Commands = &[(1, |actor, _| {
    Ok(Item::ask(actor, Command::Destroy { actor_id: actor }))
})];

/// CARLA's number of a kind of attachment.
fn attachment(number: u8) -> Result<Attachment, Wrong> {
    match number {
        0 => Ok(Attachment::Rigid),
        1 => Ok(Attachment::SpringArm),
        2 => Ok(Attachment::SpringArmGhost),
        other => Err(format!(
            "the kind of attachment is {other}, but must be 0 (rigid), 1 (spring arm) or 2 (spring arm ghost)"
        )),
    }
}

/// The command that spawns, or why this type cannot be.
pub(crate) fn spawn_command(
    description: &Description,
    transform: &Transform,
    parent: Option<u32>,
    attachment: Attachment,
) -> Result<Command, Wrong> {
    if description.type_id.starts_with("sensor.") {
        return spec::command(description, pose(transform), parent, attachment);
    }
    Ok(Command::Spawn {
        type_id: description.type_id.clone(),
        pose: pose(transform),
        parent_id: parent,
        role: description
            .attribute("role_name")
            .unwrap_or_default()
            .to_owned(),
        attributes: blueprints::settable(description),
    })
}

impl Gateway {
    fn spawn(&self, call: &mut Call<'_>, has_parent: bool) -> Outcome {
        let (description, transform) = (call.description()?, call.transform()?);
        let (parent, attachment) = if has_parent {
            (Some(call.u32()?), attachment(call.u8()?)?)
        } else {
            (None, Attachment::Rigid)
        };
        let command = spawn_command(&description, &transform, parent, attachment)?;
        let (reply, _) = self.commander.ask_one(command)?;
        let CommandReply::Spawned { actor_id, topics } = reply else {
            return Err(Failure::Refused(format!(
                "{reply:?} is no answer to a spawn"
            )));
        };
        self.remember(
            actor_id,
            Own {
                description: description.clone(),
                parent: parent.unwrap_or(0),
                topics,
            },
        );
        self.wait_until_seen(actor_id);
        Ok(Answer::Value(shapes::new_actor(
            &self.world.known(),
            actor_id,
            parent.unwrap_or(0),
            &description,
        )))
    }

    /// Keeps what is known of a client's own actor.
    pub(crate) fn remember(&self, id: u32, own: Own) {
        self.world.change(|known| known.own.insert(id, own));
    }

    /// In free-running mode, waits for a snapshot with the actor: a Traffic Manager looks for it
    /// there.
    pub(crate) fn wait_until_seen(&self, id: u32) {
        let is_paced = |known: &crate::world::Known| {
            known
                .info
                .as_ref()
                .is_some_and(|info| info.mode == StepMode::FreeRunning)
        };
        self.world.wait_for(FIRST_SEEN, |known| {
            let seen = known
                .snapshot
                .as_ref()
                .is_some_and(|snapshot| snapshot.actor(id).is_some());
            (seen || !is_paced(known)).then_some(())
        });
    }

    fn destroy(&self, call: &mut Call<'_>) -> Outcome {
        let actor_id = call.u32()?;
        // Scripts destroy a vehicle and then its sensors, which CARLA leaves behind.
        if !self
            .world
            .change(|known| known.gone_along.remove(&actor_id))
        {
            self.commander.ask_one(Command::Destroy { actor_id })?;
            self.world.change(|known| known.forget(actor_id));
            self.await_absence(actor_id);
        }
        Ok(Answer::Value(true.into()))
    }

    /// A Traffic Manager of a free-running world goes on with a vehicle until a snapshot lacks it,
    /// and ends its process if the script has
    /// destroyed it by then; so the answer comes with the snapshot after that one, when what was
    /// begun before should be done. In a stepped
    /// world there is none before the next tick, which waits. With ticks of a second and more the
    /// answer may come first.
    fn await_absence(&self, actor_id: u32) {
        if lock(&self.traffic_managers).is_empty() {
            return;
        }
        let mut first = None;
        self.world.wait_for(ABSENCE_WAIT, |known| {
            if known
                .info
                .as_ref()
                .is_none_or(|info| info.mode != StepMode::FreeRunning)
            {
                return Some(());
            }
            let snapshot = known
                .snapshot
                .as_ref()
                .filter(|snapshot| snapshot.actor(actor_id).is_none())?;
            (snapshot.header.tick > *first.get_or_insert(snapshot.header.tick)).then_some(())
        });
    }
}
