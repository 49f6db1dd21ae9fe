//! Commands from `control/world`, and keys. What would change the world is refused: a recording only
//! goes on, stands still, or is somewhere else.

use std::collections::BTreeMap;

use anyhow::{bail, ensure};
use schema_bus::Origin;
use schema_frames::command::{COMMAND_VERSION, SPEED_RATIO};
use schema_frames::{Command, CommandReply, ReplyBatch, StepMode};

use crate::keys::Key;
use crate::session::Session;

/// Most ticks that one cue can ask for, as in the simulator.
const MAX_CUE: u64 = 8_640_000;
/// By how much `+` and `-` change the speed.
const SPEED_STEP: f64 = 1.25;

/// Runs the requests that have their turn, by (client, seq), and answers.
pub fn serve(session: &mut Session) -> anyhow::Result<()> {
    let requests = match session.ports.commands.take_all() {
        Ok(requests) => requests,
        Err(error) => {
            tracing::debug!(%error, "requests could not be read; trying again");
            return Ok(());
        }
    };
    if requests.is_empty() {
        return Ok(());
    }
    for request in requests {
        let replies = match &request.batch {
            Ok(batch) => batch
                .commands
                .iter()
                .map(|command| {
                    run(session, command, &request.origin)
                        .unwrap_or_else(|error| refused(format!("{error:#}")))
                })
                .collect(),
            Err(error) => vec![refused(error.to_string())],
        };
        let answer = ReplyBatch {
            v: COMMAND_VERSION,
            epoch: session.epoch.to_string(),
            tick: session.tick,
            replies,
        };
        if let Err(error) = session.ports.commands.reply(request, &answer) {
            tracing::warn!(%error, "an answer could not be sent");
        }
    }
    session.publish_info()
}

/// A refusal with its sentence.
fn refused(error: String) -> CommandReply {
    CommandReply::Refused { error }
}

fn run(session: &mut Session, command: &Command, asker: &Origin) -> anyhow::Result<CommandReply> {
    if let Some(seal) = &session.options.seal {
        let gate = &session.gate;
        seal.admit(command, asker.pid, |number| gate.name_of(number))?;
    }
    match command {
        Command::Ping => Ok(CommandReply::Pong {
            version: env!("CARGO_PKG_VERSION").into(),
        }),
        Command::Step { n } => step(session, *n),
        Command::Configure {
            mode,
            period_nanos,
            longest_substep_nanos,
        } => {
            ensure!(
                period_nanos.is_none() && longest_substep_nanos.is_none(),
                "this is a recording, whose ticks keep their lengths; configure takes a mode only, and set_speed makes it faster"
            );
            set_mode(session, mode.unwrap_or(session.mode));
            Ok(CommandReply::Done)
        }
        Command::SetSpeed { ratio } => set_speed(session, *ratio),
        Command::Seek { sim_nanos } => seek(session, *sim_nanos),
        Command::JoinLockstep { name } => {
            let (bus, acks) = (&session.bus, &session.ports.acks);
            let participant = session.gate.admit(name, asker, bus, acks, session.tick)?;
            session.has_come_back(name);
            Ok(CommandReply::Joined {
                participant,
                first_tick: session.tick.saturating_add(1),
            })
        }
        Command::LeaveLockstep { participant } => {
            let Some(left) = session.gate.leave(*participant) else {
                bail!("participant is {participant}, but nobody joined under that number")
            };
            tracing::info!(name = left.name, participant, "left the lockstep");
            Ok(CommandReply::Done)
        }
        Command::ListMaps => Ok(CommandReply::Maps {
            names: vec![session.ports.documents.map().to_string()],
        }),
        Command::Counters => Ok(counters(session)),
        Command::Journal { .. } => bail!(
            "this is a replay, which keeps no journal; gantry rerun runs the recording itself again"
        ),
        // A recording holds the scenery as pictures only; clients of CARLA ask for it when they join.
        Command::Scenery => Ok(CommandReply::Scenery {
            objects: Vec::new(),
            lamps: Vec::new(),
        }),
        question if !question.acts_on_world() => bail!(
            "this is a recording, which has no answer to {}; its snapshots, documents and frames are all that it knows",
            name_of(question)
        ),
        other => bail!(
            "this is a recording, which {} does not change; it serves ping, step, configure with a mode, set_speed, seek, join_lockstep, leave_lockstep, list_maps, scenery and counters",
            name_of(other)
        ),
    }
}

/// The word of a command.
fn name_of(command: &Command) -> String {
    let value = serde_json::to_value(command).ok();
    let word = value.as_ref().and_then(|value| value.get("do")?.as_str());
    word.unwrap_or("this").to_owned()
}

fn step(session: &mut Session, n: u64) -> anyhow::Result<CommandReply> {
    ensure!(
        session.mode == StepMode::Stepped,
        "step needs stepped mode; send {{\"do\":\"configure\",\"mode\":\"stepped\"}} first"
    );
    ensure!(
        (1..=MAX_CUE).contains(&n),
        "n is {n}, but must be 1 to {MAX_CUE}"
    );
    session.cues = session.cues.saturating_add(n);
    Ok(CommandReply::Stepping {
        last_tick: session.tick.saturating_add(session.cues),
    })
}

fn set_mode(session: &mut Session, mode: StepMode) {
    session.mode = mode;
    session.cues = 0;
    session.pace.restart();
}

fn set_speed(session: &mut Session, ratio: f64) -> anyhow::Result<CommandReply> {
    let (least, most) = SPEED_RATIO;
    ensure!(
        (least..=most).contains(&ratio),
        "ratio is {ratio}, but must be {least} to {most}"
    );
    session.pace.set_ratio(ratio);
    Ok(CommandReply::Done)
}

fn seek(session: &mut Session, sim_nanos: u64) -> anyhow::Result<CommandReply> {
    let (first, last) = session.tape.span();
    ensure!(
        sim_nanos <= last,
        "sim_nanos is {sim_nanos}, but the recording ends at {last}"
    );
    session.jump(sim_nanos.max(first))?;
    Ok(CommandReply::Done)
}

/// Does what a key asks for.
pub fn press(session: &mut Session, key: Key) -> anyhow::Result<()> {
    let (first, last) = session.tape.span();
    match key {
        Key::Pause => {
            let mode = match session.mode {
                StepMode::FreeRunning => StepMode::Stepped,
                StepMode::Stepped => StepMode::FreeRunning,
            };
            set_mode(session, mode);
            session.publish_info()?;
        }
        Key::Step => {
            if session.mode == StepMode::FreeRunning {
                set_mode(session, StepMode::Stepped);
                session.publish_info()?;
            }
            session.cues = session.cues.saturating_add(1);
        }
        Key::Seek(secs) => {
            let by = i64::from(secs).saturating_mul(1_000_000_000);
            let to = session.sim_nanos.saturating_add_signed(by);
            session.jump(to.max(first).min(last))?;
        }
        Key::Faster | Key::Slower => {
            let factor = if key == Key::Faster {
                SPEED_STEP
            } else {
                1.0 / SPEED_STEP
            };
            let ratio = session.pace.ratio().unwrap_or(1.0) * factor;
            let (least, most) = SPEED_RATIO;
            session.pace.set_ratio(ratio.clamp(least, most));
        }
        Key::Quit => session.quit = true,
    }
    Ok(())
}

/// Counters by name. They show tests and users what was done.
fn counters(session: &Session) -> CommandReply {
    let counts = session.tape.counts();
    let mut counters = BTreeMap::from([
        ("ticks".to_owned(), counts.n_ticks),
        ("results".to_owned(), counts.n_results),
        ("dropped".to_owned(), counts.n_dropped),
        ("payload_bytes".to_owned(), counts.payload_bytes),
        ("unreadable".to_owned(), session.tape.damage().total()),
        ("late_ticks".to_owned(), session.pace.n_late()),
        ("ticks_given_up".to_owned(), session.pace.n_given_up()),
        ("acks_refused".to_owned(), session.complaints.n()),
        (
            "requests_refused".to_owned(),
            session.ports.commands.n_faults(),
        ),
    ]);
    for port in &session.ports.frames {
        counters.insert(format!("sent {}", port.name()), port.n_sent);
        counters.insert(format!("dropped {}", port.name()), port.n_dropped);
    }
    CommandReply::Counters { counters }
}
