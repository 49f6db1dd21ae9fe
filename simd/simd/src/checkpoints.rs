//! Checkpoints: named ones in memory, files in the data folder, and the start of the episode for
//! `reset`.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Context as _, bail, ensure};
use launch_cli::file_in;
use schema_frames::command::CheckpointPlace;
use schema_frames::{CommandReply, StepMode};
use schema_types::SimTime;
use simd_world::Checkpoint;

use crate::daemon::Daemon;
use crate::pace::Pace;

/// Named checkpoints in memory.
const MAX_NAMED: usize = 64;
/// Longest name, bytes.
const MAX_NAME: usize = 100;
/// Largest file that is read: far above what 4096 actors need.
const MAX_FILE_BYTES: u64 = 1 << 30;
/// Ending of checkpoint files.
const KIND: &str = "gckp";

/// What the daemon can go back to.
#[derive(Default)]
pub struct Checkpoints {
    named: BTreeMap<String, Checkpoint>,
    start: Option<Checkpoint>,
    /// Whether the next snapshot is the first after going back.
    pub just_restored: bool,
}

impl Checkpoints {
    /// A new episode: nothing of the old one can be restored.
    pub fn begin_episode(&mut self, start: Checkpoint) {
        self.named.clear();
        self.start = Some(start);
    }
}

impl Daemon {
    /// Keeps the world as it is now as the start of the episode.
    pub(crate) fn mark_start(&mut self) {
        let start = self.world.checkpoint(0);
        self.checkpoints.begin_episode(start);
    }

    pub(crate) fn save_checkpoint(&mut self, to: &CheckpointPlace) -> anyhow::Result<CommandReply> {
        let elapsed_nanos = self
            .clock
            .time_of(self.tick)
            .0
            .saturating_sub(self.episode.start.0);
        let checkpoint = self.world.checkpoint(elapsed_nanos);
        let path = match to {
            CheckpointPlace::Name(name) => {
                ensure!(
                    (1..=MAX_NAME).contains(&name.len()),
                    "name is {name:?}, but must have 1 to {MAX_NAME} bytes"
                );
                let named = &mut self.checkpoints.named;
                ensure!(
                    named.len() < MAX_NAMED || named.contains_key(name),
                    "{MAX_NAMED} checkpoints are in memory already, which is the most; save over one of them, or to a file"
                );
                named.insert(name.clone(), checkpoint);
                String::new()
            }
            CheckpointPlace::File(name) => {
                let path = self.checkpoint_file(name)?;
                let folder = path.parent().expect("files lie in a folder");
                std::fs::create_dir_all(folder)
                    .with_context(|| format!("cannot make the folder {}", folder.display()))?;
                // Whole or not at all: a half-written file would be found damaged much later.
                let part = path.with_extension("part");
                std::fs::write(&part, checkpoint.to_bytes()?)
                    .with_context(|| format!("cannot write {}", part.display()))?;
                std::fs::rename(&part, &path)
                    .with_context(|| format!("cannot write {}", path.display()))?;
                path.display().to_string()
            }
        };
        Ok(CommandReply::Saved { path })
    }

    pub(crate) fn restore_checkpoint(
        &mut self,
        from: &CheckpointPlace,
    ) -> anyhow::Result<CommandReply> {
        let checkpoint = match from {
            CheckpointPlace::Name(name) => match self.checkpoints.named.get(name) {
                Some(checkpoint) => checkpoint.clone(),
                None => {
                    let names: Vec<&str> =
                        self.checkpoints.named.keys().map(String::as_str).collect();
                    bail!(
                        "there is no checkpoint {name:?} in memory, only [{}]; a new map forgets them",
                        names.join(", ")
                    )
                }
            },
            CheckpointPlace::File(name) => {
                let path = self.checkpoint_file(name)?;
                let length = std::fs::metadata(&path)
                    .with_context(|| format!("cannot read {}", path.display()))?
                    .len();
                ensure!(
                    length <= MAX_FILE_BYTES,
                    "{} has {length} bytes, at most {MAX_FILE_BYTES} are read",
                    path.display()
                );
                let bytes = std::fs::read(&path)
                    .with_context(|| format!("cannot read {}", path.display()))?;
                Checkpoint::from_bytes(&bytes, &self.world)
                    .with_context(|| format!("cannot restore {}", path.display()))?
            }
        };
        self.go_back(&checkpoint)
    }

    pub(crate) fn reset(&mut self) -> anyhow::Result<CommandReply> {
        let start = self
            .checkpoints
            .start
            .clone()
            .context("there is no start to go back to")?;
        self.go_back(&start)
    }

    /// The tick goes on; the episode's time is the checkpoint's. If that is longer than the daemon
    /// has run, simulated time leaps ahead.
    fn go_back(&mut self, checkpoint: &Checkpoint) -> anyhow::Result<CommandReply> {
        self.sensors.finish_all()?;
        let gone = self.world.restore(checkpoint)?;
        self.sensors.remove(|sensor| gone.contains(&sensor.actor))?;
        self.sensors
            .sensors
            .iter_mut()
            .for_each(crate::rig::Sensor::forget);
        let SimTime(now_nanos) = self.clock.time_of(self.tick);
        if now_nanos < checkpoint.elapsed_nanos() {
            self.clock
                .leap(self.tick, SimTime(checkpoint.elapsed_nanos()));
        }
        self.episode.start = SimTime(self.clock.time_of(self.tick).0 - checkpoint.elapsed_nanos());
        self.checkpoints.just_restored = true;
        if self.gate.mode() == StepMode::FreeRunning {
            self.pace = Pace::new(schema_bus::mono_now().0, self.clock.period_nanos());
        }
        self.ports.documents.touch_info();
        Ok(CommandReply::Restored {
            gone: gone.into_iter().map(|actor| actor.0).collect(),
        })
    }

    fn checkpoint_file(&self, name: &str) -> anyhow::Result<PathBuf> {
        let folder = launch_cli::data_dir(self.args.data.as_deref())?.join("checkpoints");
        file_in(&folder, name, KIND).map_err(anyhow::Error::msg)
    }
}
