//! A place for processes that meet nobody else.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use schema_bus::{Bus, BusError, BusOptions, write_private_config};

use crate::error::RunError;

/// By what the places of one kind of runs are known.
#[derive(Clone, Copy, Debug)]
pub struct Naming<'a> {
    /// Start of the temporary folder's name.
    pub folder: &'a str,
    /// Start of the domain's name.
    pub domain: &'a str,
    /// Start of the names of files in shared memory.
    pub memory: &'a str,
}

/// The next number of this process.
fn number() -> u64 {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    COUNT.fetch_add(1, Ordering::Relaxed)
}

/// A domain on the shared bus that no other run has.
pub fn domain_name(start: &str) -> String {
    format!("{start}{}x{}", std::process::id(), number())
}

/// A domain, a part of shared memory and a folder; removed when dropped. End the processes before.
#[derive(Debug)]
pub struct PrivateDomain {
    folder: tempfile::TempDir,
    domain: String,
    prefix: String,
}

impl PrivateDomain {
    /// A fresh one.
    ///
    /// # Errors
    /// [`RunError::TemporaryFolder`], or if iceoryx2's configuration cannot be written.
    pub fn make(naming: &Naming<'_>) -> Result<PrivateDomain, RunError> {
        // Sockets live below it, whose paths must be short.
        let folder = tempfile::Builder::new()
            .prefix(naming.folder)
            .tempdir()
            .map_err(RunError::TemporaryFolder)?;
        let (own, number) = (std::process::id(), number());
        let made = PrivateDomain {
            domain: format!("{}{own}x{number}", naming.domain),
            prefix: format!("{}{own}x{number}_", naming.memory),
            folder,
        };
        fs::create_dir_all(made.iceoryx_root())?;
        // iceoryx2 reads this file in the working folder of every process.
        write_private_config(made.folder(), &made.iceoryx_root(), &made.prefix)?;
        Ok(made)
    }

    /// Working folder of its processes.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// The name for `--domain`.
    pub fn name(&self) -> &str {
        &self.domain
    }

    /// Start of the names of its files in `/dev/shm`.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// Root folder of iceoryx2.
    pub fn iceoryx_root(&self) -> PathBuf {
        self.folder().join("iox")
    }

    /// The iceoryx2 configuration file, for programs that are told its path.
    pub fn iceoryx_config(&self) -> PathBuf {
        self.folder().join("config/iceoryx2.toml")
    }

    /// Options with which a process that works elsewhere joins its bus.
    pub fn bus_options(&self) -> BusOptions {
        BusOptions {
            iceoryx_root: Some(self.iceoryx_root()),
            prefix: Some(self.prefix.clone()),
        }
    }

    /// This process's place on its bus. Drop it, and its ports, before the domain.
    ///
    /// # Errors
    /// As [`Bus::open_with`].
    pub fn join(&self, program: &str) -> Result<Bus, BusError> {
        Bus::open_with(&self.domain, program, &self.bus_options())
    }

    /// Names of the files that processes left in shared memory.
    pub fn leftovers(&self) -> Vec<String> {
        // By design, iceoryx2 never removes its one management file of 16 bytes.
        let mut left: Vec<String> = shared_memory_of(&self.prefix)
            .map(|path| {
                path.file_name()
                    .unwrap_or_default()
                    .to_string_lossy()
                    .into()
            })
            .filter(|name: &String| !name.ends_with(".global_mgmt"))
            .collect();
        left.sort();
        left
    }
}

impl Drop for PrivateDomain {
    fn drop(&mut self) {
        // The processes are gone; what a killed one left in shared memory goes with them.
        remove_shared_memory(&self.prefix);
    }
}

/// Removes the files in shared memory whose names begin with `prefix`.
pub(crate) fn remove_shared_memory(prefix: &str) {
    for path in shared_memory_of(prefix) {
        let _ = fs::remove_file(path);
    }
}

fn shared_memory_of(prefix: &str) -> impl Iterator<Item = PathBuf> {
    let entries = fs::read_dir("/dev/shm").into_iter().flatten().flatten();
    entries
        .filter(move |entry| entry.file_name().to_string_lossy().starts_with(prefix))
        .map(|entry| entry.path())
}

/// A temporary folder for a run on a domain that the user has chosen. Its name is `start` and this
/// process's id, so that folders of processes that were killed are known, and removed here.
///
/// # Errors
/// If it cannot be made.
pub fn temporary_folder(start: &str) -> io::Result<tempfile::TempDir> {
    remove_abandoned(&std::env::temp_dir(), start);
    tempfile::Builder::new()
        .prefix(&format!("{start}{}-", std::process::id()))
        .tempdir()
}

/// Removes the folders of runs whose process was killed.
fn remove_abandoned(folder: &Path, start: &str) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let pid = name
            .to_str()
            .and_then(|name| name.strip_prefix(start)?.split('-').next())
            .and_then(|pid| pid.parse::<u32>().ok());
        if pid.is_some_and(|pid| !Path::new(&format!("/proc/{pid}")).exists())
            && let Err(error) = fs::remove_dir_all(entry.path())
        {
            // Another user's, for example.
            tracing::debug!(%error, folder = %entry.path().display(), "an abandoned folder stays");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_places_share_nothing_and_leave_nothing() {
        let naming = Naming {
            folder: "gantry-test-",
            domain: "t",
            memory: "gt",
        };
        let (a, b) = (
            PrivateDomain::make(&naming).unwrap(),
            PrivateDomain::make(&naming).unwrap(),
        );
        assert!(a.name() != b.name() && a.prefix() != b.prefix() && a.folder() != b.folder());
        assert!(a.iceoryx_config().is_file());
        let folder = a.folder().to_owned();
        let file = Path::new("/dev/shm").join(format!("{}x", a.prefix()));
        fs::write(&file, "").unwrap();
        assert_eq!(a.leftovers(), [format!("{}x", a.prefix())]);
        drop(a);
        assert!(!folder.exists() && !file.exists() && b.folder().exists());
    }

    #[test]
    fn folders_of_killed_programs_are_removed_and_others_stay() {
        let folder = tempfile::tempdir().unwrap();
        let own = format!("gantry-run-{}-a", std::process::id());
        // Beyond the largest process id of Linux.
        let gone = "gantry-run-4194999-b";
        for name in [&*own, gone, "gantry-run-x", "else"] {
            fs::create_dir(folder.path().join(name)).unwrap();
        }
        remove_abandoned(folder.path(), "gantry-run-");
        let is_there = |name: &str| folder.path().join(name).exists();
        assert!(is_there(&own) && is_there("gantry-run-x") && is_there("else"));
        assert!(!is_there(gone));
    }
}
