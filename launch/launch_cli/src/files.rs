//! Files that are there as a whole or not at all, also after a loss of power, and files that are
//! really files: no pipe, no device, not longer than expected.

use std::fs::{File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

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

/// Opens a file for reading, and tells its length. Pipes, devices and folders are no files, and
/// opening one neither waits nor does anything to it.
///
/// # Errors
/// If there is no such file, or it cannot be read, or it is something else.
pub fn open_plain(path: &Path) -> io::Result<(File, u64)> {
    let is_file = |about: &std::fs::Metadata| {
        about
            .is_file()
            .then_some(())
            .ok_or_else(|| io::Error::other("it is not a file"))
    };
    is_file(&std::fs::metadata(path)?)?;
    // Something else may have taken its place by now.
    let file = OpenOptions::new()
        .read(true)
        .custom_flags(nix::fcntl::OFlag::O_NONBLOCK.bits())
        .open(path)?;
    let about = file.metadata()?;
    is_file(&about)?;
    Ok((file, about.len()))
}

/// Reads a file of at most `max` bytes, whatever length it claims to have.
///
/// # Errors
/// As [`open_plain`], and if it is longer.
pub fn read_plain(path: &Path, max: u64) -> io::Result<Vec<u8>> {
    let (file, n_bytes) = open_plain(path)?;
    let too_long = |n_bytes: u64| {
        io::Error::new(
            io::ErrorKind::FileTooLarge,
            format!("it has {n_bytes} bytes, at most {max} are read"),
        )
    };
    if n_bytes > max {
        return Err(too_long(n_bytes));
    }
    let mut bytes = Vec::with_capacity(n_bytes as usize);
    file.take(max + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > max {
        return Err(too_long(bytes.len() as u64));
    }
    Ok(bytes)
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

    #[test]
    fn only_files_are_read_and_only_so_much_of_them() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, b"12345").unwrap();
        assert_eq!(read_plain(&path, 5).unwrap(), b"12345");
        assert!(
            read_plain(&path, 4)
                .unwrap_err()
                .to_string()
                .contains("at most 4")
        );
        // Its length is said to be 0.
        assert!(read_plain(Path::new("/proc/self/maps"), 100).is_err());
        let pipe = folder.path().join("pipe");
        nix::unistd::mkfifo(&pipe, nix::sys::stat::Mode::S_IRWXU).unwrap();
        for other in [&*pipe, folder.path(), Path::new("/dev/zero")] {
            let error = read_plain(other, 100).unwrap_err().to_string();
            assert_eq!(error, "it is not a file", "{}", other.display());
        }
    }
}
