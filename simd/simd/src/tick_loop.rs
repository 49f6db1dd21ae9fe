//! The tick loop: commands → physics → snapshot → sensors, and what waits between two ticks.

use std::time::Duration;

use anyhow::bail;
use launch_cli::{GpuLost, Shutdown};
use schema_bus::{Look, mono_now};
use schema_frames::{JournalFile, StepMode, VehicleControlRecord};
use schema_types::{ActorId, Tick};
use sensor_gpu::GpuError;
use simd_world::World;

use crate::clients::CLEANING_NANOS;
use crate::commands;
use crate::daemon::Daemon;
use crate::pace::Pace;
use crate::player::Act;
use crate::settings::Speed;
use crate::sharing;
use crate::stages;

/// Longest time without a look at shutdown, lockstep participants and lost clients.
const LOOK_AROUND: Duration = Duration::from_millis(100);

/// The same while render workers work, of which one may be killed.
const LOOK_AT_WORKERS: Duration = Duration::from_millis(10);

/// What to do next.
enum Next {
    Tick,
    Look,
    Stop,
}

/// Runs until the shutdown flag, the tick limit or an error.
pub fn run(mut daemon: Daemon, shutdown: &Shutdown) -> anyhow::Result<()> {
    let result = run_ticks(&mut daemon, shutdown);
    let finished = daemon.sensors.finish_all();
    report(&daemon);
    let ended = result
        .and(finished)
        .and(daemon.sensors.check_gpu().map_err(Into::into));
    let closed = daemon.sensors.close();
    ended.and(closed).map_err(of_gpu)
}

/// An error of a GPU that is gone ends the program with a code of its own.
fn of_gpu(error: anyhow::Error) -> anyhow::Error {
    let gone = error.chain().find_map(|cause| match cause.downcast_ref() {
        Some(gone @ (GpuError::Lost { .. } | GpuError::Hung { .. })) => Some(gone.to_string()),
        _ => None,
    });
    gone.map_or(error, |sentence| anyhow::Error::new(GpuLost(sentence)))
}

/// Ends the GPU if a test asks for it.
fn lose_gpu(daemon: &Daemon) {
    if let Some(file) = &daemon.settings.lose_gpu_when
        && let Some(gpu) = daemon.sensors.gpu()
        && std::fs::remove_file(file).is_ok()
    {
        gpu.lose();
    }
}

fn run_ticks(daemon: &mut Daemon, shutdown: &Shutdown) -> anyhow::Result<()> {
    loop {
        let Tick(tick) = daemon.tick;
        schema_stages::post(tick);
        match wait_for_tick(daemon, shutdown)? {
            Next::Tick => run_tick(daemon)?,
            Next::Look => {}
            Next::Stop => return Ok(()),
        }
    }
}

/// Serves commands, and says whether the next tick may start now.
fn wait_for_tick(daemon: &mut Daemon, shutdown: &Shutdown) -> anyhow::Result<Next> {
    let Tick(tick) = daemon.tick;
    lose_gpu(daemon);
    // A world that stands still hears of a lost GPU here.
    daemon.sensors.check_gpu()?;
    // Who takes part in lockstep gets the last tick whole, too.
    let is_over = has_ended(daemon) && daemon.gate.missing(tick).next().is_none();
    if shutdown.requested() || (is_over && sharing::have_sent_all(daemon)) {
        return Ok(Next::Stop);
    }
    play(daemon)?;
    daemon.ports.greet();
    take_acks(daemon);
    sharing::attend(daemon)?;
    if !may_start(daemon) {
        // Before a wait nothing may be left in flight: all frames of tick N are sent before N+1
        // begins.
        daemon.sensors.finish_all()?;
        if !daemon.ports.commands.is_behind() {
            let is_rendering = sharing::are_busy(daemon);
            let wait = if is_rendering {
                LOOK_AT_WORKERS
            } else {
                LOOK_AROUND
            };
            daemon.ports.wake.wait(wait)?;
        }
        // Who gets an answer in stepped mode or lockstep may count on the frames of the tick.
        if sharing::let_answer(daemon) {
            commands::serve(daemon);
        }
        daemon.show_again()?;
        look_after_participants(daemon);
        sharing::look_after(daemon);
        look_after_clients(daemon);
        return Ok(Next::Look);
    }
    if is_paced(daemon) {
        let now_nanos = mono_now().0;
        let wait_nanos = daemon.pace.wait_nanos(now_nanos);
        clean(daemon, now_nanos, wait_nanos >= CLEANING_NANOS);
        if wait_nanos > 0 {
            let wait = Duration::from_nanos(wait_nanos).min(LOOK_AROUND);
            if daemon.sensors.is_busy() {
                // The next tick begins in time, also while this one is still drawn.
                daemon.sensors.finish_oldest_within(wait)?;
                return Ok(Next::Look);
            }
            if daemon.ports.commands.is_behind() || daemon.ports.wake.wait(wait)? {
                commands::serve(daemon);
            }
            return Ok(Next::Look);
        }
    } else {
        clean(daemon, mono_now().0, false);
    }
    if daemon.gate.mode() == StepMode::Stepped || !daemon.gate.participants().is_empty() {
        daemon.sensors.finish_all()?;
    }
    Ok(Next::Tick)
}

/// Whether the last tick of the run has begun.
fn has_ended(daemon: &Daemon) -> bool {
    let Tick(tick) = daemon.tick;
    daemon
        .settings
        .run
        .last_tick
        .is_some_and(|last| tick >= last)
}

fn may_start(daemon: &Daemon) -> bool {
    if has_ended(daemon) {
        return false;
    }
    let Tick(tick) = daemon.tick;
    let gate = &daemon.gate;
    let settings = &daemon.settings;
    let has_joined = |name: &String| gate.participants().iter().any(|p| p.name == *name);
    let enough = tick > 0
        || (gate.participants().len() >= settings.run.n_awaited_participants
            && settings.awaited_participants.iter().all(has_joined));
    // A journal and a daemon without clients need no cues.
    let is_uncued = daemon.clients.is_running_alone() || daemon.player.is_some();
    let open = gate.is_open(tick) || (is_uncued && gate.missing(tick).next().is_none());
    enough && open && sharing::let_go_on(daemon)
}

fn is_paced(daemon: &Daemon) -> bool {
    let is_real_time = daemon.settings.run.speed == Speed::RealTime;
    if daemon.player.is_some() {
        return false;
    }
    (daemon.gate.mode() == StepMode::FreeRunning && is_real_time)
        || daemon.clients.is_running_alone()
}

/// One tick in its fixed order.
fn run_tick(daemon: &mut Daemon) -> anyhow::Result<()> {
    daemon.pace.start_tick(mono_now().0);
    keep_up(daemon);
    {
        let _span = stages::COMMANDS.span();
        commands::serve(daemon);
        if !may_start(daemon) {
            return Ok(());
        }
        apply_controls(daemon);
    }
    daemon.tick = Tick(daemon.tick.0 + 1);
    daemon.sensors.start_tick(daemon.tick);
    let period_nanos = daemon.clock.period_nanos();
    {
        let _span = stages::PHYSICS.span();
        daemon.world.step(period_nanos);
    }
    {
        let _span = stages::SNAPSHOT.span();
        daemon.publish_snapshot()?;
        daemon.publish_documents();
    }
    daemon.sensors.settle_topics(&daemon.bus, period_nanos)?;
    daemon.fire_sensors()
}

/// Lets cameras and lidars fire less often if real time is not kept and the user wants that.
fn keep_up(daemon: &mut Daemon) {
    if !daemon.settings.run.keep_up {
        return;
    }
    if !is_paced(daemon) {
        return daemon.keep_up.pause();
    }
    let (now_nanos, period_nanos) = (mono_now().0, daemon.wall_period_nanos());
    if let Some(every) = daemon.keep_up.note(now_nanos, period_nanos) {
        daemon.sensors.fire_every(every);
        tracing::warn!(
            tick = daemon.tick.0,
            "real time is not kept: cameras and lidars fire once in {every} ticks from now on (--keep-up)"
        );
    }
}

/// Lets everything act that a journal has for the edge behind the last tick, or ends the journal.
fn play(daemon: &mut Daemon) -> anyhow::Result<()> {
    let Tick(edge) = daemon.tick;
    let (now_nanos, period_nanos) = (daemon.now().0, daemon.clock.period_nanos());
    loop {
        let Some(player) = &mut daemon.player else {
            return Ok(());
        };
        if player.is_over(now_nanos, period_nanos) {
            break;
        }
        let Some(act) = player.next_at(edge)? else {
            return Ok(());
        };
        play_one(daemon, act)?;
    }
    daemon.player = None;
    daemon.sensors.follow_readers();
    daemon.pace = Pace::new(mono_now().0, daemon.wall_period_nanos());
    daemon.ports.documents.touch_info();
    tracing::info!(tick = edge, "the journal ends; the world is live");
    Ok(())
}

fn play_one(daemon: &mut Daemon, act: Act) -> anyhow::Result<()> {
    let Tick(edge) = daemon.tick;
    match act {
        Act::Commands {
            client,
            seq,
            text,
            outcomes,
            is_last_of_round,
        } => {
            let now = commands::run_again(daemon, &client, seq, &text)?;
            if let Some(player) = &mut daemon.player {
                player.compare(edge, &client, &now, &outcomes);
            }
            if is_last_of_round {
                daemon.journal.end_round(edge);
                daemon.publish_documents();
            }
        }
        Act::Controls { writer, records } => {
            daemon.journal.note_controls(edge, &writer, &records);
            for record in &records {
                // What was refused then is refused now.
                if let Err(error) = apply_control(&mut daemon.world, record) {
                    tracing::debug!(%error, writer, "a control of the journal is refused");
                }
            }
        }
        Act::Audience { topic, is_made } => daemon.sensors.tell(&topic, is_made),
        Act::File {
            of: JournalFile::Map,
            name,
            title,
            bytes,
        } => daemon.maps.provide(name, title, &bytes),
        Act::File {
            of: JournalFile::Checkpoint,
            name,
            bytes,
            ..
        } => daemon.checkpoints.provide(name, bytes),
    }
    Ok(())
}

fn apply_controls(daemon: &mut Daemon) {
    let batches = match daemon.ports.controls.drain() {
        Ok(batches) => batches,
        Err(error) => return daemon.faults.unreadable(&error),
    };
    if daemon.player.is_some() {
        return;
    }
    for batch in batches {
        let Tick(edge) = daemon.tick;
        daemon
            .journal
            .note_controls(edge, &batch.writer, &batch.records);
        for record in &batch.records {
            if let Err(error) = apply_control(&mut daemon.world, record)
                && daemon.faults.controls.count(&batch.origin, "control")
            {
                tracing::warn!(
                    "{} sent a control as {:?} that was refused: {error}; further refusals are only counted",
                    batch.origin,
                    batch.writer
                );
            }
        }
    }
}

/// Holds a control until it is replaced. A record of which a number is not finite is refused whole,
/// and the vehicle keeps the control that it has.
fn apply_control(world: &mut World, record: &VehicleControlRecord) -> anyhow::Result<()> {
    let pedals = [
        ("throttle_ratio", record.throttle_ratio),
        ("steer_ratio", record.steer_ratio),
        ("brake_ratio", record.brake_ratio),
    ];
    if let Some((name, value)) = pedals.into_iter().find(|(_, value)| !value.is_finite()) {
        bail!(
            "{name} of actor {} is {value}, but must be a finite number",
            record.actor_id
        );
    }
    let actor = ActorId(record.actor_id);
    world.set_control(actor, record.control())?;
    if record.lamps != u32::MAX {
        world.set_lamps(actor, record.lamps)?;
    }
    Ok(())
}

fn take_acks(daemon: &mut Daemon) {
    let acks = match daemon.ports.acks.drain() {
        Ok(acks) => acks,
        Err(error) => return daemon.faults.unreadable(&error),
    };
    let epoch = daemon.episode.stamp.epoch;
    let Tick(last_tick) = daemon.tick;
    let complaints = &mut daemon.faults.acks;
    daemon.gate.note(acks, epoch, last_tick, complaints);
}

/// Removes lockstep participants whose process is gone, and idle ones if a time-out is set. Says for
/// whom the world waits long.
fn look_after_participants(daemon: &mut Daemon) {
    let Tick(tick) = daemon.tick;
    let settings = &daemon.settings;
    let is_awaited =
        settings.run.n_awaited_participants > 0 || !settings.awaited_participants.is_empty();
    let look = Look {
        tick,
        before_first: tick == 0 && is_awaited,
        idle_nanos: mono_now().0.saturating_sub(daemon.pace.last_start_nanos()),
        timeout_nanos: settings.run.lockstep_timeout_nanos,
    };
    let n_removed = daemon
        .gate
        .look_after(&daemon.bus, &daemon.ports.acks, &look);
    if n_removed == 0 {
        return;
    }
    daemon.ports.documents.touch_info();
    // While the world stands still, no tick says who is left.
    daemon.publish_documents();
}

/// Takes the places of killed processes back from time to time, so that nothing is rendered for them.
fn clean(daemon: &mut Daemon, now_nanos: u64, is_idle: bool) {
    if daemon.clients.must_clean(now_nanos, is_idle) {
        daemon.bus.clean_dead_nodes();
    }
}

/// Notices killed clients, and lets stepped mode run on by itself once none is left.
fn look_after_clients(daemon: &mut Daemon) {
    let now = mono_now().0;
    clean(daemon, now, true);
    if daemon.gate.mode() == StepMode::FreeRunning
        || daemon.ports.commands.n_clients() > 0
        || daemon.tick.0 == 0
    {
        daemon.clients.seen(now);
    } else if daemon
        .clients
        .missed(now, daemon.settings.run.on_lost_client)
    {
        tracing::warn!(
            tick = daemon.tick.0,
            "no client for 10 s in stepped mode; running on by itself until the next cue"
        );
        daemon.pace = Pace::new(now, daemon.wall_period_nanos());
    }
}

/// The daemon's last line.
fn report(daemon: &Daemon) {
    let (counts, of_workers) = (daemon.sensors.counts(), daemon.workers.totals());
    tracing::info!(
        ticks = daemon.tick.0,
        frames = counts.n_sent + of_workers.n_sent,
        dropped = counts.n_dropped + of_workers.n_dropped,
        late_ticks = daemon.pace.n_late(),
        "stopped after {:.1} s of simulated time",
        daemon.now().as_secs()
    );
}
