//! Another map while the daemon runs.

use schema_frames::{CommandReply, DebugKind, JournalFile};
use schema_types::ActorId;

use crate::daemon::Daemon;
use crate::episode::{self, EpisodeId};
use simd_frames::sensor::{Role, Sensor};

/// Begins a new episode on another map or the same one. The launch file's actors are made anew and
/// its topics stay; sensors that commands made end.
///
/// The new world is built beside the old one and takes its place when nothing can fail any more, so
/// that a map that cannot be used leaves the old world as it is.
pub fn load(daemon: &mut Daemon, map: &str) -> anyhow::Result<CommandReply> {
    daemon.maps.check_asked(map)?;
    daemon.sensors.finish_all()?;
    let is_owed = !daemon.gate.participants().is_empty();
    let sim_time = daemon.now();
    let stamp = daemon.episode.stamp;
    let launch = &daemon.settings.launch;
    let loaded = daemon.maps.load(map, launch.scenario.seed)?;
    if let Some(text) = daemon.maps.file_text(map)? {
        let title = &loaded.data.name;
        daemon
            .journal
            .note_file(JournalFile::Map, map, title, text.as_bytes());
    }
    let id = EpisodeId {
        epoch: stamp.epoch,
        episode: stamp.episode + 1,
        start: sim_time,
    };
    let mut world = daemon.world.successor();
    let episode = episode::begin(&mut world, launch, &loaded, id)?;
    let mut actors: Vec<ActorId> = Vec::new();
    for sensor in daemon.sensors.sensors.iter().filter(|it| stays(it)) {
        let actor = match (sensor.role, &sensor.launch_rig) {
            (Role::Sensor, Some(rig)) => episode::spawn_sensor(
                &mut world,
                &episode.scenario,
                rig,
                &sensor.spec,
                &sensor.name,
                sensor.is_added,
            )?,
            _ => world.spectator(),
        };
        world.set_topics(actor, sensor.topic_infos())?;
        actors.push(actor);
    }
    if let Err(error) = daemon.sensors.load_for(&episode.assets, stays) {
        daemon.sensors.load(&daemon.episode.assets)?;
        return Err(error);
    }
    daemon.world = world;
    daemon.episode = episode;
    daemon.sensors.remove(|sensor| !stays(sensor), is_owed)?;
    let period_nanos = daemon.clock.period_nanos();
    for (sensor, actor) in daemon.sensors.sensors.iter_mut().zip(actors) {
        sensor.begin_episode(actor, (daemon.tick, sim_time), period_nanos);
    }
    daemon.debug.clear(DebugKind::All);
    daemon.mark_start();
    daemon.ports.documents.touch_info();
    // The map before was as large as this one.
    launch_cli::heap::give_back();
    tracing::info!(map, episode = daemon.episode.stamp.episode, "map loaded");
    Ok(CommandReply::Done)
}

/// Whether a sensor outlives its episode.
fn stays(sensor: &Sensor) -> bool {
    !sensor.is_of_episode()
}
