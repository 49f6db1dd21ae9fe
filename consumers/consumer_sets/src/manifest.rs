//! The manifest of an export: what it is made from, with which options, and how far it is.

use std::fs;
use std::path::Path;

use anyhow::Context as _;
use launch_cli::files::{MAX_NOTES_BYTES, read_text};
use launch_cli::wrong_usage;
use serde::{Deserialize, Serialize};

use crate::exporter::DoneScenario;
use crate::options::Options;
use crate::tree::STATE_FOLDER;

/// Name of the manifest of a complete export, in its folder.
pub const MANIFEST: &str = "gantry-export.json";

/// What an export is made from and how far it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of the program that wrote it.
    pub version: String,
    /// The options.
    pub options: Options,
    /// The recordings.
    pub recordings: Vec<Recording>,
    /// Scenarios that are done, in order.
    pub done: Vec<DoneScenario>,
}

/// One recording.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Recording {
    /// Scenario that it became.
    pub scenario: String,
    /// Part of the set.
    pub split: String,
    /// Bytes of the file.
    pub file_bytes: u64,
    /// Simulated time of its first message, nanoseconds.
    pub start_nanos: u64,
    /// Simulated time of its last message, nanoseconds.
    pub end_nanos: u64,
    /// Epoch of the simulator that it shows.
    pub epoch: String,
}

/// What a folder is to an export that is about to begin.
#[derive(Clone, Debug, PartialEq)]
pub enum Found {
    /// Empty, or not there.
    Fresh,
    /// An export of the same that was stopped.
    Unfinished(Manifest),
    /// The same export, complete.
    Complete(Manifest),
}

impl Manifest {
    /// Looks what is in `out`.
    ///
    /// # Errors
    /// [`wrong_usage`] if the folder holds anything and `resume` is not set, or holds something else
    /// than a stopped export of the same recordings with the same options.
    pub fn look(&self, out: &Path, resume: bool) -> anyhow::Result<Found> {
        let shown = out.display();
        if out.exists() && !out.is_dir() {
            return Err(wrong_usage(format!(
                "{shown} is a file; --out needs a folder"
            )));
        }
        // A folder that holds nothing but recordings of launch files is as good as empty.
        let is_state = |entry: &fs::DirEntry| {
            entry.file_name() == STATE_FOLDER && !entry.path().join(MANIFEST).exists()
        };
        let is_empty = match fs::read_dir(out) {
            Ok(entries) => entries.flatten().all(|entry| is_state(&entry)),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => true,
            Err(error) => return Err(error).with_context(|| format!("cannot read {shown}")),
        };
        if is_empty {
            return Ok(Found::Fresh);
        }
        if !resume {
            return Err(wrong_usage(format!(
                "{shown} is not empty; give another --out, remove it, or go on with --resume if an export was stopped there"
            )));
        }
        let (path, complete) = [(out.join(MANIFEST), true), (out.join(STATE_FOLDER).join(MANIFEST), false)]
            .into_iter()
            .find(|(path, _)| path.exists())
            .ok_or_else(|| {
                wrong_usage(format!("{shown} is not empty and holds no export that was stopped, so --resume cannot go on there"))
            })?;
        let text = read_text(&path, MAX_NOTES_BYTES)
            .with_context(|| format!("cannot read {}", path.display()))?;
        let found: Manifest = serde_json::from_str(&text).map_err(|error| {
            wrong_usage(format!(
                "{} is no manifest of an export: {error}",
                path.display()
            ))
        })?;
        if let Some(difference) = self.difference(&found) {
            return Err(wrong_usage(format!(
                "the export in {shown} was begun with {difference}; give the same to go on, or another --out"
            )));
        }
        Ok(if complete {
            Found::Complete(found)
        } else {
            Found::Unfinished(found)
        })
    }

    /// What differs in `other`, in words.
    fn difference(&self, other: &Manifest) -> Option<String> {
        if self.version != other.version {
            return Some(format!(
                "version {} of gantry-export, this is {}",
                other.version, self.version
            ));
        }
        let as_map = |options: &Options| {
            serde_json::to_value(options)
                .ok()
                .and_then(|value| value.as_object().cloned())
                .unwrap_or_default()
        };
        let (own, others) = (as_map(&self.options), as_map(&other.options));
        if let Some((key, value)) = others
            .iter()
            .find(|(key, value)| own.get(*key) != Some(value))
        {
            return Some(format!("{key} = {value}"));
        }
        if self.recordings.len() != other.recordings.len() {
            return Some(format!("{} recordings", other.recordings.len()));
        }
        let pairs = self.recordings.iter().zip(&other.recordings);
        pairs
            .filter(|(own, other)| own != other)
            .map(|(own, other)| {
                format!(
                    "another recording {:?} ({} bytes; now it is {:?} with {} bytes)",
                    other.scenario, other.file_bytes, own.scenario, own.file_bytes
                )
            })
            .next()
    }

    /// Writes it into the folder of an export that goes on. It is replaced at once or not at all.
    ///
    /// # Errors
    /// A sentence with the path.
    pub fn save(&self, out: &Path) -> anyhow::Result<()> {
        let folder = out.join(STATE_FOLDER);
        fs::create_dir_all(&folder)
            .with_context(|| format!("cannot write {}", folder.display()))?;
        replace(&folder.join(MANIFEST), &self.text())
    }

    /// The export is complete: writes it beside the data and removes the state.
    ///
    /// # Errors
    /// A sentence with the path.
    pub fn complete(&self, out: &Path) -> anyhow::Result<()> {
        // What the manifest counts is on the disk before it: names of files, too.
        fs::File::open(out)
            .and_then(|folder| Ok(nix::unistd::syncfs(&folder)?))
            .with_context(|| format!("cannot write {} to disk", out.display()))?;
        replace(&out.join(MANIFEST), &self.text())?;
        let folder = out.join(STATE_FOLDER);
        fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))
    }

    fn text(&self) -> String {
        let text = serde_json::to_string_pretty(self).expect("a manifest is plain data");
        text + "\n"
    }
}

fn replace(path: &Path, text: &str) -> anyhow::Result<()> {
    launch_cli::files::replace(path, text.as_bytes())
        .with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exporter::Format;

    fn manifest(every: u64) -> Manifest {
        let mut options = Options::new(Format::Coco, Default::default());
        options.every = every;
        Manifest {
            version: "1".into(),
            options,
            recordings: vec![],
            done: vec![],
        }
    }

    #[test]
    fn a_folder_with_anything_in_it_is_refused_and_a_stopped_export_goes_on() {
        let folder = tempfile::tempdir().expect("a folder");
        let out = folder.path().join("set");
        assert_eq!(
            manifest(1).look(&out, false).expect("nothing there"),
            Found::Fresh
        );
        manifest(1).save(&out).expect("room");
        let error = manifest(1)
            .look(&out, false)
            .expect_err("not empty")
            .to_string();
        assert!(error.contains("--resume"), "{error}");
        assert_eq!(
            manifest(1).look(&out, true).expect("the same"),
            Found::Unfinished(manifest(1))
        );
        let error = manifest(2)
            .look(&out, true)
            .expect_err("another")
            .to_string();
        assert!(error.contains("every = 1"), "{error}");
        manifest(1).complete(&out).expect("room");
        assert!(!out.join(STATE_FOLDER).exists());
        assert_eq!(
            manifest(1).look(&out, true).expect("done"),
            Found::Complete(manifest(1))
        );
    }
}
