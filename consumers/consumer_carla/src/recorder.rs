//! CARLA's recorder: writes what snapshots show into a file in the data folder, reports about such
//! files, and replays them.
//!
//! It works with a consumer's means only: it records what it reads on the bus, and it replays by
//! commands that move actors. `docs/reference/carla-recorder.md` describes the files: those that it writes,
//! and CARLA's own, which it reads.

mod carla_file;
mod carla_packets;
pub mod changes;
mod counterparts;
pub mod disk;
pub mod extra;
pub mod file;
pub mod frame;
mod motion;
pub mod own_file;
mod playback;
pub mod read_error;
pub mod replay;
mod replay_changes;
pub mod report;
mod report_details;
mod text;
pub mod watch;
pub mod writer;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use consumer_kit::WorldAt;
use launch_cli::{BadFileName, data_dir, file_in};
use parking_lot::Mutex;
use schema_frames::scenery::LampChange;

use crate::state::commander::Commander;
use crate::state::known_world::World;
use replay::{Replay, Settings};
use writer::{WriteError, Writer};

/// File ending of recordings.
const KIND: &str = "log";

/// The recorder and the replayer of a gateway.
///
/// The world's thread passes here with every snapshot before clients see it, so nobody holds `state`
/// while waiting for a disk or for the simulator.
#[derive(Debug, Default)]
pub struct Recorder {
    state: Mutex<State>,
    /// Held while a replay takes a step in the world's thread, and by others only to put a replay in
    /// or take it out; locked before `state`.
    replay: Mutex<Option<Replay>>,
    /// Held while a client begins or ends a replay, so that two of them do it one after the other.
    changes: Mutex<()>,
    data: OnceLock<PathBuf>,
}

#[derive(Debug)]
struct State {
    writer: Option<Writer>,
    /// Recordings that ended by themselves and may still be written.
    ended: Vec<Writer>,
    settings: Settings,
}

impl Default for State {
    fn default() -> Self {
        State {
            writer: None,
            ended: Vec::new(),
            settings: Settings {
                time_factor: 1.0,
                ignore_hero: false,
                ignore_spectator: true,
            },
        }
    }
}

/// The last part of a path of either kind of system.
fn plain(name: &str) -> &str {
    name.rsplit(['/', '\\']).next().unwrap_or(name)
}

/// Why a name is not that of a recording.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NameError {
    /// There is no folder for recordings, for this reason.
    #[error("{0}")]
    Folder(String),
    /// It cannot be a file's.
    #[error(transparent)]
    File(#[from] BadFileName),
    /// The file is a link.
    #[error("{0:?} is a link; recordings are only read and written in their folder itself")]
    Link(OsString),
}

fn no_link(path: PathBuf) -> Result<PathBuf, NameError> {
    if path.is_symlink() {
        let name = path.file_name().unwrap_or_default();
        return Err(NameError::Link(name.to_owned()));
    }
    Ok(path)
}

impl Recorder {
    /// Sets the data folder that recordings are kept in, instead of the user's.
    pub fn keep_in(&self, data: PathBuf) {
        // Set once, at start-up.
        let _ = self.data.set(data);
    }

    /// The file that a recording of this name is written to. Only the last part of a path counts, so
    /// that scripts' `/tmp/x.log` works and stays in the folder.
    ///
    /// # Errors
    /// If the name cannot be a file's.
    pub fn path(&self, name: &str) -> Result<PathBuf, NameError> {
        let data = data_dir(self.data.get().map(PathBuf::as_path))
            .map_err(|error| NameError::Folder(error.to_string()))?;
        let folder = data.join("recordings").join("carla");
        no_link(file_in(&folder, plain(name), KIND)?)
    }

    /// The file of a recording that is to be read: that of [`Recorder::path`], or else one that has
    /// the very name, as scripts also call recordings of CARLA `x.rec`.
    ///
    /// # Errors
    /// As [`Recorder::path`].
    pub fn existing(&self, name: &str) -> Result<PathBuf, NameError> {
        self.catch_up();
        let path = self.path(name)?;
        let same = path.with_file_name(plain(name));
        if !path.exists() && same.exists() {
            return no_link(same);
        }
        Ok(path)
    }

    /// Starts a recording on this map; a running one is finished first.
    ///
    /// # Errors
    /// If the file cannot be made.
    pub fn start(&self, path: &Path, map: String, with_motion: bool) -> Result<(), WriteError> {
        self.stop();
        let writer = Writer::create(path, map, with_motion)?;
        let before = self.state.lock().writer.replace(writer);
        finish(before);
        Ok(())
    }

    /// Notes that a vehicle's physics control was set.
    pub fn note_physics(&self, actor_id: u32) {
        if let Some(writer) = &mut self.state.lock().writer {
            writer.note_physics(actor_id);
        }
    }

    /// Notes that street lights were set.
    pub fn note_street_lights(&self, changes: &[LampChange]) {
        if let Some(writer) = &mut self.state.lock().writer {
            writer.note_street_lights(changes);
        }
    }

    /// Ends the recording, and waits until it is written.
    pub fn stop(&self) {
        let mut state = self.state.lock();
        let (writer, ended) = (state.writer.take(), std::mem::take(&mut state.ended));
        drop(state);
        finish(ended.into_iter().chain(writer));
    }

    /// Waits until what was recorded so far is written, for who reads the file of a recording that
    /// goes on.
    fn catch_up(&self) {
        let state = self.state.lock();
        let all: Vec<_> = state
            .ended
            .iter()
            .chain(&state.writer)
            .map(Writer::written)
            .collect();
        drop(state);
        // An end without a mark is that of a thread that has ended.
        for written in all {
            let _ = written.recv();
        }
    }

    /// Changes the settings of replays, including the running one.
    pub fn set(&self, change: impl FnOnce(&mut Settings)) {
        change(&mut self.state.lock().settings);
    }

    /// The settings for a replay that begins.
    pub fn settings(&self) -> Settings {
        self.state.lock().settings
    }

    /// Starts a replay in place of a running one. The next tick shows its first moment. Its actors
    /// are spawned without a lock that the world's thread needs.
    pub fn play(&self, mut replay: Replay, world: &World, commander: &Commander) {
        let _one_by_one = self.changes.lock();
        // The old replay ends first; otherwise it would release actors that the new one holds.
        let before = self.replay.lock().take();
        if let Some(before) = before {
            before.end(commander, true);
        }
        let snapshot = world.known().snapshot.clone();
        if let Some(snapshot) = snapshot {
            replay.step(&snapshot, commander);
        }
        *self.replay.lock() = Some(replay);
    }

    /// Ends the replay.
    pub fn stop_replay(&self, keep_actors: bool, commander: &Commander) {
        let _one_by_one = self.changes.lock();
        let replay = self.replay.lock().take();
        if let Some(replay) = replay {
            replay.end(commander, keep_actors);
        }
    }

    /// Records and replays one tick. It runs before clients see the snapshot, so that the tick that
    /// they cue next finds the replay's actors in place.
    pub fn step(&self, world: &World, commander: &Commander) {
        let snapshot = world.known().snapshot.clone();
        let Some(snapshot) = snapshot else { return };
        let settings = {
            let mut state = self.state.lock();
            state.record(&snapshot, world, commander);
            state.settings
        };
        let mut running = self.replay.lock();
        if let Some(replay) = &mut *running {
            replay.settings = settings;
            if !replay.step(&snapshot, commander)
                && let Some(replay) = running.take()
            {
                replay.end(commander, true);
            }
        }
    }
}

impl State {
    fn record(&mut self, snapshot: &Arc<WorldAt>, world: &World, commander: &Commander) {
        let Some(mut writer) = self.writer.take() else {
            return;
        };
        let asked = writer.wanted(snapshot).ask(commander);
        match writer.write(snapshot, &world.known(), asked) {
            Ok(()) => self.writer = Some(writer),
            // Its thread has ended, so finishing waits for nothing and says why.
            Err(WriteError::Ended) => finish([writer]),
            Err(error) => {
                tracing::warn!(%error, "the recording ends here");
                self.ended.push(writer);
            }
        }
    }
}

/// Waits until recordings are written, and says which could not be.
fn finish(writers: impl IntoIterator<Item = Writer>) {
    for writer in writers {
        if let Err(error) = writer.finish() {
            tracing::warn!(%error, "the recording ends here");
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use schema_frames::{BodyBox, Catalogue, CatalogueEntry};

    use super::*;
    use crate::recorder::file::Recording;
    use crate::recorder::frame::{Born, Frame, Head, Origin};
    use crate::recorder::replay::Wish;
    use crate::state::commander::commander;
    use crate::wire::axes::Transform;
    use crate::wire::description::Description;

    const PROP: &str = "static.prop.box";

    /// A replay whose first moment spawns an actor.
    fn replay(world: &World) -> Replay {
        let head = Head {
            origin: Origin::Gantry,
            version: own_file::VERSION,
            map: "Town10HD".into(),
            date: String::new(),
        };
        let frame = Frame {
            number: 1,
            born: vec![Born {
                id: 7,
                parent: 0,
                family: 0,
                description: Description {
                    type_id: PROP.into(),
                    attributes: Vec::new(),
                },
                at: Transform::default(),
                on_parent: false,
            }],
            ..Frame::default()
        };
        let mut bytes = Vec::new();
        head.write(&mut bytes);
        frame.write(&mut bytes);
        let folder = std::env::temp_dir().join(format!("gantry-replay-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("one.log");
        std::fs::write(&path, bytes).unwrap();
        let recording = Recording::open(&path).unwrap();
        std::fs::remove_dir_all(folder).unwrap();
        let wish = Wish {
            start_secs: 0.0,
            duration_secs: 0.0,
            follow: 0,
            offset: Transform::default(),
            with_sensors: false,
        };
        let settings = Recorder::default().settings();
        let begun = Replay::begin(recording, wish, settings, &world.known().excerpt());
        begun.unwrap().0
    }

    /// Every client's stream waits for [`Recorder::step`].
    #[test]
    fn a_replay_that_spawns_its_actors_delays_no_snapshot() {
        let world = Arc::new(World::default());
        world.change(|known| {
            known.catalogue = Arc::new(Catalogue {
                entries: vec![CatalogueEntry {
                    type_id: PROP.into(),
                    kind: "prop".into(),
                    class: 0,
                    body_box: BodyBox {
                        centre_m: [0.0; 3],
                        half_m: [0.5; 3],
                    },
                    attributes: Default::default(),
                    recommended: Default::default(),
                }],
            });
            known.snapshot = Some(Arc::new(WorldAt {
                header: bytemuck::Zeroable::zeroed(),
                records: Vec::new(),
            }));
        });
        // Nobody answers until the queue's end is dropped.
        let (commander, work) = commander();
        let recorder = Arc::new(Recorder::default());
        let playing = {
            let (recorder, world, commander) = (recorder.clone(), world.clone(), commander.clone());
            std::thread::spawn(move || recorder.play(replay(&world), &world, &commander))
        };
        let until = Instant::now() + Duration::from_secs(60);
        while work.n_waiting() == 0 {
            assert!(Instant::now() < until, "the replay asked for nothing");
            std::thread::sleep(Duration::from_millis(1));
        }
        let (passed, has_passed) = std::sync::mpsc::channel();
        let steps = (recorder.clone(), world.clone(), commander.clone());
        std::thread::spawn(move || {
            let (recorder, world, commander) = steps;
            recorder.step(&world, &commander);
            passed.send(()).unwrap();
        });
        let passed = has_passed.recv_timeout(Duration::from_secs(60));
        assert!(passed.is_ok(), "the snapshot waits for the simulator");
        drop(work);
        playing.join().unwrap();
    }
}
