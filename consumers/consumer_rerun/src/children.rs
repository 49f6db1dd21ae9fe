//! The programs that a new run needs: the simulator, and a recorder if it is recorded. They end with
//! this program, whatever ends it.

use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::Context as _;
use launch_cli::CommonArgs;
use launch_cli::programs::find;
use launch_run::{Ending, Output, Process, Program};

/// How long a program may take to end after it was asked.
const GRACE: Duration = Duration::from_secs(20);

/// Starts `name`, one of Gantry's programs, found beside this one or on `PATH`. Its log lines go where
/// this program's go.
///
/// # Errors
/// If it is not there or cannot be started.
pub fn start(name: &str, args: &[String], common: &CommonArgs) -> anyhow::Result<Process> {
    let loudness = match (common.verbose, common.quiet) {
        (0, quiet) => vec!["-q"; usize::from(quiet) + 1],
        (verbose, _) => vec!["-v"; usize::from(verbose) - 1],
    };
    let program = Program::new(name, &find(name)?)
        .words(args)
        .on_domain(&common.domain)
        .with_parent()
        .words(loudness)
        .ends_by(Ending::term(GRACE));
    Ok(program.start(Output::Shared)?)
}

/// The names of the GPUs that the simulator finds.
///
/// # Errors
/// If the simulator cannot be asked.
pub fn adapters() -> anyhow::Result<Vec<String>> {
    #[derive(serde::Deserialize)]
    struct Adapter {
        name: String,
    }
    let program = find("simd")?;
    let answer = Command::new(&program)
        .args(["--adapters", "--json", "-qq"])
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .output()
        .with_context(|| format!("cannot start {}", program.display()))?;
    let text = String::from_utf8_lossy(&answer.stdout);
    Ok(text
        .lines()
        .filter_map(|line| serde_json::from_str(line).ok())
        .map(|adapter: Adapter| adapter.name)
        .collect())
}
