//! Calls that make and remove actors.

use std::sync::Arc;
use std::time::Duration;

use schema_frames::{Attachment, Command, CommandReply, StepMode};

use crate::gateway::Gateway;
use crate::rpc::batch_item::{Commands, Item};
use crate::rpc::call::{Call, Calls};
use crate::spawn::spawn_command;
use crate::state::actors;
use crate::state::known_world::{Known, Own};
use crate::wire::axes::Transform;
use crate::wire::description::Description;
use crate::wire::fields::Structures as _;
use crate::wire::fields::Wrong;
use crate::wire::requests::{Answer, Failure, Outcome};

/// Longest wait for the first snapshot with a new actor in free-running mode.
const FIRST_SEEN: Duration = Duration::from_millis(1500);
/// Longest wait for the second snapshot without a destroyed actor; less than the 2 s that some
/// clients wait for an answer.
const ABSENCE_WAIT: Duration = Duration::from_millis(1500);

pub(crate) const CALLS: Calls = &[
    ("spawn_actor", |gateway, call| {
        let (description, transform) = (call.description()?, call.transform()?);
        spawn(gateway, description, &transform, None)
    }),
    ("spawn_actor_with_parent", |gateway, call| {
        let (description, transform) = (call.description()?, call.transform()?);
        let on = Carrier {
            id: call.u32()?,
            attachment: attachment(call.u8()?)?,
        };
        spawn(gateway, description, &transform, Some(on))
    }),
    ("destroy_actor", destroy),
];

/// `SpawnActor` is read in `batch`, because other commands may follow it.
pub(crate) const BATCH: Commands = &[(1, |actor, _| {
    Ok(Item::ask(actor, Command::Destroy { actor_id: actor }))
})];

/// The kind of attachment that has this number in CARLA.
fn attachment(number: u8) -> Result<Attachment, Wrong> {
    match number {
        0 => Ok(Attachment::Rigid),
        1 => Ok(Attachment::SpringArm),
        2 => Ok(Attachment::SpringArmGhost),
        other => Err(Wrong::Value(format!(
            "the kind of attachment is {other}, but must be 0 (rigid), 1 (spring arm) or 2 (spring arm ghost)"
        ))),
    }
}

/// What a new actor is attached to.
struct Carrier {
    id: u32,
    attachment: Attachment,
}

fn spawn(
    gateway: &Gateway,
    description: Description,
    transform: &Transform,
    on: Option<Carrier>,
) -> Outcome {
    let parent = on.as_ref().map(|carrier| carrier.id);
    let attachment = on.map_or(Attachment::Rigid, |carrier| carrier.attachment);
    let command = spawn_command(&description, transform, parent, attachment)?;
    let (reply, _) = gateway.commander.ask_one(command)?;
    let CommandReply::Spawned { actor_id, topics } = reply else {
        return Err(Failure::Refused(format!(
            "{reply:?} is no answer to a spawn"
        )));
    };
    let parent = parent.unwrap_or(0);
    remember(gateway, actor_id, description.clone(), parent, topics);
    wait_until_seen(gateway, actor_id);
    Ok(Answer::Value(actors::new_actor(
        &gateway.world.known(),
        actor_id,
        parent,
        &description,
    )))
}

/// Remembers what a client said about the actor that it spawned; without attributes if those of all
/// actors take too much memory.
pub(crate) fn remember(
    gateway: &Gateway,
    id: u32,
    mut description: Description,
    parent: u32,
    topics: Vec<String>,
) {
    let cost = gateway.descriptions.hold(description.n_bytes()).ok();
    if cost.is_none() {
        description.attributes = Vec::new();
        if let Some(n_unsaid) = gateway.descriptions.may_warn() {
            tracing::warn!(
                actor = id,
                n_unsaid,
                "forgets the attributes of a new actor: those of all actors take too much memory"
            );
        }
    }
    let own = Own {
        description,
        parent,
        topics,
        cost: cost.map(Arc::new),
    };
    gateway.world.change(|known| known.own.insert(id, own));
}

/// In free-running mode, waits for a snapshot with the actor, because a Traffic Manager looks for
/// it there.
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
    // Scripts destroy a vehicle and then its sensors, which CARLA leaves behind and Gantry has
    // destroyed together with the vehicle.
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

/// In a free-running world a Traffic Manager handles a vehicle until a snapshot lacks it, and it
/// ends its process if the script has been told meanwhile that the vehicle is destroyed. The answer
/// therefore waits for the second snapshot without the vehicle; by then the Traffic Manager has
/// finished the cycle that it began before. A stepped world has no snapshot before the next tick,
/// so nobody waits there. With ticks of a second and more the wait may time out first.
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
