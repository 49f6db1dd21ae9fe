//! Commands that decide when ticks happen: cues, the length of a tick, and lockstep.

use anyhow::{bail, ensure};
use schema_bus::{Origin, mono_now};
use schema_frames::{CommandReply, StepMode};
use schema_types::Tick;

use crate::daemon::Daemon;
use crate::lockstep::Participant;
use crate::pace::Pace;

/// Shortest and longest tick, nanoseconds: 10 kHz to 0.1 Hz.
const PERIOD_NANOS: (u64, u64) = (100_000, 10_000_000_000);
/// Shortest and longest physics sub-step, nanoseconds.
const SUBSTEP_NANOS: (u64, u64) = (100_000, 10_000_000);

/// Most ticks one cue can ask for: a day at 100 Hz; more is surely a mistake in units.
const MAX_CUE: u64 = 8_640_000;

/// What `configure` changes; `None` stays as it is.
pub struct Configuration {
    pub mode: Option<StepMode>,
    pub period_nanos: Option<u64>,
    pub longest_substep_nanos: Option<u64>,
}

pub fn cue(daemon: &mut Daemon, n: u64) -> anyhow::Result<CommandReply> {
    ensure!(
        daemon.gate.mode() == StepMode::Stepped,
        "step needs stepped mode; send {{\"do\":\"configure\",\"mode\":\"stepped\"}} first"
    );
    ensure!(
        (1..=MAX_CUE).contains(&n),
        "n is {n}, but must be 1 to {MAX_CUE}"
    );
    if daemon.clients.take_over(mono_now().0) {
        tracing::info!(tick = daemon.tick.0, "a client steps again");
    }
    Ok(CommandReply::Stepping {
        last_tick: daemon.gate.cue(n, daemon.tick.0),
    })
}

pub fn configure(daemon: &mut Daemon, wish: &Configuration) -> anyhow::Result<CommandReply> {
    let limits = [
        ("period_nanos", wish.period_nanos, PERIOD_NANOS),
        (
            "longest_substep_nanos",
            wish.longest_substep_nanos,
            SUBSTEP_NANOS,
        ),
    ];
    for (name, given, (least, most)) in limits {
        if let Some(nanos) = given.filter(|nanos| !(least..=most).contains(nanos)) {
            bail!("{name} is {nanos}, but must be {least} to {most}");
        }
    }
    if let Some(period_nanos) = wish.period_nanos {
        daemon.clock.set_period(daemon.tick, period_nanos);
    }
    if let Some(nanos) = wish.longest_substep_nanos {
        daemon.world.set_longest_substep(nanos as f64 * 1e-9);
    }
    if let Some(mode) = wish.mode {
        daemon.gate.set_mode(mode, daemon.tick.0);
        daemon.clients.take_over(mono_now().0);
    }
    daemon.pace = Pace::new(mono_now().0, daemon.clock.period_nanos());
    daemon.ports.documents.touch_info();
    Ok(CommandReply::Done)
}

pub fn join(daemon: &mut Daemon, name: &str, asker: &Origin) -> anyhow::Result<CommandReply> {
    ensure!(
        !name.is_empty() && name.len() <= 64,
        "name is {name:?}, but must have 1 to 64 characters"
    );
    replace_namesake(daemon, name, asker)?;
    let Tick(last_tick) = daemon.tick;
    let participant = daemon.gate.join(name.to_owned(), last_tick);
    tracing::info!(
        name,
        participant,
        first_tick = last_tick + 1,
        "joined the lockstep"
    );
    daemon.ports.documents.touch_info();
    Ok(CommandReply::Joined {
        participant,
        first_tick: last_tick + 1,
    })
}

/// Gives up the place of a participant that was killed and comes back under its name. Both cannot be
/// there: the daemon knows participants by the names of their writers.
fn replace_namesake(daemon: &mut Daemon, name: &str, asker: &Origin) -> anyhow::Result<()> {
    let namesake = |p: &&Participant| p.name == name;
    let Some(before) = daemon.gate.participants().iter().find(namesake) else {
        return Ok(());
    };
    let number = before.number;
    daemon.bus.clean_dead_nodes();
    let writers = daemon.ports.acks.writers();
    let same: Vec<_> = writers.iter().filter(|w| w.port == name).collect();
    if let Some(other) = same.iter().find(|w| w.pid != asker.pid) {
        bail!("name is {name:?}, but {other} has joined under it; choose another")
    }
    ensure!(
        same.len() < 2,
        "name is {name:?}, but this process has joined under it already; leave first, or choose another"
    );
    tracing::warn!(
        name,
        participant = number,
        "a participant of this name joins again; its former place in the lockstep ends"
    );
    daemon.gate.leave(number);
    Ok(())
}

pub fn leave(daemon: &mut Daemon, participant: u32) -> anyhow::Result<CommandReply> {
    let Some(left) = daemon.gate.leave(participant) else {
        bail!("participant is {participant}, but nobody joined under that number")
    };
    tracing::info!(name = left.name, participant, "left the lockstep");
    daemon.ports.documents.touch_info();
    Ok(CommandReply::Done)
}
