//! `[process.NAME]`: what the launcher starts, when it counts as ready, and what happens when it
//! ends.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::period::Period;

/// One process.
#[derive(Clone, Debug, PartialEq)]
pub struct Process {
    /// Its name in the file, its log prefix and its log file.
    pub name: String,
    /// Program and arguments, no shell. `${run_dir}`, `${name}`, `${domain}`, `${launch}`,
    /// `${params}` and `${params_file}` are replaced.
    pub cmd: Vec<String>,
    /// Folder in which it runs; without it, the launcher's own. A relative path begins in the
    /// folder of the file that says it.
    pub cwd: Option<PathBuf>,
    /// Virtual environment of Python whose programs come first. A relative path begins in the
    /// folder of the file that says it.
    pub venv: Option<PathBuf>,
    /// Whether its end stops all processes; the launcher then ends with its exit code.
    pub required: bool,
    /// When the processes that come after it may start; without it, at once.
    pub ready: Option<Ready>,
    /// Processes that must be ready before it starts.
    pub after: Vec<String>,
    /// What happens when it ends by itself.
    pub restart: Restart,
    /// How it is asked to end.
    pub stop: Stop,
    /// Environment on top of the launcher's; `${run_dir}`, `${name}`, `${domain}` and `${launch}` are
    /// replaced.
    pub env: BTreeMap<String, String>,
    /// Processor cores it may run on, from 0; empty: those of the launcher.
    pub cores: Vec<u32>,
    /// Scheduling priority, −20 (first) to 19 (last); without it, the launcher's.
    pub nice: Option<i32>,
    /// Whether it takes part in lockstep under its name. The first tick waits until it has joined.
    pub lockstep: bool,
    /// Settings of its own, which it is given as JSON: where `cmd` has `${params}` (the text) or
    /// `${params_file}` (the path of a file), else as its last argument.
    pub params: Option<toml::Table>,
}

impl Process {
    /// Whether this process publishes the world, whose ticks the others follow: the simulator, or a
    /// recording in its place.
    pub fn is_daemon(&self) -> bool {
        self.is_simulator() || self.runs("gantry-replay")
    }

    /// Whether this process is the simulator, which makes the sensors of the launch file.
    pub fn is_simulator(&self) -> bool {
        self.runs("simd")
    }

    fn runs(&self, program: &str) -> bool {
        self.cmd.first().is_some_and(|path| {
            Path::new(path)
                .file_name()
                .is_some_and(|name| name == program)
        })
    }
}

/// When a process counts as ready.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ready {
    /// The sign to wait for.
    pub when: ReadyWhen,
    /// Longest wait. Then the run fails.
    pub within: Period,
}

/// Time in which a process must become ready, or join lockstep, if the file says no other. It is
/// long because the first start on a software adapter builds a town and shaders.
pub const READY_WITHIN: Period = Period::from_millis(180_000);

/// A sign of readiness.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ReadyWhen {
    /// This topic (named without the domain) has a living publisher.
    Service(String),
    /// A line of its output matches this regular expression.
    Line(String),
    /// This `host:port` accepts a connection.
    Tcp(String),
    /// Nothing but its place in lockstep, which it has to take in any case.
    Lockstep,
}

/// What happens when a process ends by itself.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Restart {
    /// When to start it again.
    pub policy: RestartPolicy,
    /// Pause before the first restart.
    pub delay: Period,
    /// Every further pause is this many times as long.
    pub factor: f64,
    /// Longest pause.
    pub max_delay: Period,
    /// Most restarts within `window`; one more stops all processes.
    pub max: u32,
    /// Time over which `max` counts. A process that ran longer than this is restarted after `delay`.
    pub window: Period,
}

impl Default for Restart {
    fn default() -> Self {
        Restart {
            policy: RestartPolicy::Never,
            delay: Period::from_millis(500),
            factor: 2.0,
            max_delay: Period::from_millis(10_000),
            max: 5,
            window: Period::from_millis(60_000),
        }
    }
}

/// When a process is started again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RestartPolicy {
    /// Never.
    #[default]
    Never,
    /// After a signal or an exit code other than 0.
    OnFailure,
    /// Whenever it ends.
    Always,
}

/// How a process is asked to end: it gets `signal`, TERM after `grace`, and KILL two seconds later,
/// each sent to its whole process group.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Stop {
    /// First signal.
    pub signal: StopSignal,
    /// Time it has to end after the first signal.
    pub grace: Period,
}

impl Default for Stop {
    fn default() -> Self {
        Stop {
            signal: StopSignal::Int,
            grace: Period::from_millis(5_000),
        }
    }
}

/// A signal that asks a process to end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum StopSignal {
    /// SIGINT, as Ctrl-C sends.
    #[default]
    Int,
    /// SIGTERM.
    Term,
    /// SIGHUP.
    Hup,
    /// SIGQUIT.
    Quit,
    /// SIGKILL, which leaves no time to clean up.
    Kill,
}
