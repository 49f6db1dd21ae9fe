//! The types of a report: all of `report.json`.

use std::collections::BTreeMap;

use consumer_report::Spread;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use super::throughput::Throughput;
use crate::capture::Mode;

/// Number of this form; it rises when a field changes its meaning or goes.
pub const REPORT_VERSION: u32 = 1;

/// Digits of a hash that tell reports apart where people read them.
const SHORT_HASH: usize = 16;

/// SHA-256 of what makes the frames of a suite: its text, the build and the seed.
pub fn suite_hash(text: &str, build: &str, seed: u64, is_drawn: bool) -> String {
    let seed = match is_drawn {
        true => format!("{seed} drawn"),
        false => seed.to_string(),
    };
    hash_of([text, build, &seed])
}

fn hash_of<'a>(parts: impl IntoIterator<Item = &'a str>) -> String {
    let mut hash = Sha256::new();
    for part in parts {
        hash.update((part.len() as u64).to_le_bytes());
        hash.update(part);
    }
    format!("{:x}", hash.finalize())
}

/// A benchmark, whole.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
pub struct Report {
    /// Number of the form, 1.
    pub version: u32,
    /// Name of the suite.
    pub suite: String,
    /// SHA-256 of the suite's text, of the build and of the seed: equal means the same frames.
    pub suite_hash: String,
    /// The suite itself, TOML.
    #[serde(default)]
    pub suite_text: String,
    /// The command that made this report, word by word.
    #[serde(default)]
    pub command: Vec<String>,
    /// What else a reader wants to know of how it ran, e.g. `source` (recording or live) and the
    /// cores of the simulator.
    #[serde(default)]
    pub settings: BTreeMap<String, String>,
    /// Version of Gantry and hash of the programs that made the frames.
    pub build: String,
    /// Seed of all that is random.
    pub seed: u64,
    /// Whether the seed was drawn for this report, so that nobody knew these drives beforehand.
    #[serde(default)]
    pub has_drawn_seed: bool,
    /// Whether programs reached their inputs and nothing else of the world.
    #[serde(default)]
    pub is_sealed: bool,
    /// Inputs that are truth, which the suite gives on purpose.
    #[serde(default)]
    pub given_truth: Vec<String>,
    /// Whether a process of a program ended by itself with something else than exit code 0.
    #[serde(default)]
    pub has_crash: bool,
    /// Maps on which programs may have been trained; no scenario has one of them.
    #[serde(default)]
    pub training_maps: Vec<String>,
    /// When it began, RFC 3339.
    pub began: String,
    /// How long it took, seconds.
    pub took_secs: f64,
    /// Where it ran.
    pub machine: Machine,
    /// What was shown, in order.
    pub scenarios: Vec<ScenarioInfo>,
    /// What was measured: one entry for each program, mode, speed and added delay.
    pub runs: Vec<Run>,
    /// What a reader must know before believing a figure: a pace that was missed, a busy machine.
    pub warnings: Vec<String>,
}

impl Report {
    /// How the figures are cited: what must be equal for them to be compared, in a sentence.
    pub fn citation(&self) -> String {
        let short = |hash: &str| hash.chars().take(SHORT_HASH).collect::<String>();
        let of_scenarios = self.scenarios.iter();
        let frames = hash_of(of_scenarios.flat_map(|it| [it.name.as_str(), &it.frames_hash]));
        let drawn = if self.has_drawn_seed {
            "drawn"
        } else {
            "public"
        };
        let machine = &self.machine;
        let mut parts = vec![
            format!("Gantry {}", self.build),
            format!("suite {} {}", self.suite, short(&self.suite_hash)),
            format!("frames {}", short(&frames)),
            format!("seed {} ({drawn})", self.seed),
            machine.cpu.clone(),
            format!("{} processors", machine.n_cpus),
            machine.adapter.clone(),
        ];
        parts.retain(|part| !part.is_empty());
        parts.join(", ")
    }

    /// What programs reached, and whether they could have known the drives, a sentence each.
    pub fn fairness(&self) -> Vec<String> {
        let mut sentences = vec![match self.is_sealed {
            true => {
                "sealed: programs reached their inputs and nothing else of the world".to_owned()
            }
            false => {
                "not sealed: programs could read the world's snapshots and documents".to_owned()
            }
        }];
        if !self.given_truth.is_empty() {
            sentences.push(format!("given on purpose: {}", self.given_truth.join(", ")));
        }
        sentences.push(match self.has_drawn_seed {
            true => format!("seed {} was drawn for this report", self.seed),
            false => format!(
                "seed {} is public: everybody can make these drives beforehand; to cite figures, use --seed",
                self.seed
            ),
        });
        if !self.training_maps.is_empty() {
            sentences.push(format!(
                "training maps, which are not scored on: {}",
                self.training_maps.join(", ")
            ));
        }
        sentences
    }
}

/// The machine.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
pub struct Machine {
    /// Model of the processor.
    pub cpu: String,
    /// Logical processors that could be used.
    pub n_cpus: usize,
    /// Memory, bytes.
    pub memory_bytes: u64,
    /// What rendered.
    pub adapter: String,
    /// Release of the kernel.
    #[serde(default)]
    pub kernel: String,
    /// Load average over a minute when it began.
    pub load: f64,
}

/// A scenario, as it was shown to every program.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
pub struct ScenarioInfo {
    /// Name, unique within the suite.
    pub name: String,
    /// What makes it: map, weather, time, traffic, seed, as the suite says them.
    pub settings: BTreeMap<String, String>,
    /// Measured simulated seconds, without warm-up.
    pub secs: f64,
    /// SHA-256 over all frames and snapshots.
    pub frames_hash: String,
    /// Queries per simulated second: how often truth is compared with the newest result.
    pub query_hz: f64,
}

/// One program in one mode.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Run {
    /// Name of the program.
    pub program: String,
    /// Its command.
    pub command: Vec<String>,
    /// Its mode.
    pub mode: Mode,
    /// Simulated seconds per second of the wall clock that were asked for; 0 in lockstep.
    pub speed: f64,
    /// Milliseconds that every result was held back by, on top of its own.
    #[serde(default)]
    pub added_delay_ms: f64,
    /// Processor cores of the program; empty: all.
    pub cores: Vec<u32>,
    /// Its priority, if it has one of its own.
    pub nice: Option<i32>,
    /// By scenario.
    pub scenarios: Vec<ScenarioRun>,
    /// All scenarios together.
    pub scores: Vec<TaskScore>,
    /// All scenarios together.
    pub latency: Latency,
    /// All scenarios together.
    pub counts: Counts,
    /// All scenarios together.
    pub usage: Vec<ProcessUsage>,
    /// What went wrong, a sentence each.
    pub faults: Vec<String>,
}

/// One program in one mode and one scenario.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
pub struct ScenarioRun {
    /// Name of the scenario.
    pub scenario: String,
    /// Simulated seconds per second of the wall clock that were reached.
    pub pace: Option<f64>,
    /// Scores of this scenario alone.
    pub scores: Vec<TaskScore>,
    /// Latency in this scenario alone.
    pub latency: Latency,
    /// Counts of this scenario alone.
    pub counts: Counts,
    /// Rates and jitter by the wall clock.
    #[serde(default)]
    pub throughput: Throughput,
    /// Each result and what became of it, for the time line; at most a few thousand.
    pub events: Vec<ResultEvent>,
    /// Simulated seconds of the frames that could be answered, over the time of `events`.
    #[serde(default)]
    pub frame_secs: Vec<f64>,
    /// Frames with the worst results, with pictures beside the report.
    pub worst: Vec<WorstFrame>,
}

/// How right a program was at one task.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
pub struct TaskScore {
    /// The task, as suites name it, e.g. `boxes2d`.
    pub task: String,
    /// Topic of the results that were scored.
    pub topic: String,
    /// Name of the metric that stands for the task, e.g. `AP`.
    pub headline: String,
    /// Its unit, e.g. `px`; empty if it has none.
    #[serde(default)]
    pub unit: String,
    /// Whether more of it is better.
    pub higher_is_better: bool,
    /// Results against the truth of the frame they answer, by metric: accuracy without time.
    pub offline: BTreeMap<String, f64>,
    /// Truth at every query against the newest result then, by metric; empty in lockstep.
    pub streaming: BTreeMap<String, f64>,
    /// The streaming headline if every result had come later by this many milliseconds.
    pub curve: Vec<CurvePoint>,
    /// Parts of the truth, e.g. distances; offline, and streaming if there is time.
    pub strata: Vec<Stratum>,
    /// Truths (objects, pixels, poses) that were scored, and left out by the rules of the task.
    pub n_scored: u64,
    /// See `n_scored`.
    pub n_ignored: u64,
}

/// A point of the curve of accuracy over added delay.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, JsonSchema)]
pub struct CurvePoint {
    /// Delay that was added to every result, milliseconds.
    pub delay_ms: f64,
    /// The headline metric.
    pub value: f64,
}

/// The headline metric over a part of the truth.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Stratum {
    /// What divides, e.g. `distance_m`, `occlusion`, `light`, `speed_mps`.
    pub by: String,
    /// Which part, e.g. `10-20` or `night`.
    pub part: String,
    /// Truths in it.
    pub n: u64,
    /// Offline; `None` if nothing is in it.
    pub offline: Option<f64>,
    /// Streaming; `None` if nothing is in it, or in lockstep.
    pub streaming: Option<f64>,
}

/// How long results took, milliseconds.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
pub struct Latency {
    /// From the publication of the oldest sensor frame behind a result to that of the result.
    pub end_to_end: Spread,
    /// From the frame's publication to the result's: what the program and its wake-up took.
    pub answer: Spread,
    /// From the moment the program took the frame until it published.
    pub work: Spread,
    /// From the frame's publication until the program took it.
    pub age_at_use: Spread,
}

impl Latency {
    /// The four distributions and their names in files and tables.
    pub fn named(&self) -> [(&'static str, &Spread); 4] {
        [
            ("end_to_end", &self.end_to_end),
            ("answer", &self.answer),
            ("work", &self.work),
            ("age_at_use", &self.age_at_use),
        ]
    }
}

/// What became of frames and results.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Counts {
    /// Frames that could be answered.
    pub n_frames: u64,
    /// Frames with at least one answer.
    pub n_answered: u64,
    /// Results that came.
    pub n_results: u64,
    /// Results of topics or types that nobody asked for, or that cannot be read.
    pub n_unreadable: u64,
    /// Results for a frame that had one already.
    pub n_repeated: u64,
    /// Results for a frame older than one that was answered before.
    pub n_out_of_order: u64,
    /// Results that answer frames that were never sent.
    pub n_invented: u64,
    /// Results that the benchmark's reader lost, because they came faster than it reads.
    pub n_lost: u64,
    /// Queries at which there was no result yet.
    pub miss: u64,
    /// Queries whose newest result answers the newest frame then.
    pub in_time: u64,
    /// Sum over queries of how many frames the newest result lags behind the newest frame.
    pub mismatch: u64,
    /// Queries in all.
    pub n_queries: u64,
}

/// What a process used.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ProcessUsage {
    /// Its name.
    pub process: String,
    /// Whether it belongs to the program; if not, it is the simulator's or the benchmark's.
    #[serde(default)]
    pub of_program: bool,
    /// Processor time per second of the wall clock.
    pub cpu_cores: f64,
    /// Processor time per answered frame, milliseconds.
    pub cpu_ms_per_frame: f64,
    /// Most memory of its own, bytes.
    pub peak_bytes: u64,
}

/// A result on the time line; times in simulated seconds since the scenario began.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ResultEvent {
    /// Topic of the result.
    #[serde(default)]
    pub topic: String,
    /// Time of the frame that it answers.
    pub frame_secs: f64,
    /// When the program took the frame.
    pub taken_secs: f64,
    /// When the result was published.
    pub published_secs: f64,
    /// Number of the frame.
    pub seq: u64,
}

/// A frame whose result is among the worst.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct WorstFrame {
    /// The task.
    pub task: String,
    /// Simulated seconds since the scenario began.
    pub secs: f64,
    /// What is wrong with it, in a few words with numbers.
    pub why: String,
    /// The frame with the truth drawn on it: a JPEG beside the report.
    pub truth_image: String,
    /// The frame with the result drawn on it: a JPEG beside the report.
    pub result_image: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_citation_names_version_suite_frames_seed_and_machine() {
        let mut report = Report {
            suite: "small".into(),
            suite_hash: suite_hash("text", "0.1.0 abc", 7, true),
            build: "0.1.0 abc".into(),
            seed: 7,
            has_drawn_seed: true,
            scenarios: vec![ScenarioInfo::default()],
            ..Report::default()
        };
        report.machine.cpu = "a processor".into();
        report.machine.n_cpus = 2;
        let cited = report.citation();
        for part in [
            "Gantry 0.1.0 abc, suite small ",
            "seed 7 (drawn), a processor, 2 processors",
            &report.suite_hash[..16],
        ] {
            assert!(cited.contains(part), "{cited}");
        }
        report.scenarios[0].frames_hash = "other".into();
        assert_ne!(report.citation(), cited);
        assert_ne!(suite_hash("text", "0.1.0 abc", 7, false), report.suite_hash);
    }
}
