//! Checkpoints in files of the data folder.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use launch_cli::file_in;
use simd_world::{Checkpoint, World};

/// Longest checkpoint files that are read for one request, bytes together. This is far above what
/// all actors need.
pub const MAX_CHECKPOINT_BYTES: u64 = 1 << 30;
/// Ending of checkpoint files.
const KIND: &str = "gckp";

/// Where checkpoint files lie.
#[derive(Clone, Debug)]
pub struct Folder(PathBuf);

impl Folder {
    /// The data folder's `checkpoints`.
    pub fn of(data_folder: &Path) -> Folder {
        Folder(data_folder.join("checkpoints"))
    }

    /// Path of a file in it.
    ///
    /// # Errors
    /// If the name is none of a file in this folder.
    pub fn file(&self, name: &str) -> anyhow::Result<PathBuf> {
        Ok(file_in(&self.0, name, KIND)?)
    }
}

/// Writes a checkpoint to a file, which is on the disk once this returns.
///
/// # Errors
/// If it cannot be written; what was there before is then as it was.
pub fn write(path: &Path, checkpoint: &Checkpoint) -> anyhow::Result<()> {
    let folder = path.parent().expect("files lie in a folder");
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    launch_cli::files::replace(path, &checkpoint.to_bytes()?)
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Checkpoint files that can be read.
#[derive(Debug)]
pub struct CheckpointFiles {
    folder: Folder,
    /// Files of a journal by name, in place of those in the folder.
    provided: BTreeMap<String, Vec<u8>>,
}

impl CheckpointFiles {
    /// Those of a folder.
    pub fn new(folder: Folder) -> CheckpointFiles {
        CheckpointFiles {
            folder,
            provided: BTreeMap::new(),
        }
    }

    /// Takes a file of a journal, which is found once in place of the one in the folder.
    pub fn provide(&mut self, name: String, bytes: Vec<u8>) {
        self.provided.insert(name, bytes);
    }

    /// A checkpoint of at most `max_bytes` with the bytes of its file. It is read with the
    /// catalogue and the map of `living`.
    ///
    /// # Errors
    /// If there is none, or it cannot be used.
    pub fn read(
        &mut self,
        name: &str,
        max_bytes: u64,
        living: &World,
    ) -> anyhow::Result<(Checkpoint, Vec<u8>)> {
        let path = self.folder.file(name)?;
        let bytes = match self.provided.remove(name) {
            Some(bytes) => bytes,
            None => launch_cli::files::read_plain(&path, max_bytes)
                .with_context(|| format!("cannot read {}", path.display()))?,
        };
        let checkpoint = Checkpoint::from_bytes(&bytes, living)
            .with_context(|| format!("cannot restore {}", path.display()))?;
        Ok((checkpoint, bytes))
    }
}
