//! Why a run cannot go on.

use std::io;
use std::path::PathBuf;
use std::process::ExitStatus;

use schema_bus::{BusError, CommandError};

/// Why a run cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The user asked to stop.
    #[error("stopped")]
    Stopped,
    /// There is no such program.
    #[error(transparent)]
    NoProgram(anyhow::Error),
    /// A program cannot be started.
    #[error("cannot start {}{}", .program.display(), on_cores(.cores))]
    Start {
        /// Its file.
        program: PathBuf,
        /// The cores on which it was to run; empty: all.
        cores: Vec<u32>,
        /// What the system says.
        source: io::Error,
    },
    /// A file cannot be written.
    #[error("cannot write {}", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A folder cannot be made.
    #[error("cannot make the folder {}", .path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The temporary folder of a private domain cannot be made.
    #[error("cannot make a temporary folder")]
    TemporaryFolder(#[source] io::Error),
    /// The system does not say what became of a process.
    #[error("cannot tell whether {name} runs")]
    Unknown {
        /// The process.
        name: String,
        /// What the system says.
        source: io::Error,
    },
    /// A process ended.
    #[error("{name} ended ({status}); it said last:\n  {last}")]
    Ended {
        /// The process.
        name: String,
        /// How.
        status: ExitStatus,
        /// Its last lines.
        last: String,
    },
    /// A process ended whose lines the user has seen.
    #[error("{name} ended {doing} ({status}); its own lines above say why")]
    EndedAbove {
        /// The process.
        name: String,
        /// What it was doing.
        doing: String,
        /// How.
        status: ExitStatus,
    },
    /// A line that was waited for did not come.
    #[error("{name} {how} without saying {wanted:?}; output:\n{output}")]
    Silent {
        /// The process.
        name: String,
        /// Whether it ended or hangs.
        how: String,
        /// What it was to say.
        wanted: String,
        /// What it said.
        output: String,
    },
    /// A condition did not come true in time.
    #[error("{otherwise} within {secs} s")]
    TooLong {
        /// What did not happen, as a sentence.
        otherwise: String,
        /// The time that it had.
        secs: u64,
    },
    /// No tick passed for a long time.
    #[error("nothing has happened for {secs} s; {hint}")]
    Stalled {
        /// The time that it had.
        secs: u64,
        /// Where more is to be seen.
        hint: String,
    },
    /// The simulator did not step as it was told.
    #[error(
        "the simulator was to step to tick {tick} and answered {answer}; somebody else steps it"
    )]
    OtherStepper {
        /// The tick to which it was to step.
        tick: u64,
        /// What it answered.
        answer: String,
    },
    /// The simulator does not answer.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// The bus failed.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// A launch file cannot be written as TOML.
    #[error(transparent)]
    Launch(#[from] toml::ser::Error),
    /// The disk refuses.
    #[error(transparent)]
    Io(#[from] io::Error),
}

fn on_cores(cores: &[u32]) -> String {
    match cores {
        [] => String::new(),
        cores => format!(" on cores {cores:?}"),
    }
}

/// Whether an error says that the user asked to stop.
pub fn is_stopped(error: &anyhow::Error) -> bool {
    matches!(error.downcast_ref(), Some(RunError::Stopped))
}
