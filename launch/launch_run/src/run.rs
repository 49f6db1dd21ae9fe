//! A domain with its processes.

use std::path::{Path, PathBuf};

use schema_bus::{Bus, BusError};

use crate::domain::{Naming, PrivateDomain, domain_name};
use crate::error::RunError;
use crate::process::{Ending, Process};
use crate::program::{Output, Program};
use crate::register::Register;
use crate::watch::Watched;

/// Where a run takes place.
#[derive(Debug)]
enum Place {
    /// Among others, under a name of its own.
    Shared(String),
    /// Alone, and written down.
    Private(Register, PrivateDomain),
}

/// A domain with its processes. They end in the reverse of the order in which they began.
#[derive(Debug)]
pub struct Run {
    // The processes are gone before their place.
    processes: Vec<Process>,
    place: Place,
    logs: PathBuf,
}

impl Run {
    /// A run in a private domain, which is written down in the file `register`. Logs go to the
    /// folder `logs`.
    ///
    /// # Errors
    /// If the domain cannot be made.
    pub fn private(naming: &Naming<'_>, register: &Path, logs: &Path) -> Result<Run, RunError> {
        let domain = PrivateDomain::make(naming)?;
        let register = Register::open(register, &domain)?;
        Ok(Run {
            processes: Vec::new(),
            place: Place::Private(register, domain),
            logs: logs.to_owned(),
        })
    }

    /// A run on the shared bus, in a domain whose name begins with `start`.
    pub fn shared(start: &str, logs: &Path) -> Run {
        Run {
            processes: Vec::new(),
            place: Place::Shared(domain_name(start)),
            logs: logs.to_owned(),
        }
    }

    /// The domain.
    pub fn domain(&self) -> &str {
        match &self.place {
            Place::Shared(name) => name,
            Place::Private(_, domain) => domain.name(),
        }
    }

    /// This process's place on its bus. Drop it, and its ports, before the run.
    ///
    /// # Errors
    /// As [`Bus::open`].
    pub fn join(&self, program: &str) -> Result<Bus, BusError> {
        match &self.place {
            Place::Shared(name) => Bus::open(name, program),
            Place::Private(_, domain) => domain.join(program),
        }
    }

    /// One of Gantry's programs, told its domain and its parent, in a group of its own.
    pub fn program(&self, name: &str, file: &Path) -> Program {
        let program = Program::new(name, file)
            .on_domain(self.domain())
            .with_parent()
            .in_own_group();
        match &self.place {
            Place::Shared(_) => program,
            Place::Private(_, domain) => program.in_folder(domain.folder()),
        }
    }

    /// Starts a program; its log is `NAME.log` in the folder for logs.
    ///
    /// # Errors
    /// As [`Program::start`].
    pub fn start(&mut self, program: Program) -> Result<(), RunError> {
        let log = self.logs.join(format!("{}.log", program.name()));
        self.start_with_log(program, &log)
    }

    /// Starts a program with another log.
    ///
    /// # Errors
    /// As [`Program::start`].
    pub fn start_with_log(&mut self, program: Program, log: &Path) -> Result<(), RunError> {
        self.processes.push(program.start(Output::Log(log))?);
        match &self.place {
            Place::Shared(_) => Ok(()),
            Place::Private(register, domain) => register.write(domain, &self.processes),
        }
    }

    /// Takes a process out of the run.
    fn remove(&mut self, name: &str) -> Option<Process> {
        let at = self.processes.iter().position(|it| it.name() == name)?;
        Some(self.processes.remove(at))
    }

    /// Ends a process, and fails if its exit code is not 0. One that never ran is fine.
    ///
    /// # Errors
    /// As [`Process::finish`].
    pub fn finish(&mut self, name: &str, ending: &Ending) -> Result<(), RunError> {
        match self.remove(name) {
            Some(mut process) => process.finish(ending),
            None => Ok(()),
        }
    }

    /// Ends a process as its program says, whatever its exit code.
    ///
    /// # Errors
    /// As [`Process::end`].
    pub fn end(&mut self, name: &str) -> Result<(), RunError> {
        match self.remove(name) {
            Some(mut process) => process.end().map(drop),
            None => Ok(()),
        }
    }
}

impl Watched for Run {
    fn must_run(&mut self) -> Result<(), RunError> {
        self.processes.iter_mut().try_for_each(Process::must_run)
    }

    fn hint(&self) -> String {
        match (&self.place, self.processes.first()) {
            // The first process is the launcher, which prints what all others say.
            (Place::Shared(_), Some(first)) => first.hint(),
            _ => format!("logs are in {}", self.logs.display()),
        }
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        while let Some(process) = self.processes.pop() {
            drop(process);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;
    use crate::register::{clear, started};

    const NAMING: Naming<'_> = Naming {
        folder: "gantry-test-",
        domain: "t",
        memory: "gt",
    };

    fn with_sleeper(folder: &Path) -> (Run, PathBuf) {
        let register = folder.join("running/a");
        let mut run = Run::private(&NAMING, &register, folder).unwrap();
        let sleeper = Program::new("sleeper", Path::new("/bin/sh"))
            .words(["-c", "echo here; exec sleep 1000"]);
        run.start(sleeper).unwrap();
        (run, register)
    }

    #[test]
    fn what_a_killed_run_left_is_ended_and_removed() {
        let folder = tempfile::tempdir().unwrap();
        let (mut run, register) = with_sleeper(folder.path());
        let Place::Private(_, domain) = &run.place else {
            panic!("the run is private");
        };
        let left = domain.folder().to_owned();
        run.must_run().unwrap();
        clear(&folder.path().join("running"), &NAMING);
        let start = Instant::now();
        while run.must_run().is_ok() && start.elapsed() < Duration::from_secs(60) {
            std::thread::sleep(Duration::from_millis(5));
        }
        let error = run.must_run().unwrap_err().to_string();
        assert!(error.contains("sleeper ended (signal: 9"), "{error}");
        assert!(!left.exists() && !register.exists());
    }

    #[test]
    fn dropping_ends_everything() {
        let folder = tempfile::tempdir().unwrap();
        let (run, register) = with_sleeper(folder.path());
        let pid = run.processes[0].pid().cast_signed();
        assert!(started(pid).is_some());
        drop(run);
        assert_eq!(started(pid), None);
        assert!(!register.exists() && folder.path().join("sleeper.log").exists());
    }
}
