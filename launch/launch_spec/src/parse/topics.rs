//! `[topic."NAME"]`: limits of topics, and the types of the processes' own.

use std::collections::BTreeMap;

use schema_frames::about::ABOUT;
use schema_frames::{Modality, ResultType, SensorKind};
use toml::Value as Toml;

use super::sections::whole_number;
use crate::error::{Errors, did_you_mean};
use crate::fill::{refuse_unknown, table_or_error};
use crate::model::Launch;
use crate::topic::{MAX_BYTES, READERS, SAMPLES, Topic, TopicLimits};
use crate::tree::{Entry, Table};

const KEYS: [&str; 7] = [
    "readers",
    "buffer",
    "borrowed",
    "gpu",
    "gpu_readers",
    "type",
    "max_bytes",
];
/// Modalities whose frames can stay on the GPU.
const ON_GPU: &str = "images, dvs and lidar points";
/// First parts of topics that belong to the simulator, with fixed limits.
const RESERVED: [&str; 2] = ["world", "control"];

pub(super) fn read(file: &Table, launch: &Launch, errors: &mut Errors) -> BTreeMap<String, Topic> {
    let table = file
        .get("topic")
        .and_then(|entry| table_or_error(entry, "topic", errors));
    let sensors: Vec<String> = launch
        .memory_budget()
        .into_iter()
        .map(|topic| topic.topic)
        .collect();
    let mut topics = BTreeMap::new();
    for (name, entry) in table.into_iter().flatten() {
        if let Some(topic) = topic(name, entry, &sensors, errors) {
            topics.insert(name.clone(), topic);
        }
    }
    topics
}

fn topic(name: &str, entry: &Entry, sensors: &[String], errors: &mut Errors) -> Option<Topic> {
    let path = format!("topic.{name:?}");
    let table = table_or_error(entry, &path, errors)?;
    refuse_unknown(table, &KEYS, &path, errors);
    check_name(name, &path, entry, errors);
    let mut number = |key: &str, (least, most): (u64, u64)| {
        let range = (least as i64, most as i64);
        whole_number(table.get(key), &format!("{path}.{key}"), range, errors)
    };
    let wide = |(least, most): (u32, u32)| (u64::from(least), u64::from(most));
    let limits = TopicLimits {
        readers: number("readers", wide(READERS)).map(|n| n as u32),
        buffer: number("buffer", wide(SAMPLES)).map(|n| n as u32),
        borrowed: number("borrowed", wide(SAMPLES)).map(|n| n as u32),
        gpu: false,
        gpu_readers: number("gpu_readers", wide(READERS)).map(|n| n as u32),
    };
    let max_bytes = number("max_bytes", MAX_BYTES).map(|n| n as u64);
    let gpu = boolean(table, "gpu", &path, errors);
    let limits = TopicLimits {
        gpu: gpu.unwrap_or(false),
        ..limits
    };
    for key in ["gpu", "gpu_readers"] {
        if let Some(entry) = table.get(key)
            && (!stays_on_gpu(name) || table.contains_key("type"))
        {
            errors.push(
                entry.key_at,
                format!("{path}.{key} is given, but only frames of cameras and lidars ({ON_GPU}) can stay on the GPU; remove the key"),
            );
        }
    }
    let result = table
        .get("type")
        .and_then(|entry| result_type(entry, &path, errors));
    let of_a_sensor = sensors.iter().any(|topic| topic == name);
    if of_a_sensor {
        for key in ["type", "max_bytes"] {
            if let Some(entry) = table.get(key) {
                errors.push(
                    entry.key_at,
                    format!("{path}.{key} is given, but a sensor of this launch publishes the topic and says that; remove the key"),
                );
            }
        }
    } else if !table.contains_key("type") && !is_reserved(name) {
        let near = did_you_mean(name, sensors.iter().map(String::as_str));
        errors.push(
            entry.key_at,
            format!("no sensor of this launch publishes {name:?}; a topic of your own needs type, e.g. type = \"boxes2d\"{near}"),
        );
    }
    Some(Topic {
        limits,
        result,
        max_bytes,
    })
}

fn result_type(entry: &Entry, path: &str, errors: &mut Errors) -> Option<ResultType> {
    let value = entry.node.plain();
    let found = match &value {
        Toml::String(word) => ResultType::from_name(word),
        _ => None,
    };
    if found.is_none() {
        let known = ResultType::ALL.iter().map(|kind| kind.name());
        let hint = did_you_mean(value.as_str().unwrap_or_default(), known);
        errors.push(
            entry.node.at,
            format!("{path}.type is {value}, but must be a type of result{hint}"),
        );
    }
    found
}

/// Whether a topic of this name carries what can stay on the GPU.
fn stays_on_gpu(name: &str) -> bool {
    let modality = name.rsplit('/').next().and_then(Modality::from_name);
    modality.is_some_and(|modality| {
        matches!(
            modality.sensor_kind(),
            SensorKind::Camera | SensorKind::Lidar
        )
    })
}

fn boolean(table: &Table, key: &str, path: &str, errors: &mut Errors) -> Option<bool> {
    let entry = table.get(key)?;
    let value = entry.node.plain();
    if let Toml::Boolean(value) = value {
        return Some(value);
    }
    errors.push(
        entry.node.at,
        format!("{path}.{key} is {value}, but must be true or false"),
    );
    None
}

fn is_reserved(name: &str) -> bool {
    RESERVED.contains(&name.split('/').next().unwrap_or(name))
        || name.rsplit('/').next() == Some(ABOUT)
}

/// The characters that `schema_bus` accepts in the name of a topic.
fn check_name(name: &str, path: &str, entry: &Entry, errors: &mut Errors) {
    let is_good = |part: &str| {
        !part.is_empty()
            && part
                .bytes()
                .all(|b| b.is_ascii_alphanumeric() || b"_-.".contains(&b))
    };
    if name.len() > 200 || !name.split('/').all(is_good) {
        errors.push(
            entry.key_at,
            format!("[{path}] has a name that is not 1 to 200 letters, digits, '_', '-', '.', with '/' between parts"),
        );
    } else if is_reserved(name) {
        errors.push(
            entry.key_at,
            format!("[{path}] is one of the simulator's own topics, whose limits are fixed; choose a name outside world/ and control/ that does not end in /about"),
        );
    }
}
