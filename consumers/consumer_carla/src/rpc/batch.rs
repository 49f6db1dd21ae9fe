//! `apply_batch`: many commands in one call, with commands that follow a spawn.

use schema_frames::{Attachment, Command, CommandReply, PhysicsAction};

use crate::gateway::Gateway;
use crate::list;
use crate::rpc::actors::place_at;
use crate::rpc::batch_item::{Commands, Item};
use crate::rpc::call::{Call, Calls};
use crate::rpc::session::tick_cue;
use crate::rpc::spawning::{remember, wait_until_seen};
use crate::spawn::spawn_command;
use crate::state::commander::answer::CommandError;
use crate::wire::fields::{Fields, Structures as _, Wrong};
use crate::wire::msgpack::Value;
use crate::wire::requests::{Answer, Failure, Outcome};
use crate::wire::vehicle_physics::fit_wheels;

/// Most commands in one call.
const MAX_COMMANDS: usize = 10_000;

/// The tables of all areas.
const AREAS: &[Commands] = &[
    super::actors::BATCH,
    super::spawning::BATCH,
    super::vehicles::BATCH,
    super::physics::BATCH,
    super::walkers::BATCH,
    super::traffic_lights::BATCH,
];

pub(crate) const CALLS: Calls = &[("apply_batch", apply_batch)];

/// Names of all commands that clients can put into a batch, by their numbers on the wire.
pub const NAMES: [&str; 22] = [
    "SpawnActor",
    "DestroyActor",
    "ApplyVehicleControl",
    "ApplyVehicleAckermannControl",
    "ApplyWalkerControl",
    "ApplyVehiclePhysicsControl",
    "ApplyTransform",
    "ApplyWalkerState",
    "ApplyTargetVelocity",
    "ApplyTargetAngularVelocity",
    "ApplyImpulse",
    "ApplyForce",
    "ApplyAngularImpulse",
    "ApplyTorque",
    "SetSimulatePhysics",
    "SetEnableGravity",
    "SetAutopilot",
    "ShowDebugTelemetry",
    "SetVehicleLightState",
    "ApplyLocation",
    "ConsoleCommand",
    "SetTrafficLightState",
];

/// Names of the commands that this gateway runs.
pub fn served() -> impl Iterator<Item = &'static str> {
    let others = AREAS
        .iter()
        .copied()
        .flatten()
        .filter_map(|(number, _)| NAMES.get(usize::from(*number)).copied());
    std::iter::once(NAMES[0]).chain(others)
}

/// Reads one command. For commands that follow a spawn, `new_actor` replaces the actor.
fn read(value: &Value, new_actor: Option<u32>) -> Result<Item<'_>, Wrong> {
    let mut wrapped = Fields::new("a batch", std::slice::from_ref(value));
    let mut variant = wrapped.fields("a command")?.fields("a command's variant")?;
    let (kind, mut fields) = (variant.u8()?, variant.fields("a command's fields")?);
    if kind == 0 {
        return read_spawn(&mut fields);
    }
    let found = AREAS
        .iter()
        .copied()
        .flatten()
        .find(|(number, _)| *number == kind);
    let (_, read) = found
        .ok_or_else(|| Wrong::Value(format!("batch command {kind} cannot be done by gantry-carla; docs/reference/carla-compatibility.md lists what works")))?;
    let given = fields.u32()?;
    read(new_actor.unwrap_or(given), &mut fields)
}

fn read_spawn<'v>(fields: &mut Fields<'v>) -> Result<Item<'v>, Wrong> {
    let (description, transform) = (fields.description()?, fields.transform()?);
    let mut parent = fields.fields("an optional parent")?;
    let parent = if parent.bool()? {
        Some(parent.u32()?)
    } else {
        None
    };
    // The kind of attachment is not used: without a parent it is uninitialised memory of the
    // client, and with one CARLA's batches always attach rigidly.
    fields.value()?;
    fields.text()?;
    let then = fields.list()?;
    let command = spawn_command(&description, &transform, parent, Attachment::Rigid)?;
    Ok(Item::Spawn {
        description,
        parent: parent.unwrap_or(0),
        command,
        then,
    })
}

/// Why a command of a batch was not run.
#[derive(Clone, Debug, thiserror::Error)]
enum ItemError {
    /// Its fields are wrong.
    #[error(transparent)]
    Wrong(#[from] Wrong),
    /// The simulator refused it, or did not answer.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// It spawns, and the answer is another one.
    #[error("this is no answer to a spawn")]
    NoSpawn,
    /// There is no such actor.
    #[error("actor {actor} could not be found; it does not exist or was destroyed")]
    NoActor {
        /// Its id.
        actor: u32,
    },
}

/// Result of one command: the actor's id, or why it failed.
type Done = Result<u32, ItemError>;

fn apply_batch(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let (commands, do_tick) = (call.list()?, call.bool()?);
    if commands.len() > MAX_COMMANDS {
        return Err(Failure::Refused(format!(
            "a batch has {} commands, at most {MAX_COMMANDS} are run; split it",
            commands.len()
        )));
    }
    let done = run_batch(
        gateway,
        commands.iter().map(|command| read(command, None)).collect(),
    );
    if do_tick {
        tick_cue(gateway, call.connection)?;
    }
    let answer = |done: Done| match done {
        Ok(actor) => list![list![1u32, actor]],
        Err(error) => list![list![0u32, list![error.to_string()]]],
    };
    Ok(Answer::Bare(Value::Array(
        done.into_iter().map(answer).collect(),
    )))
}

/// Result of a `DestroyActor` command, given the simulator's answer.
fn destroyed(gateway: &Gateway, actor: u32, answer: Result<(), CommandError>) -> Done {
    let went_along = gateway
        .world
        .change(|known| known.gone_along.remove(&actor));
    match answer {
        Ok(()) => gateway.world.change(|known| known.forget(actor)),
        Err(error) if !went_along => return Err(error.into()),
        Err(_) => {}
    }
    Ok(actor)
}

/// Runs the commands in order as one request and the commands that follow spawns as another;
/// vehicle controls are sent last.
fn run_batch(gateway: &Gateway, mut items: Vec<Result<Item<'_>, Wrong>>) -> Vec<Done> {
    for item in &mut items {
        if let Ok(Item::Move { actor, location_m }) = item {
            let command = place_at(gateway, *actor, *location_m);
            *item = Ok(Item::ask(*actor, command));
        }
        if let Ok(Item::Ask {
            actor,
            command: Command::Physics { action, .. },
        }) = item
            && matches!(action, PhysicsAction::SetVehiclePhysics { .. })
        {
            fit_wheels(action, gateway.world.known().n_wheels(*actor));
        }
    }
    let asked: Vec<Command> = items
        .iter()
        .filter_map(|item| match item {
            Ok(Item::Ask { command, .. } | Item::Spawn { command, .. }) => Some(command.clone()),
            _ => None,
        })
        .collect();
    let answer = if asked.is_empty() {
        Ok(Vec::new())
    } else {
        gateway.commander.ask(asked).map(|answer| answer.replies)
    };
    let (mut replies, lost) = match answer {
        Ok(replies) => (replies.into_iter(), None),
        Err(error) => (Vec::new().into_iter(), Some(error)),
    };
    let (mut controls, mut following, mut newest) = (Vec::new(), Vec::new(), None);
    let mut reply = || match (&lost, replies.next()) {
        (None, Some(CommandReply::Refused { error })) => Err(CommandError::Refused(error)),
        (None, Some(reply)) => Ok(reply),
        (lost, _) => Err(lost.clone().unwrap_or(CommandError::OtherLength)),
    };
    let done = items
        .into_iter()
        .map(|item| match item? {
            Item::Ask {
                actor,
                command: Command::Destroy { .. },
            } => destroyed(gateway, actor, reply().map(drop)),
            Item::Ask { actor, command } => {
                reply()?;
                if matches!(
                    command,
                    Command::Physics {
                        action: PhysicsAction::SetVehiclePhysics { .. },
                        ..
                    }
                ) {
                    gateway.recorder.note_physics(actor);
                }
                Ok(actor)
            }
            Item::Spawn {
                description,
                parent,
                then,
                ..
            } => {
                let CommandReply::Spawned { actor_id, topics } = reply()? else {
                    return Err(ItemError::NoSpawn);
                };
                remember(gateway, actor_id, description, parent, topics);
                newest = Some(actor_id);
                following.extend(then.iter().map(|command| read(command, Some(actor_id))));
                Ok(actor_id)
            }
            Item::Control { actor, record } if gateway.world.known().has_actor(actor) => {
                controls.push(record);
                Ok(actor)
            }
            Item::Control { actor, .. } => Err(ItemError::NoActor { actor }),
            Item::Move { actor, .. } => Ok(actor),
            Item::Nothing { actor, what } => {
                what.into_iter().for_each(|what| gateway.no_effect(what));
                Ok(actor)
            }
        })
        .collect();
    if !controls.is_empty() {
        gateway.commander.control(controls);
    }
    // This recursion ends: clients cannot let commands follow a spawn that itself follows a spawn.
    if !following.is_empty() {
        run_batch(gateway, following);
    }
    if let Some(id) = newest {
        wait_until_seen(gateway, id);
    }
    done
}
