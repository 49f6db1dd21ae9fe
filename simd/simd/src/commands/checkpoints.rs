//! Saves checkpoints of the world and restores them.

use schema_bus::mono_now;
use schema_frames::command::CheckpointPlace;
use schema_frames::{CommandReply, JournalFile, StepMode};
use schema_types::SimTime;
use simd_world::Checkpoint;

use crate::daemon::Daemon;
use crate::pace::Pace;
use simd_frames::sensor::Sensor;

pub fn save(daemon: &mut Daemon, to: &CheckpointPlace) -> anyhow::Result<CommandReply> {
    let elapsed_nanos = daemon.now().0.saturating_sub(daemon.episode.start.0);
    let checkpoint = daemon.world.checkpoint(elapsed_nanos);
    let file = daemon.checkpoints.save(to, checkpoint)?;
    let path = file.map_or(String::new(), |path| path.display().to_string());
    Ok(CommandReply::Saved { path })
}

pub fn restore(daemon: &mut Daemon, from: &CheckpointPlace) -> anyhow::Result<CommandReply> {
    let (checkpoint, file) = daemon.checkpoints.find(from, &daemon.world)?;
    if let (Some(bytes), CheckpointPlace::File(name)) = (file, from) {
        daemon
            .journal
            .note_file(JournalFile::Checkpoint, name, "", &bytes);
    }
    go_back(daemon, &checkpoint)
}

pub fn reset(daemon: &mut Daemon) -> anyhow::Result<CommandReply> {
    let start = daemon.checkpoints.start()?;
    go_back(daemon, &start)
}

/// Restores a checkpoint. Ticks count on, and the time since the episode's start becomes that of the
/// checkpoint. If that is more than the simulated time so far, simulated time leaps ahead.
fn go_back(daemon: &mut Daemon, checkpoint: &Checkpoint) -> anyhow::Result<CommandReply> {
    daemon.sensors.finish_all()?;
    let gone = daemon.world.restore(checkpoint)?;
    let is_owed = !daemon.gate.participants().is_empty();
    daemon
        .sensors
        .remove(|sensor| gone.contains(&sensor.actor), is_owed)?;
    daemon.sensors.sensors.iter_mut().for_each(Sensor::forget);
    if daemon.now().0 < checkpoint.elapsed_nanos() {
        daemon
            .clock
            .leap(daemon.tick, SimTime(checkpoint.elapsed_nanos()));
    }
    daemon.episode.start = SimTime(daemon.now().0 - checkpoint.elapsed_nanos());
    daemon.just_restored = true;
    if daemon.gate.mode() == StepMode::FreeRunning {
        daemon.pace = Pace::new(mono_now().0, daemon.clock.period_nanos());
    }
    daemon.ports.documents.touch_info();
    Ok(CommandReply::Restored {
        gone: gone.into_iter().map(|actor| actor.0).collect(),
    })
}
