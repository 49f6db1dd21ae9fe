//! Commands from `control/world`. Those that concern the world alone are passed on to it; the others
//! are carried out here.

mod checkpoints;
mod counters;
mod maps;
mod rays;
mod sensors;
mod stepping;

use anyhow::{Context as _, bail};
use schema_bus::Origin;
use schema_frames::journal::JOURNAL_ANSWER_BYTES;
use schema_frames::limits;
use schema_frames::query::MAX_HITS;
use schema_frames::{Command, CommandBatch, CommandReply, ReplyBatch};
use schema_types::{ActorId, Pose};

use crate::daemon::Daemon;
use crate::spectator;
use sensors::SensorWish;
use stepping::Configuration;

/// Runs the requests that have their turn, by (client, seq), and answers.
pub fn serve(daemon: &mut Daemon) {
    let requests = match daemon.ports.commands.take_all() {
        Ok(requests) => requests,
        Err(error) => {
            daemon.faults.unreadable(&error);
            return;
        }
    };
    if requests.is_empty() {
        return;
    }
    for request in requests {
        let replies = match &request.batch {
            Ok(batch) => {
                let mut n_bytes = 0;
                let mut reply_to = |command: &Command| {
                    // What acts on the world acts again when a journal is run, so it is never
                    // refused for the answers before it.
                    let reply = match n_bytes > limits::MAX_ANSWER_BYTES && !command.acts_on_world()
                    {
                        true => refused(format!(
                            "the answers to this request are longer than {} MiB already; ask for fewer things at once",
                            limits::MAX_ANSWER_BYTES >> 20
                        )),
                        false => answer(daemon, command, &request.origin),
                    };
                    n_bytes += answer_bytes(&reply);
                    reply
                };
                let replies: Vec<CommandReply> = batch.commands.iter().map(&mut reply_to).collect();
                let outcomes = outcomes(&batch.commands, &replies);
                if !outcomes.is_empty() && daemon.player.is_none() {
                    daemon.journal.note_commands(
                        &request.client,
                        request.seq,
                        request.text(),
                        outcomes,
                    );
                }
                replies
            }
            Err(error) => vec![refused(error.clone())],
        };
        let answer = ReplyBatch {
            v: schema_frames::command::COMMAND_VERSION,
            epoch: daemon.episode.stamp.epoch.to_string(),
            tick: daemon.tick.0,
            replies,
        };
        if let Err(error) = daemon.ports.commands.reply(request, &answer) {
            tracing::warn!(%error, "an answer could not be sent");
        }
    }
    daemon.journal.end_round(daemon.tick.0);
    daemon.publish_documents();
}

/// Runs those commands of a journal's request again that act on the world; returns their outcomes.
pub fn run_again(
    daemon: &mut Daemon,
    client: &str,
    seq: u64,
    text: &str,
) -> anyhow::Result<Vec<String>> {
    let batch: CommandBatch =
        serde_json::from_str(text).context("a request in the journal cannot be read")?;
    let mut outcomes = Vec::new();
    for command in batch.commands.iter().filter(|c| c.acts_on_world()) {
        let reply = match command {
            // The mode decides when ticks come, and here the journal does.
            Command::Configure {
                period_nanos,
                longest_substep_nanos,
                ..
            } => {
                let wish = Configuration {
                    mode: None,
                    period_nanos: *period_nanos,
                    longest_substep_nanos: *longest_substep_nanos,
                };
                stepping::configure(daemon, &wish)
            }
            command => run(daemon, command),
        };
        outcomes.push(short(reply).outcome());
    }
    daemon
        .journal
        .note_commands(client, seq, text, outcomes.clone());
    Ok(outcomes)
}

/// What was answered to the commands that act on the world.
fn outcomes(commands: &[Command], replies: &[CommandReply]) -> Vec<String> {
    commands
        .iter()
        .zip(replies)
        .filter(|(command, _)| command.acts_on_world())
        .map(|(_, reply)| reply.outcome())
        .collect()
}

/// Runs a client's command, or says why not.
fn answer(daemon: &mut Daemon, command: &Command, asker: &Origin) -> CommandReply {
    let decides_ticks = matches!(
        command,
        Command::Step { .. } | Command::Configure { .. } | Command::SetSpeed { .. }
    );
    if daemon.player.is_some() && (decides_ticks || command.acts_on_world()) {
        return refused(
            "a run is run again from its journal here, and until that ends nobody else may change it; ask what you like, and change it then".into(),
        );
    }
    let reply = match command {
        Command::JoinLockstep { name } => stepping::join(daemon, name, asker),
        command => run(daemon, command),
    };
    short(reply)
}

/// The reply, or the refusal with a sentence that is not too long: what a client sent may stand in
/// it.
fn short(reply: anyhow::Result<CommandReply>) -> CommandReply {
    match reply {
        Ok(CommandReply::Refused { error }) => refused(error),
        Ok(reply) => reply,
        Err(error) => refused(format!("{error:#}")),
    }
}

/// A refusal with its sentence.
fn refused(error: String) -> CommandReply {
    CommandReply::Refused {
        error: limits::cut(error),
    }
}

/// Bytes of JSON that a reply takes, about.
fn answer_bytes(reply: &CommandReply) -> usize {
    const RECORD_BYTES: usize = 256;
    let n_records = match reply {
        CommandReply::Maps { names } => return names.iter().map(String::len).sum(),
        CommandReply::Journal { .. } => return JOURNAL_ANSWER_BYTES,
        CommandReply::Refused { error } => return error.len(),
        CommandReply::Counters { counters } => counters.len(),
        CommandReply::Boxes { boxes } => boxes.len(),
        CommandReply::Bones { bones } => bones.len(),
        CommandReply::Hits { rays } => rays.iter().map(Vec::len).sum(),
        CommandReply::Scenery { objects, lamps } => objects.len() + lamps.len(),
        _ => 1,
    };
    n_records * RECORD_BYTES
}

/// Runs one command. Every command is named here, so that a new one cannot go to the wrong place.
fn run(daemon: &mut Daemon, command: &Command) -> anyhow::Result<CommandReply> {
    match command {
        Command::Ping => Ok(CommandReply::Pong {
            version: env!("CARGO_PKG_VERSION").into(),
        }),
        Command::Step { n } => stepping::cue(daemon, *n),
        Command::Configure {
            mode,
            period_nanos,
            longest_substep_nanos,
        } => {
            let wish = Configuration {
                mode: *mode,
                period_nanos: *period_nanos,
                longest_substep_nanos: *longest_substep_nanos,
            };
            stepping::configure(daemon, &wish)
        }
        Command::SetSpeed { ratio } => stepping::set_speed(daemon, *ratio),
        Command::Seek { .. } => bail!(
            "this is a live simulator, whose time only goes on; seek works on a replay (gantry replay), and restore_checkpoint goes back here"
        ),
        Command::JoinLockstep { .. } => bail!("only a client can join the lockstep"),
        Command::LeaveLockstep { participant } => stepping::leave(daemon, *participant),
        Command::ListMaps => Ok(CommandReply::Maps {
            names: daemon.maps.names(),
        }),
        Command::StoreMap(map) => {
            daemon.maps.store(map.clone())?;
            Ok(CommandReply::Done)
        }
        Command::LoadMap { map } => maps::load(daemon, map),
        Command::Counters => Ok(counters::counters(daemon)),
        Command::Journal { after } => Ok(daemon.journal.answer(*after)),
        // Passive sensors have no frames: CARLA's clients compute lane invasions themselves, and the
        // gateway computes what the V2X radio receives.
        Command::Spawn { type_id, .. }
            if type_id.starts_with("sensor.")
                && !simd_world::PASSIVE_SENSORS.contains(&type_id.as_str()) =>
        {
            bail!(
                "{type_id:?} is a sensor; make it with the command spawn_sensor, which says what it measures"
            )
        }
        Command::SpawnSensor {
            type_id,
            pose,
            parent_id,
            attachment,
            interval_nanos,
            spec,
            attributes,
        } => {
            let wish = SensorWish {
                type_id,
                pose: Pose::from(*pose),
                parent: parent_id.map(ActorId),
                attachment: *attachment,
                interval_nanos: *interval_nanos,
                spec,
                attributes,
            };
            sensors::spawn(daemon, &wish)
        }
        Command::Destroy { actor_id } => sensors::destroy(daemon, ActorId(*actor_id)),
        Command::SaveCheckpoint { to } => checkpoints::save(daemon, to),
        Command::RestoreCheckpoint { from } => checkpoints::restore(daemon, from),
        Command::Reset => checkpoints::reset(daemon),
        Command::CastRays { rays, all } => {
            let max_hits = if *all { MAX_HITS } else { 1 };
            rays::cast(daemon, rays, max_hits)
        }
        Command::DrawDebug { shapes } => {
            daemon.debug.draw(shapes)?;
            Ok(CommandReply::Done)
        }
        Command::ClearDebug { what } => {
            daemon.debug.clear(*what);
            Ok(CommandReply::Done)
        }
        Command::HideActors {
            sensor_id,
            actor_ids,
        } => sensors::hide(daemon, ActorId(*sensor_id), actor_ids),
        Command::ShowTelemetry { actor_id, shown } => {
            let vehicle = ActorId(*actor_id);
            anyhow::ensure!(
                !shown || !spectator::telemetry_lines(&mut daemon.world, vehicle).is_empty(),
                "actor {actor_id} is no vehicle, and only vehicles have telemetry"
            );
            daemon.debug.show_telemetry(vehicle, *shown);
            Ok(CommandReply::Done)
        }
        Command::Spawn { .. }
        | Command::SetPose { .. }
        | Command::SetVelocity { .. }
        | Command::ControlVehicle { .. }
        | Command::ControlWalker { .. }
        | Command::LeadWalker { .. }
        | Command::Skeleton { .. }
        | Command::Physics { .. }
        | Command::SetLamps { .. }
        | Command::SetDoors { .. }
        | Command::SetTrafficLight { .. }
        | Command::FreezeTrafficLights { .. }
        | Command::SetTrafficLightTime { .. }
        | Command::ResetTrafficLights { .. }
        | Command::LightBoxes { .. }
        | Command::SetWeather { .. }
        | Command::SetWeatherEffects { .. }
        | Command::Scenery
        | Command::ShowObjects { .. }
        | Command::ShowLayers { .. }
        | Command::SetSceneryLamps { .. }
        | Command::SetLampCycle { .. } => {
            daemon.ports.documents.touch_info();
            Ok(daemon.world.apply(command))
        }
    }
}
