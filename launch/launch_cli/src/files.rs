//! Files that are there as a whole or not at all, also after a loss of power, and files that are
//! really files: no pipe, no device, not longer than expected.

use std::fs::File;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

pub use schema_types::files::{
    MAX_NOTES_BYTES, MAX_SETTINGS_BYTES, open_plain, read_plain, read_text,
};

/// Writes a file in place of the one that may be there. Whoever reads it finds the old or the new
/// one whole; once this returns, the new one is on the disk.
///
/// # Errors
/// If the disk refuses; the old file is then as it was.
pub fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut name = path.as_os_str().to_owned();
    name.push(format!(".{}.part", std::process::id()));
    let part = PathBuf::from(name);
    let written = File::create(&part)
        .and_then(|mut file| file.write_all(bytes))
        .and_then(|()| rename(&part, path));
    if written.is_err() {
        let _ = std::fs::remove_file(&part);
    }
    written
}

/// Gives a finished file its name. Its bytes reach the disk before the name does, and the name
/// before this returns.
///
/// # Errors
/// If the disk refuses.
pub fn rename(part: &Path, path: &Path) -> io::Result<()> {
    File::open(part)?.sync_all()?;
    std::fs::rename(part, path)?;
    sync_folder_of(path)
}

/// Brings the name of a file to the disk.
///
/// # Errors
/// If the disk refuses.
pub fn sync_folder_of(path: &Path) -> io::Result<()> {
    let folder = path.parent().filter(|it| !it.as_os_str().is_empty());
    File::open(folder.unwrap_or(Path::new(".")))?.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("state.json");
        replace(&path, b"one").unwrap();
        replace(&path, b"two").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"two");
        assert!(replace(&folder.path().join("none/state"), b"x").is_err());
        std::fs::create_dir(folder.path().join("taken")).unwrap();
        assert!(replace(&folder.path().join("taken"), b"x").is_err());
        let names = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(names, 2, "nothing is left beside them");
    }
}
