//! Reads suites and checks what their types do not say: ranges, names that must exist, rates that
//! must fit.

use std::collections::BTreeSet;
use std::path::Path;

use schema_frames::Modality;
use toml::Table;

use crate::scenario::{InputTopic, Scenario, is_camera, is_lidar, scenarios};
use crate::suite::file::{SuiteFile, check_version};
use crate::suite::{ListedScenario, Suite, SuiteFault, Task, TaskKind};

/// Most scenarios of a suite.
const MAX_SCENARIOS: usize = 10_000;
/// Most delays of a curve.
const MAX_DELAYS: usize = 100;
/// Windows of event flow, as DSEC has them.
const EVENT_FLOW_HZ: f64 = 10.0;

impl Suite {
    /// Reads and checks a suite.
    ///
    /// # Errors
    /// [`launch_cli::wrong_usage`] with the file, what is wrong, and what is allowed.
    pub fn read(file: &Path) -> anyhow::Result<Suite> {
        let folder = std::path::absolute(file)?
            .parent()
            .map(Path::to_owned)
            .unwrap_or_default();
        let file = SuiteFile::read(file)?;
        Suite::parse(&file.text, &folder, &file.stem()).map_err(|fault| file.refused(&[fault]))
    }

    /// As [`Suite::read`], of a text whose relative paths begin in `folder`.
    ///
    /// # Errors
    /// A sentence.
    pub fn parse(text: &str, folder: &Path, name: &str) -> Result<Suite, SuiteFault> {
        let mut suite = Suite::unchecked(text, folder, name)?;
        suite.check()?;
        Ok(suite)
    }

    /// Checks everything, and fills in the rate of queries.
    ///
    /// # Errors
    /// A sentence with the key, the value and what is allowed.
    fn check(&mut self) -> Result<(), SuiteFault> {
        check_version(self.version)?;
        for (key, value, least, most) in [
            ("settle_s", self.settle_s, 0.0, 3600.0),
            ("warm_up_s", self.warm_up_s, 0.0, 3600.0),
            ("secs", self.secs, 0.01, 36_000.0),
            ("tick_hz", self.tick_hz, 0.1, 1000.0),
            ("answer_within_s", self.answer_within_s, 0.01, 3600.0),
            ("ready_within_s", self.ready_within_s, 0.1, 3600.0),
            ("patience_s", self.patience_s, 0.01, 3600.0),
        ] {
            in_range(key, value, least, most)?;
        }
        if self.query_hz != 0.0 {
            in_range("query_hz", self.query_hz, 0.1, self.tick_hz)?;
        }
        if self.seed > i64::MAX as u64 {
            return Err(format!("seed = {}; it lies in 0 to 2^63 - 1", self.seed).into());
        }
        self.delays_ms.sort_by(f64::total_cmp);
        self.delays_ms.dedup();
        if self.delays_ms.len() > MAX_DELAYS
            || self
                .delays_ms
                .iter()
                .any(|it| !(0.0..=10_000.0).contains(it))
        {
            return Err(format!(
                "delays_ms has {} values; it is a list of at most {MAX_DELAYS} numbers from 0 to 10000",
                self.delays_ms.len()
            ).into());
        }
        self.check_matrix()?;
        self.check_tasks()?;
        self.check_programs()?;
        let all = scenarios(self)?;
        if all.is_empty() || all.len() > MAX_SCENARIOS {
            return Err(format!(
                "there are {} scenarios; a suite has 1 to {MAX_SCENARIOS}",
                all.len()
            )
            .into());
        }
        self.check_exact_inputs(&all)?;
        let mut rates = BTreeSet::new();
        let mut seen = BTreeSet::new();
        for scenario in &all {
            // Weathers and maps are looked at by the simulator's own checks below, once for each.
            let key = (&scenario.rig, &scenario.weather, &scenario.time);
            if !seen.insert(key) {
                continue;
            }
            let inputs = scenario.inputs(self)?;
            let sensors = self.rig[&scenario.rig].sensor.clone();
            for task in &self.tasks {
                check_sensor(task, &scenario.rig, &sensors, &inputs)?;
            }
            let about = |input: &&InputTopic| {
                self.tasks.is_empty()
                    || self
                        .tasks
                        .iter()
                        .any(|task| task.sensor.as_deref() == Some(&input.sensor))
            };
            for input in inputs.iter().filter(about) {
                rates.extend(input.rate_hz.map(f64::to_bits));
            }
        }
        let rates: Vec<f64> = rates.into_iter().map(f64::from_bits).collect();
        self.settle_rates(&rates)
    }

    /// Fills in the rate of queries, and checks it against the inputs.
    fn settle_rates(&mut self, rates: &[f64]) -> Result<(), SuiteFault> {
        let fastest = rates.iter().copied().fold(0.0, f64::max);
        if self.query_hz == 0.0 {
            self.query_hz = if fastest > 0.0 { fastest } else { self.tick_hz };
        }
        if !divides(self.query_hz, self.tick_hz) {
            return Err(format!(
                "query_hz = {}; it must divide tick_hz = {}, because truth exists at ticks",
                self.query_hz, self.tick_hz
            )
            .into());
        }
        for rate_hz in rates {
            if !divides(*rate_hz, self.query_hz) {
                return Err(format!(
                    "query_hz = {}; it must be a multiple of the inputs' rate_hz = {rate_hz}, so that every frame has its truth",
                    self.query_hz
                ).into());
            }
        }
        let flows = |task: &Task| task.kind == TaskKind::EventFlow;
        if self.tasks.iter().any(flows) && !divides(EVENT_FLOW_HZ, self.tick_hz) {
            return Err(format!(
                "tick_hz = {}; a task of kind event_flow needs a multiple of {EVENT_FLOW_HZ}",
                self.tick_hz
            )
            .into());
        }
        Ok(())
    }

    /// Inputs that keep numbers and classes must be inputs that have some.
    fn check_exact_inputs(&self, all: &[Scenario]) -> Result<(), SuiteFault> {
        for exact in &self.exact_inputs {
            let mut topics = BTreeSet::new();
            for scenario in all {
                let inputs = scenario.inputs(self)?;
                topics.extend(inputs.into_iter().map(|input| input.topic));
            }
            topics.retain(|topic| {
                let last = topic.rsplit('/').next().unwrap_or_default();
                let modality = Modality::from_name(last);
                modality.is_some_and(|modality| !modality.sealed_bytes().is_empty())
            });
            if !topics.contains(exact) {
                return Err(format!(
                    "exact_inputs names {exact:?}; inputs with numbers and classes of objects are {}",
                    match topics.is_empty() {
                        true => "none in this suite".to_owned(),
                        false => list(topics.iter()),
                    }
                )
                .into());
            }
        }
        Ok(())
    }

    fn check_matrix(&self) -> Result<(), SuiteFault> {
        let matrix = &self.matrix;
        for (key, is_empty) in [
            ("maps", matrix.maps.is_empty() && self.listed.is_empty()),
            ("weathers", matrix.weathers.is_empty()),
            ("times", matrix.times.is_empty()),
            ("densities", matrix.densities.is_empty()),
            ("spawn_points", matrix.spawn_points.is_empty()),
            ("seeds", matrix.seeds.list().is_empty()),
        ] {
            if is_empty {
                return Err(format!("matrix.{key} is empty; give at least one value").into());
            }
        }
        let is_scored = |map: &&String| {
            matrix.maps.contains(map) || self.listed.iter().any(|place| place.map == **map)
        };
        if let Some(map) = matrix.training_maps.iter().find(is_scored) {
            return Err(format!(
                "matrix.training_maps names {map:?}, which is one of matrix.maps or of [[scenario]]; a program that was trained on a map is not scored on it"
            )
            .into());
        }
        let has_rig =
            |place: &&ListedScenario| place.rig.is_empty() || self.rig.contains_key(&place.rig);
        if let Some(place) = self.listed.iter().find(|place| !has_rig(place)) {
            return Err(format!(
                "[[scenario]] names the rig {:?}; there is {}",
                place.rig,
                list(self.rig.keys())
            )
            .into());
        }
        if let Some(name) = self
            .rigs()
            .iter()
            .find(|name| !self.rig.contains_key(*name))
        {
            return Err(format!(
                "matrix.rigs names {name:?}; there is {}",
                list(self.rig.keys())
            )
            .into());
        }
        if self.rig.is_empty() {
            return Err("there is no rig; give [rig.NAME.sensor.NAME] with a kind".into());
        }
        for (name, rig) in &self.rig {
            let is_truth = |name: &&String| name.ends_with("_truth") || name.ends_with("_truth10");
            if let Some(sensor) = rig.sensor.keys().find(is_truth) {
                return Err(format!(
                    "[rig.{name}.sensor.{sensor}]: names that end with _truth are those of the benchmark's own sensors"
                ).into());
            }
            let carried = |spec: &toml::Value| spec.get("rig").is_some();
            if let Some((sensor, _)) = rig.sensor.iter().find(|(_, spec)| carried(spec)) {
                return Err(format!(
                    "[rig.{name}.sensor.{sensor}] has the key \"rig\"; sensors of a suite are carried by the ego"
                ).into());
            }
        }
        Ok(())
    }

    fn check_tasks(&self) -> Result<(), SuiteFault> {
        let mut names = BTreeSet::new();
        for task in &self.tasks {
            crate::score::check(task)?;
            if !names.insert(&task.name) {
                return Err(format!(
                    "two tasks are called {:?}; give one of them another `name`",
                    task.name
                )
                .into());
            }
        }
        let acting = self.tasks.iter().filter(|task| task.kind.acts()).count();
        if acting > 0 && acting < self.tasks.len() {
            return Err(
                "a task of kind driving changes the world, so what others see is not the same for every program; put it into a suite of its own".into());
        }
        Ok(())
    }

    fn check_programs(&self) -> Result<(), SuiteFault> {
        for program in &self.programs {
            for (topic, task) in &program.results {
                if self.task(task).is_none() {
                    return Err(format!(
                        "[program.{}] results: {topic:?} is to be scored as {task:?}; there is {}",
                        program.name,
                        list(self.tasks.iter().map(|task| &task.name))
                    )
                    .into());
                }
            }
        }
        Ok(())
    }
}

/// Whether the sensor of a task is there and of a kind that fits.
fn check_sensor(
    task: &Task,
    rig: &str,
    sensors: &Table,
    inputs: &[InputTopic],
) -> Result<(), SuiteFault> {
    let at = format!("the task {:?}", task.name);
    let Some(sensor) = &task.sensor else {
        return match task.kind {
            TaskKind::Driving => Ok(()),
            _ => Err(format!(
                "{at} has no sensor; give sensor = one of {}",
                list(sensors.keys())
            )
            .into()),
        };
    };
    for (key, name) in [("sensor", Some(sensor)), ("partner", task.partner.as_ref())] {
        if let Some(name) = name.filter(|name| !sensors.contains_key(*name)) {
            return Err(format!(
                "{at}: {key} = {name:?}, which [rig.{rig}] has not; it has {}",
                list(sensors.keys())
            )
            .into());
        }
    }
    let needs_lidar = task.kind == TaskKind::LidarSemantic;
    let any = matches!(
        task.kind,
        TaskKind::Boxes3d | TaskKind::Tracking | TaskKind::Odometry
    );
    if is_lidar(sensors, sensor) != needs_lidar && !any {
        let wanted = if needs_lidar { "a lidar" } else { "a camera" };
        return Err(format!("{at}: its sensor {sensor:?} must be {wanted}").into());
    }
    let has = |wanted: Modality| {
        let topic = format!("ego/{sensor}/{}", wanted.name());
        inputs.iter().any(|input| input.topic == topic)
    };
    if task.kind == TaskKind::EventFlow && !has(Modality::Dvs) {
        return Err(format!(
            "{at}: its sensor {sensor:?} makes no events; give it modalities = [\"dvs\"]"
        )
        .into());
    }
    if task.kind == TaskKind::Stereo && task.partner.is_none() {
        return Err(
            format!("{at} has no partner; give partner = the name of the right camera").into(),
        );
    }
    let camera = |input: &InputTopic| {
        let modality = input.topic.rsplit('/').next().and_then(Modality::from_name);
        input.sensor == *sensor && modality.is_some_and(is_camera)
    };
    let needs_camera = !any && !needs_lidar && task.kind != TaskKind::Driving;
    if needs_camera && !inputs.iter().any(camera) {
        return Err(format!("{at}: its sensor {sensor:?} must be a camera").into());
    }
    Ok(())
}

fn in_range(key: &str, value: f64, least: f64, most: f64) -> Result<(), SuiteFault> {
    match (least..=most).contains(&value) {
        true => Ok(()),
        false => Err(format!("{key} = {value}; it lies in {least} to {most}").into()),
    }
}

/// Whether `most` is a whole multiple of `least`.
fn divides(least: f64, most: f64) -> bool {
    let ratio = most / least;
    ratio >= 1.0 && (ratio - ratio.round()).abs() < 1e-9
}

fn list<T: ToString>(values: impl Iterator<Item = T>) -> String {
    let values: Vec<String> = values.map(|it| it.to_string()).collect();
    values.join(", ")
}

#[cfg(test)]
mod tests {
    use crate::suite::tests::{SMALL, read};

    #[test]
    fn what_is_wrong_is_said_in_a_sentence() {
        for (from, to, word) in [
            ("version = 1", "version = 2", "reads 1"),
            ("secs = 2.0", "secs = 0.0", "secs = 0; it lies in"),
            ("secs = 2.0", "sces = 2.0", "sces"),
            ("secs = 2.0", "secs = 2.0\nquery_hz = 15", "divide tick_hz"),
            (
                "tick_hz = 20",
                "tick_hz = 20\nquery_hz = 5",
                "multiple of the inputs' rate_hz",
            ),
            ("tick_hz = 20", "tick_hz = 20\nquery_hz = 40", "0.1 to 20"),
            ("\"rain\"", "\"snow\"", "there is no weather \"snow\""),
            ("maps =", "densities = [\"huge\"]\nmaps =", "[density.NAME]"),
            ("maps =", "rigs = [\"bus\"]\nmaps =", "there is car"),
            (
                "kind = \"depth\"\nsensor = \"front\"",
                "kind = \"depth\"\nsensor = \"back\"",
                "it has front, roof",
            ),
            (
                "kind = \"depth\"\nsensor = \"front\"",
                "kind = \"depth\"\nsensor = \"roof\"",
                "must be a camera",
            ),
            (
                "kind = \"depth\"\nsensor = \"front\"",
                "kind = \"depth\"",
                "has no sensor",
            ),
            ("kind = \"depth\"", "kind = \"stereo\"", "has no partner"),
            (
                "kind = \"depth\"",
                "kind = \"event_flow\"",
                "makes no events",
            ),
            (
                "kind = \"depth\"",
                "kind = \"driving\"\noptions = { route_m = 50 }",
                "a suite of its own",
            ),
            (
                "kind = \"depth\"",
                "kind = \"boxes2d\"",
                "two tasks are called",
            ),
            ("kind = \"depth\"", "kind = \"dept\"", "dept"),
            (
                "= \"boxes2d\" }",
                "= \"boxes\" }",
                "there is boxes2d, depth",
            ),
            ("cmd = [\"./free\"]", "", "has no cmd"),
            ("[program.free]", "[program.simd]", "no name for a program"),
            (
                "sensor.roof",
                "sensor.roof_truth",
                "names that end with _truth",
            ),
            ("width_px = 96", "width_px = 5", "width_px"),
            ("rate_hz = 10\nmod", "rate_hz = 7\nmod", "rate_hz"),
        ] {
            let text = SMALL.replacen(from, to, 1);
            assert_ne!(text, SMALL, "{from}");
            let error = read(&text).expect_err(to);
            assert!(error.contains(word), "{to}: {error}");
        }
    }

    #[test]
    fn queries_may_come_as_often_as_ticks() {
        let text = SMALL.replace("tick_hz = 20", "tick_hz = 1000\nquery_hz = 1000");
        assert_eq!(read(&text).unwrap().query_hz, 1000.0);
    }
}
