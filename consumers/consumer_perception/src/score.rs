//! Scores programs: from the truth of a scenario and what was captured of each program in it to the
//! runs of a report.
//!
//! The recording of a scenario is read once, tick by tick, for all programs and modes together; only
//! sums, matches and poses are kept. A second look at some ticks draws the worst frames.

mod latency;
mod plan;
mod work;
mod worst;

use std::path::Path;

use consumer_report::Spread;
use consumer_truth::recording::{TickReader, scenario};
use consumer_truth::scenario::Scenario;
use rayon::prelude::*;
use schema_recording::read::RecordingFile;

use crate::capture::{Capture, Mode};
use crate::evidence::moment::Moment;
use crate::evidence::queries::{Answers, Association};
use crate::report::{Counts, Files, Latency, Run, ScenarioRun};
use crate::suite::Suite;
use crate::tasks::{AnyTask, Context, Plan};
use crate::truth_pass::TruthRecording;

use latency::Answered;
pub use plan::check;
use work::{Wanted, Work, is_query};

/// Worst frames of a task that are drawn of each scenario.
const N_WORST: usize = 3;

/// Most events, and frames, of a scenario's time line.
const MAX_EVENTS: usize = 3000;

/// Most sentences about faults that a run keeps.
const MAX_FAULTS: usize = 50;

/// Scores all scenarios of a suite, one after the other.
pub struct Scorer {
    suite: Suite,
    plan: Plan,
    n_scenarios: u32,
    runs: Vec<RunState>,
}

/// What was scored.
#[derive(Debug, Default)]
pub struct Finished {
    /// One for each program, mode and speed, in the order in which they were first seen. Command,
    /// cores, priority and usage are left to who knows them.
    pub runs: Vec<Run>,
    /// What files of other formats need.
    pub files: Files,
}

/// A program in one mode and at one speed.
struct RunState {
    run: Run,
    tasks: Vec<Box<dyn AnyTask>>,
}

impl Scorer {
    /// For a suite.
    ///
    /// # Errors
    /// A sentence if a task asks for something that cannot be scored.
    pub fn new(suite: &Suite) -> anyhow::Result<Scorer> {
        for task in &suite.tasks {
            check(task).map_err(launch_cli::wrong_usage)?;
        }
        let mut delays: Vec<f64> = suite.delays_ms.iter().map(|ms| ms * 1e6).collect();
        delays.push(0.0);
        delays.sort_by(f64::total_cmp);
        delays.dedup();
        Ok(Scorer {
            suite: suite.clone(),
            plan: Plan {
                delays_nanos: delays,
                n_worst: N_WORST,
            },
            n_scenarios: 0,
            runs: Vec::new(),
        })
    }

    /// Scores a scenario: all that was captured of all programs in it. Pictures of the worst frames
    /// go to `pictures/` in `out`, the folder of the report.
    ///
    /// # Errors
    /// A sentence if the recording cannot be read or lacks what a task needs.
    pub fn add(
        &mut self,
        truth: &TruthRecording,
        captures: &[Capture],
        out: &Path,
    ) -> anyhow::Result<()> {
        let index = self.n_scenarios;
        self.n_scenarios += 1;
        let opened = match truth.path.exists() {
            true => {
                let file = RecordingFile::open(&truth.path)?;
                let name = &truth.scenario.name;
                let about = scenario(&file, name, index, "", Some(&truth.rig))?;
                Some((file, about))
            }
            false => None,
        };
        let empty = plan::nothing_recorded(truth, index);
        let about = opened.as_ref().map_or(&empty, |(_, about)| about);
        let mut works = self.works(truth, captures, about)?;
        if let Some((file, about)) = &opened {
            let wanted = plan::wanted(&works_specs(&works), truth, &self.suite);
            self.pass(truth, file, about, &wanted, &mut works)?;
            let mut of_runs: Vec<(usize, ScenarioRun)> = self.scenario_runs(truth, captures);
            self.finish_works(truth, works, &mut of_runs, |work, scored| {
                worst::draw(work, scored, file, about, &wanted, truth, out)
            })?;
            self.keep(of_runs);
        } else {
            let mut of_runs = self.scenario_runs(truth, captures);
            self.finish_works(truth, works, &mut of_runs, |_, _| Ok(Vec::new()))?;
            self.keep(of_runs);
        }
        Ok(())
    }

    /// The run that a capture belongs to, made if there is none yet.
    fn run_of(&mut self, capture: &Capture) -> usize {
        let added_delay_ms = capture.added_delay_nanos as f64 / 1e6;
        let found = self.runs.iter().position(|state| {
            let run = &state.run;
            run.program == capture.program
                && run.mode == capture.mode
                && run.speed == capture.speed
                && run.added_delay_ms == added_delay_ms
        });
        found.unwrap_or_else(|| {
            self.runs.push(RunState {
                run: Run {
                    program: capture.program.clone(),
                    command: Vec::new(),
                    mode: capture.mode,
                    speed: capture.speed,
                    added_delay_ms,
                    cores: Vec::new(),
                    nice: None,
                    scenarios: Vec::new(),
                    scores: Vec::new(),
                    latency: Latency::default(),
                    counts: Counts::default(),
                    usage: Vec::new(),
                    faults: Vec::new(),
                },
                tasks: Vec::new(),
            });
            self.runs.len() - 1
        })
    }

    /// Every task of every capture, ready for the first tick.
    fn works<'a>(
        &mut self,
        truth: &TruthRecording,
        captures: &'a [Capture],
        about: &Scenario,
    ) -> anyhow::Result<Vec<Work<'a>>> {
        let mut works = Vec::new();
        for capture in captures {
            let run = self.run_of(capture);
            if capture.mode == Mode::Stress {
                continue;
            }
            let from_nanos = plan::from_nanos(&self.suite, truth, capture);
            let sent = plan::sent(truth, capture);
            let n_queries =
                truth.end_nanos.saturating_sub(from_nanos) / truth.query_nanos.max(1) + 1;
            for spec in plan::specs(&self.suite, truth, capture) {
                let tasks = &mut self.runs[run].tasks;
                let own = tasks.iter().position(|task| {
                    task.spec().name == spec.name && task.spec().topic == spec.topic
                });
                let mut task = match own {
                    Some(at) => tasks.swap_remove(at),
                    None => plan::task(&spec, capture.mode, &self.plan)
                        .map_err(launch_cli::wrong_usage)?,
                };
                let answers = Answers::of(
                    capture,
                    &sent,
                    &spec.topic,
                    &spec.input,
                    (from_nanos, truth.end_nanos),
                    capture.added_delay_nanos,
                );
                let context = Context {
                    scenario: about,
                    spec: &spec,
                    is_sealed: !self.suite.is_closed_loop(),
                };
                task.begin(&context, answers, n_queries)?;
                works.push(Work {
                    run,
                    capture,
                    task,
                    from_nanos,
                });
            }
        }
        Ok(works)
    }

    /// One pass over the recording.
    fn pass(
        &self,
        truth: &TruthRecording,
        file: &RecordingFile,
        about: &Scenario,
        wanted: &Wanted,
        works: &mut [Work<'_>],
    ) -> anyhow::Result<()> {
        let mut ticks = TickReader::new(file, (0, u64::MAX), &wanted.topics)?;
        let is_night = about.info.weather.sun_altitude_deg < 0.0;
        while let Some(set) = ticks.next_tick()? {
            let mut moment = Moment::new(&set, about.carrier_id, &wanted.views);
            moment.is_night = is_night;
            moment.is_query = is_query(truth, about, set.sim_nanos);
            works.par_iter_mut().for_each(|work| {
                let measured = (work.from_nanos..=truth.end_nanos).contains(&set.sim_nanos);
                work.task.tick(&moment, work.capture, measured);
            });
        }
        let (n_lost, sentences) = ticks.losses();
        anyhow::ensure!(
            n_lost == 0,
            "the truth in {} is damaged: {}",
            truth.path.display(),
            sentences.first().map_or("", String::as_str)
        );
        Ok(())
    }

    /// What can be said about each capture without truth.
    fn scenario_runs(
        &mut self,
        truth: &TruthRecording,
        captures: &[Capture],
    ) -> Vec<(usize, ScenarioRun)> {
        let of = captures.iter().map(|capture| {
            let run = self.run_of(capture);
            let from_nanos = plan::from_nanos(&self.suite, truth, capture);
            let inputs = plan::inputs_by_topic(&self.suite, truth, capture);
            let sent = plan::sent(truth, capture);
            let answered = Answered::of(capture, &sent, &inputs, (from_nanos, truth.end_nanos));
            let others = capture
                .results
                .iter()
                .filter(|result| !inputs.contains_key(&result.topic));
            let n_unreadable = others.count() as u64 + capture.n_refused;
            let timed = capture.mode != Mode::Offline;
            let scenario_run = ScenarioRun {
                scenario: truth.scenario.name.clone(),
                pace: capture.clock.pace().filter(|_| timed),
                latency: answered.latency(),
                counts: answered.tally(n_unreadable),
                throughput: answered.throughput(),
                events: match timed {
                    true => answered.events(truth.begin_nanos, MAX_EVENTS),
                    false => Vec::new(),
                },
                frame_secs: answered.frame_secs(truth.begin_nanos, MAX_EVENTS),
                ..ScenarioRun::default()
            };
            (run, scenario_run)
        });
        of.collect()
    }

    /// Takes the scores of all tasks, and puts the tasks back for the next scenario.
    fn finish_works(
        &mut self,
        truth: &TruthRecording,
        works: Vec<Work<'_>>,
        of_runs: &mut [(usize, ScenarioRun)],
        mut draw: impl FnMut(
            &mut Work<'_>,
            &crate::tasks::Scored,
        ) -> anyhow::Result<Vec<crate::report::WorstFrame>>,
    ) -> anyhow::Result<()> {
        for mut work in works {
            let scored = work.task.end(work.capture)?;
            let worst = draw(&mut work, &scored)?;
            let own = of_runs.iter_mut().find(|(run, _)| *run == work.run);
            if let Some((_, scenario_run)) = own {
                scenario_run.scores.push(scored.score);
                scenario_run.worst.extend(worst);
                scenario_run.counts.n_unreadable += scored.n_unreadable;
                add_association(&mut scenario_run.counts, &scored.association);
            }
            let state = &mut self.runs[work.run];
            if let Some(sentence) = scored.first_fault
                && state.run.faults.len() < MAX_FAULTS
            {
                let name = &truth.scenario.name;
                state.run.faults.push(format!("{name}: {sentence}"));
            }
            state.tasks.push(work.task);
        }
        Ok(())
    }

    fn keep(&mut self, of_runs: Vec<(usize, ScenarioRun)>) {
        for (run, scenario_run) in of_runs {
            add_counts(&mut self.runs[run].run.counts, &scenario_run.counts);
            self.runs[run].run.scenarios.push(scenario_run);
        }
    }

    /// All scenarios together.
    pub fn finish(self) -> Finished {
        let mut finished = Finished::default();
        for mut state in self.runs {
            state.tasks.sort_by_key(|task| {
                let at = self.suite.tasks.iter();
                let mut at = at.take_while(|own| own.name != task.spec().name);
                (at.by_ref().count(), task.spec().topic.clone())
            });
            let mut run = state.run;
            run.scores = state.tasks.iter().map(|task| task.total()).collect();
            let spread = |of: fn(&Latency) -> &Spread| {
                Spread::merged(run.scenarios.iter().map(|scenario| of(&scenario.latency)))
            };
            run.latency = Latency {
                end_to_end: spread(|latency| &latency.end_to_end),
                answer: spread(|latency| &latency.answer),
                work: spread(|latency| &latency.work),
                age_at_use: spread(|latency| &latency.age_at_use),
            };
            for task in &mut state.tasks {
                if let Some(kept) = task.coco() {
                    kept.join(run.file_stem(), &mut finished.files.coco);
                }
            }
            finished.runs.push(run);
        }
        finished
    }
}

fn works_specs<'a>(works: &'a [Work<'_>]) -> Vec<&'a crate::tasks::Spec> {
    works.iter().map(|work| work.task.spec()).collect()
}

fn add_association(counts: &mut Counts, of: &Association) {
    counts.n_queries += of.n_queries;
    counts.miss += of.miss;
    counts.in_time += of.in_time;
    counts.mismatch += of.mismatch;
}

fn add_counts(all: &mut Counts, of: &Counts) {
    all.n_frames += of.n_frames;
    all.n_answered += of.n_answered;
    all.n_results += of.n_results;
    all.n_unreadable += of.n_unreadable;
    all.n_repeated += of.n_repeated;
    all.n_out_of_order += of.n_out_of_order;
    all.n_invented += of.n_invented;
    all.n_lost += of.n_lost;
    all.miss += of.miss;
    all.in_time += of.in_time;
    all.mismatch += of.mismatch;
    all.n_queries += of.n_queries;
}
