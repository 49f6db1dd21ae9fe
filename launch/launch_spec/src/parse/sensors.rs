//! `[sensor.NAME]`: kind, values and rigs of each sensor.

use std::collections::BTreeMap;

use sensor_spec::SensorSpec;
use toml::Value as Toml;

use super::scenario::TICK_HZ;
use super::sections::{named, nearest_place};
use crate::error::{Errors, did_you_mean};
use crate::fill::{fill, table_or_error};
use crate::model::{EGO_RIG, Ego, Rig, Scenario, Sensor};
use crate::tree::{Entry, Table, place_of};

pub(super) fn read(
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

/// Reports a sensor on the ego vehicle if the file asks for no ego vehicle.
pub(super) fn check_ego(
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

/// Reads `kind` first, then the other keys into the struct of that kind.
fn spec(table: &Table, entry: &Entry, path: &str, errors: &mut Errors) -> Option<SensorSpec> {
    const ELSEWHERE: [&str; 3] = ["kind", "rig", "sensor"];
    let Some(kind) = table.get("kind") else {
        // A profile that gives none has been reported already.
        if !table.contains_key("sensor") {
            errors.push(
                entry.key_at,
                format!(
                    "[{path}] has no kind; give one of {}, or a profile as sensor",
                    SensorSpec::KINDS.join(", ")
                ),
            );
        }
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

/// The rigs of a sensor: `rig = "ego"` (the default) or `rig = ["ego", "chaser"]`.
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
    // A rig that is in the file, but missing in `rigs`, has been reported already.
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
