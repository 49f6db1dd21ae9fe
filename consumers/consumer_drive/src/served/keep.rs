//! A file with what clients have set, from which a process that takes over after a kill goes on
//! driving the same vehicles in the same way. An orderly end removes it.

use std::io::Write as _;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use launch_cli::files::{MAX_NOTES_BYTES, read_plain};

use crate::desk::{Desk, Memory};

/// Time between two writes of settings, so that scripts that set something in every tick cost little.
/// Who is driven is written at once.
const WRITE_EVERY: Duration = Duration::from_millis(50);

/// The file of one served port.
#[derive(Debug)]
pub(super) struct Record {
    path: Option<PathBuf>,
    /// What a killed process left.
    left: Option<Memory>,
    is_stale: bool,
    /// When it was last written, and which registrations it has.
    written: Option<(Instant, u64)>,
}

impl Record {
    /// The record of `port` on `domain`, with what a killed process left.
    pub fn new(domain: &str, port: u16) -> Record {
        let path = folder().map(|folder| folder.join(format!("{domain}-{port}.json")));
        let text = path
            .as_ref()
            .and_then(|path| read_plain(path, MAX_NOTES_BYTES).ok());
        Record {
            left: text.and_then(|text| serde_json::from_slice(&text).ok()),
            path,
            is_stale: false,
            written: None,
        }
    }

    /// Goes on where a killed process of this episode was.
    pub fn recall(&mut self, desk: &mut Desk) {
        let Some(memory) = self.left.take() else {
            return;
        };
        if desk.episode() == Some((memory.epoch, memory.episode)) {
            tracing::info!(
                vehicles = memory.n_registered(),
                "goes on with what clients set before this process was killed"
            );
            desk.recall(memory);
        } else {
            self.remove();
        }
    }

    /// Writes what has changed.
    pub fn keep(&mut self, desk: &Desk, has_changed: bool) {
        self.is_stale |= has_changed;
        let is_due = self.written.is_none_or(|(at, registrations)| {
            registrations != desk.revision() || at.elapsed() >= WRITE_EVERY
        });
        let (true, true, Some(path)) = (self.is_stale, is_due, &self.path) else {
            return;
        };
        let Some(memory) = desk.memory() else { return };
        if let Err(error) = write(path, &memory) {
            tracing::warn!(path = %path.display(), %error, "cannot keep what clients set");
            self.path = None;
        }
        (self.is_stale, self.written) = (false, Some((Instant::now(), desk.revision())));
    }

    /// Removes the file.
    pub fn remove(&self) {
        if let Some(path) = &self.path {
            let _ = std::fs::remove_file(path);
        }
    }
}

/// Replaces the file as a whole: a kill while writing leaves the former one.
fn write(path: &Path, memory: &Memory) -> std::io::Result<()> {
    let next = path.with_extension("next");
    let mut file = std::fs::OpenOptions::new()
        .write(true)
        .create(true)
        .truncate(true)
        .mode(0o600)
        .open(&next)?;
    file.write_all(&serde_json::to_vec(memory)?)?;
    std::fs::rename(next, path)
}

/// A folder for temporary files that only this user can read or write; `None` if it is somebody
/// else's.
fn folder() -> Option<PathBuf> {
    let ours = std::fs::metadata("/proc/self").ok()?.uid();
    let folder = std::env::temp_dir().join(format!("gantry-drive-{ours}"));
    let made = std::fs::DirBuilder::new()
        .recursive(true)
        .mode(0o700)
        .create(&folder);
    let found = std::fs::symlink_metadata(&folder).ok()?;
    let is_ours = found.is_dir() && found.uid() == ours && found.mode() & 0o077 == 0;
    (made.is_ok() && is_ours).then_some(folder)
}
