//! What two reports have in common: whether they may be compared, which runs and scenarios belong
//! together, and the values of each metric by scenario.

use crate::capture::Mode;
use crate::report::metrics;
use crate::report::rows::{SHOWN_DELAY_MS, at_delay};
use crate::report::types::{Report, Run, ScenarioRun, TaskScore};

/// Why two reports cannot be compared, a few words each; empty if they can.
pub fn reasons_against(a: &Report, b: &Report) -> Vec<String> {
    let mut reasons = Vec::new();
    if a.suite != b.suite {
        reasons.push(format!(
            "they are of the suites {:?} and {:?}",
            a.suite, b.suite
        ));
    }
    if a.seed != b.seed {
        reasons.push(format!("their seeds are {} and {}", a.seed, b.seed));
    }
    for one in &a.scenarios {
        match b.scenarios.iter().find(|other| other.name == one.name) {
            None => reasons.push(format!("the second has no scenario {:?}", one.name)),
            Some(other) if one.frames_hash != other.frames_hash => {
                reasons.push(format!("the frames of {:?} differ", one.name));
            }
            Some(other) if one.query_hz != other.query_hz => reasons.push(format!(
                "truth was asked for {} and {} times a second in {:?}",
                one.query_hz, other.query_hz, one.name
            )),
            Some(_) => {}
        }
    }
    let missing = |it: &&crate::report::types::ScenarioInfo| {
        a.scenarios.iter().all(|one| one.name != it.name)
    };
    for other in b.scenarios.iter().filter(missing) {
        reasons.push(format!("the first has no scenario {:?}", other.name));
    }
    if reasons.is_empty() && a.suite_hash != b.suite_hash {
        let why = if a.build == b.build {
            "the suite's text"
        } else {
            "the build of Gantry"
        };
        reasons.push(format!("the hash of suite, build and seed differs ({why})"));
    }
    reasons
}

/// Scenarios that both have, in the order of the first.
pub fn scenarios(a: &Report, b: &Report) -> Vec<String> {
    let both = a
        .scenarios
        .iter()
        .filter(|one| b.scenarios.iter().any(|it| it.name == one.name));
    both.map(|one| one.name.clone()).collect()
}

/// Runs of the same program, mode, speed and delay; `renamed` says which program of the first is
/// which of the second where their names differ.
pub fn runs<'a>(
    a: &'a Report,
    b: &'a Report,
    renamed: &[(String, String)],
) -> Vec<(&'a Run, &'a Run)> {
    let mut pairs = Vec::new();
    for run in &a.runs {
        let names: Vec<&str> = match renamed.iter().any(|(from, _)| *from == run.program) {
            true => renamed
                .iter()
                .filter(|(from, _)| *from == run.program)
                .map(|(_, to)| to.as_str())
                .collect(),
            false => vec![run.program.as_str()],
        };
        for name in names {
            let same = |it: &&Run| {
                it.program == name
                    && it.mode == run.mode
                    && it.speed == run.speed
                    && it.added_delay_ms == run.added_delay_ms
            };
            pairs.extend(b.runs.iter().find(same).map(|other| (run, other)));
        }
    }
    pairs
}

/// A metric of a run: what it is called, which direction is better, and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Metric {
    /// The task, or `latency`, `queries`, `resources`.
    pub group: String,
    /// Its name within the group.
    pub name: String,
    /// Whether more of it is better, if that is known.
    pub higher_is_better: Option<bool>,
    place: Place,
}

#[derive(Clone, Debug, PartialEq)]
enum Place {
    Score {
        task: String,
        topic: String,
        name: String,
        is_streaming: bool,
    },
    Delayed {
        task: String,
        topic: String,
    },
    Latency {
        kind: usize,
        part: usize,
    },
    Miss,
    InTime,
    Mismatch,
    Cpu,
    Memory,
}

/// Parts of a distribution that are compared.
const PARTS: [&str; 4] = ["p50", "p99", "p99.9", "mean"];

/// All metrics that a run has; without `all` only what the report's own tables show.
pub fn metrics_of(run: &Run, all: bool) -> Vec<Metric> {
    let mut found = Vec::new();
    let is_streaming = run.mode == Mode::Streaming;
    for score in &run.scores {
        let values = if is_streaming {
            &score.streaming
        } else {
            &score.offline
        };
        let several = run.scores.iter().filter(|it| it.task == score.task).count() > 1;
        let group = if several {
            format!("{} {}", score.task, score.topic)
        } else {
            score.task.clone()
        };
        let (task, topic) = (score.task.clone(), score.topic.clone());
        for name in values.keys().filter(|name| all || **name == score.headline) {
            found.push(Metric {
                group: group.clone(),
                name: name.clone(),
                higher_is_better: metrics::higher_is_better(score, name),
                place: Place::Score {
                    task: task.clone(),
                    topic: topic.clone(),
                    name: name.clone(),
                    is_streaming,
                },
            });
        }
        if is_streaming && at_delay(score, SHOWN_DELAY_MS).is_some() {
            found.push(Metric {
                group,
                name: format!("{} +{SHOWN_DELAY_MS} ms", score.headline),
                higher_is_better: Some(score.higher_is_better),
                place: Place::Delayed { task, topic },
            });
        }
    }
    let mut add = |group: &str, name: String, higher_is_better: bool, place: Place| {
        found.push(Metric {
            group: group.into(),
            name,
            higher_is_better: Some(higher_is_better),
            place,
        });
    };
    if run.mode != Mode::Offline {
        for (kind, (name, spread)) in run.latency.named().into_iter().enumerate() {
            let shown = if run.mode == Mode::Stress { 1 } else { 0 };
            if spread.n == 0 || (!all && kind != shown) {
                continue;
            }
            // Of few results the high percentiles are the largest, which says little.
            let exists = [true, spread.n >= 100, spread.n >= 1000, all];
            for (part, text) in PARTS.iter().enumerate().filter(|(part, _)| exists[*part]) {
                add(
                    "latency",
                    format!("{name} {text}, ms"),
                    false,
                    Place::Latency { kind, part },
                );
            }
        }
    }
    if is_streaming && run.counts.n_queries > 0 {
        add("queries", "miss, share".into(), false, Place::Miss);
        add("queries", "in time, share".into(), true, Place::InTime);
        add("queries", "behind, frames".into(), false, Place::Mismatch);
    }
    if run.cpu_cores().is_some() {
        add("resources", "CPU, cores".into(), false, Place::Cpu);
        add("resources", "memory, MB".into(), false, Place::Memory);
    }
    found
}

impl Metric {
    /// Its value over all scenarios.
    pub fn of_run(&self, run: &Run) -> Option<f64> {
        match self.place {
            Place::Cpu => run.cpu_cores(),
            Place::Memory => run.peak_bytes().map(|bytes| bytes as f64 / 1e6),
            _ => self.value(&run.scores, &run.latency, &run.counts),
        }
    }

    /// Its value in one scenario; resources are known for the whole run only.
    pub fn of_scenario(&self, run: &ScenarioRun) -> Option<f64> {
        self.value(&run.scores, &run.latency, &run.counts)
    }

    fn value(
        &self,
        scores: &[TaskScore],
        latency: &crate::report::types::Latency,
        counts: &crate::report::types::Counts,
    ) -> Option<f64> {
        let score = |task: &str, topic: &str| {
            scores
                .iter()
                .find(|it| it.task == task && it.topic == topic)
        };
        let share = |n: u64, of: u64| (of > 0).then(|| n as f64 / of as f64);
        match &self.place {
            Place::Score {
                task,
                topic,
                name,
                is_streaming,
            } => {
                // Another version of a program may publish under another name.
                let score = score(task, topic).or_else(|| only(scores, task))?;
                let values = if *is_streaming {
                    &score.streaming
                } else {
                    &score.offline
                };
                values.get(name).copied()
            }
            Place::Delayed { task, topic } => at_delay(
                score(task, topic).or_else(|| only(scores, task))?,
                SHOWN_DELAY_MS,
            ),
            Place::Latency { kind, part } => {
                let (_, spread) = latency.named()[*kind];
                let parts = [spread.p50, spread.p99, spread.p999, spread.mean];
                (spread.n > 0).then(|| parts[*part])
            }
            Place::Miss => share(counts.miss, counts.n_queries),
            Place::InTime => share(counts.in_time, counts.n_queries),
            Place::Mismatch => share(
                counts.mismatch,
                counts.n_queries.saturating_sub(counts.miss),
            ),
            Place::Cpu | Place::Memory => None,
        }
    }
}

/// The scores of a task if there is one topic of it.
fn only<'a>(scores: &'a [TaskScore], task: &str) -> Option<&'a TaskScore> {
    let mut of_task = scores.iter().filter(|it| it.task == task);
    of_task.next().filter(|_| of_task.next().is_none())
}
