//! Answers to what workers ask.

use launch_cli::wrong_usage;
use schema_bus::Origin;
use simd_frames::frames::Sensors;
use simd_frames::sensor::Maker;
use simd_frames::share::{Camera, CameraList, Joined, Question, accepted, refused};
use simd_frames::topic::Audience;

use crate::faults::Faults;
use crate::sensing::workers::{Newcomer, Workers};
use crate::world::LiveWorld;

/// Questions that are answered in one turn of the tick loop.
const MAX_TURN: usize = 8;

/// Answers questions that wait.
pub fn answer(sensors: &Sensors, workers: &mut Workers, world: &LiveWorld, faults: &mut Faults) {
    for _ in 0..MAX_TURN {
        let question = match workers.next_question() {
            Ok(Some(question)) => question,
            Ok(None) => return,
            Err(error) => return faults.unreadable(&error),
        };
        let answer = serde_json::from_slice(question.text())
            .map_err(|error| wrong_usage(format!("the question cannot be read: {error}")))
            .and_then(|asked| answer_to(sensors, workers, world, asked, &question.origin));
        let bytes = match answer {
            Ok(bytes) => accepted(&bytes),
            Err(error) => refused(&format!("{error:#}")),
        };
        if let Err(error) = workers.answer(question, &bytes) {
            tracing::warn!(%error, "a render worker's question could not be answered");
        }
    }
}

fn answer_to(
    sensors: &Sensors,
    workers: &mut Workers,
    world: &LiveWorld,
    asked: Question,
    asker: &Origin,
) -> anyhow::Result<Vec<u8>> {
    if sensors.options().seal.is_some() {
        return Err(wrong_usage(
            "this world is sealed, and shows no scene to other processes; render workers work with one that is not",
        ));
    }
    match asked {
        Question::Join {
            name,
            version,
            adapter,
            weight,
        } => {
            check_version(&version)?;
            let newcomer = Newcomer::new(name, adapter, weight, asker)?;
            check_audience(sensors.options().audience)?;
            let stamp = world.episode().stamp();
            let joined = Joined {
                worker: workers.join(newcomer, world.episode().assets())?,
                epoch: stamp.epoch,
                seed: stamp.seed,
                frames_in_flight: sensors.options().frames_in_flight,
            };
            Ok(serde_json::to_vec(&joined)?)
        }
        Question::Cameras { worker } => {
            let own = sensors.sensors.iter();
            let own = own.filter(|sensor| sensor.maker == Maker::Worker(worker));
            let batches = sensors.batches.iter();
            let batches = batches.filter(|batch| batch.maker == Maker::Worker(worker));
            CameraList {
                version: workers.cameras_version(),
                cameras: own.map(Camera::of).collect(),
                batches: batches.map(|batch| batch.plan.clone()).collect(),
            }
            .to_bytes()
        }
        Question::Scenery => Ok(workers.scenery().list()),
        Question::Meshes { keys } => Ok(workers.scenery().meshes(&keys)),
    }
}

/// Refuses workers of another version.
fn check_version(version: &str) -> anyhow::Result<()> {
    let own = env!("CARGO_PKG_VERSION");
    match version == own {
        true => Ok(()),
        false => Err(wrong_usage(format!(
            "the worker is of version {version}, the simulator of {own}; the bytes of frames may differ, so build both from one source"
        ))),
    }
}

/// Refuses workers where this process makes all frames for their hashes.
fn check_audience(audience: Audience) -> anyhow::Result<()> {
    match audience {
        Audience::Readers => Ok(()),
        Audience::Hash => Err(wrong_usage(
            "the simulator prints hashes of what it renders itself (--hash); start it without, or without workers",
        )),
    }
}
