//! Commands that decide when ticks happen: the length of a tick, and lockstep.

use anyhow::bail;
use schema_bus::{Origin, mono_now};
use schema_frames::{CommandReply, StepMode};

use crate::clock::Clock;
use crate::participants::Participants;
use crate::ports::Ports;
use crate::world::LiveWorld;

/// Shortest and longest tick, nanoseconds: 10 kHz to 0.1 Hz.
const PERIOD_NANOS: (u64, u64) = (100_000, 10_000_000_000);
/// Shortest and longest physics sub-step, nanoseconds.
const SUBSTEP_NANOS: (u64, u64) = (100_000, 10_000_000);

/// What `configure` changes; `None` stays as it is.
pub struct Configuration {
    pub mode: Option<StepMode>,
    pub period_nanos: Option<u64>,
    pub longest_substep_nanos: Option<u64>,
}

/// What `configure` touches.
pub struct Context<'a> {
    pub clock: &'a mut Clock,
    pub participants: &'a mut Participants,
    pub world: &'a mut LiveWorld,
    pub ports: &'a mut Ports,
}

pub fn configure(context: Context<'_>, wish: &Configuration) -> anyhow::Result<CommandReply> {
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
    let Context {
        clock,
        participants,
        world,
        ports,
    } = context;
    if let Some(period_nanos) = wish.period_nanos {
        clock.set_period(period_nanos);
    }
    if let Some(nanos) = wish.longest_substep_nanos {
        world.world_mut().set_longest_substep(nanos as f64 * 1e-9);
    }
    if let Some(mode) = wish.mode {
        participants.set_mode(mode, clock.tick());
    }
    clock.pace_anew(mono_now().0);
    ports.touch_info();
    Ok(CommandReply::Done)
}

pub fn join(
    participants: &mut Participants,
    ports: &mut Ports,
    clock: &Clock,
    name: &str,
    asker: &Origin,
) -> anyhow::Result<CommandReply> {
    let last_tick = clock.tick();
    let participant = participants.join(name, asker, ports.bus(), ports.acks(), last_tick)?;
    ports.touch_info();
    Ok(CommandReply::Joined {
        participant,
        first_tick: last_tick.0 + 1,
    })
}
