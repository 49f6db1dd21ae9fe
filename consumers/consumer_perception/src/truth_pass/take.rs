//! One scenario from the start of its simulator to a whole recording.
//!
//! [`launch_run::take()`] steps and records; here is the launch file of the processes that it needs.

use std::path::Path;
use std::time::Duration;

use launch_run::launched::{LAUNCHER, launcher};
use launch_run::{Run, RunError, Take};
use toml::{Table, Value};

use super::found::Options;
use crate::scenario::Scenario;
use crate::suite::{Suite, SuiteFault};
use crate::up::process_table;

/// Time in which the recorder ends after it was asked to.
const END_WITHIN: Duration = Duration::from_secs(600);

/// The launch file of a truth pass.
///
/// # Errors
/// A sentence if a weather or a time of day is unknown.
pub fn launch(suite: &Suite, scenario: &Scenario, options: &Options) -> Result<Table, SuiteFault> {
    let mut launch = scenario.launch_with_truth(suite)?;
    let mut processes = Table::new();
    let mut words: Vec<Value> = ["simd", "--on-lost-client", "wait"].map(Into::into).into();
    if let Some(adapter) = &options.adapter {
        words.extend(["--adapter".into(), adapter.clone().into()]);
    }
    let simulator: Table = [
        ("cmd", Value::Array(words)),
        ("required", true.into()),
        (
            "ready",
            Value::Table(
                [("service".to_owned(), "world/snapshot".into())]
                    .into_iter()
                    .collect(),
            ),
        ),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .into_iter()
    .collect();
    processes.insert("simd".into(), simulator.into());
    if suite.drive {
        let mut words: Vec<Value> = vec!["gantry-drive".into()];
        if let Some(factor) = suite.speed_factor {
            words.extend(["--speed-factor".into(), format!("{factor:.2}").into()]);
        }
        let driver: Table = [
            ("cmd", Value::Array(words)),
            ("lockstep", true.into()),
            ("required", true.into()),
            ("after", Value::Array(vec!["simd".into()])),
        ]
        .map(|(key, value)| (key.to_owned(), value))
        .into_iter()
        .collect();
        processes.insert("drive".into(), driver.into());
    }
    for process in &suite.input_programs {
        let mut table = process_table(process, true, &["simd"]);
        table.insert("lockstep".into(), true.into());
        table.insert("required".into(), true.into());
        processes.insert(process.name.clone(), table.into());
    }
    launch.insert("process".into(), processes.into());
    Ok(launch)
}

/// What a truth pass needs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Job<'a> {
    pub suite: &'a Suite,
    pub launch: &'a Table,
    /// Folder for logs.
    pub folder: &'a Path,
    /// Where the recording goes.
    pub recording: &'a Path,
    /// Longest time without a finished tick before it counts as hanging.
    pub stall: Duration,
}

/// Runs and records a scenario.
///
/// # Errors
/// [`RunError::Stopped`], or which process failed and what it said.
pub(super) fn record(
    job: &Job<'_>,
    stop: &dyn Fn() -> bool,
    progress: &dyn Fn(u64, u64),
) -> Result<(), RunError> {
    let suite = job.suite;
    let ticks = |secs: f64| (secs * suite.tick_hz).round() as u64;
    let n_before = ticks(suite.settle_s);
    let n_recorded = ticks(suite.warm_up_s + suite.secs).max(1);
    let mut run = Run::shared("bench", job.folder);
    let (launcher, log) = launcher(run.domain(), job.launch, &job.folder.join("up"))?;
    run.start_with_log(launcher, &log)?;
    let wanted = Take {
        client: "bench",
        n_before,
        n_recorded,
        recording: job.recording,
        // Nobody looks at these recordings.
        record_words: &["--previews".to_owned(), "none".to_owned()],
        end_within: END_WITHIN,
        stall: job.stall,
        stop,
        progress: &|done| progress(done, n_before + n_recorded),
    };
    launch_run::take(&mut run, &wanted)?;
    run.end(LAUNCHER)
}
