//! Calls of the recorder and the replayer.

use std::fs::File;
use std::io::BufReader;
use std::time::Duration;

use schema_frames::Command;

use crate::gateway::Gateway;
use crate::recorder::NameError;
use crate::recorder::file::{Reader, Recording};
use crate::recorder::read_error::{OpenError, ReadError};
use crate::recorder::replay::{Replay, Wish};
use crate::recorder::report;
use crate::rpc::call::{Call, Calls};
use crate::rpc::maps::own_map;
use crate::wire::fields::Structures as _;
use crate::wire::requests::{Answer, Failure, Outcome};

/// Longest wait for the new episode after loading a recording's map.
const SETTLE: Duration = Duration::from_secs(20);
/// Fastest replay.
const MAX_FACTOR: f64 = 1000.0;

pub(crate) const CALLS: Calls = &[
    ("start_recorder", start_recorder),
    ("stop_recorder", |gateway, _| {
        gateway.recorder.stop();
        Ok(Answer::Void)
    }),
    ("show_recorder_file_info", |gateway, call| {
        let (name, all) = (call.text()?, call.bool()?);
        about(gateway, name, |reader| report::info(reader, all))
    }),
    ("show_recorder_collisions", |gateway, call| {
        let (name, first, second) = (call.text()?, letter(call)?, letter(call)?);
        about(gateway, name, |reader| {
            report::collisions(reader, first, second)
        })
    }),
    ("show_recorder_actors_blocked", |gateway, call| {
        let (name, min_secs, min_distance_cm) = (call.text()?, call.f64()?, call.f64()?);
        about(gateway, name, |reader| {
            report::blocked(reader, min_secs, min_distance_cm)
        })
    }),
    ("replay_file", replay_file),
    ("stop_replayer", |gateway, call| {
        let keep_actors = call.bool()?;
        gateway
            .recorder
            .stop_replay(keep_actors, &gateway.commander);
        Ok(Answer::Void)
    }),
    ("set_replayer_time_factor", |gateway, call| {
        let factor = call.f64()?.clamp(0.0, MAX_FACTOR);
        gateway
            .recorder
            .set(|settings| settings.time_factor = factor);
        Ok(Answer::Void)
    }),
    ("set_replayer_ignore_hero", |gateway, call| {
        let ignore = call.bool()?;
        gateway
            .recorder
            .set(|settings| settings.ignore_hero = ignore);
        Ok(Answer::Void)
    }),
    ("set_replayer_ignore_spectator", |gateway, call| {
        let ignore = call.bool()?;
        gateway
            .recorder
            .set(|settings| settings.ignore_spectator = ignore);
        Ok(Answer::Void)
    }),
];

impl From<NameError> for Failure {
    fn from(error: NameError) -> Self {
        Failure::Refused(error.to_string())
    }
}

/// Reads the letter of a kind of actor: h (hero), v (vehicle), w (walker), t (traffic light), o
/// (other) or a (any).
fn letter(call: &mut Call<'_>) -> Result<char, Failure> {
    let code = call.u8()?;
    match char::from(code) {
        letter @ ('h' | 'v' | 'w' | 't' | 'o' | 'a') => Ok(letter),
        other => Err(Failure::Refused(format!(
            "a kind of actor is {other:?}, but must be h, v, w, t, o or a"
        ))),
    }
}

/// Starts a recording and answers with the file's full path.
fn start_recorder(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let (name, with_motion) = (call.text()?, call.bool()?);
    let path = gateway.recorder.path(name)?;
    // A statement of its own, so that the world is unlocked before the recorder is locked: every
    // tick locks them in the opposite order.
    let map = gateway
        .world
        .known()
        .info
        .as_ref()
        .map_or_else(String::new, |info| info.map.clone());
    let started = gateway.recorder.start(&path, map, with_motion);
    started.map_err(|error| Failure::Refused(error.to_string()))?;
    Ok(Answer::Value(path.display().to_string().into()))
}

/// A report about a recording. For a file that cannot be read, CARLA answers with a text, not with
/// an error.
fn about(
    gateway: &Gateway,
    name: &str,
    tell: impl FnOnce(&mut Reader<BufReader<File>>) -> Result<String, ReadError>,
) -> Outcome {
    let text = match gateway.recorder.existing(name) {
        Ok(path) => Reader::open(&path)
            .and_then(|mut reader| tell(&mut reader).map_err(|cause| OpenError::of(&path, cause)))
            .unwrap_or_else(|error| format!("{error}\n")),
        Err(error) => format!("{error}\n"),
    };
    Ok(Answer::Value(text.into()))
}

fn replay_file(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let name = call.text()?;
    let (start_secs, duration_secs, follow, replay_sensors) =
        (call.f64()?, call.f64()?, call.u32()?, call.bool()?);
    let offset = if call.rest().is_empty() {
        Default::default()
    } else {
        call.transform()?
    };
    let path = gateway.recorder.existing(name)?;
    let recording = match Recording::open(&path) {
        Ok(recording) => recording,
        Err(error) => return Ok(Answer::Value(format!("{error}\n").into())),
    };
    let opening = format!("Replaying File: {}\n\n", path.display());
    let info = gateway.info()?;
    let map = own_map(&recording.reader.head().map);
    if map != info.map {
        let load = Command::LoadMap {
            map: map.to_owned(),
        };
        // CARLA answers with a text, too.
        if let Err(error) = gateway.commander.ask_one(load) {
            let text = format!("{opening}Could not load mapfile {map}: {error}\n");
            return Ok(Answer::Value(text.into()));
        }
        if !gateway.world.knows_episode_after(info.episode, SETTLE) {
            let sentence = "the recording's map was loaded and no new episode was published";
            return Err(Failure::Refused(sentence.to_owned()));
        }
    }
    let wish = Wish {
        start_secs,
        duration_secs,
        follow,
        offset,
        with_sensors: replay_sensors,
    };
    // A statement of its own, so that the world is unlocked while files are read and compared.
    let known = gateway.world.known().excerpt();
    let begun = Replay::begin(recording, wish, gateway.recorder.settings(), &known);
    let (replay, text) = match begun {
        Ok(begun) => begun,
        Err(cause) => {
            let error = OpenError::of(&path, cause);
            return Ok(Answer::Value(format!("{error}\n").into()));
        }
    };
    gateway
        .recorder
        .play(replay, &gateway.world, &gateway.commander);
    Ok(Answer::Value(format!("{opening}{text}").into()))
}
