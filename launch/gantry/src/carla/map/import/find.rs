//! Finds the OpenDRIVE files that arguments name, and the names their maps will have.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use launch_cli::wrong_usage;
use schema_roads::MAX_TEXT_BYTES;

use crate::carla::map::refusal::{MAX_NAME_BYTES, Refusal};

/// Most files and folders that are looked at below one folder.
const MAX_ENTRIES: usize = 1_000_000;
/// Folders within folders that are looked into.
const MAX_DEPTH: usize = 24;
/// CARLA's suffix for a town whose layers can be switched; it has the same roads.
const LAYERED: &str = "_Opt";

/// A map that was found.
pub(super) struct Found {
    /// Name that it will have.
    pub name: String,
    /// Its file.
    pub file: PathBuf,
    /// Why it cannot have that name.
    pub refused: Option<Refusal>,
    /// What there is to say about how it was chosen.
    pub notes: Vec<String>,
}

/// The maps of all arguments by rising name; files of the same contents count once.
///
/// # Errors
/// A sentence if an argument is no file and no folder, or a folder has no maps.
pub(super) fn maps(what: &[PathBuf]) -> anyhow::Result<Vec<Found>> {
    let mut files = Vec::new();
    for path in what {
        if path.is_dir() {
            let below = below(path)?;
            if below.is_empty() {
                return Err(wrong_usage(format!(
                    "there is no .xodr file in the folder {} or below it; CARLA's are in CarlaUE4/Content/Carla/Maps of its installation",
                    path.display()
                )));
            }
            files.extend(below);
        } else if path.is_file() {
            files.push(path.clone());
        } else {
            let shown = path.display();
            return Err(wrong_usage(match launch_cli::files::open_plain(path) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                    format!("cannot import {shown}: {error}")
                }
                _ => format!("there is no file or folder {shown}"),
            }));
        }
    }
    Ok(by_name(files))
}

/// All `.xodr` files in a folder and below it, sorted. Links to folders are not followed.
fn below(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    let mut open = vec![(folder.to_owned(), 0)];
    let mut n = 0;
    while let Some((folder, depth)) = open.pop() {
        let entries = match std::fs::read_dir(&folder) {
            Ok(entries) => entries,
            Err(error) if depth == 0 => {
                return Err(wrong_usage(format!(
                    "cannot read the folder {}: {error}",
                    folder.display()
                )));
            }
            Err(error) => {
                tracing::warn!("the folder {} is left out: {error}", folder.display());
                continue;
            }
        };
        for entry in entries.flatten() {
            n += 1;
            if n > MAX_ENTRIES {
                return Err(wrong_usage(format!(
                    "there are more than {MAX_ENTRIES} files below {}; name a folder further in",
                    folder.display()
                )));
            }
            let (path, Ok(kind)) = (entry.path(), entry.file_type()) else {
                continue;
            };
            if kind.is_dir() && depth < MAX_DEPTH {
                open.push((path, depth + 1));
            } else if path.is_file() && path.extension().is_some_and(|end| end == "xodr") {
                files.push(path);
            }
        }
    }
    files.sort();
    Ok(files)
}

/// Whether a map may be called so.
///
/// # Errors
/// If it is none of a file in the map folder.
pub(super) fn check_name(name: &str) -> Result<(), Refusal> {
    let plain = |c: char| c.is_alphanumeric() || matches!(c, '-' | '_' | '.' | ' ' | '+');
    if (1..=MAX_NAME_BYTES).contains(&name.len())
        && !name.starts_with('.')
        && name.chars().all(plain)
    {
        Ok(())
    } else {
        Err(Refusal::Name {
            name: name.to_owned(),
        })
    }
}

/// Puts files of one name together. Of a town and its layered double the town counts.
fn by_name(files: Vec<PathBuf>) -> Vec<Found> {
    let mut groups: BTreeMap<String, Vec<(bool, PathBuf)>> = BTreeMap::new();
    for file in files {
        let stem = file
            .file_stem()
            .map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
        let (name, layered) = match stem.strip_suffix(LAYERED) {
            Some(short) if !short.is_empty() => (short.to_owned(), true),
            _ => (stem, false),
        };
        groups.entry(name).or_default().push((layered, file));
    }
    groups
        .into_iter()
        .map(|(name, mut files)| {
            files.sort();
            files.dedup();
            chosen(name, files)
        })
        .collect()
}

/// Which of the files of one name is imported.
fn chosen(name: String, files: Vec<(bool, PathBuf)>) -> Found {
    let has_plain = files.iter().any(|(layered, _)| !layered);
    let (kept, left): (Vec<_>, Vec<_>) = files
        .into_iter()
        .partition(|(layered, _)| *layered != has_plain);
    let (file, others) = kept
        .split_first()
        .map(|((_, first), rest)| (first.clone(), rest))
        .expect("a name has a file");
    let bytes = |path: &Path| launch_cli::files::read_plain(path, MAX_TEXT_BYTES as u64).ok();
    let first = if others.is_empty() && left.is_empty() {
        None
    } else {
        bytes(&file)
    };
    let mut notes = Vec::new();
    let mut refused = check_name(&name).err();
    for (_, other) in others {
        if bytes(other) != first {
            refused = Some(Refusal::Ambiguous {
                other: other.clone(),
            });
        }
    }
    for (_, other) in left {
        let is_same = bytes(&other) == first;
        notes.push(format!(
            "{} is {}",
            other.display(),
            if is_same {
                format!("the same map and loads as {name}{LAYERED}")
            } else {
                "another text of this town and left out; import it with --name to have both"
                    .to_owned()
            }
        ));
    }
    Found {
        name,
        file,
        refused,
        notes,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_town_and_its_layered_double_are_one_map() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, text).unwrap();
            path
        };
        file("a/Town01.xodr", "1");
        file("a/Town01_Opt.xodr", "1");
        file("Town12/OpenDrive/Town12.xodr", "12");
        file("Town12/copy/Town12.xodr", "12");
        file("b/Town05_Opt.xodr", "5");
        file("b/Town03.xodr", "3");
        file("c/Town03.xodr", "other");
        file("c/notes.txt", "");
        let found = maps(&[folder.path().to_owned()]).unwrap();
        let names: Vec<&str> = found.iter().map(|found| found.name.as_str()).collect();
        assert_eq!(names, ["Town01", "Town03", "Town05", "Town12"]);
        assert!(found[0].notes[0].contains("loads as Town01_Opt"));
        assert!(found[0].file.ends_with("Town01.xodr"));
        let reason = found[1].refused.as_ref().unwrap().to_string();
        assert!(reason.contains("other contents"), "{reason}");
        assert!(found[2].refused.is_none() && found[2].file.ends_with("Town05_Opt.xodr"));
        assert!(found[3].refused.is_none());
    }

    #[test]
    fn no_name_leads_out_of_the_map_folder() {
        for name in ["", ".x", "../Town01", "a/b", "x\0"] {
            assert!(check_name(name).is_err(), "{name:?}");
        }
        assert!(check_name("Town 01+b_2.v3-é").is_ok());
    }
}
