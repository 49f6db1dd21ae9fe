//! Scenarios: the combinations of a suite's matrix, and the launch file of each, with the inputs
//! that programs get and the sensors that see the truth.

use std::collections::{BTreeMap, BTreeSet};

use launch_run::matrix::{combinations, name, number_doubles};
use launch_spec::Launch;
use launch_spec::presets::{self, merge};
use schema_frames::{Modality, SensorKind};
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use crate::suite::SuiteFault;
use crate::suite::{Suite, TruthPlace};

/// Longest name of a scenario.
const MAX_NAME: usize = 64;

/// One scenario.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Scenario {
    /// Its name, unique in the suite.
    pub name: String,
    /// Map, as the suite names it.
    pub map: String,
    /// Name of the weather.
    pub weather: String,
    /// Name of the time of day.
    pub time: String,
    /// Name of the density of traffic.
    pub density: String,
    /// Name of the rig.
    pub rig: String,
    /// Where the ego begins.
    pub spawn_point: u32,
    /// Seed of everything random.
    pub seed: u64,
    /// Vehicles besides the ego.
    pub vehicles: u32,
    /// People on foot.
    pub walkers: u32,
}

/// A topic that programs get.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputTopic {
    /// Without the domain.
    pub topic: String,
    /// Its sensor's name; empty for results of an input program.
    pub sensor: String,
    /// Frames per simulated second; `None` if they come when something happens.
    pub rate_hz: Option<f64>,
}

impl Scenario {
    /// What makes it, for reports.
    pub fn settings(&self) -> BTreeMap<String, String> {
        let pairs = [
            ("map", self.map.clone()),
            ("weather", self.weather.clone()),
            ("time", self.time.clone()),
            ("density", self.density.clone()),
            ("rig", self.rig.clone()),
            ("spawn_point", self.spawn_point.to_string()),
            ("seed", self.seed.to_string()),
            ("vehicles", self.vehicles.to_string()),
            ("walkers", self.walkers.to_string()),
        ];
        pairs.map(|(key, value)| (key.to_owned(), value)).into()
    }

    /// The launch file of its world and its inputs, without processes.
    ///
    /// # Errors
    /// A sentence if a weather or a time of day is unknown.
    pub fn launch(&self, suite: &Suite) -> Result<Table, SuiteFault> {
        let rig = suite.rig.get(&self.rig);
        let rig = rig.ok_or_else(|| format!("there is no [rig.{}]", self.rig))?;
        let sentence = |error: presets::PresetError| error.to_string();
        let mut weather = presets::weather(&self.weather, &suite.weather).map_err(sentence)?;
        weather.extend(presets::time(&self.time, &suite.time).map_err(sentence)?);
        let map = match self.map.contains('/') {
            true => suite.folder.join(&self.map).display().to_string(),
            false => self.map.clone(),
        };
        let mut world = Table::new();
        world.insert("map".into(), map.into());
        world.insert("seed".into(), Value::Integer(self.seed as i64));
        world.insert("tick_hz".into(), suite.tick_hz.into());
        world.insert("mode".into(), "stepped".into());
        world.insert("vehicles".into(), i64::from(self.vehicles).into());
        world.insert("walkers".into(), i64::from(self.walkers).into());
        world.insert("weather".into(), Value::Table(weather));
        let mut ego = rig.ego.clone();
        let place = i64::from(self.spawn_point);
        ego.entry("spawn_point").or_insert(Value::Integer(place));
        let mut launch = Table::new();
        launch.insert("version".into(), Value::Integer(1));
        launch.insert("scenario".into(), Value::Table(world));
        launch.insert("ego".into(), Value::Table(ego));
        launch.insert("sensor".into(), Value::Table(rig.sensor.clone()));
        merge(&mut launch, &suite.launch);
        Ok(launch)
    }

    /// The topics of its sensors, as the simulator will make them.
    ///
    /// # Errors
    /// A sentence with everything that is wrong with the rig.
    pub fn inputs(&self, suite: &Suite) -> Result<Vec<InputTopic>, SuiteFault> {
        self.topics(self.launch(suite)?)
    }

    /// As [`Scenario::inputs`], of a scenario that a user recorded, whose weather has no name.
    ///
    /// # Errors
    /// As [`Scenario::inputs`].
    pub fn rig_inputs(&self, suite: &Suite) -> Result<Vec<InputTopic>, SuiteFault> {
        let rig = suite.rig.get(&self.rig);
        let rig = rig.ok_or_else(|| format!("there is no [rig.{}]", self.rig))?;
        let mut launch = Table::new();
        launch.insert("version".into(), Value::Integer(1));
        let world = [("tick_hz".to_owned(), suite.tick_hz.into())];
        let world: Table = world.into_iter().collect();
        launch.insert("scenario".into(), world.into());
        launch.insert("sensor".into(), Value::Table(rig.sensor.clone()));
        merge(&mut launch, &suite.launch);
        self.topics(launch)
    }

    fn topics(&self, launch: Table) -> Result<Vec<InputTopic>, SuiteFault> {
        let text = toml::to_string(&launch).map_err(|error| error.to_string())?;
        let launch = Launch::parse(&text, &format!("[rig.{}]", self.rig))
            .map_err(|errors| errors.to_string())?;
        let mut topics = Vec::new();
        for sensor in launch.placed_sensors() {
            for modality in sensor.spec.modalities() {
                topics.push(InputTopic {
                    topic: format!("{}/{}/{}", sensor.rig, sensor.name, modality.name()),
                    sensor: sensor.name.to_owned(),
                    rate_hz: sensor.spec.rate_hz(),
                });
            }
        }
        Ok(topics)
    }

    /// As [`Scenario::launch`], with the sensors that see the truth of all tasks.
    ///
    /// # Errors
    /// As [`Scenario::launch`].
    pub fn launch_with_truth(&self, suite: &Suite) -> Result<Table, SuiteFault> {
        let mut launch = self.launch(suite)?;
        let inputs = launch.get("sensor").and_then(Value::as_table).cloned();
        let mut sensors = inputs.clone().unwrap_or_default();
        for (name, wanted) in wanted(suite, &inputs.unwrap_or_default()) {
            let Some(input) = sensors.get(&name).and_then(Value::as_table).cloned() else {
                continue;
            };
            for place in [TruthPlace::Queries, TruthPlace::TenHz, TruthPlace::Lidar] {
                let modalities = of_place(&wanted, place);
                if modalities.is_empty() {
                    continue;
                }
                let mut truth = input.clone();
                let ending = match place {
                    TruthPlace::TenHz => "truth10",
                    _ => "truth",
                };
                match place {
                    TruthPlace::Lidar => {
                        truth.insert("semantic".into(), true.into());
                        if truth.contains_key("returns") || truth.contains_key("sensor") {
                            truth.insert("returns".into(), false.into());
                        }
                        truth.retain(|key, _| !is_loss(key));
                    }
                    _ => {
                        let rate_hz = match place {
                            TruthPlace::TenHz => 10.0,
                            _ => suite.query_hz,
                        };
                        truth.insert("rate_hz".into(), rate_hz.into());
                        truth.insert("modalities".into(), modalities.into());
                        truth.remove("dvs");
                    }
                }
                sensors.insert(format!("{name}_{ending}"), truth.into());
            }
            let own = of_place(&wanted, TruthPlace::Input);
            let input = sensors.get_mut(&name).and_then(Value::as_table_mut);
            if let Some(input) = input.filter(|_| !own.is_empty()) {
                let usual = || Value::Array(vec![Modality::Rgb.name().into()]);
                if let Some(list) = input
                    .entry("modalities")
                    .or_insert_with(usual)
                    .as_array_mut()
                {
                    let new: Vec<Value> = own.into_iter().filter(|it| !list.contains(it)).collect();
                    list.extend(new);
                }
            }
        }
        launch.insert("sensor".into(), sensors.into());
        Ok(launch)
    }
}

/// Keys of a lidar that take points away or move them, which the truth does not have.
fn is_loss(key: &str) -> bool {
    key.starts_with("dropoff") || key.starts_with("noise") || key == "attenuation_per_m"
}

/// What the truth of all tasks needs, by input sensor.
fn wanted(
    suite: &Suite,
    sensors: &Table,
) -> BTreeMap<String, BTreeSet<(TruthPlace, &'static str)>> {
    let mut all: BTreeMap<String, BTreeSet<_>> = BTreeMap::new();
    for task in &suite.tasks {
        let Some(name) = &task.sensor else { continue };
        let is_lidar = is_lidar(sensors, name);
        let needs = task.kind.truth(is_lidar);
        let needs = needs
            .into_iter()
            .map(|(place, modality)| (place, modality.name()));
        all.entry(name.clone()).or_default().extend(needs);
    }
    all
}

/// Whether a sensor of a rig is a lidar.
pub fn is_lidar(sensors: &Table, name: &str) -> bool {
    let sensor = sensors.get(name).and_then(|sensor| sensor.get("kind"));
    sensor.and_then(Value::as_str) == Some("lidar")
}

fn of_place(wanted: &BTreeSet<(TruthPlace, &'static str)>, place: TruthPlace) -> Vec<Value> {
    let of_it = wanted.iter().filter(|(other, _)| *other == place);
    of_it.map(|(_, modality)| (*modality).into()).collect()
}

/// All scenarios: those of the matrix, whose last key varies fastest, then those that are listed.
///
/// # Errors
/// A sentence if a density is unknown.
pub fn scenarios(suite: &Suite) -> Result<Vec<Scenario>, SuiteFault> {
    let matrix = &suite.matrix;
    let (rigs, seeds) = (suite.rigs(), matrix.seeds.list());
    let lengths = [
        matrix.maps.len(),
        matrix.weathers.len(),
        matrix.times.len(),
        matrix.densities.len(),
        rigs.len(),
        matrix.spawn_points.len(),
        seeds.len(),
    ];
    let mut found = Vec::new();
    for [map, weather, time, density, rig, spawn_point, offset] in combinations(lengths) {
        let traffic = suite.density(&matrix.densities[density])?;
        let mut scenario = Scenario {
            name: String::new(),
            map: matrix.maps[map].clone(),
            weather: matrix.weathers[weather].clone(),
            time: matrix.times[time].clone(),
            density: matrix.densities[density].clone(),
            rig: rigs[rig].clone(),
            spawn_point: matrix.spawn_points[spawn_point],
            seed: suite.seed.saturating_add(seeds[offset]),
            vehicles: traffic.vehicles,
            walkers: traffic.walkers,
        };
        scenario.name = name_of(suite, &scenario);
        found.push(scenario);
    }
    for listed in &suite.listed {
        let traffic = suite.density(&listed.density)?;
        let rig = match listed.rig.is_empty() {
            true => rigs.first().cloned().unwrap_or_default(),
            false => listed.rig.clone(),
        };
        let mut scenario = Scenario {
            name: String::new(),
            map: listed.map.clone(),
            weather: listed.weather.clone(),
            time: listed.time.clone(),
            density: listed.density.clone(),
            rig,
            spawn_point: listed.spawn_point,
            seed: suite.seed.saturating_add(listed.seed),
            vehicles: traffic.vehicles,
            walkers: traffic.walkers,
        };
        scenario.name = name_of(suite, &scenario);
        found.push(scenario);
    }
    number_doubles(found.iter_mut().map(|scenario| &mut scenario.name));
    Ok(found)
}

/// What is varied, in words that are safe in paths.
fn name_of(suite: &Suite, scenario: &Scenario) -> String {
    let matrix = &suite.matrix;
    let point = format!("p{}", scenario.spawn_point);
    let seed = format!("s{}", scenario.seed);
    let mut words = vec![scenario.weather.as_str(), &scenario.time];
    if matrix.densities.len() > 1 {
        words.push(&scenario.density);
    }
    if suite.rigs().len() > 1 {
        words.push(&scenario.rig);
    }
    if matrix.spawn_points.len() > 1 || !suite.listed.is_empty() {
        words.push(&point);
    }
    words.push(&seed);
    let name = name(&scenario.map, &words);
    let cut = name.len().saturating_sub(MAX_NAME);
    // The end says most: the seed stands there.
    name[cut..].to_owned()
}

/// Whether frames of a topic come from a camera.
pub fn is_camera(modality: Modality) -> bool {
    modality.sensor_kind() == SensorKind::Camera
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::suite::tests::{SMALL, read};

    #[test]
    fn every_combination_is_a_scenario_with_a_name() {
        let text = SMALL.replace("maps =", "densities = [\"empty\", \"dense\"]\nmaps =");
        let suite = read(&text.replace("secs = 2.0", "secs = 2.0\nseed = 7")).unwrap();
        let found = scenarios(&suite).unwrap();
        let names: Vec<&str> = found.iter().map(|it| it.name.as_str()).collect();
        assert_eq!(
            names,
            [
                "Town01_clear_noon_empty_s7",
                "Town01_clear_noon_dense_s7",
                "Town01_rain_noon_empty_s7",
                "Town01_rain_noon_dense_s7"
            ]
        );
        assert_eq!((found[1].vehicles, found[1].walkers), (100, 150));
    }

    #[test]
    fn listed_scenarios_stand_behind_those_of_the_matrix_or_alone() {
        let listed = "[[scenario]]\nmap = \"Town02\"\nspawn_point = 5\ntime = \"night\"\nseed = 3\n\
                      [[scenario]]\nmap = \"Town03\"\nweather = \"rain\"\ndensity = \"dense\"\n";
        let text = SMALL.replace("[program.quick]", &format!("{listed}[program.quick]"));
        let mut suite = read(&text).unwrap();
        let names = |suite: &Suite| -> Vec<String> {
            let all = scenarios(suite).unwrap();
            all.into_iter().map(|it| it.name).collect()
        };
        assert_eq!(
            names(&suite),
            [
                "Town01_clear_noon_p0_s1",
                "Town01_rain_noon_p0_s1",
                "Town02_clear_night_p5_s4",
                "Town03_rain_noon_p0_s1",
            ]
        );
        let dense = &scenarios(&suite).unwrap()[3];
        assert_eq!(
            (dense.vehicles, dense.walkers, dense.rig.as_str()),
            (100, 150, "car")
        );
        suite.draw(77);
        let drawn = scenarios(&suite).unwrap();
        assert_eq!(drawn[2].spawn_point, drawn[0].spawn_point + 5);

        let start = text.find("[matrix]").unwrap();
        let end = start + 1 + text[start + 1..].find("\n[").unwrap();
        let alone = format!("{}{}", &text[..start], &text[end..]);
        assert_eq!(
            names(&read(&alone).unwrap()),
            ["Town02_clear_night_p5_s4", "Town03_rain_noon_p0_s1"]
        );
        for (from, to, words) in [
            (
                "map = \"Town03\"",
                "map = \"Town03\"\nrig = \"lorry\"",
                "names the rig \"lorry\"",
            ),
            (
                "[matrix]",
                "[matrix]\ntraining_maps = [\"Town02\"]",
                "or of [[scenario]]",
            ),
        ] {
            let error = read(&text.replace(from, to)).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn inputs_are_what_the_rig_has_and_the_truth_is_added_beside_them() {
        let more = "[[task]]\nkind = \"flow\"\nsensor = \"front\"\n[[task]]\nkind = \"lidar_semantic\"\nsensor = \"roof\"\n";
        let suite = read(&SMALL.replace("[program.quick]", &format!("{more}[program.quick]")));
        let suite = suite.unwrap();
        let scenario = &scenarios(&suite).unwrap()[0];
        let inputs = scenario.inputs(&suite).unwrap();
        let topics: Vec<&str> = inputs.iter().map(|it| it.topic.as_str()).collect();
        assert_eq!(topics, ["ego/front/rgb", "ego/roof/lidar"]);
        let launch = scenario.launch_with_truth(&suite).unwrap();
        let sensors = launch["sensor"].as_table().unwrap();
        let names: Vec<&String> = sensors.keys().collect();
        assert_eq!(names, ["front", "front_truth", "roof", "roof_truth"]);
        let modalities = |name: &str| sensors[name]["modalities"].to_string();
        assert_eq!(modalities("front"), "[\"rgb\", \"flow\"]");
        assert_eq!(
            modalities("front_truth"),
            "[\"depth\", \"instance\", \"semantic\"]"
        );
        assert_eq!(sensors["roof_truth"]["semantic"].as_bool(), Some(true));
        let text = toml::to_string(&launch).unwrap();
        Launch::parse(&text, "truth").unwrap();
    }
}
