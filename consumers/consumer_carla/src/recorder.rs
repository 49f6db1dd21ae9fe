//! CARLA's recorder: writes what snapshots show into a file in the data folder, reports about such
//! files, and replays them.
//!
//! It works with a consumer's means only: it records what it reads on the bus, and it replays by
//! commands that move actors. `docs/carla-recorder.md` describes the files: those that it writes,
//! and CARLA's own, which it reads.

mod carla_file;
mod carla_packets;
pub mod changes;
mod counterparts;
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

use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock};

use launch_cli::{data_dir, file_in};
use schema_frames::scenery::LampChange;

use crate::lock::lock;
use crate::state::commander::Commander;
use crate::state::known_world::World;
use changes::Changes;
use replay::{Replay, Settings};
use writer::{WriteError, Writer};

/// File ending of recordings.
const KIND: &str = "log";

/// The recorder and the replayer of a gateway.
#[derive(Debug, Default)]
pub struct Recorder {
    state: Mutex<State>,
    data: OnceLock<PathBuf>,
}

#[derive(Debug)]
struct State {
    writer: Option<Writer>,
    replay: Option<Replay>,
    settings: Settings,
}

impl Default for State {
    fn default() -> Self {
        State {
            writer: None,
            replay: None,
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

fn no_link(path: PathBuf) -> Result<PathBuf, String> {
    if path.is_symlink() {
        let name = path.file_name().unwrap_or_default();
        return Err(format!(
            "{name:?} is a link; recordings are only read and written in their folder itself"
        ));
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
    pub fn path(&self, name: &str) -> Result<PathBuf, String> {
        let data =
            data_dir(self.data.get().map(PathBuf::as_path)).map_err(|error| error.to_string())?;
        let path = file_in(&data.join("recordings").join("carla"), plain(name), KIND)
            .map_err(|error| error.to_string())?;
        no_link(path)
    }

    /// The file of a recording that is to be read: that of [`Recorder::path`], or else one that has
    /// the very name, as scripts also call recordings of CARLA `x.rec`.
    ///
    /// # Errors
    /// As [`Recorder::path`].
    pub fn existing(&self, name: &str) -> Result<PathBuf, String> {
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
        let mut state = lock(&self.state);
        state.writer = None;
        state.writer = Some(Writer::create(path, map, with_motion)?);
        Ok(())
    }

    /// Notes that a vehicle's physics control was set.
    pub fn note_physics(&self, actor_id: u32) {
        if let Some(writer) = &mut lock(&self.state).writer {
            writer.note_physics(actor_id);
        }
    }

    /// Notes that street lights were set.
    pub fn note_street_lights(&self, changes: &[LampChange]) {
        if let Some(writer) = &mut lock(&self.state).writer {
            writer.note_street_lights(changes);
        }
    }

    /// Ends the recording.
    pub fn stop(&self) {
        lock(&self.state).writer = None;
    }

    /// Changes the settings of replays, including the running one.
    pub fn set(&self, change: impl FnOnce(&mut Settings)) {
        let mut state = lock(&self.state);
        change(&mut state.settings);
        let settings = state.settings;
        if let Some(replay) = &mut state.replay {
            replay.settings = settings;
        }
    }

    /// The settings for a replay that begins.
    pub fn settings(&self) -> Settings {
        lock(&self.state).settings
    }

    /// Starts a replay in place of a running one. The next tick shows its first moment.
    pub fn play(&self, mut replay: Replay, world: &World, commander: &Commander) {
        let mut state = lock(&self.state);
        // The old replay ends first; otherwise it would release actors that the new one holds.
        if let Some(before) = state.replay.take() {
            before.end(commander, true);
        }
        let snapshot = world.known().snapshot.clone();
        if let Some(snapshot) = snapshot {
            replay.step(&snapshot, commander);
        }
        state.replay = Some(replay);
    }

    /// Ends the replay.
    pub fn stop_replay(&self, keep_actors: bool, commander: &Commander) {
        let replay = lock(&self.state).replay.take();
        if let Some(replay) = replay {
            replay.end(commander, keep_actors);
        }
    }

    /// Records and replays one tick. It runs before clients see the snapshot, so that the tick that
    /// they cue next finds the replay's actors in place.
    pub fn step(&self, world: &World, commander: &Commander) {
        let mut state = lock(&self.state);
        if state.writer.is_none() && state.replay.is_none() {
            return;
        }
        let snapshot = world.known().snapshot.clone();
        let Some(snapshot) = snapshot else { return };
        let mut changes = Changes::default();
        if let Some(writer) = &mut state.writer {
            // Asked before the world is locked: the thread that answers looks at the world, too.
            writer.wanted(&snapshot).ask(commander, &mut changes);
        }
        let failed = state
            .writer
            .as_mut()
            .and_then(|writer| writer.write(&snapshot, &world.known(), changes).err());
        if let Some(error) = failed {
            tracing::warn!(%error, "the recording ends here");
            state.writer = None;
        }
        if let Some(replay) = &mut state.replay
            && !replay.step(&snapshot, commander)
            && let Some(replay) = state.replay.take()
        {
            replay.end(commander, true);
        }
    }
}
