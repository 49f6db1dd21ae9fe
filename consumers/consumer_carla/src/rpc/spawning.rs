//! Calls that make and remove actors.

use std::time::Duration;

use schema_frames::{Attachment, Command, CommandReply, StepMode};

use crate::gateway::Gateway;
use crate::rpc::batch_item::{Commands, Item};
use crate::rpc::call::{Call, Calls};
use crate::spawn::spawn_command;
use crate::state::actors;
use crate::state::known_world::Known;
use crate::state::known_world::Own;
use crate::wire::fields::Wrong;
use crate::wire::requests::{Answer, Failure, Outcome};

/// Longest wait for the first snapshot with a new actor in free-running mode.
const FIRST_SEEN: Duration = Duration::from_millis(1500);
/// Longest wait for the second snapshot without a destroyed one. Clients that wait 2 s for an
/// answer get theirs.
const ABSENCE_WAIT: Duration = Duration::from_millis(1500);

pub(crate) const CALLS: Calls = &[
    ("spawn_actor", |gateway, call| spawn(gateway, call, false)),
    ("spawn_actor_with_parent", |gateway, call| {
        spawn(gateway, call, true)
    }),
    ("destroy_actor", destroy),
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

fn spawn(gateway: &Gateway, call: &mut Call<'_>, has_parent: bool) -> Outcome {
    let (description, transform) = (call.description()?, call.transform()?);
    let (parent, attachment) = if has_parent {
        (Some(call.u32()?), attachment(call.u8()?)?)
    } else {
        (None, Attachment::Rigid)
    };
    let command = spawn_command(&description, &transform, parent, attachment)?;
    let (reply, _) = gateway.commander.ask_one(command)?;
    let CommandReply::Spawned { actor_id, topics } = reply else {
        return Err(Failure::Refused(format!(
            "{reply:?} is no answer to a spawn"
        )));
    };
    remember(
        gateway,
        actor_id,
        Own {
            description: description.clone(),
            parent: parent.unwrap_or(0),
            topics,
        },
    );
    wait_until_seen(gateway, actor_id);
    Ok(Answer::Value(actors::new_actor(
        &gateway.world.known(),
        actor_id,
        parent.unwrap_or(0),
        &description,
    )))
}

/// Keeps what is known of a client's own actor.
pub(crate) fn remember(gateway: &Gateway, id: u32, own: Own) {
    gateway.world.change(|known| known.own.insert(id, own));
}

/// In free-running mode, waits for a snapshot with the actor: a Traffic Manager looks for it
/// there.
pub(crate) fn wait_until_seen(gateway: &Gateway, id: u32) {
    let is_paced = |known: &Known| {
        known
            .info
            .as_ref()
            .is_some_and(|info| info.mode == StepMode::FreeRunning)
    };
    gateway.world.wait_for(FIRST_SEEN, |known| {
        let seen = known
            .snapshot
            .as_ref()
            .is_some_and(|snapshot| snapshot.actor(id).is_some());
        (seen || !is_paced(known)).then_some(())
    });
}

fn destroy(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let actor_id = call.u32()?;
    // Scripts destroy a vehicle and then its sensors, which CARLA leaves behind.
    if !gateway
        .world
        .change(|known| known.gone_along.remove(&actor_id))
    {
        gateway.commander.ask_one(Command::Destroy { actor_id })?;
        gateway.world.change(|known| known.forget(actor_id));
        await_absence(gateway, actor_id);
    }
    Ok(Answer::Value(true.into()))
}

/// A Traffic Manager of a free-running world goes on with a vehicle until a snapshot lacks it,
/// and ends its process if the script has
/// destroyed it by then; so the answer comes with the snapshot after that one, when what was
/// begun before should be done. In a stepped
/// world there is none before the next tick, which waits. With ticks of a second and more the
/// answer may come first.
fn await_absence(gateway: &Gateway, actor_id: u32) {
    if gateway.traffic_managers.is_empty() {
        return;
    }
    let mut first = None;
    gateway.world.wait_for(ABSENCE_WAIT, |known| {
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
