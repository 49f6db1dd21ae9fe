//! Commands that decide when ticks happen: cues, the length of a tick, and lockstep.

use anyhow::{bail, ensure};
use schema_bus::{Origin, mono_now};
use schema_frames::command::SPEED_RATIO;
use schema_frames::{CommandReply, StepMode};
use schema_types::Tick;

use crate::daemon::Daemon;
use crate::pace::Pace;
use crate::settings::Speed;

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
    daemon.pace = Pace::new(mono_now().0, daemon.wall_period_nanos());
    daemon.ports.documents.touch_info();
    Ok(CommandReply::Done)
}

pub fn set_speed(daemon: &mut Daemon, ratio: f64) -> anyhow::Result<CommandReply> {
    ensure!(
        daemon.settings.run.speed == Speed::RealTime,
        "this simulator runs as fast as it can; start it without --unpaced to set its speed"
    );
    let (slowest, fastest) = SPEED_RATIO;
    ensure!(
        (slowest..=fastest).contains(&ratio),
        "ratio is {ratio}, but must be {slowest} to {fastest}"
    );
    daemon.speed_ratio = ratio;
    daemon.pace = Pace::new(mono_now().0, daemon.wall_period_nanos());
    Ok(CommandReply::Done)
}

pub fn join(daemon: &mut Daemon, name: &str, asker: &Origin) -> anyhow::Result<CommandReply> {
    let Tick(last_tick) = daemon.tick;
    let participant = daemon
        .gate
        .admit(name, asker, &daemon.bus, &daemon.ports.acks, last_tick)?;
    daemon.ports.documents.touch_info();
    Ok(CommandReply::Joined {
        participant,
        first_tick: last_tick + 1,
    })
}

pub fn leave(daemon: &mut Daemon, participant: u32) -> anyhow::Result<CommandReply> {
    let Some(left) = daemon.gate.leave(participant) else {
        bail!("participant is {participant}, but nobody joined under that number")
    };
    tracing::info!(name = left.name, participant, "left the lockstep");
    daemon.ports.documents.touch_info();
    Ok(CommandReply::Done)
}
