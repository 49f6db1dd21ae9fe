//! `manifest.json`: every file of a set with its size and hash, so that two sets can be compared and
//! a copy can be checked.

use std::collections::BTreeMap;
use std::fs;
use std::io::Read as _;
use std::path::Path;

use anyhow::Context as _;
use launch_cli::files::{MAX_NOTES_BYTES, open_plain, read_text};
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use crate::state::RECIPE;

/// Its name.
pub const MANIFEST: &str = "manifest.json";

/// The files of a set.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of the program that made the set.
    pub version: String,
    /// By path with `/` between folders.
    pub files: BTreeMap<String, Entry>,
}

/// A file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Entry {
    /// Its bytes.
    pub bytes: u64,
    /// SHA-256, hexadecimal.
    pub sha256: String,
}

/// How a set differs from its manifest.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Difference {
    /// Files that are not there.
    pub missing: Vec<String>,
    /// Files with other bytes.
    pub changed: Vec<String>,
    /// Files that are not in the manifest.
    pub new: Vec<String>,
}

impl Difference {
    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.missing.is_empty() && self.changed.is_empty() && self.new.is_empty()
    }
}

/// Whether a file is the same whenever a set is made again. Recordings hold the times at which they
/// were made, the exports' own manifests say from which recordings they come, and the plan where its
/// files lie on this machine.
fn is_hashed(path: &str) -> bool {
    let name = path.rsplit('/').next().unwrap_or(path);
    let hidden = path.split('/').any(|part| part.starts_with('.'));
    let is_own = [MANIFEST, RECIPE].contains(&path) || name == consumer_sets::manifest::MANIFEST;
    !hidden && !is_own && !path.starts_with("recordings/") && !path.starts_with("logs/")
}

/// Hashes every file of a set.
///
/// # Errors
/// If a file cannot be read.
pub fn hash_set(folder: &Path) -> anyhow::Result<Manifest> {
    let mut paths = Vec::new();
    walk(folder, "", &mut paths)?;
    let mut files = BTreeMap::new();
    for path in paths.into_iter().filter(|path| is_hashed(path)) {
        let entry = hash_file(&folder.join(&path))?;
        files.insert(path, entry);
    }
    Ok(Manifest {
        version: env!("CARGO_PKG_VERSION").into(),
        files,
    })
}

/// Compares a set with its manifest.
///
/// # Errors
/// If the manifest or a file cannot be read.
pub fn verify(folder: &Path) -> anyhow::Result<(Manifest, Difference)> {
    let path = folder.join(MANIFEST);
    let text = read_text(&path, MAX_NOTES_BYTES).map_err(|error| {
        launch_cli::wrong_usage(format!(
            "cannot read {}: {error}; a finished set has one",
            path.display()
        ))
    })?;
    let wanted: Manifest = serde_json::from_str(&text).map_err(|error| {
        launch_cli::wrong_usage(format!(
            "{} is no manifest of a set: {error}",
            path.display()
        ))
    })?;
    let found = hash_set(folder)?;
    let mut difference = Difference::default();
    for (path, entry) in &wanted.files {
        match found.files.get(path) {
            None => difference.missing.push(path.clone()),
            Some(other) if other != entry => difference.changed.push(path.clone()),
            Some(_) => {}
        }
    }
    let is_new = |path: &&String| !wanted.files.contains_key(*path);
    difference.new = found.files.keys().filter(is_new).cloned().collect();
    Ok((wanted, difference))
}

fn walk(root: &Path, below: &str, paths: &mut Vec<String>) -> anyhow::Result<()> {
    let folder = root.join(below);
    let entries =
        fs::read_dir(&folder).with_context(|| format!("cannot read {}", folder.display()))?;
    for entry in entries {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let path = if below.is_empty() {
            name
        } else {
            format!("{below}/{name}")
        };
        if entry.file_type()?.is_dir() {
            walk(root, &path, paths)?;
        } else {
            paths.push(path);
        }
    }
    Ok(())
}

fn hash_file(path: &Path) -> anyhow::Result<Entry> {
    let cannot = || format!("cannot read {}", path.display());
    let (mut file, _) = open_plain(path).with_context(cannot)?;
    let mut hasher = Sha256::new();
    let mut buffer = vec![0; 1 << 18];
    let mut bytes = 0;
    loop {
        let n = file.read(&mut buffer).with_context(cannot)?;
        if n == 0 {
            break;
        }
        bytes += n as u64;
        hasher.update(&buffer[..n]);
    }
    let sha256 = hasher
        .finalize()
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect();
    Ok(Entry { bytes, sha256 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_went_changed_or_came_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let write = |path: &str, text: &str| {
            let path = folder.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        for path in ["kitti/a", "kitti/b", "c"] {
            write(path, "abc");
        }
        write("recordings/x.mcap", "left out");
        write("kitti/gantry-export.json", "left out");
        let manifest = hash_set(folder.path()).unwrap();
        assert_eq!(manifest.files.len(), 3);
        // FIPS 180-2's first example.
        assert_eq!(
            manifest.files["c"].sha256,
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
        );
        write(MANIFEST, &serde_json::to_string(&manifest).unwrap());
        assert!(verify(folder.path()).unwrap().1.is_empty());
        fs::remove_file(folder.path().join("kitti/a")).unwrap();
        write("kitti/b", "abd");
        write("d", "");
        let (_, difference) = verify(folder.path()).unwrap();
        assert_eq!(
            difference,
            Difference {
                missing: vec!["kitti/a".into()],
                changed: vec!["kitti/b".into()],
                new: vec!["d".into()],
            }
        );
    }
}
