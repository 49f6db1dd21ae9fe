//! An export from its recordings to the finished folder.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use std::collections::HashSet;
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context as _;
use indicatif::{ProgressBar, ProgressStyle};
use launch_cli::wrong_usage;
use schema_recording::read::RecordingFile;
use serde::Serialize;

use crate::exporter::{DoneScenario, Exporter};
use crate::formats;
use crate::manifest::{Found, Manifest, Recording};
use crate::options::{Options, deal};
use crate::tree::Tree;
use consumer_truth::recording::{TickReader, scenario, scenario_name};
use consumer_truth::scenario::Scenario;
use consumer_truth::ticks::TickSet;

/// What became of an export.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Format.
    pub format: &'static str,
    /// The folder.
    pub out: PathBuf,
    /// Scenarios that are done, in order.
    pub scenarios: Vec<DoneScenario>,
    /// Whether everything is there; `false` after Ctrl-C.
    pub complete: bool,
    /// Things of the recordings that could not be read.
    pub n_lost: u64,
    /// A sentence for each of the first few.
    pub lost: Vec<String>,
}

/// One recording to export, and the name of its scenario if the user gave one.
#[derive(Clone, Debug)]
pub struct Input {
    /// The file.
    pub path: PathBuf,
    /// Name of the scenario; `None`: the file's.
    pub name: Option<String>,
}

/// Exports recordings; `stop` is asked once a tick, and answering `true` ends the export so that it
/// can be continued.
///
/// # Errors
/// A sentence; [`wrong_usage`] for what the caller can mend.
pub fn export(
    inputs: &[Input],
    options: &Options,
    stop: &dyn Fn() -> bool,
) -> anyhow::Result<Report> {
    let mut exporter = formats::exporter(options.format, options)?;
    let (files, scenarios) = open(inputs, options)?;
    for scenario in &scenarios {
        let length_nanos = scenario.end_nanos.saturating_sub(scenario.start_nanos);
        if options.from_nanos > length_nanos {
            return Err(wrong_usage(format!(
                "--from lies behind the end of {}, which is {:.2} s long",
                scenario.name,
                length_nanos as f64 * 1e-9
            )));
        }
        exporter.check(scenario)?;
    }
    let mut manifest = Manifest {
        version: env!("CARGO_PKG_VERSION").into(),
        options: options.clone(),
        recordings: files
            .iter()
            .zip(&scenarios)
            .map(|(file, scenario)| facts(file, scenario))
            .collect(),
        done: Vec::new(),
    };
    match manifest.look(&options.out, options.resume)? {
        Found::Fresh => {}
        Found::Unfinished(found) => manifest.done = found.done,
        Found::Complete(found) => return Ok(report(options, found.done, true, Losses::default())),
    }
    let out = &options.out;
    fs::create_dir_all(out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    let tree = Tree::new(out.clone());
    manifest.save(out)?;
    let bar = progress_bar(&scenarios, options);
    let mut losses = Losses::default();
    for (file, scenario) in files.iter().zip(&scenarios) {
        if (scenario.index as usize) < manifest.done.len() {
            bar.inc(span_ms(scenario, options));
            continue;
        }
        let done = one(
            file,
            scenario,
            options,
            &mut *exporter,
            &manifest.done,
            &tree,
            &bar,
            stop,
            &mut losses,
        )?;
        let Some(done) = done else {
            bar.abandon();
            return Ok(report(options, manifest.done, false, losses));
        };
        manifest.done.push(done);
        manifest.save(out)?;
    }
    exporter.finish(&manifest.done, &tree)?;
    manifest.complete(out)?;
    bar.finish_and_clear();
    Ok(report(options, manifest.done, true, losses))
}

/// What of the recordings could not be read.
#[derive(Default)]
struct Losses {
    n: u64,
    /// A sentence for each of the first few.
    sentences: Vec<String>,
}

fn report(
    options: &Options,
    scenarios: Vec<DoneScenario>,
    complete: bool,
    losses: Losses,
) -> Report {
    Report {
        format: options.format.name(),
        out: options.out.clone(),
        scenarios,
        complete,
        n_lost: losses.n,
        lost: losses.sentences,
    }
}

/// Opens all recordings before anything is written.
fn open(
    inputs: &[Input],
    options: &Options,
) -> anyhow::Result<(Vec<RecordingFile>, Vec<Scenario>)> {
    let mut names: Vec<String> = Vec::new();
    for input in inputs {
        let name = input
            .name
            .clone()
            .unwrap_or_else(|| scenario_name(&input.path));
        let name = match (
            &input.name,
            (2..)
                .map(|n| format!("{name}_{n}"))
                .find(|n| !names.contains(n)),
        ) {
            (None, Some(other)) if names.contains(&name) => other,
            (Some(_), _) if names.contains(&name) => {
                return Err(wrong_usage(format!("two scenarios are called {name:?}")));
            }
            _ => name,
        };
        names.push(name);
    }
    let splits = deal(&names, &options.split, options.split_seed);
    let mut files = Vec::new();
    let mut scenarios = Vec::new();
    for (index, ((input, name), split)) in inputs.iter().zip(&names).zip(&splits).enumerate() {
        let file = RecordingFile::open(&input.path)?;
        let context = || format!("cannot export {}", input.path.display());
        scenarios.push(
            scenario(&file, name, index as u32, split, options.rig.as_deref())
                .with_context(context)?,
        );
        files.push(file);
    }
    Ok((files, scenarios))
}

fn facts(file: &RecordingFile, scenario: &Scenario) -> Recording {
    Recording {
        scenario: scenario.name.clone(),
        split: scenario.split.clone(),
        file_bytes: file.file_bytes(),
        start_nanos: scenario.start_nanos,
        end_nanos: scenario.end_nanos,
        epoch: scenario.info.epoch.clone(),
    }
}

/// First time that is exported, and the first behind it, of a scenario.
fn times(scenario: &Scenario, options: &Options) -> (u64, u64) {
    let from = scenario.start_nanos.saturating_add(options.from_nanos);
    let to = options
        .to_nanos
        .map_or(u64::MAX, |to| scenario.start_nanos.saturating_add(to));
    (from, to)
}

fn span_ms(scenario: &Scenario, options: &Options) -> u64 {
    let (from, to) = times(scenario, options);
    to.min(scenario.end_nanos).saturating_sub(from) / 1_000_000
}

/// A bar on terminals, nothing elsewhere.
fn progress_bar(scenarios: &[Scenario], options: &Options) -> ProgressBar {
    let bar = ProgressBar::new(
        scenarios
            .iter()
            .map(|scenario| span_ms(scenario, options))
            .fold(0, u64::saturating_add),
    );
    let style = ProgressStyle::with_template("{msg} {wide_bar} {percent:>3} %, {eta} left");
    bar.set_style(style.expect("the template is constant"));
    bar
}

/// Exports one scenario; `None` if it was stopped.
#[allow(
    clippy::too_many_arguments,
    reason = "the parts of one export, named where they are used"
)]
fn one(
    file: &RecordingFile,
    scenario: &Scenario,
    options: &Options,
    exporter: &mut dyn Exporter,
    done: &[DoneScenario],
    tree: &Tree,
    bar: &ProgressBar,
    stop: &dyn Fn() -> bool,
    losses: &mut Losses,
) -> anyhow::Result<Option<DoneScenario>> {
    bar.set_message(scenario.name.clone());
    let topics = scenario.sensors.iter().flat_map(|sensor| &sensor.topics);
    let wanted: HashSet<Arc<str>> = topics
        .filter(|topic| exporter.wants(scenario, topic))
        .map(|topic| topic.name.clone())
        .collect();
    let keys = exporter.keys(scenario);
    let mut keyframes = Keyframes {
        keys,
        every: options.every,
        period_nanos: exporter.key_period_nanos(),
        last_nanos: None,
        n_found: 0,
        n_kept: 0,
    };
    let mut reader = TickReader::new(file, times(scenario, options), &wanted)?;
    exporter.begin(scenario, done, tree)?;
    let start = bar.position();
    let (from, _) = times(scenario, options);
    while let Some(mut set) = reader.next_tick()? {
        if stop() {
            return Ok(None);
        }
        keyframes.number(&mut set);
        if options.frames.is_some_and(|most| keyframes.n_kept > most) {
            keyframes.n_kept = keyframes.n_kept.saturating_sub(1);
            break;
        }
        exporter.tick(scenario, &set, tree)?;
        let done_ms = set.sim_nanos.saturating_sub(from) / 1_000_000;
        bar.set_position(start.saturating_add(done_ms));
    }
    let (mut n_lost, mut sentences) = reader.losses();
    if !file.is_complete() {
        n_lost = u64::saturating_add(n_lost, 1);
        sentences.push("the file was cut off; what its end held is missing".into());
    }
    losses.n = losses.n.saturating_add(n_lost);
    losses.sentences.extend(
        sentences
            .into_iter()
            .map(|sentence| format!("{}: {sentence}", scenario.name)),
    );
    if keyframes.n_kept == 0 {
        let needed = match keyframes.keys.join(", ") {
            none if none.is_empty() => "a snapshot".to_string(),
            topics => format!("a snapshot and a frame of each of {topics}"),
        };
        anyhow::bail!(
            "{} has no tick with {needed} in the asked range",
            scenario.name
        );
    }
    let state = exporter.end(scenario, tree)?;
    bar.set_position(start.saturating_add(span_ms(scenario, options)));
    Ok(Some(DoneScenario {
        name: scenario.name.clone(),
        split: scenario.split.clone(),
        n_ticks: keyframes.n_kept,
        state,
    }))
}

/// Which ticks are keyframes.
struct Keyframes {
    keys: Vec<Arc<str>>,
    every: u64,
    period_nanos: u64,
    last_nanos: Option<u64>,
    n_found: u64,
    n_kept: u64,
}

impl Keyframes {
    fn number(&mut self, set: &mut TickSet) {
        let has = |topic: &Arc<str>| set.frames.iter().any(|frame| frame.topic == *topic);
        let complete = set.world.is_some() && self.keys.iter().all(has);
        let is_soon = |last: u64| set.sim_nanos < last.saturating_add(self.period_nanos);
        if !complete || self.last_nanos.is_some_and(is_soon) {
            return;
        }
        self.last_nanos = Some(set.sim_nanos);
        if self.n_found.is_multiple_of(self.every) {
            set.key = Some(self.n_kept);
            self.n_kept = self.n_kept.saturating_add(1);
        }
        self.n_found = self.n_found.saturating_add(1);
    }
}
