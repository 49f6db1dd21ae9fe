//! A set from its recipe to the finished folder.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use launch_cli::{WrongUsage, wrong_usage};
use launch_run::{RunError, is_stopped, register};
use parking_lot::Mutex;

use crate::digest::{MANIFEST, hash_set};
use crate::estimate::{Estimate, Room, size};
use crate::matrix::{Scenario, scenarios};
use crate::recipe::Recipe;
use crate::state::{Found, Plan, SetFolder, replace};
use crate::statistics::{Statistics, count};
use crate::take::{Job, NAMING, Programs, record};
use crate::{exports, launch, page};

/// Wait before the first new attempt; it doubles with each.
const FIRST_PAUSE: Duration = Duration::from_secs(1);
/// Longest wait between two attempts.
const LONGEST_PAUSE: Duration = Duration::from_secs(60);
/// How often a wait looks whether it shall end.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// How a set is made.
#[derive(Clone, Debug)]
pub struct Options {
    /// Scenarios beside one another; `None`: as many as cores and memory allow.
    pub jobs: Option<usize>,
    /// New attempts of a scenario or an export that failed.
    pub retries: u32,
    /// Make it although it does not seem to fit.
    pub anyway: bool,
    /// Longest time without a finished tick.
    pub stall: Duration,
    /// GPU for the simulators, as `simd --adapter` takes it.
    pub adapter: Option<String>,
}

/// What became of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The set is finished; it has so many files.
    Finished {
        /// Files in its manifest.
        n_files: usize,
        /// Their bytes.
        n_bytes: u64,
    },
    /// It was finished before.
    AlreadyFinished,
    /// The user stopped it; the same command goes on.
    Stopped {
        /// Scenarios that are recorded.
        n_recorded: usize,
    },
    /// These scenarios or exports failed again and again: name and reason.
    Failed(Vec<(String, String)>),
}

/// A recipe with everything that follows from it.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// The plan.
    pub plan: Plan,
    /// What it will cost.
    pub estimate: Estimate,
}

/// Reads a recipe and checks every scenario as the simulator will.
///
/// # Errors
/// [`wrong_usage`] for everything that the recipe has wrong.
pub fn prepare(file: &Path) -> anyhow::Result<Prepared> {
    let recipe = Recipe::read(file)?;
    let shown = file.display();
    let scenarios = scenarios(&recipe).map_err(|error| wrong_usage(format!("{shown}: {error}")))?;
    let folder = file.parent().unwrap_or(Path::new(""));
    let mut launches = Vec::with_capacity(scenarios.len());
    let mut estimate = Estimate::default();
    for scenario in &scenarios {
        let text = launch::text(&recipe, scenario, folder)?;
        let launch = launch::check(&text, scenario)?;
        estimate.add(scenario, &launch, recipe.export.len());
        launches.push(text);
    }
    Ok(Prepared {
        plan: Plan {
            version: env!("CARGO_PKG_VERSION").into(),
            recipe,
            scenarios,
            launches,
        },
        estimate,
    })
}

/// Makes a set in `out`, or goes on with it.
///
/// # Errors
/// [`wrong_usage`] for what the caller can mend, or if the disk refuses. Scenarios that fail are no
/// error but [`Outcome::Failed`].
pub fn make(
    prepared: &Prepared,
    out: &Path,
    options: &Options,
    stop: &(dyn Fn() -> bool + Sync),
) -> anyhow::Result<Outcome> {
    let plan = &prepared.plan;
    let set = SetFolder::new(out)?;
    let room = Room::look(out);
    let jobs = prepared
        .estimate
        .jobs(options.jobs, plan.scenarios.len(), &room);
    let found = set.look(plan)?;
    if found == Found::Finished {
        set.finish(plan)?;
        return Ok(Outcome::AlreadyFinished);
    }
    let programs = Programs::find()?;
    if found == Found::Fresh {
        if !options.anyway {
            prepared.estimate.check(jobs, &room, out)?;
        }
        set.begin(plan)?;
    }
    register::clear(&set.registers(), &NAMING);
    let n_done = plan
        .scenarios
        .iter()
        .filter(|it| set.done(it).is_some())
        .count();
    tracing::info!(
        scenarios = plan.scenarios.len(),
        recorded = n_done,
        jobs,
        disk = size(prepared.estimate.disk_bytes),
        free = size(room.disk_bytes),
        "making {}",
        out.display()
    );
    let work = Work {
        plan,
        set: &set,
        programs: &programs,
        options,
        stop,
        usage_error: AtomicBool::new(false),
    };
    let mut failed = work.record_all(jobs);
    if stop() {
        let n_recorded = plan
            .scenarios
            .iter()
            .filter(|it| set.done(it).is_some())
            .count();
        return Ok(Outcome::Stopped { n_recorded });
    }
    if failed.is_empty() {
        failed = work.export_all();
        if stop() {
            let n_recorded = plan.scenarios.len();
            return Ok(Outcome::Stopped { n_recorded });
        }
    }
    if !failed.is_empty() {
        if work.usage_error.load(Ordering::Relaxed) {
            let (name, reason) = &failed[0];
            return Err(wrong_usage(format!("{name}: {reason}")));
        }
        return Ok(Outcome::Failed(failed));
    }
    work.finish()
}

/// Everything that the threads share.
struct Work<'a> {
    plan: &'a Plan,
    set: &'a SetFolder,
    programs: &'a Programs,
    options: &'a Options,
    stop: &'a (dyn Fn() -> bool + Sync),
    /// Whether something failed in a way that no attempt will mend.
    usage_error: AtomicBool,
}

impl Work<'_> {
    /// Records every scenario that is not done, `jobs` at a time; returns those that failed.
    fn record_all(&self, jobs: usize) -> Vec<(String, String)> {
        let todo: VecDeque<(usize, &Scenario)> = self
            .plan
            .scenarios
            .iter()
            .enumerate()
            .filter(|(_, scenario)| self.set.done(scenario).is_none())
            .collect();
        let n_ticks = |it: &Scenario| it.frames + it.warm_up_ticks;
        let bar = progress_bar(self.plan.scenarios.iter().map(n_ticks).sum(), "ticks");
        let left: u64 = todo.iter().map(|(_, it)| n_ticks(it)).sum();
        bar.set_position(bar.length().unwrap_or(0) - left);
        let todo = Mutex::new(todo);
        let failed = Mutex::new(Vec::new());
        std::thread::scope(|scope| {
            for _ in 0..jobs {
                scope.spawn(|| {
                    while let Some((index, scenario)) = next(&todo) {
                        if (self.stop)() {
                            return;
                        }
                        let outcome = self
                            .attempts(&scenario.name, &|| self.record_one(index, scenario, &bar));
                        if let Err(error) = outcome {
                            self.note_failure(&failed, &scenario.name, &error);
                        }
                    }
                });
            }
        });
        bar.finish_and_clear();
        failed.into_inner()
    }

    fn record_one(
        &self,
        index: usize,
        scenario: &Scenario,
        bar: &ProgressBar,
    ) -> anyhow::Result<()> {
        let began = Instant::now();
        let name = &scenario.name;
        let recording = self.set.recording(scenario);
        let simd_words: Vec<String> = match &self.options.adapter {
            Some(adapter) => vec!["--adapter".into(), adapter.clone()],
            None => vec![],
        };
        // Pictures for people are worth their time only in recordings that stay.
        let record_words: &[String] = match self.plan.recipe.keep_recordings {
            true => &[],
            false => &["--previews".into(), "none".into()],
        };
        let job = Job {
            scenario,
            launch: &self.plan.launches[index],
            register: &self.set.registers().join(format!("{name}.json")),
            folder: &self.set.running(name),
            recording: &recording,
            simd_words: &simd_words,
            record_words,
            stall: self.options.stall,
        };
        let told = AtomicU64::new(0);
        let progress = |done: u64| bar.inc(done - told.swap(done, Ordering::Relaxed));
        let ticks = scenario.warm_up_ticks + 1..=scenario.warm_up_ticks + scenario.frames;
        let outcome = record(&job, self.programs, &self.stop, &progress)
            .and_then(|()| count(&recording, name, ticks, &self.stop))
            .and_then(|found| self.set.set_done(scenario, &found).map(|()| found));
        match outcome {
            Ok(found) => {
                let _ = std::fs::remove_dir_all(job.folder);
                let secs = began.elapsed().as_secs();
                bar.suspend(|| {
                    tracing::info!(objects = found.seen(), secs, "recorded {name}");
                });
                Ok(())
            }
            Err(error) => {
                // A new attempt passes the same ticks again.
                let told = told.load(Ordering::Relaxed);
                bar.set_position(bar.position().saturating_sub(told));
                Err(error)
            }
        }
    }

    /// Runs every export, one after the other: each uses all cores.
    fn export_all(&self) -> Vec<(String, String)> {
        let exports = &self.plan.recipe.export;
        let failed = Mutex::new(Vec::new());
        let bar = progress_bar(exports.len() as u64, "formats");
        for export in exports {
            if (self.stop)() {
                break;
            }
            bar.set_message(format!("exporting {}", export.format));
            let job = exports::Job {
                set: self.set,
                recipe: &self.plan.recipe,
                scenarios: &self.plan.scenarios,
                export,
                program: &self.programs.export,
            };
            match self.attempts(&export.format, &|| job.run(&self.stop)) {
                Ok(()) => bar.suspend(|| tracing::info!("exported {}", export.format)),
                Err(error) => self.note_failure(&failed, &export.format, &error),
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        failed.into_inner()
    }

    /// Tries until it works, up to the retries that were asked for, with longer and longer pauses.
    fn attempts(&self, name: &str, work: &dyn Fn() -> anyhow::Result<()>) -> anyhow::Result<()> {
        let mut pause = FIRST_PAUSE;
        let mut n_failed = 0;
        loop {
            let error = match work() {
                Ok(()) => return Ok(()),
                Err(error) => error,
            };
            let is_final = is_stopped(&error) || error.chain().any(|it| it.is::<WrongUsage>());
            n_failed += 1;
            if is_final || n_failed > self.options.retries {
                return Err(error);
            }
            tracing::warn!(
                attempt = n_failed,
                of = self.options.retries + 1,
                "{name} failed and is begun anew in {} s: {error:#}",
                pause.as_secs()
            );
            let since = Instant::now();
            while since.elapsed() < pause {
                if (self.stop)() {
                    return Err(RunError::Stopped.into());
                }
                std::thread::sleep(LOOK_EVERY);
            }
            pause = (pause * 2).min(LONGEST_PAUSE);
        }
    }

    fn note_failure(
        &self,
        failed: &Mutex<Vec<(String, String)>>,
        name: &str,
        error: &anyhow::Error,
    ) {
        if is_stopped(error) {
            return;
        }
        if error.chain().any(|it| it.is::<WrongUsage>()) {
            self.usage_error.store(true, Ordering::Relaxed);
        }
        failed.lock().push((name.to_owned(), format!("{error:#}")));
    }

    /// Writes the summary and the manifest, and removes what is not needed any more.
    fn finish(&self) -> anyhow::Result<Outcome> {
        let found = self.plan.scenarios.iter().map(|scenario| {
            self.set.done(scenario).ok_or_else(|| {
                anyhow::anyhow!(
                    "the recording of {} is gone; the same command makes it again",
                    scenario.name
                )
            })
        });
        let found: Vec<Statistics> = found.collect::<anyhow::Result<_>>()?;
        let summary = page::summary(&self.plan.recipe, &self.plan.scenarios, &found);
        let json = serde_json::to_string_pretty(&summary)? + "\n";
        replace(&self.set.path("summary.json"), &json)?;
        replace(&self.set.path("index.html"), &page::html(&summary, &found))?;
        let manifest = hash_set(self.set.root())?;
        let text = serde_json::to_string_pretty(&manifest)? + "\n";
        replace(&self.set.path(MANIFEST), &text)?;
        self.set.finish(self.plan)?;
        Ok(Outcome::Finished {
            n_files: manifest.files.len(),
            n_bytes: manifest.files.values().map(|entry| entry.bytes).sum(),
        })
    }
}

fn next<'a>(todo: &Mutex<VecDeque<(usize, &'a Scenario)>>) -> Option<(usize, &'a Scenario)> {
    todo.lock().pop_front()
}

/// A bar on terminals, nothing elsewhere.
fn progress_bar(n: u64, unit: &str) -> ProgressBar {
    let bar = ProgressBar::new(n);
    let template = format!("{{msg}} {{wide_bar}} {{pos}}/{{len}} {unit}, {{eta}} left");
    let style = ProgressStyle::with_template(&template);
    bar.set_style(style.expect("the template is constant"));
    bar
}
