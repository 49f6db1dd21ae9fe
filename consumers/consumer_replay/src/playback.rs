//! The loop of a replay: reads the next tick into its slots, waits until it is due and all
//! participants are ready, sends it, and serves commands and keys in between.

use std::time::Duration;

use launch_cli::{Shutdown, wrong_usage};
use schema_bus::{Bus, mono_now};
use schema_frames::StepMode;
use schema_recording::read::RecordingFile;

use crate::commands;
use crate::options::Options;
use crate::plan::Plan;
use crate::ports::Ports;
use crate::session::{Report, Session};

/// Longest time without a look at shutdown, participants and keys.
const LOOK_AROUND: Duration = Duration::from_millis(50);
/// The last stretch before a tick is due is slept by the clock, because events wake too coarsely.
const LAST_STRETCH: Duration = Duration::from_micros(1500);

/// Replays until the end, or until `shutdown` says so.
///
/// # Errors
/// If the file cannot be replayed, the domain has a simulator or another replay, or memory is short.
pub fn replay(options: &Options, shutdown: &Shutdown) -> anyhow::Result<Report> {
    let file = RecordingFile::open(&options.file)?;
    if let Some(why) = file.walked_because() {
        tracing::warn!(
            "{}: {why}; its records were looked for one by one",
            options.file.display()
        );
    }
    let plan = Plan::of(&file, options)?;
    for (topic, why) in &plan.left_out {
        tracing::warn!("{topic} is not replayed: {why}");
    }
    let bus = Bus::open_with(&options.domain, "gantry-replay", &options.bus)?;
    let claim = bus.claim_world()?;
    let (Some(claim), false) = (claim, bus.daemon_alive()?) else {
        return Err(wrong_usage(format!(
            "domain {0:?} already has a simulator or a replay; stop it, or choose another name with --domain",
            options.domain
        )));
    };
    plan.check_memory()?;
    let ports = Ports::open(&bus, &plan, options.seal.is_some())?;
    let mut session = Session::new(options, file, &plan, ports, bus, claim)?;
    let outcome = run(&mut session, shutdown);
    let report = session.report();
    outcome.map(|()| report)
}

fn run(session: &mut Session, shutdown: &Shutdown) -> anyhow::Result<()> {
    while !shutdown.requested() && !session.quit {
        session.ports.greet();
        session.take_acks();
        take_keys(session)?;
        if !session.tape.load(&mut session.ports)? {
            if at_the_end(session)? {
                return Ok(());
            }
            continue;
        }
        if session.tape.begins_run() {
            // The file goes back in time: another run begins.
            session.new_epoch()?;
        }
        session.announce()?;
        if !session.may_start() {
            look_around(session, LOOK_AROUND)?;
            continue;
        }
        if is_early(session)? {
            continue;
        }
        let epoch = session.epoch;
        commands::serve(session)?;
        // After a jump the next tick may be another, which is not due.
        if session.epoch == epoch && session.may_start() {
            session.run_tick()?;
        }
    }
    Ok(())
}

/// Waits a little, and serves what came meanwhile.
fn look_around(session: &mut Session, wait: Duration) -> anyhow::Result<()> {
    session.ports.wake.wait(wait)?;
    session.take_acks();
    commands::serve(session)?;
    session.look_after_participants();
    session.clean();
    Ok(())
}

/// Waits until the next tick is due. Returns whether it is not yet.
fn is_early(session: &mut Session) -> anyhow::Result<bool> {
    if session.mode == StepMode::Stepped {
        return Ok(false);
    }
    let now = mono_now().0;
    let Some(next_nanos) = session.tape.next_nanos() else {
        return Ok(false);
    };
    let due = session.pace.due_nanos(next_nanos, now);
    let wait = Duration::from_nanos(due.saturating_sub(now));
    if wait > LAST_STRETCH {
        session.clean();
        session.show_status();
        if session
            .ports
            .wake
            .wait(wait.saturating_sub(LAST_STRETCH).min(LOOK_AROUND))?
        {
            commands::serve(session)?;
        }
        return Ok(true);
    }
    // The kernel wakes a sleeper some fifty microseconds late.
    if !wait.is_zero() {
        std::thread::sleep(wait);
    }
    Ok(false)
}

/// What happens once everything was sent. Returns whether the replay ends.
fn at_the_end(session: &mut Session) -> anyhow::Result<bool> {
    if session.gate.missing(session.tick).next().is_some() {
        look_around(session, LOOK_AROUND)?;
        return Ok(false);
    }
    if session.options.again && session.has_begun {
        session.jump(session.tape.start_nanos())?;
        return Ok(false);
    }
    if !session.options.hold && session.mode == StepMode::FreeRunning {
        return Ok(true);
    }
    session.show_status();
    look_around(session, LOOK_AROUND)?;
    Ok(false)
}

fn take_keys(session: &mut Session) -> anyhow::Result<()> {
    while let Some(key) = session.next_key() {
        commands::press(session, key)?;
    }
    session.show_status();
    Ok(())
}
