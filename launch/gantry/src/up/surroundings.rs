//! What a process starts in: its folder, its environment, its cores and its priority, checked
//! before anything starts.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::ensure;
use launch_spec::Process;
use nix::sys::resource::{Resource, getrlimit};
use schema_bus::names::DOMAIN_VARIABLE;

use crate::programs::Search;

/// The number of CAP_SYS_NICE, which allows any priority.
const CAP_SYS_NICE: u32 = 23;

/// Variables that processes have unless somebody says otherwise.
const USUALLY: [(&str, &str); 3] = [
    // Otherwise Python keeps its lines for itself until some kilobytes have come together.
    ("PYTHONUNBUFFERED", "1"),
    // Otherwise Mesa's drivers complain at every start.
    ("XDG_RUNTIME_DIR", "/tmp"),
    // Otherwise rerun tells at its first start what it would count.
    ("DO_NOT_TRACK", "1"),
];

/// Folder, environment, cores and priority of one process.
#[derive(Debug)]
pub struct Surroundings {
    /// Folder in which it runs; `None`: the launcher's.
    pub cwd: Option<PathBuf>,
    /// Variables that it has besides the launcher's.
    pub env: BTreeMap<String, OsString>,
    /// Variables of the launcher that it does not have.
    pub without: Vec<&'static str>,
    /// Cores it may run on; empty: the launcher's.
    pub cores: Vec<u32>,
    /// Its priority; `None`: the launcher's.
    pub nice: Option<i32>,
    /// Folder of the programs of its virtual environment.
    programs: Option<PathBuf>,
}

impl Surroundings {
    /// Where its program is looked for.
    pub fn search(&self) -> Search {
        Search {
            first: self.programs.clone(),
            path: path_of(&self.env),
            folder: self.cwd.clone(),
        }
    }
}

/// What `process` starts in.
///
/// # Errors
/// A sentence if the folder, the virtual environment or a core is not there, or the priority is not
/// allowed.
pub fn of(
    process: &Process,
    domain: &str,
    replaced: &dyn Fn(&str) -> String,
) -> anyhow::Result<Surroundings> {
    let cwd = process
        .cwd
        .as_deref()
        .map(std::path::absolute)
        .transpose()?;
    if let Some(cwd) = &cwd {
        ensure!(
            cwd.is_dir(),
            "cwd is {}, but there is no such folder",
            cwd.display()
        );
    }
    let mut env: BTreeMap<String, OsString> = process
        .env
        .iter()
        .map(|(key, value)| (key.clone(), replaced(value).into()))
        .collect();
    env.entry(DOMAIN_VARIABLE.into())
        .or_insert_with(|| domain.into());
    for (variable, value) in USUALLY {
        if std::env::var_os(variable).is_none() {
            env.entry(variable.into()).or_insert_with(|| value.into());
        }
    }
    let mut without = Vec::new();
    let programs = match &process.venv {
        None => None,
        Some(venv) => {
            let venv = std::path::absolute(venv)?;
            let programs = enter(&venv, &mut env)?;
            // It would send Python to the library of another installation.
            without.push("PYTHONHOME");
            Some(programs)
        }
    };
    check_cores(&process.cores)?;
    process.nice.map_or(Ok(()), check_nice)?;
    Ok(Surroundings {
        cwd,
        env,
        without,
        cores: process.cores.clone(),
        nice: process.nice,
        programs,
    })
}

/// Puts a virtual environment first, as its `activate` does; returns the folder of its programs.
fn enter(venv: &Path, env: &mut BTreeMap<String, OsString>) -> anyhow::Result<PathBuf> {
    let programs = venv.join("bin");
    ensure!(
        programs.join("python").exists(),
        "venv is {0}, but there is no {0}/bin/python; make it with `python3 -m venv {0}`",
        venv.display()
    );
    let old = path_of(env);
    let path =
        std::env::join_paths(std::iter::once(programs.clone()).chain(std::env::split_paths(&old)))?;
    env.insert("PATH".into(), path);
    env.insert("VIRTUAL_ENV".into(), venv.into());
    Ok(programs)
}

fn path_of(env: &BTreeMap<String, OsString>) -> OsString {
    env.get("PATH")
        .cloned()
        .or_else(|| std::env::var_os("PATH"))
        .unwrap_or_default()
}

fn check_cores(cores: &[u32]) -> anyhow::Result<()> {
    let Ok(online) = std::fs::read_to_string("/sys/devices/system/cpu/online") else {
        return Ok(());
    };
    let online = online.trim();
    match cores.iter().find(|core| !is_listed(**core, online)) {
        None => Ok(()),
        Some(core) => {
            anyhow::bail!("cores has {core}, but the cores of this machine are {online}")
        }
    }
}

/// Whether a list such as `0-3,8` has a number.
fn is_listed(core: u32, list: &str) -> bool {
    list.split(',').any(|part| {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        match (first.trim().parse::<u32>(), last.trim().parse::<u32>()) {
            (Ok(first), Ok(last)) => (first..=last).contains(&core),
            _ => false,
        }
    })
}

fn check_nice(nice: i32) -> anyhow::Result<()> {
    let own = own_nice();
    let limit = getrlimit(Resource::RLIMIT_NICE).map_or(0, |(soft, _)| soft.min(40) as i32);
    let least = own.min(20 - limit);
    ensure!(
        nice >= least || may_set_priorities(),
        "nice is {nice}, but this user may only go down to {least}; give {least} to 19, raise the limit (`ulimit -e`), or start it with the right CAP_SYS_NICE"
    );
    Ok(())
}

/// Priority of the launcher itself.
fn own_nice() -> i32 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The program's name stands in brackets and may hold anything; the priority is the 17th field
    // behind it.
    let behind = stat.rsplit(')').next().unwrap_or_default();
    behind
        .split_whitespace()
        .nth(16)
        .and_then(|field| field.parse().ok())
        .unwrap_or(0)
}

fn may_set_priorities() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    status
        .lines()
        .find_map(|line| line.strip_prefix("CapEff:"))
        .and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .is_some_and(|mask| mask >> CAP_SYS_NICE & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_cores_are_read_as_the_kernel_writes_them() {
        assert!(is_listed(0, "0-1") && is_listed(8, "0-3,8,10-11") && is_listed(11, "0-3,8,10-11"));
        assert!(!is_listed(2, "0-1") && !is_listed(9, "0-3,8,10-11") && !is_listed(0, ""));
    }

    #[test]
    fn going_last_is_always_allowed() {
        check_nice(19).unwrap();
        assert!((-20..=19).contains(&own_nice()));
    }
}
