//! Hears render workers, gives cameras their places, and says whether the world may go on.

mod lists;
mod questions;
mod shares;

use schema_frames::{SceneFiring, SceneHeader, StepMode};
use simd_frames::frames::TickView;
use simd_frames::sensor::{Maker, Sensor};
use simd_frames::share::scene_of;

use crate::daemon::Daemon;
use crate::workers::{Look, Timeout, Worker};
use lists::is_complete;

/// Hears the workers, and gives cameras their places. Called in every turn of the tick loop.
pub fn attend(daemon: &mut Daemon) -> anyhow::Result<()> {
    daemon.workers.scenes.greet();
    if let Err(error) = daemon.workers.take_answers() {
        daemon.faults.unreadable(&error);
    }
    let tick = daemon.tick.0;
    // A worker that was started again asks under its old name.
    daemon.workers.bury(&daemon.bus, tick);
    questions::answer(daemon);
    shares::divide(daemon)?;
    finish(daemon)
}

/// Looks after workers for which the world waits.
pub fn look_after(daemon: &mut Daemon) {
    let look = Look {
        tick: daemon.tick.0,
        behind: behind(daemon),
        timeout_nanos: match daemon.settings.run.lockstep_timeout_nanos {
            _ if !is_strict(daemon) => Timeout::Usual,
            Some(nanos) => Timeout::After(nanos),
            None => Timeout::Never,
        },
    };
    daemon.workers.look_after(&look);
}

/// Whether the next tick may start as far as workers are concerned.
pub fn let_go_on(daemon: &Daemon) -> bool {
    let workers = &daemon.workers;
    is_complete(daemon)
        && workers.is_settled()
        && shares::are_listed(daemon)
        && workers.has_sent(behind(daemon))
}

/// Whether all frames of all ticks are sent.
pub fn have_sent_all(daemon: &Daemon) -> bool {
    daemon.workers.unfinished.is_empty() && daemon.workers.has_sent(0)
}

/// Whether commands may be answered: where all frames of a tick are sent before the next begins, they
/// are sent before an answer, too, unless a worker takes very long.
pub fn let_answer(daemon: &Daemon) -> bool {
    let is_slow = |worker: &Worker| worker.said_nanos > 0;
    !is_strict(daemon) || have_sent_all(daemon) || daemon.workers.working().any(is_slow)
}

/// Whether workers are expected to answer soon.
pub fn are_busy(daemon: &Daemon) -> bool {
    !have_sent_all(daemon) || !daemon.workers.is_settled()
}

/// Messages that workers may be behind when a tick starts: none where all frames of a tick are sent
/// before the next begins.
fn behind(daemon: &Daemon) -> u64 {
    match is_strict(daemon) {
        true => 0,
        false => u64::from(daemon.settings.frames_in_flight),
    }
}

fn is_strict(daemon: &Daemon) -> bool {
    daemon.gate.mode() == StepMode::Stepped || !daemon.gate.participants().is_empty()
}

/// Has the frames made that a worker left undone, once its cameras have their new places.
fn finish(daemon: &mut Daemon) -> anyhow::Result<()> {
    let workers = &mut daemon.workers;
    if workers.unfinished.is_empty() || workers.must_divide || !workers.all_took_over() {
        return Ok(());
    }
    let unfinished = std::mem::take(&mut workers.unfinished);
    let Some(last) = &mut workers.last else {
        return Ok(());
    };
    let (mut here, mut away) = (Vec::new(), Vec::new());
    for firing in unfinished {
        let of_firing = |sensor: &&Sensor| sensor.actor.0 == firing.sensor_id;
        match daemon
            .sensors
            .sensors
            .iter()
            .find(of_firing)
            .map(|sensor| sensor.maker)
        {
            Some(Maker::Here) => here.push(firing),
            Some(Maker::Worker(worker)) => away.push(SceneFiring { worker, ..firing }),
            Some(Maker::Nobody) | None => {}
        }
    }
    let header = SceneHeader {
        n_firings: 0,
        ..last.scene.header
    };
    if !here.is_empty() {
        let (scene, _) = scene_of(&header, &last.scene.rest, &daemon.episode.assets)?;
        let tick = TickView {
            scene: &scene,
            stamp: &daemon.episode.stamp,
            collisions: &[],
            roads: None,
        };
        daemon
            .sensors
            .settle_topics(&daemon.bus, header.period_nanos)?;
        daemon.sensors.fire_given(&tick, &here)?;
    }
    if !away.is_empty() {
        let rest = std::mem::take(&mut last.scene.rest);
        let sent = workers.send(header, &away, &rest);
        let number = workers.number;
        if let Some(last) = &mut workers.last {
            last.scene.rest = rest;
            last.firings
                .extend(away.iter().map(|firing| (number, *firing)));
        }
        if let Err(error) = sent {
            daemon.faults.unsent("a scene for render workers", &error);
        }
    }
    Ok(())
}
