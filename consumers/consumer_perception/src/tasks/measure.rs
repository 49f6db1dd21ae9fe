//! What makes a task: its measure, and what is said of it before and after a scenario.

use consumer_truth::scenario::Scenario;
use schema_frames::About;
use serde::Deserialize;

use crate::capture::{Capture, CapturedResult};
use crate::evidence::coco_keep::Kept;
use crate::evidence::ignore::Rules;
use crate::evidence::moment::Moment;
use crate::evidence::queries::{Answers, Association};
use crate::picture::Picture;
use crate::report::TaskScore;
use crate::suite::TaskKind;
use crate::tasks::tally::Tally;

/// What is scored, and how.
#[derive(Clone, Debug, PartialEq)]
pub struct Spec {
    /// Name of the task in the report.
    pub name: String,
    /// What kind of task it is.
    pub kind: TaskKind,
    /// Topic of the results, without the domain.
    pub topic: String,
    /// Topic of the input frames that are to be answered.
    pub input: String,
    /// Sensor whose exact frames are the truth, `rig/sensor`; empty if snapshots are.
    pub truth: String,
    /// Flow: sensor whose exact depth, instance and semantic images tell what moves and what was
    /// hidden.
    pub images: String,
    /// Classes that count, by name; empty: the task's usual ones.
    pub classes: Vec<String>,
    /// What counts and what is ignored.
    pub rules: Rules,
    /// The rest.
    pub options: Options,
}

/// Settings of some tasks; the others ignore them.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// Tracking: boxes in space are compared, not those in the image.
    pub in_space: bool,
    /// Stereo: distance of the two cameras, metres; 0: as they are mounted.
    pub baseline_m: f64,
    /// Stereo: name of the right camera.
    #[serde(skip)]
    pub partner: String,
    /// Driving: length of the route, metres.
    pub route_m: f64,
    /// Odometry: queries per simulated second.
    #[serde(skip)]
    pub query_hz: f64,
}

/// What a measure may know of a scenario before its first tick.
pub struct Context<'a> {
    /// What the recording holds.
    pub scenario: &'a Scenario,
    /// What is scored.
    pub spec: &'a Spec,
    /// Whether programs saw a sealed world: the poses that they say are then relative to the
    /// carrier, of which frames told them the mount alone.
    pub is_sealed: bool,
}

/// A result, ready to be read.
pub struct Reading<'a> {
    /// As it came.
    pub result: &'a CapturedResult,
    /// Its body.
    pub body: &'a [u8],
    /// What its topic says about itself.
    pub about: &'a About,
}

/// The metric that stands for a task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Headline {
    /// Its name.
    pub metric: &'static str,
    /// Its unit; empty without one.
    pub unit: &'static str,
    /// Whether more of it is better.
    pub higher_is_better: bool,
}

/// A frame that went wrong.
#[derive(Clone, Debug, PartialEq)]
pub struct Bad {
    /// How wrong; comparable within a task.
    pub badness: f64,
    /// In a few words with numbers.
    pub why: String,
}

/// Why a result is not what the task's results must be, in words that follow "result 7 of TOPIC".
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Unreadable(String);

impl From<String> for Unreadable {
    fn from(words: String) -> Unreadable {
        Unreadable(words)
    }
}

impl From<&str> for Unreadable {
    fn from(words: &str) -> Unreadable {
        Unreadable(words.to_owned())
    }
}

/// What makes a task.
pub trait Measure: Send + Sync {
    /// A result, decoded.
    type Estimate: Send + Sync;
    /// What one moment's truth and one result give.
    type Part: Send;
    /// Parts, added up.
    type Total: Tally;

    /// The metric that stands for the task.
    fn headline(&self) -> Headline;

    /// A scenario begins.
    ///
    /// # Errors
    /// A sentence if the recording lacks something.
    fn begin(&mut self, _context: &Context<'_>) -> anyhow::Result<()> {
        Ok(())
    }

    /// Sees every tick, before anything is scored at it.
    fn watch(&mut self, _moment: &Moment<'_>) {}

    /// Nothing, added up.
    fn empty(&self) -> Self::Total;

    /// Decodes a result.
    ///
    /// # Errors
    /// A sentence if it is not what the task's results must be.
    fn read(&self, reading: &Reading<'_>) -> Result<Self::Estimate, Unreadable>;

    /// Compares the truth of a moment with a result, or with none; `None` if the moment has no truth.
    fn part(&self, moment: &Moment<'_>, estimate: Option<&Self::Estimate>) -> Option<Self::Part>;

    /// Adds a part.
    fn add(&self, total: &mut Self::Total, part: &Self::Part);

    /// Strata of the truths within a moment: what divides, and which part.
    fn strata(&self) -> Vec<(&'static str, &'static str)> {
        Vec::new()
    }

    /// Adds what of a part lies in a stratum of [`Measure::strata`], by its index.
    fn add_stratum(&self, _total: &mut Self::Total, _part: &Self::Part, _stratum: usize) {}

    /// How wrong a part is; `None` if nothing is wrong.
    fn bad(&self, _part: &Self::Part) -> Option<Bad> {
        None
    }

    /// A frame of the report's own list of frames was scored: keeps what files of other formats need.
    fn keep(&mut self, _moment: &Moment<'_>, _part: &Self::Part) {}

    /// Draws the truth of a moment, or a result, over the input's image.
    fn draw(&self, _picture: &mut Picture, _moment: &Moment<'_>, _what: Drawn<'_, Self::Estimate>) {
    }

    /// What was kept for COCO's files.
    fn coco(&mut self) -> Option<Kept> {
        None
    }
}

/// What is drawn.
#[derive(Debug)]
pub enum Drawn<'a, E> {
    /// What is true.
    Truth,
    /// What a program said.
    Result(&'a E),
}

/// A frame that went wrong, before it is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Worst {
    /// How wrong, and why.
    pub bad: Bad,
    /// Its tick.
    pub tick: u64,
    /// Its simulated time, nanoseconds.
    pub sim_nanos: u64,
    /// The result, as an index in [`Capture::results`]; `None` if there was none.
    pub result: Option<usize>,
}

/// What a scenario gave.
#[derive(Clone, Debug, Default)]
pub struct Scored {
    /// Scores of this scenario alone.
    pub score: TaskScore,
    /// The toolkit's counts.
    pub association: Association,
    /// The worst frames, worst first.
    pub worst: Vec<Worst>,
    /// Results that could not be read, and the first sentence about them.
    pub n_unreadable: u64,
    /// See `n_unreadable`.
    pub first_fault: Option<String>,
}

/// What is the same for all tasks of a benchmark.
#[derive(Clone, Debug, Default)]
pub struct Plan {
    /// Added delays, nanoseconds; the first is 0.
    pub delays_nanos: Vec<f64>,
    /// How many worst frames are kept of a scenario.
    pub n_worst: usize,
}

/// A task of one program in one mode, whatever the task.
pub trait AnyTask: Send {
    /// A scenario begins.
    ///
    /// # Errors
    /// A sentence if the recording lacks something.
    fn begin(
        &mut self,
        context: &Context<'_>,
        answers: Answers,
        n_queries: u64,
    ) -> anyhow::Result<()>;
    /// A tick of the measured part, or of the warm-up.
    fn tick(&mut self, moment: &Moment<'_>, capture: &Capture, measured: bool);
    /// The scenario is over.
    ///
    /// # Errors
    /// A sentence if the recording of a drive cannot be read.
    fn end(&mut self, capture: &Capture) -> anyhow::Result<Scored>;
    /// All scenarios together.
    fn total(&self) -> TaskScore;
    /// What was answered in the running scenario.
    fn answers(&self) -> &Answers;
    /// What is scored.
    fn spec(&self) -> &Spec;
    /// Draws truth and result of a moment.
    fn draw(
        &mut self,
        truth: &mut Picture,
        result: &mut Picture,
        moment: &Moment<'_>,
        capture: &Capture,
        index: Option<usize>,
    );
    /// What was kept for COCO's files, of all scenarios.
    fn coco(&mut self) -> Option<Kept>;
}
