//! Sockets of writers: where they are, who may speak there, and whose remains they are.

use std::ffi::OsStr;
use std::fs::{DirBuilder, File};
use std::io;
use std::os::fd::{AsFd as _, AsRawFd as _, OwnedFd};
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};

use nix::errno::Errno;
use nix::sys::socket::{
    AddressFamily, Backlog, SockFlag, SockType, UnixAddr, bind, connect, getsockopt, listen,
    setsockopt, socket, sockopt,
};
use nix::sys::time::{TimeVal, TimeValLike as _};

/// Longest wait for the other side's record, milliseconds: both sides answer at once, so a longer
/// one is a process that is stopped.
pub(crate) const PATIENCE_MILLIS: i64 = 2000;

/// The folder of sockets below iceoryx2's root.
pub(crate) fn folder_of(root: &Path) -> PathBuf {
    root.join("gantry-gpu")
}

/// Name of a process's socket.
pub(crate) fn name_of(domain: &str, producer: u64) -> String {
    format!("{domain}-{producer:016x}")
}

/// The process's number in the name of its socket.
fn producer_of(domain: &str, name: &OsStr) -> Option<u64> {
    let number = name.to_str()?.strip_prefix(domain)?.strip_prefix('-')?;
    (number.len() == 16)
        .then(|| u64::from_str_radix(number, 16).ok())
        .flatten()
}

/// Numbers of the processes of a domain that have a socket.
pub(crate) fn producers(root: &Path, domain: &str) -> Vec<u64> {
    let entries = std::fs::read_dir(folder_of(root)).into_iter().flatten();
    let mut producers: Vec<u64> = entries
        .flatten()
        .filter_map(|entry| producer_of(domain, &entry.file_name()))
        .collect();
    producers.sort_unstable();
    producers
}

fn fresh() -> Result<OwnedFd, Errno> {
    socket(
        AddressFamily::Unix,
        SockType::SeqPacket,
        SockFlag::SOCK_CLOEXEC,
        None,
    )
}

/// The address of a file in a folder, short whatever the folder's path.
fn address(folder: &File, name: &str) -> Result<UnixAddr, Errno> {
    UnixAddr::new(format!("/proc/self/fd/{}/{name}", folder.as_raw_fd()).as_str())
}

/// Makes a socket that only this user can reach, and listens on it.
pub(crate) fn listen_at(root: &Path, name: &str) -> io::Result<(OwnedFd, PathBuf)> {
    let folder = folder_of(root);
    match DirBuilder::new()
        .recursive(true)
        .mode(0o700)
        .create(&folder)
    {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(error),
        _ => {}
    }
    let about = std::fs::symlink_metadata(&folder)?;
    if !about.is_dir() || about.uid() != nix::unistd::geteuid().as_raw() {
        return Err(io::Error::other(format!(
            "{} is not a folder of this user",
            folder.display()
        )));
    }
    let opened = File::open(&folder)?;
    let listener = fresh()?;
    // The file is made with the socket's permissions, so that nobody connects before they are set.
    nix::sys::stat::fchmod(
        listener.as_fd(),
        nix::sys::stat::Mode::from_bits_truncate(0o600),
    )?;
    bind(listener.as_raw_fd(), &address(&opened, name)?)?;
    let path = folder.join(name);
    let limit = std::os::unix::fs::PermissionsExt::from_mode(0o600);
    std::fs::set_permissions(&path, limit)?;
    listen(&listener, Backlog::new(64)?)?;
    Ok((listener, path))
}

/// Connects to a process's socket. One on which nobody listens is removed.
pub(crate) fn connect_to(root: &Path, name: &str) -> Result<OwnedFd, Errno> {
    let folder = folder_of(root);
    let opened = File::open(&folder)
        .map_err(|error| Errno::from_raw(error.raw_os_error().unwrap_or(libc::EIO)))?;
    let client = fresh()?;
    set_patience(&client)?;
    match connect(client.as_raw_fd(), &address(&opened, name)?) {
        Ok(()) => {}
        Err(Errno::ECONNREFUSED) => {
            let _ = std::fs::remove_file(folder.join(name));
            return Err(Errno::ECONNREFUSED);
        }
        Err(error) => return Err(error),
    }
    if is_ours(&client) {
        Ok(client)
    } else {
        Err(Errno::EPERM)
    }
}

/// Limits how long sending and receiving wait.
pub(crate) fn set_patience(of: &OwnedFd) -> Result<(), Errno> {
    let limit = TimeVal::milliseconds(PATIENCE_MILLIS);
    setsockopt(of, sockopt::ReceiveTimeout, &limit)?;
    setsockopt(of, sockopt::SendTimeout, &limit)
}

/// Whether the process at the other end is this user's.
pub(crate) fn is_ours(connection: &OwnedFd) -> bool {
    let user = nix::unistd::geteuid().as_raw();
    getsockopt(connection, sockopt::PeerCredentials).is_ok_and(|peer| is_allowed(peer.uid(), user))
}

/// Whether a peer of this user id may speak to a process of `user`.
fn is_allowed(peer: u32, user: u32) -> bool {
    peer == user
}

/// Removes the sockets of dead processes, of all domains.
pub(crate) fn sweep(root: &Path) {
    let folder = folder_of(root);
    let Ok(entries) = std::fs::read_dir(&folder) else {
        return;
    };
    for entry in entries.flatten() {
        if let Some(name) = entry.file_name().to_str() {
            // Connecting removes what nobody listens on.
            let _ = connect_to(root, name);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    #[test]
    fn a_socket_is_its_users_alone_and_a_dead_ones_is_removed() {
        let root = tempfile::tempdir().unwrap();
        let (listener, path) = listen_at(root.path(), &name_of("d", 7)).unwrap();
        let about = std::fs::metadata(&path).unwrap();
        assert_eq!(about.permissions().mode() & 0o777, 0o600);
        assert_eq!(producers(root.path(), "d"), [7]);
        assert!(producers(root.path(), "other").is_empty());
        assert!(connect_to(root.path(), &name_of("d", 7)).is_ok());
        sweep(root.path());
        assert!(path.exists(), "somebody listens");
        drop(listener);
        sweep(root.path());
        assert!(!path.exists());
    }

    #[test]
    fn another_users_process_is_not_spoken_to() {
        assert!(is_allowed(1000, 1000) && !is_allowed(1000, 1001) && !is_allowed(0, 1000));
    }

    #[test]
    fn a_long_path_is_no_obstacle() {
        let root = tempfile::tempdir().unwrap();
        let deep = root.path().join("a".repeat(100)).join("b".repeat(100));
        std::fs::create_dir_all(&deep).unwrap();
        let (_listener, path) = listen_at(&deep, &name_of("d", u64::MAX)).unwrap();
        assert!(path.exists());
        assert!(connect_to(&deep, &name_of("d", u64::MAX)).is_ok());
    }
}
