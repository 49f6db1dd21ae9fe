//! The tick loop: the order of a tick's stages, and what happens between two ticks.

use std::time::Duration;

use launch_cli::Shutdown;
use schema_bus::mono_now;
use simd_frames::gpu_end::of_gpu;

use crate::daemon::Daemon;
use crate::participants::CLEANING_NANOS;

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
    daemon.end(result).map_err(of_gpu)
}

fn run_ticks(daemon: &mut Daemon, shutdown: &Shutdown) -> anyhow::Result<()> {
    loop {
        daemon.post_stages();
        match wait_for_tick(daemon, shutdown)? {
            Next::Tick => run_tick(daemon)?,
            Next::Look => {}
            Next::Stop => return Ok(()),
        }
    }
}

/// One tick: a line per stage of the table "Life of a frame" in `ARCHITECTURE.md`, in its order.
/// Stages 5 to 8 (loan, GPU, fill, publish) are one line, because each sensor goes through them on
/// its own: an IMU's frame is published before images are begun.
fn run_tick(daemon: &mut Daemon) -> anyhow::Result<()> {
    if !daemon.begin_tick() {
        return Ok(());
    }
    daemon.step_physics();
    daemon.publish_snapshot()?;
    let due = daemon.schedule()?;
    daemon.fire(due)
}

/// Serves commands, and says whether the next tick may start now.
fn wait_for_tick(daemon: &mut Daemon, shutdown: &Shutdown) -> anyhow::Result<Next> {
    daemon.check_gpu()?;
    if shutdown.requested() || daemon.has_finished() {
        return Ok(Next::Stop);
    }
    let has_acted = daemon.play_journal()?;
    daemon.greet();
    daemon.take_acks();
    daemon.attend_workers()?;
    if !has_acted || !daemon.may_start() {
        stand_still(daemon)?;
        return Ok(Next::Look);
    }
    let now_nanos = mono_now().0;
    let wait_nanos = daemon.wait_nanos(now_nanos);
    daemon.clean(now_nanos, wait_nanos >= CLEANING_NANOS);
    if wait_nanos > 0 {
        wait_for_deadline(daemon, Duration::from_nanos(wait_nanos))?;
        return Ok(Next::Look);
    }
    if daemon.wants_whole_ticks() {
        daemon.finish_frames()?;
    }
    Ok(Next::Tick)
}

/// Waits for whatever holds the next tick up, and serves commands meanwhile.
fn stand_still(daemon: &mut Daemon) -> anyhow::Result<()> {
    // Before a wait nothing may be left in flight: all frames of tick N are sent before N+1
    // begins.
    daemon.finish_frames()?;
    daemon.tell_complete();
    if !daemon.is_behind() {
        daemon.wait(match daemon.workers_are_busy() {
            true => LOOK_AT_WORKERS,
            false => LOOK_AROUND,
        })?;
    }
    if daemon.may_answer() {
        daemon.serve_commands();
    }
    daemon.show_again()?;
    daemon.look_after_all();
    Ok(())
}

/// Spends time until the next tick is due, at most `wait`: on frames in flight, or on commands.
fn wait_for_deadline(daemon: &mut Daemon, wait: Duration) -> anyhow::Result<()> {
    let wait = wait.min(LOOK_AROUND);
    if daemon.is_drawing() {
        // The next tick begins in time, also while this one is still drawn.
        return daemon.finish_oldest_within(wait);
    }
    if daemon.is_behind() || daemon.wait(wait)? {
        daemon.serve_commands();
    }
    Ok(())
}
