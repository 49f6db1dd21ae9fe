//! Space for what runs write: the data folder and the folder of temporary files.

use std::path::{Path, PathBuf};

use nix::errno::Errno;

use super::finding::Finding;

/// A minute of the quickstart's recording, bytes, rounded up.
const RECORDING_BYTES: u64 = 2 << 30;

pub fn look(data: anyhow::Result<PathBuf>) -> Vec<Finding> {
    let data = match data {
        Ok(folder) => judge("data folder", &folder, space(&folder), RECORDING_BYTES),
        Err(error) => Finding::fail(
            "data folder",
            format!("{error:#}"),
            "export HOME=/some/folder",
        ),
    };
    vec![data]
}

/// Why a folder cannot be used.
#[derive(Debug, thiserror::Error)]
enum Unusable {
    #[error("no part of its path exists")]
    Nowhere,
    #[error("{} is no folder", .0.display())]
    NoFolder(PathBuf),
    #[error("{} cannot be written to ({})", .0.display(), .1.desc())]
    ReadOnly(PathBuf, Errno),
    #[error("{}", .0.desc())]
    Unknown(Errno),
}

/// Whether this user may write there, and the free bytes; of the nearest folder that exists.
fn space(folder: &Path) -> Result<u64, Unusable> {
    let there = folder
        .ancestors()
        .find(|folder| folder.exists())
        .ok_or(Unusable::Nowhere)?;
    let shown = || there.to_owned();
    if !there.is_dir() {
        return Err(Unusable::NoFolder(shown()));
    }
    nix::unistd::access(there, nix::unistd::AccessFlags::W_OK)
        .map_err(|error| Unusable::ReadOnly(shown(), error))?;
    let about = nix::sys::statvfs::statvfs(there).map_err(Unusable::Unknown)?;
    Ok(about.blocks_available() * about.fragment_size())
}

fn judge(what: &'static str, folder: &Path, space: Result<u64, Unusable>, want: u64) -> Finding {
    let shown = folder.display();
    match space {
        Err(problem) => Finding::fail(
            what,
            format!("{shown}: {problem}"),
            "name another with --data FOLDER, or with XDG_DATA_HOME",
        ),
        Ok(free) if free < want => Finding::warn(
            what,
            format!(
                "{shown} has {} MiB free; a minute of the quickstart's recording is about {} MiB",
                free >> 20,
                want >> 20
            ),
            format!(
                "du -sh {shown}/runs shows the logs of earlier runs; or name another with --data FOLDER"
            ),
        ),
        Ok(free) => Finding::ok(what, format!("{shown} has {} MiB free", free >> 20)),
    }
}

#[cfg(test)]
mod tests {
    use super::super::Grade;
    use super::*;

    #[test]
    fn a_folder_that_cannot_be_used_is_a_failure_and_a_full_one_a_warning() {
        let folder = tempfile::tempdir().unwrap();
        let below = folder.path().join("not/yet/there");
        let finding = judge("data folder", &below, space(&below), 0);
        assert_eq!(finding.grade, Grade::Ok, "{finding:?}");
        let finding = judge("data folder", &below, space(&below), u64::MAX);
        assert_eq!(finding.grade, Grade::Warn, "{finding:?}");
        let file = folder.path().join("file");
        std::fs::write(&file, "x").unwrap();
        let inside = file.join("data");
        let finding = judge("data folder", &inside, space(&inside), 0);
        assert_eq!(finding.grade, Grade::Fail);
        assert!(finding.text.contains("is no folder"), "{finding:?}");
        assert_eq!(look(Err(anyhow::anyhow!("no HOME")))[0].grade, Grade::Fail);
    }
}
