//! What is started: a program with its words and its surroundings.

#![expect(
    unsafe_code,
    reason = "work between fork and exec; each block proves itself"
)]

use std::ffi::OsStr;
use std::fs::File;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use nix::errno::Errno;
use nix::sys::signal::Signal;

use crate::error::RunError;
use crate::process::{Ending, Process, Said};

/// How many lines are quoted when a process fails.
const QUOTED_LINES: usize = 5;

/// Where the lines of a process go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output<'a> {
    /// Into a file, which is made anew.
    Log(&'a Path),
    /// Its log lines go where this process's go; what it prints to stdout is dropped.
    Shared,
    /// They are collected in memory, see [`Process::lines`].
    Collected,
}

/// A program that shall run.
#[derive(Debug)]
pub struct Program {
    name: String,
    command: Command,
    ending: Ending,
    n_quoted: usize,
    cores: Vec<u32>,
}

impl Program {
    /// The program in `file`; sentences call it `name`. It reads nothing, and is killed when its
    /// [`Process`] is dropped.
    pub fn new(name: impl Into<String>, file: &Path) -> Program {
        let mut command = Command::new(file);
        command.stdin(Stdio::null());
        Program {
            name: name.into(),
            command,
            ending: Ending::kill(),
            n_quoted: QUOTED_LINES,
            cores: Vec::new(),
        }
    }

    /// Adds words to its command line.
    pub fn words<I: IntoIterator<Item = S>, S: AsRef<OsStr>>(mut self, words: I) -> Program {
        self.command.args(words);
        self
    }

    /// Gives it, one of Gantry's programs, a domain.
    pub fn on_domain(self, domain: &str) -> Program {
        self.words(["--domain", domain])
    }

    /// Has it, one of Gantry's programs, end when this process dies.
    pub fn with_parent(self) -> Program {
        self.words(["--parent", &std::process::id().to_string()])
    }

    /// Gives it a working folder.
    pub fn in_folder(mut self, folder: &Path) -> Program {
        self.command.current_dir(folder);
        self
    }

    /// Sets variables besides those of this process.
    pub fn variables<I, K, V>(mut self, variables: I) -> Program
    where
        I: IntoIterator<Item = (K, V)>,
        K: AsRef<OsStr>,
        V: AsRef<OsStr>,
    {
        self.command.envs(variables);
        self
    }

    /// Keeps a variable of this process from it.
    pub fn without_variable(mut self, variable: &str) -> Program {
        self.command.env_remove(variable);
        self
    }

    /// Puts it into a group of its own: Ctrl-C on the terminal is for this process, which ends the
    /// others in order.
    pub fn in_own_group(mut self) -> Program {
        self.command.process_group(0);
        self
    }

    /// How its process is ended when it is dropped.
    pub fn ends_by(mut self, ending: Ending) -> Program {
        self.ending = ending;
        self
    }

    /// Pins it to cores, unless there are none, and sets its priority. It gets SIGTERM when the
    /// *thread* that starts it ends, so start it from one that outlives it.
    pub fn tied_to_thread(mut self, cores: &[u32], nice: Option<i32>) -> Program {
        self.cores = cores.to_vec();
        prepare(&mut self.command, cores, nice);
        self
    }

    /// Its name in sentences.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// How many lines an early end quotes.
    pub fn quotes_lines(mut self, n: usize) -> Program {
        self.n_quoted = n;
        self
    }

    /// Its file.
    fn file(&self) -> PathBuf {
        self.command.get_program().into()
    }

    /// Starts it.
    ///
    /// # Errors
    /// [`RunError::Start`], or if the log cannot be written.
    pub fn start(mut self, output: Output<'_>) -> Result<Process, RunError> {
        match output {
            Output::Log(path) => {
                let log = |path: &Path| {
                    let out = File::create(path)?;
                    Ok((out.try_clone()?, out))
                };
                let (out, err) = log(path).map_err(|source| RunError::Write {
                    path: path.to_owned(),
                    source,
                })?;
                self.command.stdout(out).stderr(err).env("NO_COLOR", "1");
            }
            Output::Shared => drop(self.command.stdout(Stdio::null())),
            Output::Collected => drop(self.command.env("NO_COLOR", "1")),
        }
        tracing::debug!(command = ?self.command, "starting");
        let (name, ending, n_quoted) = (self.name.clone(), self.ending.clone(), self.n_quoted);
        let (child, said) = match output {
            Output::Log(path) => (self.spawn()?, Said::Log(path.to_owned())),
            Output::Shared => (self.spawn()?, Said::Above),
            Output::Collected => {
                let mut child = self.spawn_piped()?;
                let said = Said::collect(&mut child);
                (child, said)
            }
        };
        Ok(Process {
            name,
            child,
            said,
            ending,
            n_quoted,
            status: None,
        })
    }

    /// Starts it with pipes for stdout and stderr, for a supervisor that reads and waits itself.
    ///
    /// # Errors
    /// [`RunError::Start`].
    pub fn spawn_piped(mut self) -> Result<Child, RunError> {
        self.command.stdout(Stdio::piped()).stderr(Stdio::piped());
        self.spawn()
    }

    fn spawn(mut self) -> Result<Child, RunError> {
        self.command.spawn().map_err(|source| RunError::Start {
            program: self.file(),
            cores: self.cores,
            source,
        })
    }
}

/// If the parent is killed, its child gets SIGTERM. Pins it to its cores, and sets its priority.
fn prepare(command: &mut Command, cores: &[u32], nice: Option<i32>) {
    let parent = nix::unistd::getpid();
    let mask = core_mask(cores);
    let prepare = move || {
        nix::sys::prctl::set_pdeathsig(Signal::SIGTERM)?;
        if nix::unistd::getppid() != parent {
            // Without this check, a parent that dies between fork and prctl would leave the child
            // running.
            return Err(Errno::ESRCH.into());
        }
        if let Some(nice) = nice {
            // SAFETY: the call takes three numbers; 0 means the calling process.
            let failed = unsafe { libc::setpriority(libc::PRIO_PROCESS, 0, nice) } != 0;
            if failed {
                return Err(std::io::Error::last_os_error());
            }
        }
        match mask {
            // SAFETY: the set is a live value of the size given; 0 means the calling process.
            Some(mask)
                if unsafe { libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), &mask) }
                    != 0 =>
            {
                Err(std::io::Error::last_os_error())
            }
            _ => Ok(()),
        }
    };
    // SAFETY: `prepare` runs in the child between fork and exec. It makes only the system calls
    // prctl, getppid, setpriority and sched_setaffinity, which are async-signal-safe; it allocates
    // nothing and takes no lock.
    unsafe { command.pre_exec(prepare) };
}

fn core_mask(cores: &[u32]) -> Option<libc::cpu_set_t> {
    if cores.is_empty() {
        return None;
    }
    // SAFETY: a CPU set is an array of integers; all zero is the empty set.
    let mut mask: libc::cpu_set_t = unsafe { std::mem::zeroed() };
    for core in cores
        .iter()
        .map(|core| *core as usize)
        .filter(|core| *core < libc::CPU_SETSIZE as usize)
    {
        // SAFETY: the index was checked against the size of the set.
        unsafe { libc::CPU_SET(core, &mut mask) };
    }
    Some(mask)
}
