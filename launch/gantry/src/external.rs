//! `gantry WORD …` runs `gantry-WORD …`.

use std::ffi::OsString;
use std::os::unix::process::CommandExt as _;
use std::process::Command;

use anyhow::Context as _;
use launch_cli::{CommonArgs, Exit, wrong_usage};
use schema_bus::names::DOMAIN_VARIABLE;

use crate::programs;

/// Replaces this process by the program; returns only if that fails.
pub fn run(words: &[OsString], common: &CommonArgs) -> anyhow::Result<Exit> {
    let (word, rest) = words.split_first().expect("clap gives at least the word");
    let name = format!("gantry-{}", word.to_string_lossy());
    let program = programs::find(&name).map_err(|error| {
        let known = installed().join(", ");
        wrong_usage(format!(
            "{error}; words are up, new, topic, top, graph, doctor, map, carla-root, completions, help{}{known}",
            if known.is_empty() { "" } else { " and " }
        ))
    })?;
    let mut command = Command::new(&program);
    command.args(rest);
    // Flags before the word are the launcher's own; those after it belong to the program.
    command.env(DOMAIN_VARIABLE, &common.domain);
    let error = command.exec();
    Err(error).with_context(|| format!("cannot start {}", program.display()))
}

/// Words for which there is a program beside this one.
fn installed() -> Vec<String> {
    let own = std::env::current_exe().ok();
    let Some(entries) = own
        .as_deref()
        .and_then(|own| own.parent())
        .and_then(|folder| folder.read_dir().ok())
    else {
        return Vec::new();
    };
    let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let mut words: Vec<_> = names
        .filter_map(|name| Some(name.strip_prefix("gantry-")?.to_owned()))
        .filter(|word| !word.contains('.'))
        .collect();
    words.sort();
    words
}
