//! What a format must provide, and the names of the formats.

use schema_frames::Modality;

use crate::tree::Tree;
use consumer_truth::scenario::{Scenario, Topic};
use consumer_truth::ticks::TickSet;

/// Name of a format on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, clap::ValueEnum)]
#[value(rename_all = "kebab-case")]
pub enum Format {
    /// KITTI object, tracking, depth and flow
    Kitti,
    /// nuScenes v1.0 tables with keyframes and sweeps
    Nuscenes,
    /// COCO instances with masks
    Coco,
    /// YOLO boxes and outlines
    Yolo,
    /// KITTI-360 images, labels, poses and boxes in space
    #[value(name = "kitti-360")]
    Kitti360,
    /// SemanticKITTI sequences of labelled clouds
    #[value(name = "semantickitti")]
    SemanticKitti,
    /// DSEC events, images and disparity
    Dsec,
    /// Prophesee EVT 3.0 raw event files
    Evt3,
    /// A ROS 2 bag
    #[value(name = "ros2-bag")]
    Ros2Bag,
}

impl Format {
    /// Name as on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Format::Kitti => "kitti",
            Format::Nuscenes => "nuscenes",
            Format::Coco => "coco",
            Format::Yolo => "yolo",
            Format::Kitti360 => "kitti-360",
            Format::SemanticKitti => "semantickitti",
            Format::Dsec => "dsec",
            Format::Evt3 => "evt3",
            Format::Ros2Bag => "ros2-bag",
        }
    }
}

/// A finished scenario, as later scenarios and the end of the export see it.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DoneScenario {
    /// Its name.
    pub name: String,
    /// Part of the set that it belongs to, e.g. `train`.
    pub split: String,
    /// Ticks that were exported.
    pub n_ticks: u64,
    /// What the exporter returned from [`Exporter::end`]: counters that later scenarios go on from.
    pub state: serde_json::Value,
}

/// A number that the last scenario left behind; 0 before the first.
pub fn last_number(done: &[DoneScenario], name: &str) -> u64 {
    let last = done.last().and_then(|last| last.state[name].as_u64());
    last.unwrap_or(0)
}

/// The parts of the set, each once, in alphabetical order.
pub fn splits(done: &[DoneScenario]) -> Vec<&str> {
    let mut splits: Vec<&str> = done.iter().map(|done| done.split.as_str()).collect();
    splits.sort_unstable();
    splits.dedup();
    splits
}

/// One format. Scenarios come one after the other: `begin`, `tick` …, `end`; then `finish` once.
///
/// An export that was stopped is continued with a new exporter: scenarios that were done are handed
/// to `begin` and `finish` as [`DoneScenario`]s only, and one that was not done begins anew. Files
/// that are already there are then not made again, because [`Tree`] leaves them; so what a file
/// holds must follow from the recording and the options alone, and state that later scenarios need
/// must go through `end`.
pub trait Exporter {
    /// Checks that the scenario has the sensors that the format needs; called for every scenario
    /// before anything is written.
    ///
    /// # Errors
    /// [`launch_cli::wrong_usage`] with a sentence: what is missing, what the recording has instead.
    fn check(&mut self, scenario: &Scenario) -> anyhow::Result<()>;

    /// Whether frames of this topic are to be read; of others the payload is never decoded.
    fn wants(&self, scenario: &Scenario, topic: &Topic) -> bool;

    /// Topics that a tick must have frames of to be a keyframe; `--every` counts keyframes. Empty:
    /// every tick is one.
    fn keys(&self, scenario: &Scenario) -> Vec<std::sync::Arc<str>>;

    /// Least time between keyframes, nanoseconds of simulated time.
    fn key_period_nanos(&self) -> u64 {
        0
    }

    /// A scenario begins; `done` are those before it.
    ///
    /// # Errors
    /// A sentence; the export ends.
    fn begin(
        &mut self,
        scenario: &Scenario,
        done: &[DoneScenario],
        tree: &Tree,
    ) -> anyhow::Result<()>;

    /// All frames and the snapshot of one tick, by rising tick. Every tick in the range comes, also
    /// those without frames and those that are no keyframes; see [`TickSet::key`].
    ///
    /// # Errors
    /// A sentence; the export ends.
    fn tick(&mut self, scenario: &Scenario, tick: &TickSet, tree: &Tree) -> anyhow::Result<()>;

    /// The scenario ends. The answer is kept in the manifest.
    ///
    /// # Errors
    /// A sentence; the export ends.
    fn end(&mut self, scenario: &Scenario, tree: &Tree) -> anyhow::Result<serde_json::Value>;

    /// After the last scenario: files that cover all of them.
    ///
    /// # Errors
    /// A sentence; the export ends.
    fn finish(&mut self, done: &[DoneScenario], tree: &Tree) -> anyhow::Result<()>;
}

/// The sentence for a sensor that a format needs and the recording lacks.
pub fn missing(
    format: Format,
    scenario: &Scenario,
    needed: &str,
    any: &[Modality],
) -> anyhow::Error {
    let wanted: Vec<_> = any.iter().map(|modality| modality.name()).collect();
    launch_cli::wrong_usage(format!(
        "{} needs {needed} (a topic <rig>/<sensor>/{}), and {} has none on rig {:?}; it has {}",
        format.name(),
        wanted.join(" or "),
        scenario.name,
        scenario.rig,
        scenario.topic_list()
    ))
}
