//! Commands from `control/world`. Those that concern the world alone are passed on to it; the others
//! are carried out here. A request that names files runs when [`Files`] has read them.

mod checkpoints;
mod counters;
mod maps;
mod rays;
mod sensors;
mod stepping;

use anyhow::{Context as _, anyhow, bail, ensure};
use schema_bus::{Origin, Request};
use schema_frames::journal::JOURNAL_ANSWER_BYTES;
use schema_frames::limits;
use schema_frames::query::MAX_HITS;
use schema_frames::{Command, CommandBatch, CommandReply, ReplyBatch};
use schema_types::{ActorId, Pose};

use crate::clock::Clock;
use crate::faults::Faults;
use crate::files::{Files, Given, MAX_FILE_REQUESTS, Needs, Ready, Returned};
use crate::history::History;
use crate::participants::Participants;
use crate::ports::Ports;
use crate::sensing::Sensing;
use crate::world::LiveWorld;
use sensors::SensorWish;
use stepping::Configuration;

/// The parts of the daemon, lent to the commands of a round. Each command is handed those of them
/// that it touches.
pub struct Context<'a> {
    pub world: &'a mut LiveWorld,
    pub sensing: &'a mut Sensing,
    pub ports: &'a mut Ports,
    pub clock: &'a mut Clock,
    pub participants: &'a mut Participants,
    pub history: &'a mut History,
    pub files: &'a mut Files,
    pub faults: &'a mut Faults,
}

/// Runs the requests whose files are read, and those that have their turn by (client, seq), and
/// answers. Returns whether there were any: then documents may have changed.
pub fn serve(context: &mut Context<'_>) -> bool {
    let mut is_any = false;
    while let Some(returned) = context.files.take_returned() {
        is_any = true;
        match returned {
            Returned::Read { request, given } => run_request(context, request, given),
            Returned::Written { request, answer } => context.ports.reply(request, &answer),
        }
    }
    for mut request in context.ports.take_requests(context.files, context.faults) {
        is_any = true;
        if context.files.is_busy(request.client_port()) {
            // It came together with the one that its client waits for.
            context.ports.hold(request);
            continue;
        }
        let needs = needs_of(context, &mut request);
        match needs.nothing() {
            true => run_request(context, request, Given::refusals(needs.refused)),
            false => context.files.read(request, needs),
        }
    }
    context.files.go_on(context.world.world());
    if is_any {
        context.history.end_round(context.clock.tick());
    }
    is_any
}

/// What a request needs of files. Commands that are refused whatever a file holds need none.
fn needs_of(context: &Context<'_>, request: &mut Request) -> Needs {
    let origin = request.origin.clone();
    let Ok(batch) = &mut request.batch else {
        return Needs::default();
    };
    let mut needs = context.files.needs(&mut batch.commands);
    let is_full = context.files.is_full();
    for idx in needs.with_files() {
        let admitted = admit(context, &batch.commands[idx], &origin).and_then(|()| {
            ensure!(
                !is_full,
                "{MAX_FILE_REQUESTS} requests wait for files of the simulator already, which is the most; ask again when some are answered"
            );
            Ok(())
        });
        if let Err(error) = admitted {
            needs.refuse(idx, &error);
        }
    }
    needs
}

/// Runs the commands of a request, and answers it, if nothing has to be written for it.
fn run_request(context: &mut Context<'_>, request: Request, mut given: Given) {
    let replies = match &request.batch {
        Ok(batch) => {
            let mut n_bytes = 0;
            let mut reply_to = |(idx, command): (usize, &Command)| {
                // What acts on the world acts again when a journal is run, so it is never
                // refused for the answers before it.
                let reply = match n_bytes > limits::MAX_ANSWER_BYTES && !command.acts_on_world() {
                    true => refused(format!(
                        "the answers to this request are longer than {} MiB already; ask for fewer things at once",
                        limits::MAX_ANSWER_BYTES >> 20
                    )),
                    false => answer(context, command, &request.origin, &mut given, idx),
                };
                n_bytes += answer_bytes(&reply);
                reply
            };
            let commands = batch.commands.iter().enumerate();
            let replies: Vec<CommandReply> = commands.map(&mut reply_to).collect();
            let outcomes = outcomes(&batch.commands, &replies);
            if !outcomes.is_empty() && !context.history.is_played() {
                context.history.note_commands(
                    &request.client,
                    request.seq,
                    request.text(),
                    outcomes,
                );
            }
            replies
        }
        Err(error) => vec![refused(error.to_string())],
    };
    let answer = ReplyBatch {
        v: schema_frames::command::COMMAND_VERSION,
        epoch: context.world.episode().stamp().epoch.to_string(),
        tick: context.clock.tick().0,
        replies,
    };
    match given.savings.is_empty() {
        true => context.ports.reply(request, &answer),
        false => context.files.write(request, answer, given.savings),
    }
}

/// The commands of a journal's request that act on the world.
pub struct Again {
    client: String,
    seq: u64,
    text: String,
    commands: Vec<Command>,
    /// Their outcomes in the run that is run again, if they are known.
    noted: Vec<String>,
    /// Whether the documents are published when they have run.
    pub is_last_of_round: bool,
}

impl Again {
    /// The commands of `text`, a request number `seq` of `client`, and what they need of files.
    ///
    /// # Errors
    /// If the text is no request.
    pub fn of(
        files: &Files,
        (client, seq): (String, u64),
        text: String,
        noted: Vec<String>,
        is_last_of_round: bool,
    ) -> anyhow::Result<(Again, Needs)> {
        let batch: CommandBatch =
            serde_json::from_str(&text).context("a request in the journal cannot be read")?;
        let commands = batch.commands.into_iter().filter(Command::acts_on_world);
        let mut commands: Vec<Command> = commands.collect();
        let mut needs = files.needs(&mut commands);
        for idx in needs.with_files() {
            // Its file may be there by now, or there was no time for it then.
            if noted.get(idx).is_some_and(|outcome| outcome == "refused") {
                needs.refuse(idx, &anyhow!("it was refused in the run that is run again"));
            }
        }
        let again = Again {
            client,
            seq,
            text,
            commands,
            noted,
            is_last_of_round,
        };
        Ok((again, needs))
    }
}

/// Runs commands of a journal again, with what has been read for them.
pub fn run_again(context: &mut Context<'_>, again: &Again, mut given: Given) {
    let mut outcomes = Vec::new();
    for (idx, command) in again.commands.iter().enumerate() {
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
                configure(context, &wish)
            }
            command => run(context, command, &mut given, idx),
        };
        outcomes.push(short(reply).outcome());
    }
    context.files.write_for_journal(given.savings);
    let Again {
        client,
        seq,
        text,
        noted,
        ..
    } = again;
    let edge = context.clock.tick();
    context.history.compare(edge, client, &outcomes, noted);
    context.history.note_commands(client, *seq, text, outcomes);
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

/// Runs command number `idx` of a client's request, or says why not.
fn answer(
    context: &mut Context<'_>,
    command: &Command,
    asker: &Origin,
    given: &mut Given,
    idx: usize,
) -> CommandReply {
    if let Err(error) = admit(context, command, asker) {
        return refused(error.to_string());
    }
    let reply = match command {
        Command::JoinLockstep { name } => join(context, name, asker),
        command => run(context, command, given, idx),
    };
    short(reply)
}

/// Whether a client may run a command now.
fn admit(context: &Context<'_>, command: &Command, asker: &Origin) -> anyhow::Result<()> {
    if let Some(seal) = context.ports.seal() {
        let participants = &context.participants;
        seal.admit(command, asker.pid, |number| participants.name_of(number))?;
    }
    let decides_ticks = matches!(
        command,
        Command::Step { .. } | Command::Configure { .. } | Command::SetSpeed { .. }
    );
    if context.history.is_played() && (decides_ticks || command.acts_on_world()) {
        bail!(
            "a run is run again from its journal here, and until that ends nobody else may change it; ask what you like, and change it then"
        );
    }
    Ok(())
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

/// Lets a client join the lockstep.
fn join(context: &mut Context<'_>, name: &str, asker: &Origin) -> anyhow::Result<CommandReply> {
    stepping::join(
        context.participants,
        context.ports,
        context.clock,
        name,
        asker,
    )
}

/// Changes when ticks happen.
fn configure(context: &mut Context<'_>, wish: &Configuration) -> anyhow::Result<CommandReply> {
    let context = stepping::Context {
        clock: context.clock,
        participants: context.participants,
        world: context.world,
        ports: context.ports,
    };
    stepping::configure(context, wish)
}

/// Why a command that names a file finds nothing of it, which no request brings about.
fn nothing_was_read() -> anyhow::Error {
    anyhow!("nothing was read for this command; this is an error of the simulator")
}

/// Runs command number `idx` of a request, which is given what was read for it. Every command is
/// named here, so that a new one cannot go to the wrong place.
fn run(
    context: &mut Context<'_>,
    command: &Command,
    given: &mut Given,
    idx: usize,
) -> anyhow::Result<CommandReply> {
    let ready = given.take(idx)?;
    let Context {
        world,
        sensing,
        ports,
        clock,
        participants,
        history,
        files,
        faults,
    } = context;
    match command {
        Command::Ping => Ok(CommandReply::Pong {
            version: env!("CARGO_PKG_VERSION").into(),
        }),
        Command::Step { n } => Ok(CommandReply::Stepping {
            last_tick: participants.cue(*n, clock.tick())?,
        }),
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
            configure(context, &wish)
        }
        Command::SetSpeed { ratio } => {
            clock.set_speed(*ratio)?;
            Ok(CommandReply::Done)
        }
        Command::Seek { .. } => bail!(
            "this is a live simulator, whose time only goes on; seek works on a replay (gantry replay), and restore_checkpoint goes back here"
        ),
        Command::JoinLockstep { .. } => bail!("only a client can join the lockstep"),
        Command::LeaveLockstep { participant } => {
            participants.leave(*participant)?;
            ports.touch_info();
            Ok(CommandReply::Done)
        }
        Command::ListMaps => match ready {
            Some(Ready::Names(names)) => Ok(CommandReply::Maps { names }),
            _ => Err(nothing_was_read()),
        },
        Command::StoreMap(_) => match ready {
            Some(Ready::Stored) => Ok(CommandReply::Done),
            _ => Err(nothing_was_read()),
        },
        Command::LoadMap { map } => {
            let Some(Ready::Map(read)) = ready else {
                return Err(nothing_was_read());
            };
            let context = maps::Context {
                world,
                sensing,
                ports,
                clock,
                participants,
                history,
            };
            maps::load(context, map, read)
        }
        Command::Counters => Ok(counters::counters(sensing, ports, clock, files, faults)),
        Command::Journal { after } => Ok(history.answer(*after)),
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
            let is_told = history.is_played();
            let mut context = sensors::Context {
                world,
                sensing,
                ports,
                clock,
                is_told,
            };
            sensors::spawn(&mut context, &wish)
        }
        Command::Destroy { actor_id } => {
            let is_owed = participants.are_there();
            sensors::destroy(world, sensing, ports, ActorId(*actor_id), is_owed)
        }
        Command::SaveCheckpoint { to } => checkpoints::save(world, clock, files, to, given, idx),
        Command::RestoreCheckpoint { from } => {
            let context = checkpoints::Context {
                world,
                sensing,
                ports,
                clock,
                participants,
            };
            checkpoints::restore(context, history, files, from, ready, given)
        }
        Command::Reset => {
            let context = checkpoints::Context {
                world,
                sensing,
                ports,
                clock,
                participants,
            };
            checkpoints::reset(context)
        }
        Command::CastRays { rays, all } => {
            let max_hits = if *all { MAX_HITS } else { 1 };
            rays::cast(world, sensing, clock, rays, max_hits)
        }
        Command::DrawDebug { shapes } => {
            sensing.draw(shapes)?;
            Ok(CommandReply::Done)
        }
        Command::ClearDebug { what } => {
            sensing.clear(*what);
            Ok(CommandReply::Done)
        }
        Command::HideActors {
            sensor_id,
            actor_ids,
        } => sensors::hide(sensing, ActorId(*sensor_id), actor_ids),
        Command::ShowTelemetry { actor_id, shown } => {
            sensing.show_telemetry(world, ActorId(*actor_id), *shown)?;
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
            ports.touch_info();
            Ok(world.apply(command))
        }
    }
}
