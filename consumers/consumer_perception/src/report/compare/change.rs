//! What a comparison says.

use serde::Serialize;

/// What is said about a metric.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// It changed beyond noise, for the better.
    Better,
    /// It changed beyond noise, for the worse.
    Worse,
    /// It changed beyond noise; which direction is better is not known.
    Changed,
    /// It did not change beyond noise.
    Same,
    /// There is no interval, so nothing can be said.
    Unknown,
}

/// A metric in both reports.
#[derive(Clone, Debug, Serialize)]
pub struct Change {
    /// The run of A, in words.
    pub run: String,
    /// The task, or `latency`, `queries`, `resources`.
    pub group: String,
    /// The metric.
    pub metric: String,
    /// Over all scenarios of A.
    pub a: f64,
    /// Over all scenarios of B.
    pub b: f64,
    /// Scenarios in which both have it.
    pub n_scenarios: usize,
    /// Mean over these of B less A; of the whole runs where no scenario has it.
    pub difference: f64,
    /// Interval of that mean; none for fewer than two scenarios.
    pub interval: Option<[f64; 2]>,
    /// Whether more of it is better, if that is known.
    pub higher_is_better: Option<bool>,
    /// What is said about it.
    pub verdict: Verdict,
}

/// The whole comparison.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Suite of A and of B.
    pub suites: [String; 2],
    /// Builds of A and of B.
    pub builds: [String; 2],
    /// Scenarios of both.
    pub scenarios: Vec<String>,
    /// Confidence of the intervals.
    pub confidence: f64,
    /// Resamples of each.
    pub resamples: u32,
    /// Their seed.
    pub seed: u64,
    /// Share of A's value from which on a change counts.
    pub at_least: f64,
    /// All metrics.
    pub changes: Vec<Change>,
    /// What must be known to read it.
    pub notes: Vec<String>,
}
