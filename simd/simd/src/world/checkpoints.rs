//! Checkpoints: named ones in memory, files in the data folder, and the start of the episode for
//! `reset`.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use launch_cli::file_in;
use schema_frames::command::CheckpointPlace;
use simd_world::{Checkpoint, World};

/// Most checkpoints in memory.
const MAX_NAMED: usize = 64;
/// Longest name, bytes.
const MAX_NAME: usize = 100;
/// Largest checkpoint file that is read, bytes. This is far above what all actors need.
pub const MAX_CHECKPOINT_BYTES: u64 = 1 << 30;
/// Ending of checkpoint files.
const KIND: &str = "gckp";

/// The checkpoints that can be restored.
pub struct Checkpoints {
    folder: PathBuf,
    named: BTreeMap<String, Checkpoint>,
    /// Files of a journal by name, in place of those in the folder.
    provided: BTreeMap<String, Vec<u8>>,
    start: Option<Checkpoint>,
}

impl Checkpoints {
    /// None yet. Files lie in the data folder's `checkpoints`.
    pub fn new(data_folder: &Path) -> Checkpoints {
        Checkpoints {
            folder: data_folder.join("checkpoints"),
            named: BTreeMap::new(),
            provided: BTreeMap::new(),
            start: None,
        }
    }

    /// Keeps the start of a new episode. Checkpoints in memory belong to the old one and are dropped.
    pub fn begin_episode(&mut self, start: Checkpoint) {
        self.named.clear();
        self.start = Some(start);
    }

    /// The start of the episode.
    pub fn start(&self) -> anyhow::Result<Checkpoint> {
        self.start
            .clone()
            .context("there is no start to go back to")
    }

    /// Keeps a checkpoint; returns the file it went to, if it went to one.
    pub fn save(
        &mut self,
        to: &CheckpointPlace,
        checkpoint: Checkpoint,
    ) -> anyhow::Result<Option<PathBuf>> {
        match to {
            CheckpointPlace::Name(name) => {
                ensure!(
                    (1..=MAX_NAME).contains(&name.len()),
                    "name is {name:?}, but must have 1 to {MAX_NAME} bytes"
                );
                let named = &mut self.named;
                ensure!(
                    named.len() < MAX_NAMED || named.contains_key(name),
                    "{MAX_NAMED} checkpoints are in memory already, which is the most; save over one of them, or to a file"
                );
                named.insert(name.clone(), checkpoint);
                Ok(None)
            }
            CheckpointPlace::File(name) => {
                let path = self.file(name)?;
                let folder = path.parent().expect("files lie in a folder");
                std::fs::create_dir_all(folder)
                    .with_context(|| format!("cannot make the folder {}", folder.display()))?;
                launch_cli::files::replace(&path, &checkpoint.to_bytes()?)
                    .with_context(|| format!("cannot write {}", path.display()))?;
                Ok(Some(path))
            }
        }
    }

    /// Takes a file of a journal, which is found once in place of the one in the folder.
    pub fn provide(&mut self, name: String, bytes: Vec<u8>) {
        self.provided.insert(name, bytes);
    }

    /// A checkpoint that was saved, and its file's bytes if it was in one; `world` knows the
    /// catalogue that a file is read with.
    pub fn find(
        &mut self,
        from: &CheckpointPlace,
        world: &World,
    ) -> anyhow::Result<(Checkpoint, Option<Vec<u8>>)> {
        match from {
            CheckpointPlace::Name(name) => match self.named.get(name) {
                Some(checkpoint) => Ok((checkpoint.clone(), None)),
                None => {
                    let names: Vec<&str> = self.named.keys().map(String::as_str).collect();
                    bail!(
                        "there is no checkpoint {name:?} in memory, only [{}]; a new map forgets them",
                        names.join(", ")
                    )
                }
            },
            CheckpointPlace::File(name) => {
                let path = self.file(name)?;
                let read = |bytes: Vec<u8>| {
                    let checkpoint = Checkpoint::from_bytes(&bytes, world)
                        .with_context(|| format!("cannot restore {}", path.display()))?;
                    Ok((checkpoint, Some(bytes)))
                };
                if let Some(bytes) = self.provided.remove(name) {
                    return read(bytes);
                }
                let bytes = launch_cli::files::read_plain(&path, MAX_CHECKPOINT_BYTES)
                    .with_context(|| format!("cannot read {}", path.display()))?;
                read(bytes)
            }
        }
    }

    fn file(&self, name: &str) -> anyhow::Result<PathBuf> {
        Ok(file_in(&self.folder, name, KIND)?)
    }
}
