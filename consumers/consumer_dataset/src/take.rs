//! One scenario from the start of its simulator to a whole recording.
//!
//! [`launch_run::take()`] steps and records; here are the processes that it needs.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context as _;
use launch_cli::programs::find;
use launch_run::{Ending, Naming, Run, RunError, Take, take};

use crate::matrix::Scenario;

/// By what the domains of scenarios are known.
pub const NAMING: Naming<'static> = Naming {
    folder: "gantry-set-",
    domain: "set",
    memory: "gs",
};
/// Time in which processes end that were asked to.
const END_WITHIN: Duration = Duration::from_secs(60);
/// The driver's name in lockstep.
const DRIVER: &str = "drive";

/// Where the programs are.
#[derive(Clone, Debug)]
pub struct Programs {
    /// `simd`.
    pub simd: PathBuf,
    /// `gantry-drive`.
    pub drive: PathBuf,
    /// `gantry-export`.
    pub export: PathBuf,
}

impl Programs {
    /// Looks for the programs beside this one, then on `PATH`.
    ///
    /// # Errors
    /// If one is missing.
    pub fn find() -> anyhow::Result<Programs> {
        Ok(Programs {
            simd: find("simd")?,
            drive: find("gantry-drive")?,
            export: find("gantry-export")?,
        })
    }
}

/// What a scenario needs to run.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// The scenario.
    pub scenario: &'a Scenario,
    /// Its launch file's text.
    pub launch: &'a str,
    /// File in which it is written down which processes run.
    pub register: &'a Path,
    /// Folder for logs and the unfinished recording.
    pub folder: &'a Path,
    /// Where the finished recording goes.
    pub recording: &'a Path,
    /// Words for `simd` besides its own.
    pub simd_words: &'a [String],
    /// Words for `gantry-record` besides its own.
    pub record_words: &'a [String],
    /// Longest time without a finished tick before it counts as hanging.
    pub stall: Duration,
}

/// Runs and records a scenario. `stop` is asked several times a second and ends it; `progress` is
/// told the ticks that are done, warm-up included.
///
/// # Errors
/// [`RunError::Stopped`](launch_run::RunError::Stopped), or which process failed and what it said.
pub fn record(
    job: &Job<'_>,
    programs: &Programs,
    stop: &dyn Fn() -> bool,
    progress: &dyn Fn(u64),
) -> anyhow::Result<()> {
    // What an earlier attempt left must not be mistaken for this one's.
    let _ = fs::remove_dir_all(job.folder);
    fs::create_dir_all(job.folder)
        .with_context(|| format!("cannot make the folder {}", job.folder.display()))?;
    let launch = job.folder.join("launch.toml");
    fs::write(&launch, job.launch)?;
    let mut run = Run::private(&NAMING, job.register, job.folder)?;
    start_simulator(&mut run, job, programs, &launch)?;
    let part = job.folder.join("recording.mcap");
    let wanted = Take {
        client: "dataset",
        n_before: job.scenario.warm_up_ticks,
        n_recorded: job.scenario.frames,
        recording: &part,
        record_words: job.record_words,
        end_within: END_WITHIN,
        stall: job.stall,
        stop,
        progress,
    };
    take(&mut run, &wanted)?;
    for name in ["gantry-drive", "simd"] {
        run.finish(name, &Ending::term(END_WITHIN))?;
    }
    if let Some(folder) = job.recording.parent() {
        fs::create_dir_all(folder)?;
    }
    launch_cli::files::rename(&part, job.recording)
        .with_context(|| format!("cannot move the recording to {}", job.recording.display()))
}

fn start_simulator(
    run: &mut Run,
    job: &Job<'_>,
    programs: &Programs,
    launch: &Path,
) -> Result<(), RunError> {
    let mut simulator = run
        .program("simd", &programs.simd)
        .words(["--launch".as_ref(), launch])
        // Nobody ticks this world but this program.
        .words(["--on-lost-client", "wait"])
        .words(job.simd_words);
    if !job.scenario.drive {
        return run.start(simulator);
    }
    simulator = simulator.words(["--await-participant", DRIVER]);
    run.start(simulator)?;
    let driver = run
        .program("gantry-drive", &programs.drive)
        .words([format!("--lockstep={DRIVER}")]);
    run.start(driver)
}
