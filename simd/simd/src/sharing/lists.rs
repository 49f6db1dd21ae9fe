//! The lists of sensors that workers have, and which sensors are on them.

use schema_frames::SceneHeader;
use simd_frames::sensor::{Model, Role, Sensor};
use simd_frames::topic::Writer;

use crate::daemon::Daemon;

/// Whether a sensor's frames are of a kind that workers can make: those of cameras and of lidars.
pub fn is_shared(sensor: &Sensor) -> bool {
    sensor.model.is_costly()
}

/// Whether a sensor's frames are made here whatever workers there are. Where there is a GPU for it, the
/// spectator's are, and those of cameras of batches, whose images one process must make; and those of
/// lidars that are not cast on the processor with the scenery of cameras.
pub fn stays_here(daemon: &Daemon, sensor: &Sensor) -> bool {
    match sensor.model {
        Model::Lidar { .. } => {
            daemon.sensors.options().lidars_on == Writer::Gpu || daemon.episode.assets.streamed
        }
        _ => {
            let is_kept = sensor.role == Role::Spectator || sensor.is_batched;
            is_kept && daemon.sensors.gpu().is_some()
        }
    }
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
