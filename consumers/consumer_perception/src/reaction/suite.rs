//! What a suite of reaction times says: which chain runs, what happens before it, and what counts as
//! a correct result of each of its processes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use schema_bus::names;
use serde::{Deserialize, Serialize};

use crate::suite::SuiteFault;
use crate::suite::file::{SuiteFile, check_version, tables};

/// Most trials of one kind.
pub const MAX_TRIALS: u32 = 100_000;
/// Most stages of a chain.
pub const MAX_STAGES: usize = 32;

/// What happens in a trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A person walks out from behind a van that stands in the next lane.
    PedestrianStepsOut,
    /// A car in the next lane changes into the ego's.
    CutIn,
    /// The car ahead brakes.
    LeadBrakes,
    /// The traffic light ahead turns from green to red.
    LightTurnsRed,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Kind; 4] = [
        Kind::PedestrianStepsOut,
        Kind::CutIn,
        Kind::LeadBrakes,
        Kind::LightTurnsRed,
    ];

    /// Its name in suites and reports.
    pub fn name(self) -> &'static str {
        match self {
            Kind::PedestrianStepsOut => "pedestrian_steps_out",
            Kind::CutIn => "cut_in",
            Kind::LeadBrakes => "lead_brakes",
            Kind::LightTurnsRed => "light_turns_red",
        }
    }
}

/// Who drives the ego vehicle until it reacts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Drive {
    /// The benchmark keeps its speed and its lane until a program of the chain brakes.
    #[default]
    Cruise,
    /// A program of the launch file drives it.
    Program,
}

/// From which side an obstacle comes, as the ego's driver sees it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// From the left.
    Left,
    /// From the right.
    Right,
    /// From either, at random.
    #[default]
    Both,
}

/// A suite, checked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Suite {
    /// [`crate::suite::file::SUITE_VERSION`].
    pub version: u32,
    /// Its name; without it, that of its file.
    #[serde(default)]
    pub name: String,
    /// A sentence for people.
    #[serde(default)]
    pub description: String,
    /// Launch files of the chain, each laid over those before it; relative to the suite.
    pub launch: Vec<PathBuf>,
    /// A table that is laid over them, with the keys of a launch file.
    #[serde(default)]
    pub overlay: toml::Table,
    /// Seed of all that is random.
    #[serde(default = "one")]
    pub seed: u64,
    /// Trials of each kind that names no number of its own.
    #[serde(default = "hundred")]
    pub trials: u32,
    /// Speed of the ego vehicle when a trial begins, m/s.
    #[serde(default = "eight")]
    pub speed_mps: f64,
    /// Who drives it.
    #[serde(default)]
    pub drive: Drive,
    /// Length of the straight, level road ahead of the ego's spawn point, metres.
    pub road_m: f64,
    /// Simulated time after the checkpoint was restored that does not count, seconds.
    #[serde(default = "half")]
    pub settle_s: f64,
    /// Shortest and longest wait after that, simulated seconds.
    #[serde(default = "wait")]
    pub wait_s: [f64; 2],
    /// Time after the stimulus in which a reaction counts, simulated seconds.
    #[serde(default = "three")]
    pub window_s: f64,
    /// Longest time from the command to the stimulus, simulated seconds.
    #[serde(default = "five")]
    pub appear_s: f64,
    /// Longest wait for the programs, seconds of the wall clock.
    #[serde(default = "two_minutes")]
    pub ready_s: f64,
    /// The camera that tells what can be seen.
    pub truth: TruthCamera,
    /// What happens; at least one.
    pub kind: BTreeMap<Kind, KindSettings>,
    /// What is watched, from the sensor to the pedals.
    pub stage: Vec<Stage>,
}

/// The camera that tells what can be seen: it sees by labels, from where the chain's sensor does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TruthCamera {
    /// Sensor of the launch files whose rig and mount it has.
    pub sensor: String,
    /// Pixels per row.
    #[serde(default = "wide")]
    pub width_px: u32,
    /// Rows.
    #[serde(default = "high")]
    pub height_px: u32,
    /// Horizontal field of view, degrees.
    #[serde(default = "right_angle")]
    pub fov_deg: f64,
    /// Visible pixels from which on something counts as seen.
    #[serde(default = "one_pixel")]
    pub min_pixels: u32,
    /// Brightness of the colour image, 0 to 255, that a pixel or one beside it must reach to count
    /// as visible; 0: light plays no part, and nothing is rendered but labels.
    #[serde(default = "twilight")]
    pub min_luma: u8,
}

/// How a kind of trial goes. What is left out has the default of the kind.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KindSettings {
    /// Number of trials; 0 leaves the kind out.
    pub trials: Option<u32>,
    /// Least and greatest distance from the ego's origin when the command is given, metres: to the
    /// person, to the other car, or to the line at which one stops for the light.
    pub distance_m: Option<[f64; 2]>,
    /// Least and greatest speed: of the person, or of the car that cuts in, m/s.
    pub speed_mps: Option<[f64; 2]>,
    /// How hard the car ahead brakes, 0 to 1.
    pub brake_ratio: Option<[f64; 2]>,
    /// Whence the obstacle comes.
    #[serde(default)]
    pub side: Side,
    /// From the middle of the ego's lane to that of the next one, metres.
    pub lane_m: Option<f64>,
    /// Catalogue id of the obstacle.
    pub type_id: Option<String>,
    /// Catalogue id of what hides the person.
    pub occluder: Option<String>,
}

/// One process of the chain, by what it publishes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stage {
    /// Its name in the report.
    pub name: String,
    /// Topic of its results.
    pub topic: Option<String>,
    /// In place of a topic: name under which it writes `control/vehicles`, or `*` for any.
    pub control: Option<String>,
    /// Kinds of trials that it is watched in; empty: all.
    #[serde(default)]
    pub kinds: Vec<Kind>,
    /// Boxes in space, tracks: greatest distance on the ground from the middle of the found box to
    /// that of the true one, metres.
    pub distance_m: Option<f64>,
    /// Boxes and tracks in an image, masks: least intersection over union with the rectangle round
    /// the visible pixels.
    pub iou: Option<f64>,
    /// Points: least number inside the true box.
    pub min_points: Option<u32>,
    /// Names of classes that count; empty: any.
    #[serde(default)]
    pub classes: Vec<String>,
    /// Least confidence that counts.
    #[serde(default)]
    pub min_score: f32,
    /// Boxes in space, tracks: the found box must also reach into the ego's path of this half
    /// width, metres.
    pub path_half_m: Option<f64>,
    /// Tracks, boxes in space: the found velocity must also have dropped by as much since the last
    /// result before the stimulus, m/s.
    pub slower_mps: Option<f64>,
    /// Scalars: name of the one that counts.
    pub scalar: Option<String>,
    /// Scalars: it must be above this.
    pub above: Option<f64>,
    /// Scalars: it must be below this.
    pub below: Option<f64>,
    /// Texts and JSON: what they must contain.
    pub contains: Option<String>,
    /// Controls: the brake must be pressed by more than this, 0 to 1.
    pub brake_above: Option<f32>,
}

fn one() -> u64 {
    1
}
fn one_pixel() -> u32 {
    1
}
fn hundred() -> u32 {
    100
}
fn eight() -> f64 {
    8.0
}
fn half() -> f64 {
    0.5
}
fn wait() -> [f64; 2] {
    [0.5, 1.5]
}
fn three() -> f64 {
    3.0
}
fn five() -> f64 {
    5.0
}
fn two_minutes() -> f64 {
    120.0
}
fn wide() -> u32 {
    320
}
fn high() -> u32 {
    180
}
fn right_angle() -> f64 {
    90.0
}
fn twilight() -> u8 {
    16
}

impl Suite {
    /// Reads a suite and checks it. Paths become relative to the working folder.
    ///
    /// # Errors
    /// [`launch_cli::wrong_usage`] with everything that is wrong.
    pub fn read(file: &Path) -> anyhow::Result<Suite> {
        let file = SuiteFile::read(file)?;
        let mut suite: Suite = tables(&file.text).map_err(|fault| file.refused(&[fault]))?;
        if suite.name.is_empty() {
            suite.name = file.stem();
        }
        let faults = suite.faults();
        if !faults.is_empty() {
            return Err(file.refused(&faults));
        }
        for path in &mut suite.launch {
            *path = file.folder().join(&path);
        }
        Ok(suite)
    }

    /// Everything that is wrong, a sentence each.
    fn faults(&self) -> Vec<SuiteFault> {
        let mut faults: Vec<SuiteFault> = check_version(self.version).err().into_iter().collect();
        let mut want = |good: bool, sentence: String| {
            if !good {
                faults.push(sentence.into());
            }
        };
        let within = |x: f64, low: f64, high: f64| (low..=high).contains(&x);
        let range = |[low, high]: [f64; 2], least: f64, most: f64| {
            within(low, least, most) && within(high, low, most)
        };
        want(
            !self.launch.is_empty(),
            "launch is empty; name the launch file of the chain".into(),
        );
        want(
            (1..=MAX_TRIALS).contains(&self.trials),
            format!("trials is {}, allowed is 1 to {MAX_TRIALS}", self.trials),
        );
        want(
            within(self.speed_mps, 0.0, 60.0),
            format!("speed_mps is {}, allowed is 0 to 60", self.speed_mps),
        );
        want(
            range(self.wait_s, 0.0, 600.0),
            format!(
                "wait_s is {:?}, it must be [shortest, longest], 0 to 600",
                self.wait_s
            ),
        );
        for (key, secs, least) in [
            ("settle_s", self.settle_s, 0.0),
            ("window_s", self.window_s, 0.05),
            ("appear_s", self.appear_s, 0.05),
            ("ready_s", self.ready_s, 1.0),
        ] {
            want(
                within(secs, least, 3600.0),
                format!("{key} is {secs}, allowed is {least} to 3600"),
            );
        }
        let truth = &self.truth;
        for (key, px) in [("width_px", truth.width_px), ("height_px", truth.height_px)] {
            want(
                (16..=4096).contains(&px),
                format!("truth.{key} is {px}, allowed is 16 to 4096"),
            );
        }
        want(
            truth.fov_deg > 0.0 && truth.fov_deg < 180.0,
            format!(
                "truth.fov_deg is {}, allowed is more than 0 and less than 180",
                truth.fov_deg
            ),
        );
        want(
            truth.min_pixels > 0,
            "truth.min_pixels is 0, allowed is 1 and up".into(),
        );
        want(
            !self.kind.is_empty(),
            format!("no kind of trial is named; add [kind.{}]", names_of_kinds()),
        );
        for (kind, settings) in &self.kind {
            let name = kind.name();
            for (key, value, most) in [
                ("distance_m", settings.distance_m, 500.0),
                ("speed_mps", settings.speed_mps, 60.0),
                ("brake_ratio", settings.brake_ratio, 1.0),
            ] {
                want(
                    value.is_none_or(|value| range(value, 0.0, most)),
                    format!(
                        "kind.{name}.{key} is {}, it must be [least, greatest], 0 to {most}",
                        shown(value)
                    ),
                );
            }
            want(
                settings.trials.is_none_or(|n| n <= MAX_TRIALS),
                format!(
                    "kind.{name}.trials is {}, allowed is 0 to {MAX_TRIALS}",
                    shown(settings.trials)
                ),
            );
            want(
                settings.lane_m.is_none_or(|m| within(m, 2.0, 10.0)),
                format!(
                    "kind.{name}.lane_m is {}, allowed is 2 to 10",
                    shown(settings.lane_m)
                ),
            );
            let [_, farthest] = settings.distance(*kind);
            let driven = self.speed_mps * (self.settle_s + self.wait_s[1] + self.appear_s.min(2.0));
            want(
                *kind == Kind::LightTurnsRed || driven + farthest <= self.road_m,
                format!(
                    "road_m is {}, but a trial of {name} can need {:.0} m: {driven:.0} m are driven and the obstacle is up to {farthest} m ahead",
                    self.road_m,
                    driven + farthest
                ),
            );
        }
        want(
            (1..=MAX_STAGES).contains(&self.stage.len()),
            format!(
                "there are {} stages, allowed is 1 to {MAX_STAGES}",
                self.stage.len()
            ),
        );
        for (index, stage) in self.stage.iter().enumerate() {
            let name = &stage.name;
            want(!name.is_empty(), format!("stage {} has no name", index + 1));
            want(
                self.stage[..index].iter().all(|other| other.name != *name),
                format!("two stages are called {name:?}"),
            );
            want(
                stage.topic.is_some() != stage.control.is_some(),
                format!("stage {name:?} must have either topic or control"),
            );
            want(
                stage
                    .topic
                    .as_deref()
                    .is_none_or(|topic| !topic.is_empty() && topic != names::CONTROL_VEHICLES),
                format!(
                    "stage {name:?} has topic {}; controls are watched with control = \"NAME\"",
                    shown(stage.topic.as_deref())
                ),
            );
            want(
                stage.iou.is_none_or(|iou| iou > 0.0 && iou <= 1.0),
                format!(
                    "stage {name:?} has iou {}, allowed is more than 0 to 1",
                    shown(stage.iou)
                ),
            );
            for (key, value) in [
                ("distance_m", stage.distance_m),
                ("path_half_m", stage.path_half_m),
                ("slower_mps", stage.slower_mps),
            ] {
                want(
                    value.is_none_or(|value| value > 0.0 && value <= 100.0),
                    format!(
                        "stage {name:?} has {key} {}, allowed is more than 0 to 100",
                        shown(value)
                    ),
                );
            }
            want(
                stage
                    .brake_above
                    .is_none_or(|ratio| (0.0..1.0).contains(&ratio)),
                format!(
                    "stage {name:?} has brake_above {}, allowed is 0 to less than 1",
                    shown(stage.brake_above)
                ),
            );
            want(
                stage.scalar.is_some() == (stage.above.is_some() || stage.below.is_some()),
                format!("stage {name:?}: scalar = \"NAME\" goes with above or below"),
            );
            for kind in stage
                .kinds
                .iter()
                .filter(|kind| !self.kind.contains_key(kind))
            {
                want(
                    false,
                    format!(
                        "stage {name:?} is watched in {}, which the suite has not",
                        kind.name()
                    ),
                );
            }
        }
        faults
    }

    /// Trials of a kind.
    pub fn n_trials(&self, kind: Kind) -> u32 {
        self.kind
            .get(&kind)
            .map_or(0, |settings| settings.trials.unwrap_or(self.trials))
    }

    /// The stages that are watched in a kind, by index.
    pub fn stages_of(&self, kind: Kind) -> impl Iterator<Item = (usize, &Stage)> {
        self.stage
            .iter()
            .enumerate()
            .filter(move |(_, stage)| stage.kinds.is_empty() || stage.kinds.contains(&kind))
    }
}

/// A value as the suite has it.
fn shown<T: std::fmt::Debug>(value: Option<T>) -> String {
    value.map_or("missing".into(), |value| format!("{value:?}"))
}

fn names_of_kinds() -> String {
    Kind::ALL.map(Kind::name).join("], [kind.")
}

impl KindSettings {
    /// See the field.
    pub fn distance(&self, kind: Kind) -> [f64; 2] {
        self.distance_m.unwrap_or(match kind {
            Kind::PedestrianStepsOut => [15.0, 30.0],
            Kind::CutIn => [15.0, 25.0],
            Kind::LeadBrakes => [15.0, 25.0],
            Kind::LightTurnsRed => [20.0, 40.0],
        })
    }

    /// Speed of the obstacle, m/s; of a car that cuts in a little below that of the ego.
    pub fn speed(&self, kind: Kind, ego_mps: f64) -> [f64; 2] {
        self.speed_mps.unwrap_or(match kind {
            Kind::PedestrianStepsOut => [1.2, 2.5],
            Kind::CutIn => [0.7 * ego_mps, 0.9 * ego_mps],
            Kind::LeadBrakes | Kind::LightTurnsRed => [ego_mps, ego_mps],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"
        version = 1
        launch = ["brake.toml"]
        road_m = 100
        truth = { sensor = "roof" }
        kind.pedestrian_steps_out = {}
        [[stage]]
        name = "brake"
        control = "brake"
    "#;

    fn read(text: &str) -> Result<Suite, String> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("mine.toml");
        std::fs::write(&file, text).unwrap();
        Suite::read(&file).map_err(|error| error.to_string())
    }

    #[test]
    fn a_small_suite_has_defaults_and_the_name_of_its_file() {
        let suite = read(GOOD).unwrap();
        assert_eq!((suite.name.as_str(), suite.trials), ("mine", 100));
        assert_eq!(suite.n_trials(Kind::PedestrianStepsOut), 100);
        assert_eq!(suite.n_trials(Kind::CutIn), 0);
        assert!(suite.launch[0].ends_with("brake.toml") && suite.launch[0].is_absolute());
    }

    #[test]
    fn what_is_wrong_is_said_with_its_value() {
        for (from, to, said) in [
            ("version = 1", "version = 2", "version is 2"),
            ("road_m = 100", "road_m = 20", "road_m is 20"),
            ("road_m = 100", "road_m = 100\ntrials = 0", "trials is 0"),
            ("control = \"brake\"", "", "either topic or control"),
            ("control = \"brake\"", "control = \"a\"\niou = 2.0", "iou"),
            (
                "control = \"brake\"",
                "control = \"a\"\nkinds = [\"cut_in\"]",
                "cut_in",
            ),
            (
                "control = \"brake\"",
                "control = \"a\"\nscalar = \"x\"",
                "above or below",
            ),
            ("name = \"brake\"", "nam = \"brake\"", "nam"),
            (
                "road_m = 100",
                "road_m = 100\nwait_s = [2.0, 1.0]",
                "wait_s",
            ),
        ] {
            let error = read(&GOOD.replace(from, to)).unwrap_err();
            assert!(error.contains(said), "{to:?}: {error}");
        }
    }
}
