//! What is at work while a scenario is scored.

use std::collections::{BTreeMap, HashSet};
use std::sync::Arc;

use consumer_truth::scenario::Scenario;

use crate::capture::Capture;
use crate::tasks::AnyTask;
use crate::truth_pass::TruthRecording;

/// A task at work on a scenario.
pub(super) struct Work<'a> {
    /// Which run it belongs to.
    pub(super) run: usize,
    pub(super) capture: &'a Capture,
    pub(super) task: Box<dyn AnyTask>,
    pub(super) from_nanos: u64,
}

/// What is read of a scenario's recording.
pub(super) struct Wanted {
    /// Topics of frames.
    pub(super) topics: HashSet<Arc<str>>,
    /// Truth cameras that tasks look at, `rig/sensor`.
    pub(super) views: Vec<Arc<str>>,
}

/// Whether truth from snapshots is asked for at a time: at most half a tick from a query. Queries are
/// counted from the first frame of the inputs on.
pub(super) fn is_query(truth: &TruthRecording, about: &Scenario, sim_nanos: u64) -> bool {
    let of_sensors = truth.inputs.iter().filter(|input| input.rate_hz.is_some());
    let first = of_sensors.filter_map(|input| truth.frames.get(&input.topic)?.first());
    let first = first.map(|frame| frame.sim_nanos).min();
    let since = sim_nanos.abs_diff(first.unwrap_or(truth.begin_nanos));
    let interval = truth.query_nanos.max(1);
    let apart = since % interval;
    apart.min(interval - apart) * 2 < about.info.period_nanos.max(1)
}

/// Topics of results that are scored, with the input that each answers.
pub(super) type Inputs = BTreeMap<Arc<str>, String>;
