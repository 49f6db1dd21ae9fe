//! Opens files that somebody else named or wrote. A pipe or a device in the place of a file waits
//! for ever or has no end, so only regular files are read, and each no further than its reader
//! says. `tests/test_tidy` holds all programs to this module; writing is `launch_cli::files`.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use std::fs::{File, FileType, OpenOptions};
use std::io::{self, Read as _};
use std::os::unix::fs::{FileTypeExt as _, OpenOptionsExt as _};
use std::path::Path;

/// Longest file of settings that people write: a launch file, a recipe, a suite, a template.
pub const MAX_SETTINGS_BYTES: u64 = 16 << 20;
/// Longest file of notes that a program writes for itself or another one: a manifest, a report.
pub const MAX_NOTES_BYTES: u64 = 1 << 30;

/// Opens a file for reading, and tells its length. Pipes, devices, sockets and folders are no
/// files; opening one neither waits nor does anything to it.
///
/// # Errors
/// If there is no such file, or it cannot be read, or it is something else, which the error names.
pub fn open_plain(path: &Path) -> io::Result<(File, u64)> {
    check(std::fs::metadata(path)?.file_type())?;
    // Something else may have taken its place by now.
    let file = OpenOptions::new()
        .read(true)
        .custom_flags(nix::fcntl::OFlag::O_NONBLOCK.bits())
        .open(path)?;
    let about = file.metadata()?;
    check(about.file_type())?;
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
    // A file with holes has any length.
    let expected = usize::try_from(n_bytes.min(MAX_NOTES_BYTES)).unwrap_or(0);
    let mut bytes = Vec::with_capacity(expected);
    file.take(max.saturating_add(1)).read_to_end(&mut bytes)?;
    let n_read = bytes.len() as u64;
    if n_read > max {
        return Err(too_long(n_read));
    }
    Ok(bytes)
}

/// As [`read_plain`], as a text.
///
/// # Errors
/// As [`read_plain`], and if it is no UTF-8.
pub fn read_text(path: &Path, max: u64) -> io::Result<String> {
    String::from_utf8(read_plain(path, max)?).map_err(|error| {
        io::Error::new(
            io::ErrorKind::InvalidData,
            format!("it is no UTF-8: {error}"),
        )
    })
}

fn check(of: FileType) -> io::Result<()> {
    match kind(of) {
        None => Ok(()),
        Some(kind) => Err(io::Error::other(format!("it is {kind}, not a file"))),
    }
}

/// What it is if it is no regular file.
fn kind(of: FileType) -> Option<&'static str> {
    let kinds = [
        (of.is_file(), None),
        (of.is_dir(), Some("a folder")),
        (of.is_fifo(), Some("a named pipe")),
        (of.is_socket(), Some("a socket")),
        (of.is_char_device(), Some("a device")),
        (of.is_block_device(), Some("a disk")),
    ];
    let found = kinds.into_iter().find(|(is_it, _)| *is_it);
    found.map_or(Some("something else"), |(_, kind)| kind)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_are_read_and_only_so_much_of_them() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, b"12345").unwrap();
        assert_eq!(read_plain(&path, 5).unwrap(), b"12345");
        assert_eq!(read_text(&path, 5).unwrap(), "12345");
        let error = read_plain(&path, 4).unwrap_err().to_string();
        assert_eq!(error, "it has 5 bytes, at most 4 are read");
        // Its length is said to be 0.
        assert!(read_plain(Path::new("/proc/self/maps"), 100).is_err());
        std::fs::write(&path, b"\xff").unwrap();
        assert!(
            read_text(&path, 5)
                .unwrap_err()
                .to_string()
                .contains("UTF-8")
        );
    }

    #[test]
    fn what_is_no_file_is_named_and_nothing_waits() {
        let folder = tempfile::tempdir().unwrap();
        let (pipe, socket) = (folder.path().join("pipe"), folder.path().join("socket"));
        nix::unistd::mkfifo(&pipe, nix::sys::stat::Mode::S_IRWXU).unwrap();
        let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        for (path, kind) in [
            (&*pipe, "a named pipe"),
            (folder.path(), "a folder"),
            (&*socket, "a socket"),
            (Path::new("/dev/zero"), "a device"),
        ] {
            let error = open_plain(path).unwrap_err().to_string();
            assert_eq!(error, format!("it is {kind}, not a file"));
            assert_eq!(read_plain(path, 100).unwrap_err().to_string(), error);
        }
    }
}
