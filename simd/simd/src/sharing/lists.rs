//! The lists of cameras that workers have, and which cameras are on them.

use schema_frames::SceneHeader;
use simd_frames::sensor::{Model, Role, Sensor};

use crate::daemon::Daemon;

/// Whether a sensor is one that workers can render.
pub fn is_camera(sensor: &Sensor) -> bool {
    matches!(sensor.model, Model::View(_))
}

/// Whether a camera's images are made here, where there is a GPU for them: the spectator's, and those
/// of batches, whose images one process must make.
pub fn stays_here(sensor: &Sensor, has_gpu: bool) -> bool {
    (sensor.role == Role::Spectator || sensor.is_batched) && has_gpu
}

/// Whether all workers are there that the first tick waits for.
pub fn is_complete(daemon: &Daemon) -> bool {
    daemon.tick.0 > 0 || daemon.workers.n_working() >= daemon.settings.run.n_awaited_workers
}

/// Sends a message without firings, which says that the lists are others.
pub fn say_that_lists_changed(daemon: &mut Daemon) {
    let workers = &mut daemon.workers;
    workers.cameras_version += 1;
    if workers.workers.is_empty() {
        return;
    }
    let header = SceneHeader {
        tick: daemon.tick.0,
        sim_nanos: daemon.clock.time_of(daemon.tick).0,
        period_nanos: daemon.clock.period_nanos(),
        episode: daemon.episode.stamp.episode,
        scenery_version: workers.scenery.version_of(&daemon.episode.assets),
        ..bytemuck::Zeroable::zeroed()
    };
    match workers.send(header, &[], &[]) {
        Ok(()) => workers.taken_over_by = workers.number,
        Err(error) => daemon.faults.unsent("a scene for render workers", &error),
    }
}
