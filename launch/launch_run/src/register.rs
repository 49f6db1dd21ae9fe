//! Who lives in a private domain, written down for whoever finds it after a kill.

use std::fs;
use std::path::{Path, PathBuf};

use launch_cli::files::{MAX_NOTES_BYTES, read_text};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde::{Deserialize, Serialize};

use crate::domain::{Naming, PrivateDomain, remove_shared_memory};
use crate::error::RunError;
use crate::process::Process;

/// What the file holds.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Entry {
    folder: PathBuf,
    prefix: String,
    /// Process ids and when they started, in the kernel's ticks.
    processes: Vec<(i32, u64)>,
}

/// The file; removed when dropped.
#[derive(Debug)]
pub(crate) struct Register(PathBuf);

impl Register {
    /// Writes down a domain without processes.
    pub(crate) fn open(path: &Path, domain: &PrivateDomain) -> Result<Register, RunError> {
        let register = Register(path.to_owned());
        register.write(domain, &[])?;
        Ok(register)
    }

    /// Writes down a domain and its processes.
    pub(crate) fn write(
        &self,
        domain: &PrivateDomain,
        processes: &[Process],
    ) -> Result<(), RunError> {
        let ids = processes.iter().map(|it| it.pid().cast_signed());
        let entry = Entry {
            folder: domain.folder().to_owned(),
            prefix: domain.prefix().to_owned(),
            processes: ids.filter_map(|pid| Some((pid, started(pid)?))).collect(),
        };
        let written = || {
            if let Some(folder) = self.0.parent() {
                fs::create_dir_all(folder)?;
            }
            fs::write(&self.0, serde_json::to_string(&entry)?)
        };
        written().map_err(|source| RunError::Write {
            path: self.0.clone(),
            source,
        })
    }
}

impl Drop for Register {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}

/// Ends what killed runs left behind: processes, shared memory and temporary folders of all
/// registers in `folder`, if they are named as `naming` says.
pub fn clear(folder: &Path, naming: &Naming<'_>) {
    let Ok(entries) = fs::read_dir(folder) else {
        return;
    };
    for path in entries.filter_map(|entry| Some(entry.ok()?.path())) {
        let text = read_text(&path, MAX_NOTES_BYTES).unwrap_or_default();
        if let Ok(entry) = serde_json::from_str::<Entry>(&text)
            && entry.prefix.starts_with(naming.memory)
        {
            for (pid, start) in entry.processes {
                // A number that another process has by now is left alone.
                if started(pid) == Some(start) {
                    let _ = kill(Pid::from_raw(pid), Signal::SIGKILL);
                }
            }
            remove_shared_memory(&entry.prefix);
            let is_ours = entry
                .folder
                .file_name()
                .is_some_and(|name| name.to_string_lossy().starts_with(naming.folder));
            if is_ours {
                let _ = fs::remove_dir_all(&entry.folder);
            }
        }
        let _ = fs::remove_file(&path);
    }
}

/// When a process started, in ticks since the machine did; `None` if there is no such process.
pub(crate) fn started(pid: i32) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name in brackets may hold anything, so the fields are counted from its end.
    let after = stat.rsplit_once(") ")?.1;
    after.split(' ').nth(19)?.parse().ok()
}
