//! Another map while the daemon runs.

use schema_frames::{CommandReply, DebugKind, JournalFile};

use crate::daemon::Daemon;
use crate::episode::{self, EpisodeId};
use crate::sensor::Role;
use crate::spectator;

/// Begins a new episode on another map or the same one. The launch file's actors are made anew and
/// its topics stay; sensors that commands made end.
pub fn load(daemon: &mut Daemon, map: &str) -> anyhow::Result<CommandReply> {
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
    daemon.episode = episode::begin(&mut daemon.world, launch, &loaded, id)?;
    daemon
        .sensors
        .remove(|sensor| sensor.is_of_episode(), is_owed)?;
    for sensor in &mut daemon.sensors.sensors {
        if sensor.role == Role::Spectator {
            let period_nanos = daemon.clock.period_nanos();
            spectator::begin_episode(
                sensor,
                &mut daemon.world,
                (daemon.tick, sim_time),
                period_nanos,
            )?;
            continue;
        }
        let rig = sensor
            .launch_rig
            .as_ref()
            .expect("those without one were removed");
        let actor = episode::spawn_sensor(
            &mut daemon.world,
            &daemon.episode.scenario,
            rig,
            &sensor.spec,
            &sensor.name,
            sensor.is_added,
        )?;
        daemon.world.set_topics(actor, sensor.topic_infos())?;
        sensor.begin_episode(actor, (daemon.tick, sim_time), daemon.clock.period_nanos());
    }
    daemon.sensors.load(&daemon.episode.assets)?;
    daemon.debug.clear(DebugKind::All);
    daemon.mark_start();
    daemon.ports.documents.touch_info();
    tracing::info!(map, episode = daemon.episode.stamp.episode, "map loaded");
    Ok(CommandReply::Done)
}
