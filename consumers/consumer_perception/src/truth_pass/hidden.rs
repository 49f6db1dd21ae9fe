//! Where a benchmark keeps its files while programs run: fresh folders that only this user may enter
//! and that no program is told of. Launch files and logs name the recording, and the names of
//! scenarios the seed.

use std::fs::{self, Permissions};
use std::io;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use crate::suite::Suite;

/// In the names of folders of the cache that are of a benchmark under way.
pub(crate) const MAKING: &str = "-making-";

/// Such a folder; what is in it moves to where it is kept when no program runs any more.
#[derive(Debug)]
pub struct Hidden {
    made: TempDir,
    kept: PathBuf,
}

/// Why there is no folder, or its files cannot be moved.
#[derive(Debug, thiserror::Error)]
#[error("files of a run cannot be kept in {folder}: {source}", folder = folder.display())]
pub struct HiddenError {
    folder: PathBuf,
    source: io::Error,
}

impl Hidden {
    /// A new folder in the cache, to which no variable of the environment leads.
    ///
    /// # Errors
    /// If the cache cannot be written.
    pub fn new(cache: &Path, kept: &Path) -> Result<Hidden, HiddenError> {
        let made = private_folder(cache).and_then(|()| {
            tempfile::Builder::new()
                .prefix(&format!("run{MAKING}"))
                .permissions(Permissions::from_mode(0o700))
                .tempdir_in(cache)
        });
        made.map(|made| Hidden {
            made,
            kept: kept.to_owned(),
        })
        .map_err(|source| HiddenError {
            folder: cache.to_owned(),
            source,
        })
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        self.made.path()
    }

    /// Moves its files to where they are kept.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn reveal(self) -> Result<(), HiddenError> {
        copy(self.made.path(), &self.kept).map_err(|source| HiddenError {
            folder: self.kept.clone(),
            source,
        })
    }
}

/// Copies a folder's files; links are left out.
fn copy(from: &Path, to: &Path) -> io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let (kind, target) = (entry.file_type()?, to.join(entry.file_name()));
        if kind.is_dir() {
            copy(&entry.path(), &target)?;
        } else if kind.is_file() {
            fs::copy(entry.path(), target)?;
        }
    }
    Ok(())
}

/// Makes a folder that only this user may enter, unless it is there.
///
/// # Errors
/// If the disk refuses.
pub fn private_folder(folder: &Path) -> io::Result<()> {
    use std::os::unix::fs::DirBuilderExt as _;
    fs::DirBuilder::new()
        .recursive(true)
        .mode(0o700)
        .create(folder)
}

/// Programs whose own working folder leads them to the cache, a sentence each.
pub fn led(suite: &Suite, cache: &Path) -> Vec<String> {
    let real = |folder: &Path| fs::canonicalize(folder).ok();
    let Some(cache) = real(cache) else {
        return Vec::new();
    };
    let home = std::env::var_os("HOME").and_then(|home| real(Path::new(&home)));
    let here = std::env::current_dir().ok();
    let mut sentences = Vec::new();
    for program in &suite.programs {
        for process in &program.processes {
            let folder = process.cwd.clone().or_else(|| here.clone());
            let Some(folder) = folder.as_deref().and_then(real) else {
                continue;
            };
            let is_home = home.as_ref().is_some_and(|home| home.starts_with(&folder));
            if cache.starts_with(&folder) && !is_home {
                sentences.push(format!(
                    "{} runs in {}, below which the recordings with the truth lie ({}); choose another --cache",
                    program.name,
                    folder.display(),
                    cache.display()
                ));
            }
        }
    }
    sentences.dedup();
    sentences
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_else_may_enter_and_the_files_are_kept_afterwards() {
        let place = tempfile::tempdir().unwrap();
        let kept = place.path().join("logs/town/quick");
        let cache = place.path().join("cache");
        let hidden = Hidden::new(&cache, &kept).unwrap();
        let folder = hidden.folder().to_owned();
        for folder in [&folder, &cache] {
            let mode = fs::metadata(folder).unwrap().permissions().mode();
            assert_eq!(mode & 0o777, 0o700);
        }
        fs::create_dir(folder.join("up")).unwrap();
        fs::write(folder.join("up/a.log"), "a").unwrap();
        std::os::unix::fs::symlink("a.log", folder.join("up/latest")).unwrap();
        hidden.reveal().unwrap();
        assert_eq!(fs::read_to_string(kept.join("up/a.log")).unwrap(), "a");
        assert!(!folder.exists() && !kept.join("up/latest").exists());
    }

    #[test]
    fn a_program_that_runs_above_the_cache_is_told() {
        let place = tempfile::tempdir().unwrap();
        let cache = place.path().join("work/cache");
        fs::create_dir_all(&cache).unwrap();
        let of = |folder: &Path| {
            let text = format!(
                "{}[program.other]\ncmd = [\"x\"]\ncwd = {folder:?}\n",
                crate::suite::tests::SMALL
            );
            let mut suite = crate::suite::tests::read(&text).unwrap();
            suite.programs.retain(|program| program.name == "other");
            led(&suite, &cache)
        };
        let told = of(&place.path().join("work"));
        assert!(told.len() == 1 && told[0].contains("--cache"), "{told:?}");
        fs::create_dir(place.path().join("beside")).unwrap();
        assert!(of(&place.path().join("beside")).is_empty());
    }
}
