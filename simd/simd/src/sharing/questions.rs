//! Answers to what workers ask.

use launch_cli::wrong_usage;
use schema_bus::Origin;
use simd_frames::sensor::Maker;
use simd_frames::share::{Camera, CameraList, Joined, Question, accepted, refused};
use simd_frames::topic::Audience;

use crate::daemon::Daemon;
use crate::workers::{MAX_WORKERS, Standing, Worker};

/// Questions that are answered in one turn of the tick loop.
const MAX_TURN: usize = 8;
/// Longest name of a worker.
const MAX_NAME: usize = 64;

/// Answers questions that wait.
pub fn answer(daemon: &mut Daemon) {
    for _ in 0..MAX_TURN {
        let question = match daemon.workers.questions.take() {
            Ok(Some(question)) => question,
            Ok(None) => return,
            Err(error) => return daemon.faults.unreadable(&error),
        };
        let answer = serde_json::from_slice(question.text())
            .map_err(|error| wrong_usage(format!("the question cannot be read: {error}")))
            .and_then(|asked: Question| answer_to(daemon, asked, &question.origin));
        let bytes = match answer {
            Ok(bytes) => accepted(&bytes),
            Err(error) => refused(&format!("{error:#}")),
        };
        if let Err(error) = daemon.workers.questions.answer(question, &bytes) {
            tracing::warn!(%error, "a render worker's question could not be answered");
        }
    }
}

fn answer_to(daemon: &mut Daemon, asked: Question, asker: &Origin) -> anyhow::Result<Vec<u8>> {
    match asked {
        Question::Join {
            name,
            version,
            adapter,
            weight,
        } => {
            check_join(daemon, &name, &version, weight, asker)?;
            let workers = &mut daemon.workers;
            // A worker that asks again begins anew.
            let before = workers
                .workers
                .iter()
                .position(|it| it.origin.pid == asker.pid);
            if let Some(idx) = before {
                let gone = workers.workers.remove(idx);
                workers.give_up(gone.number, gone.answer.sent_number);
            }
            let number = workers.next_worker;
            workers.next_worker += 1;
            workers.workers.push(Worker {
                number,
                name,
                adapter,
                weight,
                origin: asker.clone(),
                life: asker.life(),
                looked_nanos: schema_bus::mono_now().0,
                standing: Standing::Joins,
                answer: bytemuck::Zeroable::zeroed(),
                owes_since_nanos: None,
                said_nanos: 0,
            });
            // The scenery that it is about to ask for.
            workers.scenery.version_of(&daemon.episode.assets);
            let joined = Joined {
                worker: number,
                epoch: daemon.episode.stamp.epoch,
                seed: daemon.episode.stamp.seed,
                frames_in_flight: daemon.settings.frames_in_flight,
            };
            Ok(serde_json::to_vec(&joined)?)
        }
        Question::Cameras { worker } => {
            let own = daemon.sensors.sensors.iter();
            let own = own.filter(|sensor| sensor.maker == Maker::Worker(worker));
            CameraList {
                version: daemon.workers.cameras_version,
                cameras: own.map(Camera::of).collect(),
            }
            .to_bytes()
        }
        Question::Scenery => Ok(daemon.workers.scenery.list()),
        Question::Meshes { keys } => Ok(daemon.workers.scenery.meshes(&keys)),
    }
}

/// Whether a worker may join.
fn check_join(
    daemon: &Daemon,
    name: &str,
    version: &str,
    weight: f64,
    asker: &Origin,
) -> anyhow::Result<()> {
    let own = env!("CARGO_PKG_VERSION");
    let refuse = |sentence: String| Err(wrong_usage(sentence));
    if version != own {
        return refuse(format!(
            "the worker is of version {version}, the simulator of {own}; the bytes of frames may differ, so build both from one source"
        ));
    }
    if name.is_empty() || name.len() > MAX_NAME {
        return refuse(format!(
            "name is {name:?}, but must have 1 to {MAX_NAME} characters"
        ));
    }
    if !(weight.is_finite() && weight > 0.0) {
        return refuse(format!("weight is {weight}, but must be above 0"));
    }
    if daemon.settings.audience == Audience::Hash {
        return refuse(
            "the simulator prints hashes of what it renders itself (--hash); start it without, or without workers".into(),
        );
    }
    let others = || {
        daemon
            .workers
            .workers
            .iter()
            .filter(|it| it.origin.pid != asker.pid)
    };
    if let Some(other) = others().find(|it| it.name == name) {
        return refuse(format!(
            "name is {name:?}, but {} has joined under it; choose another with --name",
            other.origin
        ));
    }
    if others().count() >= MAX_WORKERS {
        return refuse(format!(
            "there are {MAX_WORKERS} render workers already, which is the most"
        ));
    }
    Ok(())
}
