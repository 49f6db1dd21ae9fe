//! The lines of the tables: for each task one per program and pace, with accuracy without time
//! beside accuracy in time.

use super::types::{Latency, Report, Run, TaskScore};
use crate::capture::Mode;

/// The added delay that tables show beside the streaming value, milliseconds.
pub const SHOWN_DELAY_MS: f64 = 100.0;

/// A task, all programs together.
#[derive(Clone, Debug)]
pub struct TaskTable<'a> {
    /// The task.
    pub task: &'a str,
    /// The metric that is shown.
    pub headline: &'a str,
    /// Its unit; empty if it has none.
    pub unit: &'a str,
    /// Whether more of it is better.
    pub higher_is_better: bool,
    /// Truths that were scored by the first run, and left out.
    pub n_scored: u64,
    /// See `n_scored`.
    pub n_ignored: u64,
    /// Programs in their order, each streaming run a line.
    pub lines: Vec<Line<'a>>,
}

/// A program at a task.
#[derive(Clone, Debug)]
pub struct Line<'a> {
    /// The program.
    pub program: &'a str,
    /// The program, and its pace and topic where that tells lines apart.
    pub label: String,
    /// The run in real time, if there is one.
    pub streaming_run: Option<&'a Run>,
    /// Its scores.
    pub streaming_score: Option<&'a TaskScore>,
    /// The run in lockstep, if there is one.
    pub offline_run: Option<&'a Run>,
    /// Its scores.
    pub offline_score: Option<&'a TaskScore>,
    /// The headline without time.
    pub offline: Option<f64>,
    /// Whether that is of a run in real time: only of frames that were answered.
    pub offline_is_partial: bool,
    /// The headline in time.
    pub streaming: Option<f64>,
    /// The same, if every result came [`SHOWN_DELAY_MS`] later.
    pub delayed: Option<f64>,
    /// Share of queries without a result.
    pub miss: Option<f64>,
    /// Share of queries whose newest result answers the newest frame.
    pub in_time: Option<f64>,
    /// Frames that the newest result lags behind, mean over queries that have a result.
    pub mismatch: Option<f64>,
    /// Processor time of the program per second of the wall clock.
    pub cpu_cores: Option<f64>,
}

impl Line<'_> {
    /// The scores that say most: those in time, else those without.
    pub fn score(&self) -> Option<&TaskScore> {
        self.streaming_score.or(self.offline_score)
    }

    /// Latency in real time; in lockstep none counts.
    pub fn latency(&self) -> Option<&Latency> {
        let latency = &self.streaming_run?.latency;
        (latency.end_to_end.n > 0).then_some(latency)
    }
}

impl Run {
    /// The run in words: `hog offline`, `hog streaming 0.5x +50 ms`.
    pub fn label(&self) -> String {
        let mut label = format!("{} {}", self.program, self.mode_name());
        let pace = self.pace_text();
        if !pace.is_empty() {
            label = label + " " + &pace;
        }
        label
    }

    /// How it ran in a word; a stream without a pace is single: its next frame comes with the answer.
    pub fn mode_name(&self) -> &'static str {
        match self.mode {
            Mode::Offline => "offline",
            Mode::Streaming => "streaming",
            Mode::Stress if self.speed > 0.0 => "constant",
            Mode::Stress => "single",
        }
    }

    /// The run as part of a file's name: `hog-streaming-0.5x`.
    pub fn file_stem(&self) -> String {
        let safe = |c: char| match c {
            'a'..='z' | 'A'..='Z' | '0'..='9' | '.' | '_' | '-' => c,
            _ => '-',
        };
        let label = self.label().replace(" +", "+").replace(" ms", "ms");
        label.replace('+', "-plus-").chars().map(safe).collect()
    }

    /// Speed and added delay where they are not the usual ones: `0.5x +50 ms`.
    fn pace_text(&self) -> String {
        let mut words = Vec::new();
        if self.mode != Mode::Offline && self.speed > 0.0 && self.speed != 1.0 {
            words.push(format!("{}x", self.speed));
        }
        if self.added_delay_ms > 0.0 {
            words.push(format!("+{} ms", self.added_delay_ms));
        }
        words.join(" ")
    }

    /// Processor time of the program's own processes per second of the wall clock.
    pub fn cpu_cores(&self) -> Option<f64> {
        let own = || self.usage.iter().filter(|it| it.of_program);
        own().next()?;
        Some(own().map(|it| it.cpu_cores).sum())
    }

    /// Most memory of the program's own processes together, bytes.
    pub fn peak_bytes(&self) -> Option<u64> {
        let own = || self.usage.iter().filter(|it| it.of_program);
        own().next()?;
        Some(own().map(|it| it.peak_bytes).sum())
    }
}

impl Mode {
    /// Its name in names of files.
    pub fn name(self) -> &'static str {
        match self {
            Mode::Offline => "offline",
            Mode::Streaming => "streaming",
            Mode::Stress => "stress",
        }
    }
}

/// The value of a curve at a delay, milliseconds; nothing between two points is made up.
pub fn at_delay(score: &TaskScore, delay_ms: f64) -> Option<f64> {
    let mut points = score.curve.iter();
    let point = points.find(|it| (it.delay_ms - delay_ms).abs() < 1e-6)?;
    Some(point.value)
}

/// The best of some values, if they differ: of equal ones none is best.
pub fn best(values: impl Iterator<Item = f64>, higher_is_better: bool) -> Option<f64> {
    let values: Vec<f64> = values.collect();
    let largest = values.iter().copied().reduce(f64::max)?;
    let smallest = values.iter().copied().reduce(f64::min)?;
    let best = if higher_is_better { largest } else { smallest };
    (largest > smallest).then_some(best)
}

/// All tasks in the order in which runs name them.
pub fn tables(report: &Report) -> Vec<TaskTable<'_>> {
    let mut tables: Vec<TaskTable<'_>> = Vec::new();
    for score in report.runs.iter().flat_map(|run| &run.scores) {
        if tables.iter().any(|table| table.task == score.task) {
            continue;
        }
        tables.push(TaskTable {
            task: &score.task,
            headline: &score.headline,
            unit: &score.unit,
            higher_is_better: score.higher_is_better,
            n_scored: score.n_scored,
            n_ignored: score.n_ignored,
            lines: lines(report, &score.task),
        });
    }
    tables
}

/// Tasks of the suite that no program answered.
pub fn unanswered(report: &Report) -> Vec<String> {
    let suite: toml::Table = report.suite_text.parse().unwrap_or_default();
    let tasks = suite.get("task").and_then(toml::Value::as_array);
    let said = |task: &toml::Value, key: &str| Some(task.get(key)?.as_str()?.to_owned());
    let names = |task: &toml::Value| [said(task, "name"), said(task, "kind")];
    let is_known = |name: &String| {
        let mut scores = report.runs.iter().flat_map(|run| &run.scores);
        scores.any(|score| score.task == *name)
    };
    let tasks = tasks.into_iter().flatten().map(names);
    let without = tasks.filter(|names| !names.iter().flatten().any(is_known));
    without
        .filter_map(|names| names.into_iter().flatten().next())
        .collect()
}

/// Programs in the order of their first runs.
pub fn programs(report: &Report) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for run in &report.runs {
        if !names.contains(&run.program.as_str()) {
            names.push(&run.program);
        }
    }
    names
}

fn lines<'a>(report: &'a Report, task: &str) -> Vec<Line<'a>> {
    let mut lines = Vec::new();
    for program in programs(report) {
        let of_program = || report.runs.iter().filter(move |run| run.program == program);
        let mut topics: Vec<&str> = Vec::new();
        for score in of_program().flat_map(|run| &run.scores) {
            if score.task == task && !topics.contains(&score.topic.as_str()) {
                topics.push(&score.topic);
            }
        }
        for topic in &topics {
            let score_of = |run: &'a Run| {
                run.scores
                    .iter()
                    .find(|score| score.task == task && score.topic == *topic)
            };
            let of_mode = |mode: Mode| {
                of_program()
                    .filter(move |run| run.mode == mode)
                    .filter_map(|run| Some((run, score_of(run)?)))
            };
            let offline = of_mode(Mode::Offline).next();
            let streaming: Vec<_> = of_mode(Mode::Streaming).collect();
            let topic = if topics.len() > 1 { topic } else { "" };
            if streaming.is_empty() {
                lines.extend(offline.map(|_| line(program, topic, offline, None)));
            }
            for run in streaming {
                lines.push(line(program, topic, offline, Some(run)));
            }
        }
    }
    lines
}

fn line<'a>(
    program: &'a str,
    topic: &str,
    offline: Option<(&'a Run, &'a TaskScore)>,
    streaming: Option<(&'a Run, &'a TaskScore)>,
) -> Line<'a> {
    let headline = |score: &'a TaskScore| score.offline.get(&score.headline).copied();
    let mut label = program.to_owned();
    if let Some((run, _)) = streaming {
        let pace = run.pace_text();
        if !pace.is_empty() {
            label = label + " " + &pace;
        }
    }
    if !topic.is_empty() {
        label = label + " " + topic;
    }
    let counts = streaming.map(|(run, _)| &run.counts);
    let counts = counts.filter(|counts| counts.n_queries > 0);
    let share = |n: u64, of: u64| (of > 0).then(|| n as f64 / of as f64);
    Line {
        program,
        label,
        streaming_run: streaming.map(|it| it.0),
        streaming_score: streaming.map(|it| it.1),
        offline_run: offline.map(|it| it.0),
        offline_score: offline.map(|it| it.1),
        offline: offline.or(streaming).and_then(|(_, score)| headline(score)),
        offline_is_partial: offline.is_none() && streaming.is_some(),
        streaming: streaming.and_then(|(_, score)| score.streaming.get(&score.headline).copied()),
        delayed: streaming.and_then(|(_, score)| at_delay(score, SHOWN_DELAY_MS)),
        miss: counts.and_then(|it| share(it.miss, it.n_queries)),
        in_time: counts.and_then(|it| share(it.in_time, it.n_queries)),
        mismatch: counts
            .and_then(|it| share(it.mismatch, it.n_queries - it.miss.min(it.n_queries))),
        cpu_cores: streaming.or(offline).and_then(|(run, _)| run.cpu_cores()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_equal_values_none_is_best() {
        assert_eq!(best([1.0, 3.0, 2.0].into_iter(), true), Some(3.0));
        assert_eq!(best([1.0, 3.0, 2.0].into_iter(), false), Some(1.0));
        assert_eq!(best([0.0, 0.0].into_iter(), true), None);
        assert_eq!(best([].into_iter(), true), None);
    }

    #[test]
    fn tasks_without_an_answer_are_named() {
        let mut report = Report {
            suite_text: "[[task]]\nkind = \"depth\"\n[[task]]\nkind = \"flow\"\nname = \"f\""
                .into(),
            ..Report::default()
        };
        assert_eq!(unanswered(&report), ["depth", "f"]);
        report.suite_text = "no TOML".into();
        assert!(unanswered(&report).is_empty());
    }
}
