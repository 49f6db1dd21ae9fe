//! Suites: what a benchmark shows, asks and runs, as a TOML file says it.

mod fault;
pub mod file;
mod program;
mod task;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use launch_run::matrix::Seeds;
use schema_frames::{InputRecord, ResultType};
use schema_types::noise::mix;
use serde::Deserialize;
use toml::Table;

pub use fault::SuiteFault;
pub(crate) use program::ProcessTable;
pub use program::{Program, ProgramProcess};
pub use task::{Task, TaskKind, TruthPlace};

/// Added delays of the curve, milliseconds, if a suite names no others.
const DELAYS_MS: [f64; 12] = [
    0.0, 10.0, 20.0, 33.0, 50.0, 75.0, 100.0, 150.0, 200.0, 300.0, 400.0, 500.0,
];

/// Places by which a drawn seed may move the beginning of a drive; maps count theirs in a circle.
const MAX_DRAWN_PLACE: u32 = 1000;
/// By how much longer a drawn drive may go on before it is recorded: 0 to 3 s.
const DRAWN_SETTLE_STEPS: u32 = 31;
const DRAWN_SETTLE_STEP_S: f64 = 0.1;
/// Shares of the speed limit of drawn drives: 0.6 to 1, in steps.
const DRAWN_SPEED_STEPS: u32 = 41;
const DRAWN_SPEED_STEP: f64 = 0.01;

/// A suite.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Suite {
    /// 1.
    pub version: u32,
    /// Its name; the file's if it is empty.
    #[serde(default)]
    pub name: String,
    /// A sentence for people.
    #[serde(default)]
    pub description: String,
    /// Seed of everything random; those of the matrix are added to it.
    #[serde(default = "one")]
    pub seed: u64,
    /// Simulated seconds before anything is recorded, so that traffic is under way.
    #[serde(default = "two_secs")]
    pub settle_s: f64,
    /// Simulated seconds that programs are shown but that do not count.
    #[serde(default = "one_sec")]
    pub warm_up_s: f64,
    /// Simulated seconds that count.
    pub secs: f64,
    /// Ticks per simulated second.
    #[serde(default = "twenty")]
    pub tick_hz: f64,
    /// Comparisons of truth and newest result per simulated second; 0 in the file stands for the
    /// rate of the fastest input that a task is about, which reading fills in.
    #[serde(default)]
    pub query_hz: f64,
    /// Whether gantry-drive drives the ego and the other vehicles.
    #[serde(default = "yes")]
    pub drive: bool,
    /// Delays of the curve, milliseconds.
    #[serde(default = "delays_ms")]
    pub delays_ms: Vec<f64>,
    /// Longest wait for the answer to a frame in lockstep, seconds of the wall clock.
    #[serde(default = "ten_secs")]
    pub answer_within_s: f64,
    /// Longest wait for a program to be ready, seconds of the wall clock.
    #[serde(default = "a_minute")]
    pub ready_within_s: f64,
    /// Longest wait for answers after the last frame, seconds of the wall clock.
    #[serde(default = "five_secs")]
    pub patience_s: f64,
    /// What is varied.
    #[serde(default)]
    pub matrix: Matrix,
    /// Scenarios one by one, behind those of the matrix.
    #[serde(default, rename = "scenario")]
    pub listed: Vec<ListedScenario>,
    /// Densities of traffic by name, besides `empty`, `light`, `medium` and `dense`.
    #[serde(default)]
    pub density: BTreeMap<String, Density>,
    /// Weathers by name: keys of a launch file's `scenario.weather`.
    #[serde(default)]
    pub weather: BTreeMap<String, Table>,
    /// Times of day by name: `sun_altitude_deg`, `sun_azimuth_deg`.
    #[serde(default)]
    pub time: BTreeMap<String, Table>,
    /// Rigs by name.
    pub rig: BTreeMap<String, Rig>,
    /// Further keys of every scenario's launch file.
    #[serde(default)]
    pub launch: Table,
    /// Topics of inputs whose points or events keep the numbers and classes of objects, because
    /// programs are to have them.
    #[serde(default)]
    pub exact_inputs: Vec<String>,
    /// Programs that run beside the simulator in lockstep, whose results are inputs of all programs.
    #[serde(default)]
    input: BTreeMap<String, ProcessTable>,
    /// What is asked of programs.
    #[serde(default, rename = "task")]
    pub tasks: Vec<Task>,
    /// Programs by name, as the file says them.
    #[serde(default)]
    program: BTreeMap<String, program::ProgramTable>,
    /// Programs, by name.
    #[serde(skip)]
    pub programs: Vec<Program>,
    /// What `input` says, by name.
    #[serde(skip)]
    pub input_programs: Vec<ProgramProcess>,
    /// Folder in which relative paths begin.
    #[serde(skip)]
    pub folder: PathBuf,
    /// The file's text.
    #[serde(skip)]
    pub text: String,
    /// Whether the seed is another than the file's, see [`Suite::draw`].
    #[serde(skip)]
    pub is_drawn: bool,
    /// Share of the speed limit that gantry-drive drives; `None`: its own.
    #[serde(skip)]
    pub speed_factor: Option<f64>,
}

/// The matrix: every combination is a scenario.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Matrix {
    /// Maps, as in a launch file; a path begins beside the suite. None if all scenarios are listed.
    #[serde(default)]
    pub maps: Vec<String>,
    /// Names of weathers.
    #[serde(default = "clear")]
    pub weathers: Vec<String>,
    /// Names of times of day.
    #[serde(default = "noon")]
    pub times: Vec<String>,
    /// Names of densities.
    #[serde(default = "light")]
    pub densities: Vec<String>,
    /// Names of rigs; empty: all.
    #[serde(default)]
    pub rigs: Vec<String>,
    /// Places where the ego begins.
    #[serde(default = "first_place")]
    pub spawn_points: Vec<u32>,
    /// Numbers that are added to the suite's seed.
    #[serde(default = "no_offset")]
    pub seeds: Seeds,
    /// Maps on which programs may have been trained; none of `maps`.
    #[serde(default)]
    pub training_maps: Vec<String>,
}

impl Default for Matrix {
    fn default() -> Matrix {
        Matrix {
            maps: Vec::new(),
            weathers: clear(),
            times: noon(),
            densities: light(),
            rigs: Vec::new(),
            spawn_points: first_place(),
            seeds: no_offset(),
            training_maps: Vec::new(),
        }
    }
}

/// A scenario that stands by itself, with the names that the matrix takes.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ListedScenario {
    /// Map.
    pub map: String,
    /// Weather.
    #[serde(default = "clear_weather")]
    pub weather: String,
    /// Time of day.
    #[serde(default = "at_noon")]
    pub time: String,
    /// Density of traffic.
    #[serde(default = "light_traffic")]
    pub density: String,
    /// Rig; the first if it is empty.
    #[serde(default)]
    pub rig: String,
    /// Place where the ego begins.
    #[serde(default)]
    pub spawn_point: u32,
    /// Number that is added to the suite's seed.
    #[serde(default)]
    pub seed: u64,
}

/// Other traffic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Density {
    /// Vehicles besides the ego.
    pub vehicles: u32,
    /// People on foot.
    pub walkers: u32,
}

/// Densities that every suite may name.
const DENSITIES: [(&str, Density); 4] = [
    ("empty", density(0, 0)),
    ("light", density(20, 20)),
    ("medium", density(50, 60)),
    ("dense", density(100, 150)),
];

const fn density(vehicles: u32, walkers: u32) -> Density {
    Density { vehicles, walkers }
}

/// Sensors and what carries them, in a launch file's words. The sensors are what programs get.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// `[ego]`.
    #[serde(default)]
    pub ego: Table,
    /// `[sensor.NAME]`, on the rig `ego`.
    pub sensor: Table,
}

impl Suite {
    /// A suite that is not checked yet; relative paths begin in `folder`.
    ///
    /// # Errors
    /// A sentence.
    pub(crate) fn unchecked(text: &str, folder: &Path, name: &str) -> Result<Suite, SuiteFault> {
        let mut suite: Suite = file::tables(text)?;
        suite.text = text.to_owned();
        suite.folder = folder.to_owned();
        if suite.name.is_empty() {
            suite.name = name.to_owned();
        }
        for task in &mut suite.tasks {
            if task.name.is_empty() {
                task.name = task.kind.name().to_owned();
            }
        }
        for (name, table) in std::mem::take(&mut suite.program) {
            suite.programs.push(table.program(&name, folder)?);
        }
        for (name, table) in std::mem::take(&mut suite.input) {
            let mut process = table.process(&name, folder)?;
            process.lockstep = true;
            suite.input_programs.push(process);
        }
        Ok(suite)
    }

    /// Takes another seed than the one that everybody knows. The egos also begin elsewhere, have
    /// driven for longer when the recording begins, and drive at another speed: along a straight
    /// street little else depends on the seed, and straight paths are alike once they are aligned.
    pub fn draw(&mut self, seed: u64) {
        (self.seed, self.is_drawn) = (seed, true);
        let drawn = |which: u64, n: u32| (mix(mix(seed) ^ which) % u64::from(n)) as u32;
        let by = drawn(1, MAX_DRAWN_PLACE);
        for place in &mut self.matrix.spawn_points {
            *place = place.saturating_add(by);
        }
        for scenario in &mut self.listed {
            scenario.spawn_point = scenario.spawn_point.saturating_add(by);
        }
        self.settle_s += f64::from(drawn(2, DRAWN_SETTLE_STEPS)) * DRAWN_SETTLE_STEP_S;
        let slower = f64::from(drawn(3, DRAWN_SPEED_STEPS)) * DRAWN_SPEED_STEP;
        self.speed_factor = Some(1.0 - slower);
    }

    /// The task of this name.
    pub fn task(&self, name: &str) -> Option<&Task> {
        self.tasks.iter().find(|task| task.name == name)
    }

    /// Whether programs act on the world, so that nothing can be recorded beforehand.
    pub fn is_closed_loop(&self) -> bool {
        self.tasks.iter().any(|task| task.kind.acts())
    }

    /// The program of this name.
    pub fn program(&self, name: &str) -> Option<&Program> {
        self.programs.iter().find(|program| program.name == name)
    }

    /// The rigs that the matrix has.
    pub fn rigs(&self) -> Vec<String> {
        match self.matrix.rigs.is_empty() {
            true => self.rig.keys().cloned().collect(),
            false => self.matrix.rigs.clone(),
        }
    }

    /// A density by name.
    ///
    /// # Errors
    /// A sentence with the names that there are.
    pub fn density(&self, name: &str) -> Result<Density, SuiteFault> {
        let preset = DENSITIES.iter().find(|(other, _)| *other == name);
        let found = self.density.get(name).copied();
        found
            .or(preset.map(|(_, density)| *density))
            .ok_or_else(|| {
                let known = DENSITIES.iter().map(|(name, _)| *name);
                let own = self.density.keys().map(String::as_str);
                format!(
                    "there is no density {name:?}; there is {}, and [density.NAME] makes another",
                    known.chain(own).collect::<Vec<_>>().join(", ")
                )
                .into()
            })
    }

    /// The task that results of a topic are scored as: what the program's `results` say, else the
    /// task that names the topic, else the first one that results of this type fit and that is about
    /// the sensor which they answer.
    pub fn task_of(
        &self,
        program: &Program,
        topic: &str,
        kind: ResultType,
        inputs: &[InputRecord],
    ) -> Option<&Task> {
        if !program.results.is_empty() {
            return self.task(program.results.get(topic)?);
        }
        if let Some(task) = self
            .tasks
            .iter()
            .find(|it| it.topic.as_deref() == Some(topic))
        {
            return Some(task);
        }
        let fits = |task: &&Task| task.topic.is_none() && task.kind.result_types().contains(&kind);
        let sensors: Vec<String> = inputs.iter().map(InputRecord::topic).collect();
        let is_about = |task: &&Task| {
            let sensor = task.sensor.as_deref();
            sensors
                .iter()
                .any(|topic| topic.split('/').nth(1) == sensor && sensor.is_some())
        };
        let fitting = || self.tasks.iter().filter(fits);
        // A chain answers results, which tell nothing about sensors.
        fitting().find(is_about).or_else(|| fitting().next())
    }
}

fn clear_weather() -> String {
    "clear".into()
}
fn at_noon() -> String {
    "noon".into()
}
fn light_traffic() -> String {
    "light".into()
}
fn one() -> u64 {
    1
}
fn one_sec() -> f64 {
    1.0
}
fn two_secs() -> f64 {
    2.0
}
fn five_secs() -> f64 {
    5.0
}
fn ten_secs() -> f64 {
    10.0
}
fn a_minute() -> f64 {
    60.0
}
fn twenty() -> f64 {
    20.0
}
fn yes() -> bool {
    true
}
fn delays_ms() -> Vec<f64> {
    DELAYS_MS.to_vec()
}
fn clear() -> Vec<String> {
    vec!["clear".into()]
}
fn noon() -> Vec<String> {
    vec!["noon".into()]
}
fn light() -> Vec<String> {
    vec!["light".into()]
}
fn first_place() -> Vec<u32> {
    vec![0]
}
fn no_offset() -> Seeds {
    Seeds::List(vec![0])
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) const SMALL: &str = r#"
version = 1
secs = 2.0
tick_hz = 20
[matrix]
maps = ["Town01"]
weathers = ["clear", "rain"]
[rig.car.sensor.front]
kind = "camera"
rate_hz = 10
modalities = ["rgb"]
width_px = 96
height_px = 64
[rig.car.sensor.roof]
kind = "lidar"
rate_hz = 10
[[task]]
kind = "boxes2d"
sensor = "front"
[[task]]
kind = "depth"
sensor = "front"
[program.quick]
cmd = ["python", "quick.py"]
results = { "quick/boxes" = "boxes2d" }
[program.free]
cmd = ["./free"]
"#;

    pub(crate) fn read(text: &str) -> Result<Suite, String> {
        Suite::parse(text, Path::new("/suites"), "small").map_err(|fault| fault.to_string())
    }

    #[test]
    fn a_small_suite_has_defaults() {
        let suite = read(SMALL).unwrap();
        assert_eq!((suite.name.as_str(), suite.seed), ("small", 1));
        assert_eq!((suite.query_hz, suite.delays_ms.len()), (10.0, 12));
        assert_eq!(suite.tasks[0].name, "boxes2d");
        assert_eq!(suite.rigs(), ["car"]);
        assert_eq!(suite.programs.len(), 2);
        assert_eq!(suite.density("dense"), Ok(density(100, 150)));
    }

    #[test]
    fn a_drawn_seed_moves_the_beginning_and_the_same_one_by_as_much() {
        let drawn = |seed| {
            let mut suite = read(SMALL).unwrap();
            suite.draw(seed);
            let speed = suite.speed_factor.unwrap();
            assert!((0.599..=1.0).contains(&speed), "{speed}");
            assert!((2.0..=5.001).contains(&suite.settle_s));
            (suite.seed, suite.matrix.spawn_points, suite.settle_s)
        };
        assert_eq!(drawn(5).0, 5);
        assert_eq!(drawn(5), drawn(5));
        let mut places: Vec<Vec<u32>> = (1..=100).map(|seed| drawn(seed).1).collect();
        places.sort();
        places.dedup();
        // A hundred draws of a thousand places leave 95 different ones on average, and 85 is more
        // than four standard deviations below.
        assert!(places.len() >= 85, "{}", places.len());
    }

    #[test]
    fn results_find_their_task_by_name_or_by_type() {
        let suite = read(SMALL).unwrap();
        let (free, quick) = (&suite.programs[0], &suite.programs[1]);
        let name = |task: Option<&Task>| task.map(|task| task.name.clone());
        let of = |program, topic, kind| name(suite.task_of(program, topic, kind, &[]));
        let boxes = Some("boxes2d".to_owned());
        assert_eq!(of(quick, "quick/boxes", ResultType::Boxes2d), boxes);
        assert_eq!(of(quick, "other", ResultType::Boxes2d), None);
        assert_eq!(of(free, "any/thing", ResultType::Boxes2d), boxes);
        assert_eq!(
            of(free, "any/depth", ResultType::Depth).as_deref(),
            Some("depth")
        );
        assert_eq!(of(free, "any/text", ResultType::Text), None);
    }
}
