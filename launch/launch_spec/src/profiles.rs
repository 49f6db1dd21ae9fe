//! Profiles of sensors as they are sold: one TOML file a product, whose every number says where it
//! comes from. `sensor = "ouster/os1-128"` in a launch file puts a profile beneath the sensor's own
//! keys; `sensor = "my_lidar.toml"` takes a file, whose path begins in the launch file's folder.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::error::{Errors, Place, did_you_mean};
use crate::files::Texts;
use crate::fill::{refuse_unknown, table_or_error};
use crate::tree::{Entry, Table, read};

/// Name and text of each profile that is built in.
const BUILT_IN: [(&str, &str); 11] = [
    (
        "adi/adis16448",
        include_str!("../../sensors/adi/adis16448.toml"),
    ),
    ("hesai/xt32", include_str!("../../sensors/hesai/xt32.toml")),
    (
        "ouster/os0-128",
        include_str!("../../sensors/ouster/os0-128.toml"),
    ),
    (
        "ouster/os1-128",
        include_str!("../../sensors/ouster/os1-128.toml"),
    ),
    (
        "ouster/os1-32",
        include_str!("../../sensors/ouster/os1-32.toml"),
    ),
    (
        "ouster/os1-64",
        include_str!("../../sensors/ouster/os1-64.toml"),
    ),
    (
        "ouster/os2-128",
        include_str!("../../sensors/ouster/os2-128.toml"),
    ),
    (
        "velodyne/vlp-16",
        include_str!("../../sensors/velodyne/vlp-16.toml"),
    ),
    (
        "xsens/mti-1",
        include_str!("../../sensors/xsens/mti-1.toml"),
    ),
    (
        "xsens/mti-300",
        include_str!("../../sensors/xsens/mti-300.toml"),
    ),
    (
        "xsens/mti-630",
        include_str!("../../sensors/xsens/mti-630.toml"),
    ),
];

/// Where a number of a profile comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// The maker's data sheet or manual says it.
    Datasheet,
    /// A driver or its metadata has it.
    Driver,
    /// Somebody measured it on a device.
    Measured,
    /// Nobody says it; it is a guess.
    Assumed,
}

impl Status {
    /// As profiles write it.
    pub fn name(self) -> &'static str {
        match self {
            Status::Datasheet => "datasheet",
            Status::Driver => "driver",
            Status::Measured => "measured",
            Status::Assumed => "assumed",
        }
    }

    const ALL: [Status; 4] = [
        Status::Datasheet,
        Status::Driver,
        Status::Measured,
        Status::Assumed,
    ];
}

/// One number of a profile.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Number {
    /// The value of the sensor's key.
    pub value: toml::Value,
    /// Where it comes from.
    pub status: Status,
    /// A key of [`Profile::sources`].
    pub source: String,
}

/// A sensor as it is sold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    /// Maker and product.
    pub name: String,
    /// Kind of sensor.
    pub kind: String,
    /// What the numbers' sources are.
    pub sources: BTreeMap<String, String>,
    /// The sensor's keys.
    pub keys: BTreeMap<String, Number>,
}

/// Names of the profiles that are built in, sorted.
pub fn names() -> impl Iterator<Item = &'static str> {
    BUILT_IN.iter().map(|(name, _)| *name)
}

/// Text of a built-in profile.
pub fn text(name: &str) -> Option<&'static str> {
    let found = BUILT_IN.iter().find(|(known, _)| *known == name);
    found.map(|(_, text)| *text)
}

/// Puts the profiles that sensors name beneath the sensors' own keys.
pub(crate) fn lay(texts: &mut Texts<'_>) {
    let Some(sensors) = texts.tree.get("sensor").and_then(|all| all.node.table()) else {
        return;
    };
    let asked: Vec<(String, toml::Value, Place)> = sensors
        .iter()
        .filter_map(|(name, entry)| {
            let asked = entry.node.table()?.get("sensor")?;
            Some((name.clone(), asked.node.plain(), asked.node.at))
        })
        .collect();
    for (sensor, asked, at) in asked {
        let path = format!("sensor.{sensor}");
        let Some(asked) = asked.as_str() else {
            let message = format!(
                "{path}.sensor is {asked}, but must be the name of a profile, e.g. \"velodyne/vlp-16\", or of a file that ends in .toml"
            );
            texts.errors.push(at, message);
            continue;
        };
        let Some(source) = source_of(texts, &path, asked, at) else {
            continue;
        };
        let text = texts.sources[source].text.clone();
        let Some(profile) = read(&text, source, &mut texts.errors) else {
            texts.is_broken = true;
            continue;
        };
        let keys = keys_of(&profile, source, &mut texts.errors);
        let table = texts
            .tree
            .get_mut("sensor")
            .and_then(|all| all.node.table_mut())
            .and_then(|all| all.get_mut(&sensor))
            .and_then(|entry| entry.node.table_mut());
        let Some(table) = table else { continue };
        if let (Some(own), Some(kind)) = (table.get("kind"), keys.get("kind"))
            && own.node.plain() != kind.node.plain()
        {
            let message = format!(
                "{path}.kind is {}, but the profile {asked:?} is of kind {}; leave kind out",
                own.node.plain(),
                kind.node.plain()
            );
            texts.errors.push(own.node.at, message);
        }
        for (key, entry) in keys {
            table.entry(key).or_insert(entry);
        }
    }
}

/// Number of the profile's text among the sources.
fn source_of(texts: &mut Texts<'_>, path: &str, asked: &str, at: Place) -> Option<usize> {
    if let Some(text) = text(asked) {
        return Some(texts.add_source(&format!("launch/sensors/{asked}.toml"), text.to_owned()));
    }
    if !asked.ends_with(".toml") {
        let message = format!(
            "{path}.sensor is {asked:?}, but must be the name of a profile or of a file that ends in .toml{}",
            did_you_mean(asked, names())
        );
        texts.errors.push(at, message);
        return None;
    }
    let file = texts.sources[at.source].folder.join(asked);
    match texts.read(&file) {
        Ok(text) => Some(texts.add_source(&file.display().to_string(), text)),
        Err(error) => {
            let message = format!(
                "{path}.sensor names {asked:?}, but {} cannot be read: {error}; its path begins in the folder of the launch file",
                file.display()
            );
            texts.errors.push(at, message);
            None
        }
    }
}

/// The keys that a profile gives a sensor, each with its place; reports what is wrong with them.
fn keys_of(profile: &Table, source: usize, errors: &mut Errors) -> Table {
    let start = Place { source, byte: 0 };
    let mut found = Table::new();
    refuse_unknown(profile, &["name", "kind", "sources", "keys"], "", errors);
    for key in ["name", "kind", "sources", "keys"] {
        if !profile.contains_key(key) {
            errors.push(start, format!("the profile has no {key}"));
        }
    }
    if let Some(name) = profile.get("name").filter(|it| !it.node.plain().is_str()) {
        errors.push(
            name.node.at,
            "name is no text; write maker and product in quotes",
        );
    }
    if let Some(kind) = profile.get("kind") {
        found.insert("kind".into(), kind.clone());
    }
    let empty = Table::new();
    let sources = match profile.get("sources") {
        Some(entry) => table_or_error(entry, "sources", errors).unwrap_or(&empty),
        None => &empty,
    };
    let Some(keys) = profile
        .get("keys")
        .and_then(|entry| table_or_error(entry, "keys", errors))
    else {
        return found;
    };
    for (key, entry) in keys {
        if let Some(value) = number(key, entry, sources, errors) {
            found.insert(key.clone(), value);
        }
    }
    found
}

/// The value of one key of a profile.
fn number(key: &str, entry: &Entry, sources: &Table, errors: &mut Errors) -> Option<Entry> {
    let path = format!("keys.{key}");
    let table = table_or_error(entry, &path, errors)?;
    refuse_unknown(table, &["value", "status", "source"], &path, errors);
    let mut part = |name: &str| {
        let found = table.get(name);
        if found.is_none() {
            errors.push(
                entry.key_at,
                format!("{path} has no {name}; write {key} = {{ value = …, status = \"datasheet\", source = \"…\" }}"),
            );
        }
        found
    };
    let (value, status, source) = (part("value"), part("status"), part("source"));
    if let Some(status) = status {
        let given = status.node.plain();
        let is_known = Status::ALL
            .iter()
            .any(|it| given.as_str() == Some(it.name()));
        if !is_known {
            let known = Status::ALL.map(Status::name).join(", ");
            errors.push(
                status.node.at,
                format!("{path}.status is {given}, but must be one of {known}"),
            );
        }
    }
    if let Some(source) = source {
        let given = source.node.plain();
        if !given.as_str().is_some_and(|it| sources.contains_key(it)) {
            let hint = did_you_mean(
                given.as_str().unwrap_or(""),
                sources.keys().map(String::as_str),
            );
            errors.push(
                source.node.at,
                format!("{path}.source is {given}, but must be a key of [sources]{hint}"),
            );
        }
    }
    value.map(|value| Entry {
        key_at: entry.key_at,
        node: value.node.clone(),
    })
}
