//! From text to a checked [`Launch`].

use std::collections::BTreeMap;

use sensor_spec::SensorSpec;
use toml::Value as Toml;

use crate::error::{Errors, LaunchError, LaunchErrors, Place, Source, did_you_mean};
use crate::fill::{fill, fill_entry, refuse_unknown, table_or_error};
use crate::model::{EGO_RIG, Ego, Launch, Rig, Scenario, Sensor};
use crate::tree::{Entry, Table, merge, place_of, read, set_as_toml};

mod processes;

/// Version of the launch file format.
pub const VERSION: i64 = 1;
/// Ticks per second a scenario may ask for.
const TICK_HZ: (f64, f64) = (0.1, 1000.0);
/// Most other vehicles.
const MAX_VEHICLES: u32 = 500;
/// Most people on foot.
const MAX_WALKERS: u32 = 1000;
const TOP: [&str; 8] = [
    "version",
    "scenario",
    "ego",
    "rig",
    "sensor",
    "defaults",
    "process",
    "description",
];

impl Launch {
    /// Reads and checks the text of a launch file; `file_name` is only used in messages.
    ///
    /// # Errors
    /// Everything that is wrong with it. A text that is no TOML is reported as such, without the
    /// errors of its content.
    pub fn parse(text: &str, file_name: &str) -> Result<Launch, LaunchErrors> {
        Self::parse_with(text, file_name, &[])
    }

    /// As [`Launch::parse`], with `key=value` settings laid over the file (`scenario.seed=7`,
    /// `sensor.front.width_px=640`).
    ///
    /// Values are typed as in TOML; what is no TOML value counts as text, so `scenario.map=Town02`
    /// needs no quotes.
    ///
    /// # Errors
    /// Everything that is wrong with the file or the settings.
    pub fn parse_with(
        text: &str,
        file_name: &str,
        sets: &[String],
    ) -> Result<Launch, LaunchErrors> {
        let mut errors = Errors::default();
        let mut wrong_sets = Vec::new();
        let mut set_texts = Vec::new();
        for set in sets {
            match set_as_toml(set) {
                Ok(typed) => set_texts.push((format!("--set {set}"), typed)),
                Err(message) => wrong_sets.push(LaunchError {
                    message,
                    place: "the command line".into(),
                }),
            }
        }
        let mut sources = vec![Source {
            name: file_name.to_owned(),
            text,
            is_file: true,
        }];
        sources.extend(set_texts.iter().map(|(name, text)| Source {
            name: name.clone(),
            text,
            is_file: false,
        }));
        let launch = read_all(&sources, &mut errors);
        let mut all = errors.finish(&sources).0;
        all.extend(wrong_sets);
        match launch {
            Some(launch) if all.is_empty() => Ok(launch),
            _ => Err(LaunchErrors(all)),
        }
    }
}

fn read_all(sources: &[Source<'_>], errors: &mut Errors) -> Option<Launch> {
    let mut file = read(sources[0].text, 0, errors)?;
    for (i, set) in sources.iter().enumerate().skip(1) {
        merge(&mut file, read(set.text, i, errors)?);
    }
    let launch = launch(&file, errors);
    Some(launch)
}

fn launch(file: &Table, errors: &mut Errors) -> Launch {
    check_version(file, errors);
    refuse_unknown(file, &TOP, "", errors);
    if let Some(entry) = file
        .get("description")
        .filter(|entry| !entry.node.plain().is_str())
    {
        errors.push(entry.node.at, "description is no text; write it in quotes");
    }
    let scenario = fill_entry(
        &Scenario::default(),
        file.get("scenario"),
        "scenario",
        &[],
        errors,
    );
    check_scenario(&scenario, file, errors);
    let ego = fill_entry(&Ego::default(), file.get("ego"), "ego", &[], errors);
    let rigs = rigs(file, &scenario, errors);
    let sensors = sensors(file, &scenario, &rigs, errors);
    check_ego(&ego, file, &rigs, &sensors, errors);
    let processes = processes::read(file, errors);
    Launch {
        scenario,
        ego,
        rigs,
        sensors,
        processes,
    }
}

/// What rides on the ego vehicle needs one.
fn check_ego(
    ego: &Ego,
    file: &Table,
    rigs: &BTreeMap<String, Rig>,
    sensors: &BTreeMap<String, Sensor>,
    errors: &mut Errors,
) {
    let rides = |sensor: &Sensor| {
        sensor
            .rigs
            .iter()
            .any(|rig| rigs.get(rig) == Some(&Rig::Ego))
    };
    if let Some((name, _)) = sensors
        .iter()
        .find(|(_, sensor)| ego.is_none() && rides(sensor))
    {
        let at = nearest_place(file, &format!("sensor.{name}"));
        errors.push(at, format!("sensor.{name} rides on the ego vehicle, but ego.type_id is \"none\"; give one of them another value"));
    }
}

fn check_version(file: &Table, errors: &mut Errors) {
    match file.get("version") {
        None => errors.push(
            Place::default(),
            format!("version is missing; begin the file with version = {VERSION}"),
        ),
        Some(entry) if entry.node.plain() == Toml::Integer(VERSION) => {}
        Some(entry) => errors.push(
            entry.node.at,
            format!(
                "version is {}, but this program reads {VERSION}",
                entry.node.plain()
            ),
        ),
    }
}

/// The place of a dotted key, or of the nearest table around it that the file has.
fn nearest_place(file: &Table, path: &str) -> Place {
    let mut path = path;
    loop {
        if let Some(at) = place_of(file, path) {
            return at;
        }
        let Some((shorter, _)) = path.rsplit_once('.') else {
            return Place::default();
        };
        path = shorter;
    }
}

fn check_scenario(scenario: &Scenario, file: &Table, errors: &mut Errors) {
    let mut range = |key: &str, value: f64, (low, high): (f64, f64)| {
        if !(low..=high).contains(&value) {
            let path = format!("scenario.{key}");
            errors.push(
                nearest_place(file, &path),
                format!("{path} is {value}, but must be {low} to {high}"),
            );
        }
    };
    range("tick_hz", scenario.tick_hz, TICK_HZ);
    range(
        "vehicles",
        scenario.vehicles.into(),
        (0.0, MAX_VEHICLES.into()),
    );
    range(
        "walkers",
        scenario.walkers.into(),
        (0.0, MAX_WALKERS.into()),
    );
    let weather = &scenario.weather;
    let percent = (0.0, 100.0);
    for (key, value, allowed) in [
        ("cloudiness", weather.cloudiness, percent),
        ("precipitation", weather.precipitation, percent),
        (
            "precipitation_deposits",
            weather.precipitation_deposits,
            percent,
        ),
        ("wind_intensity", weather.wind_intensity, percent),
        ("fog_density", weather.fog_density, percent),
        ("wetness", weather.wetness, percent),
        ("sun_azimuth_deg", weather.sun_azimuth_deg, (-360.0, 360.0)),
        ("sun_altitude_deg", weather.sun_altitude_deg, (-90.0, 90.0)),
        ("fog_distance_m", weather.fog_distance_m, (0.0, 10_000.0)),
        ("fog_falloff", weather.fog_falloff, (0.0, 10.0)),
        (
            "scattering_intensity",
            weather.scattering_intensity,
            (0.0, 1000.0),
        ),
        (
            "mie_scattering_scale",
            weather.mie_scattering_scale,
            (0.0, 5.0),
        ),
        (
            "rayleigh_scattering_scale",
            weather.rayleigh_scattering_scale,
            (0.0, 2.0),
        ),
        ("dust_storm", weather.dust_storm, percent),
    ] {
        range(&format!("weather.{key}"), value.into(), allowed);
    }
    if scenario.map.trim().is_empty() {
        errors.push(
            nearest_place(file, "scenario.map"),
            "scenario.map is empty; name a map such as \"Town10HD\", or an .xodr file",
        );
    }
}

/// The named tables below `[section.NAME]`, with names checked.
fn named<'t>(file: &'t Table, section: &str, errors: &mut Errors) -> Vec<(&'t str, &'t Entry)> {
    let Some(entry) = file.get(section) else {
        return Vec::new();
    };
    let Some(table) = table_or_error(entry, section, errors) else {
        return Vec::new();
    };
    for (name, entry) in table.iter().filter(|(name, _)| !is_name(name)) {
        errors.push(
            entry.key_at,
            format!("[{section}.{name}] has a name that is not 1 to 32 lower-case letters, digits or '_', a letter first"),
        );
    }
    table
        .iter()
        .map(|(name, entry)| (name.as_str(), entry))
        .collect()
}

/// Names become segments of service names and of files.
fn is_name(name: &str) -> bool {
    let rest = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    name.len() <= 32 && name.starts_with(|c: char| c.is_ascii_lowercase()) && name.chars().all(rest)
}

fn rigs(file: &Table, scenario: &Scenario, errors: &mut Errors) -> BTreeMap<String, Rig> {
    let mut rigs = BTreeMap::from([(EGO_RIG.to_owned(), Rig::Ego)]);
    for (name, entry) in named(file, "rig", errors) {
        let reserved = ["world", "control", "free"].contains(&name) || name.starts_with("actor_");
        if reserved {
            errors.push(
                entry.key_at,
                format!("[rig.{name}] has a name that the simulator uses itself; choose another"),
            );
        }
        if let Some(rig) = rig(name, entry, scenario, errors) {
            rigs.insert(name.to_owned(), rig);
        }
    }
    rigs
}

fn rig(name: &str, entry: &Entry, scenario: &Scenario, errors: &mut Errors) -> Option<Rig> {
    let path = format!("rig.{name}");
    let table = table_or_error(entry, &path, errors)?;
    refuse_unknown(table, &["vehicle", "pose"], &path, errors);
    let pose = table.get("pose").map(|pose| {
        Rig::Free(fill_entry(
            &Default::default(),
            Some(pose),
            &format!("{path}.pose"),
            &[],
            errors,
        ))
    });
    let Some(vehicle) = table.get("vehicle") else {
        if pose.is_none() {
            errors.push(
                entry.key_at,
                format!("[{path}] says not where it is; give vehicle = \"ego\", vehicle = 0 (another vehicle) or pose"),
            );
        }
        return pose;
    };
    if pose.is_some() {
        errors.push(
            vehicle.key_at,
            format!("[{path}] has both vehicle and pose; keep one"),
        );
    }
    let n_others = scenario.vehicles;
    match vehicle.node.plain() {
        Toml::String(word) if word == EGO_RIG => Some(Rig::Ego),
        Toml::Integer(idx) if (0..i64::from(n_others)).contains(&idx) => {
            Some(Rig::Other(idx as u32))
        }
        other => {
            let allowed = match n_others {
                0 => "or the index of another vehicle, of which scenario.vehicles has none"
                    .to_owned(),
                n => format!("or 0 to {} (scenario.vehicles is {n})", n - 1),
            };
            errors.push(
                vehicle.node.at,
                format!("{path}.vehicle is {other}, but must be \"ego\" {allowed}"),
            );
            None
        }
    }
}

fn sensors(
    file: &Table,
    scenario: &Scenario,
    rigs: &BTreeMap<String, Rig>,
    errors: &mut Errors,
) -> BTreeMap<String, Sensor> {
    let mut sensors = BTreeMap::new();
    for (name, entry) in named(file, "sensor", errors) {
        let path = format!("sensor.{name}");
        let Some(table) = table_or_error(entry, &path, errors) else {
            continue;
        };
        let carriers = carriers(table, &path, file, rigs, errors);
        let Some(spec) = spec(table, entry, &path, errors) else {
            continue;
        };
        if (TICK_HZ.0..=TICK_HZ.1).contains(&scenario.tick_hz) {
            for wrong in spec.check(scenario.tick_hz).err().unwrap_or_default() {
                let at = nearest_place(file, &format!("{path}.{}", wrong.key));
                errors.push(at, format!("{path}.{wrong}"));
            }
        }
        sensors.insert(
            name.to_owned(),
            Sensor {
                rigs: carriers,
                spec,
            },
        );
    }
    sensors
}

/// `kind` first, then the struct of that kind.
fn spec(table: &Table, entry: &Entry, path: &str, errors: &mut Errors) -> Option<SensorSpec> {
    const ELSEWHERE: [&str; 2] = ["kind", "rig"];
    let Some(kind) = table.get("kind") else {
        errors.push(
            entry.key_at,
            format!(
                "[{path}] has no kind; give one of {}",
                SensorSpec::KINDS.join(", ")
            ),
        );
        return None;
    };
    use SensorSpec::*;
    let name = kind.node.plain().as_str().unwrap_or("").to_owned();
    Some(match SensorSpec::default_of(&name) {
        Some(Camera(base)) => Camera(fill(&base, table, path, &ELSEWHERE, errors)),
        Some(Lidar(base)) => Lidar(fill(&base, table, path, &ELSEWHERE, errors)),
        Some(Imu(base)) => Imu(fill(&base, table, path, &ELSEWHERE, errors)),
        Some(Gnss(base)) => Gnss(fill(&base, table, path, &ELSEWHERE, errors)),
        Some(Radar(base)) => Radar(fill(&base, table, path, &ELSEWHERE, errors)),
        Some(Obstacle(base)) => Obstacle(fill(&base, table, path, &ELSEWHERE, errors)),
        Some(Collision(base)) => Collision(fill(&base, table, path, &ELSEWHERE, errors)),
        Some(LaneInvasion(base)) => LaneInvasion(fill(&base, table, path, &ELSEWHERE, errors)),
        None => {
            let hint = did_you_mean(&name, SensorSpec::KINDS);
            errors.push(
                kind.node.at,
                format!(
                    "{path}.kind is {}, but must be a kind of sensor{hint}",
                    kind.node.plain()
                ),
            );
            return None;
        }
    })
}

/// `rig = "ego"` (the default) or `rig = ["ego", "chaser"]`.
fn carriers(
    table: &Table,
    path: &str,
    file: &Table,
    rigs: &BTreeMap<String, Rig>,
    errors: &mut Errors,
) -> Vec<String> {
    let Some(entry) = table.get("rig") else {
        return vec![EGO_RIG.into()];
    };
    let value = entry.node.plain();
    let names: Option<Vec<String>> = match &value {
        Toml::String(name) => Some(vec![name.clone()]),
        Toml::Array(list) if !list.is_empty() => list
            .iter()
            .map(|name| name.as_str().map(str::to_owned))
            .collect(),
        _ => None,
    };
    let Some(names) = names else {
        errors.push(
            entry.node.at,
            format!("{path}.rig is {value}, but must be the name of a rig or a list of such names"),
        );
        return vec![EGO_RIG.into()];
    };
    // A rig whose own table is wrong has been reported there.
    let written = |name: &str| place_of(file, &format!("rig.{name}")).is_some();
    for (i, name) in names.iter().enumerate() {
        if names[..i].contains(name) {
            errors.push(entry.node.at, format!("{path}.rig names {name:?} twice"));
        } else if !rigs.contains_key(name) && !written(name) {
            let hint = did_you_mean(name, rigs.keys().map(String::as_str));
            errors.push(
                entry.node.at,
                format!("{path}.rig is {name:?}, but there is no [rig.{name}]{hint}"),
            );
        }
    }
    names
}
