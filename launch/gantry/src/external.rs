//! `gantry WORD …` runs `gantry-WORD …`.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::os::unix::process::CommandExt as _;
use std::path::PathBuf;
use std::process::Command;

use anyhow::Context as _;
use launch_cli::{CommonArgs, Exit, wrong_usage};
use schema_bus::names::DOMAIN_VARIABLE;

use crate::programs;

/// Words of our own programs, and what these do.
const OURS: [(&str, &str); 12] = [
    (
        "bench",
        "Measure latency, topics and memory, and score programs that perceive",
    ),
    (
        "bridge",
        "Carry topics to other machines, ROS 2 and Foxglove",
    ),
    (
        "carla",
        "Let unmodified CARLA clients look at the world and drive in it",
    ),
    (
        "dataset",
        "Make labelled data sets from recipes, and check them",
    ),
    (
        "desk",
        "Show the world on a page for the browser, and rule it from there",
    ),
    ("drive", "Drive vehicles along lanes, and let people walk"),
    (
        "export",
        "Write recordings as training sets: KITTI, nuScenes, COCO and others",
    ),
    (
        "record",
        "Record sensors, results and the world into one MCAP file",
    ),
    ("render", "Render a share of a simulator's cameras"),
    (
        "replay",
        "Publish a recording, so that programs work on it as on the simulator",
    ),
    ("rerun", "Run a recorded run again, and compare every frame"),
    (
        "view",
        "Show sensors, results, map and actors in a window or on a page",
    ),
];

/// What `gantry --help` says of the programs that are installed.
pub fn help() -> String {
    let mut text = String::new();
    for (word, file) in installed() {
        let ours = OURS.iter().find(|(known, _)| *known == word);
        let about = match ours {
            Some((_, about)) => (*about).to_owned(),
            None => file.display().to_string(),
        };
        text += &format!("  {word:<11}  {about}\n");
    }
    match text.is_empty() {
        true => text,
        false => format!("Programs, which gantry WORD starts as gantry-WORD:\n{text}\n"),
    }
}

/// Replaces this process by the program; returns only if that fails.
pub fn run(words: &[OsString], common: &CommonArgs) -> anyhow::Result<Exit> {
    let (word, rest) = words.split_first().expect("clap gives at least the word");
    let name = format!("gantry-{}", word.to_string_lossy());
    let program = programs::find(&name).map_err(|error| {
        let known: Vec<String> = installed().into_keys().collect();
        wrong_usage(format!(
            "{error}; words are up, new, topic, top, graph, doctor, map, sensor, carla-root, completions, help{}{}",
            if known.is_empty() { "" } else { " and " },
            known.join(", ")
        ))
    })?;
    let mut command = Command::new(&program);
    command.args(rest);
    // Flags before the word are the launcher's own; those after it belong to the program.
    command.env(DOMAIN_VARIABLE, &common.domain);
    let error = command.exec();
    Err(error).with_context(|| format!("cannot start {}", program.display()))
}

/// Words for which there is a program, beside this one or on `PATH`, and its file.
fn installed() -> BTreeMap<String, PathBuf> {
    let own = std::env::current_exe().ok();
    let beside = own.as_deref().and_then(|own| own.parent());
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders = beside.map(PathBuf::from).into_iter();
    let mut found = BTreeMap::new();
    for folder in folders.chain(std::env::split_paths(&path)) {
        for entry in folder.read_dir().into_iter().flatten().flatten() {
            let name = entry.file_name();
            let word = name.to_str().and_then(|name| name.strip_prefix("gantry-"));
            let Some(word) = word.filter(|word| !word.contains('.')) else {
                continue;
            };
            // The first is the one that is started.
            if programs::is_program(&entry.path()) {
                found.entry(word.to_owned()).or_insert_with(|| entry.path());
            }
        }
    }
    found
}
