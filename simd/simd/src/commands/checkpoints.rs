//! Saves checkpoints of the world and restores them.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use anyhow::Context as _;
use schema_bus::mono_now;
use schema_frames::command::CheckpointPlace;
use schema_frames::{CommandReply, JournalFile, StepMode};
use schema_types::SimTime;
use simd_world::Checkpoint;

use crate::clock::Clock;
use crate::files::{Files, Given, ReadCheckpoint, Ready, Saving};
use crate::history::History;
use crate::participants::Participants;
use crate::ports::Ports;
use crate::sensing::Sensing;
use crate::world::LiveWorld;

/// What going back to a checkpoint touches.
pub struct Context<'a> {
    pub world: &'a mut LiveWorld,
    pub sensing: &'a mut Sensing,
    pub ports: &'a mut Ports,
    pub clock: &'a mut Clock,
    pub participants: &'a Participants,
}

/// Saves the world as it is now. Where it goes to a file, that is written after all commands of the
/// request have run.
pub fn save(
    world: &mut LiveWorld,
    clock: &Clock,
    files: &Files,
    to: &CheckpointPlace,
    given: &mut Given,
    idx: usize,
) -> anyhow::Result<CommandReply> {
    match to {
        CheckpointPlace::Name(name) => {
            world.save(name, clock.now())?;
            Ok(CommandReply::Saved {
                path: String::new(),
            })
        }
        CheckpointPlace::File(name) => {
            let path = files.checkpoint(name)?;
            let reply = CommandReply::Saved {
                path: path.display().to_string(),
            };
            given.savings.push(Saving {
                idx,
                path,
                checkpoint: world.checkpoint(clock.now()),
            });
            Ok(reply)
        }
    }
}

pub fn restore(
    context: Context<'_>,
    history: &mut History,
    files: &Files,
    from: &CheckpointPlace,
    ready: Option<Ready>,
    given: &Given,
) -> anyhow::Result<CommandReply> {
    match from {
        CheckpointPlace::Name(name) => {
            let checkpoint = context.world.saved(name)?.clone();
            go_back(context, &checkpoint)
        }
        CheckpointPlace::File(name) => match ready {
            Some(Ready::Checkpoint(read)) => {
                let ReadCheckpoint { checkpoint, bytes } = *read;
                history.note_file(JournalFile::Checkpoint, name, "", &bytes);
                go_back(context, &checkpoint)
            }
            _ => {
                // The request itself saves it, so the file holds something else yet.
                let saving = given
                    .saved_here(&files.checkpoint(name)?)
                    .with_context(|| format!("the command that saves {name:?} was refused"))?;
                history.note_file(
                    JournalFile::Checkpoint,
                    name,
                    "",
                    &saving.checkpoint.to_bytes()?,
                );
                go_back(context, &saving.checkpoint)
            }
        },
    }
}

pub fn reset(context: Context<'_>) -> anyhow::Result<CommandReply> {
    let start = context.world.start()?;
    go_back(context, &start)
}

/// Restores a checkpoint. Ticks count on, and the time since the episode's start becomes that of the
/// checkpoint. If that is more than the simulated time so far, simulated time leaps ahead.
fn go_back(context: Context<'_>, checkpoint: &Checkpoint) -> anyhow::Result<CommandReply> {
    let Context {
        world,
        sensing,
        ports,
        clock,
        participants,
    } = context;
    sensing.finish_all()?;
    let gone = world.restore(checkpoint)?;
    sensing.remove(&gone, participants.are_there())?;
    sensing.forget();
    clock.leap_to(SimTime(checkpoint.elapsed_nanos()));
    let began = clock.now().0.saturating_sub(checkpoint.elapsed_nanos());
    world.restart_at(SimTime(began));
    if participants.mode() == StepMode::FreeRunning {
        clock.pace_by_period(mono_now().0);
    }
    ports.touch_info();
    Ok(CommandReply::Restored {
        gone: gone.into_iter().map(|actor| actor.0).collect(),
    })
}
