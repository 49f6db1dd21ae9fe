//! `[defaults]` and `[process.NAME]`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::params;
use super::ready;
use super::sections::{check_variables, named, nearest_place, path_in_folder, whole_number};
use crate::error::{Errors, Place, Source, did_you_mean};
use crate::fill::{fill, fill_entry, refuse_unknown, table_or_error};
use crate::process::{Process, Restart, Stop};
use crate::tree::{Entry, Table};

/// Names that `${…}` may hold in `cmd`, besides those of every text.
const PARAMS: [&str; 2] = ["params", "params_file"];
/// Highest number of a core that the system's masks can hold.
const MAX_CORE: u32 = 1023;
/// Priorities as `nice` has them.
const NICE: (i64, i64) = (-20, 19);

/// The keys of a process that need no reading of their own.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Plain {
    cmd: Vec<String>,
    required: bool,
    after: Vec<String>,
    cores: Vec<u32>,
    lockstep: bool,
    restart: Restart,
    stop: Stop,
}

/// The keys that have no default of their kind, or need more than one value to be checked.
const ELSEWHERE: [&str; 6] = ["ready", "env", "cwd", "venv", "nice", "params"];

#[derive(Default)]
struct Defaults {
    env: BTreeMap<String, String>,
    restart: Restart,
    stop: Stop,
}

pub(super) fn read(file: &Table, sources: &[Source], errors: &mut Errors) -> Vec<Process> {
    let defaults = defaults(file, errors);
    let mut processes: Vec<(Place, Process)> = Vec::new();
    for (name, entry) in named(file, "process", errors) {
        if let Some(process) = process(name, entry, &defaults, sources, errors) {
            processes.push((entry.key_at, process));
        }
    }
    processes.sort_by_key(|(at, _)| (sources[at.source].rank, at.byte));
    order_lockstep(&mut processes, file, errors);
    check_order(&processes, errors);
    processes.into_iter().map(|(_, process)| process).collect()
}

fn defaults(file: &Table, errors: &mut Errors) -> Defaults {
    let Some(table) = file
        .get("defaults")
        .and_then(|entry| table_or_error(entry, "defaults", errors))
    else {
        return Defaults::default();
    };
    refuse_unknown(table, &["env", "restart", "stop"], "defaults", errors);
    let restart = fill_entry(
        &Restart::default(),
        table.get("restart"),
        "defaults.restart",
        &[],
        errors,
    );
    check_restart(&restart, table.get("restart"), "defaults.restart", errors);
    Defaults {
        env: env(table.get("env"), "defaults.env", errors),
        restart,
        stop: fill_entry(
            &Stop::default(),
            table.get("stop"),
            "defaults.stop",
            &[],
            errors,
        ),
    }
}

fn process(
    name: &str,
    entry: &Entry,
    defaults: &Defaults,
    sources: &[Source],
    errors: &mut Errors,
) -> Option<Process> {
    let path = format!("process.{name}");
    let table = table_or_error(entry, &path, errors)?;
    let base = Plain {
        cmd: vec![],
        required: false,
        after: vec![],
        cores: vec![],
        lockstep: false,
        restart: defaults.restart,
        stop: defaults.stop,
    };
    let plain = fill(&base, table, &path, &ELSEWHERE, errors);
    check_restart(
        &plain.restart,
        table.get("restart"),
        &format!("{path}.restart"),
        errors,
    );
    match table.get("cmd") {
        None => errors.push(
            entry.key_at,
            format!("[{path}] has no cmd; give cmd = [\"program\", \"argument\"]"),
        ),
        Some(cmd)
            if plain.cmd.first().is_none_or(String::is_empty) && cmd.node.plain().is_array() =>
        {
            errors.push(cmd.node.at, format!("{path}.cmd names no program"));
        }
        Some(cmd) => plain.cmd.iter().for_each(|word| {
            check_variables(word, &PARAMS, cmd.node.at, &format!("{path}.cmd"), errors)
        }),
    }
    check_cores(&plain.cores, table.get("cores"), &path, errors);
    let params = params::read(table.get("params"), &format!("{path}.params"), errors);
    let wanted = plain.cmd.iter().any(|word| word.contains("${params"));
    if let (true, None, Some(cmd)) = (wanted, &params, table.get("cmd")) {
        let message = format!("{path}.cmd wants params, but there is no [{path}.params]");
        errors.push(cmd.node.at, message);
    }
    let folder = |key: &str, errors: &mut Errors| {
        path_in_folder(table.get(key), &format!("{path}.{key}"), sources, errors)
    };
    let mut environment = defaults.env.clone();
    environment.extend(env(table.get("env"), &format!("{path}.env"), errors));
    Some(Process {
        name: name.to_owned(),
        cmd: plain.cmd,
        cwd: folder("cwd", errors),
        venv: folder("venv", errors),
        required: plain.required,
        ready: table
            .get("ready")
            .and_then(|entry| ready::read(entry, &format!("{path}.ready"), plain.lockstep, errors)),
        after: plain.after,
        restart: plain.restart,
        stop: plain.stop,
        env: environment,
        cores: plain.cores,
        nice: whole_number(table.get("nice"), &format!("{path}.nice"), NICE, errors)
            .map(|nice| nice as i32),
        lockstep: plain.lockstep,
        params,
    })
}

fn check_restart(restart: &Restart, entry: Option<&Entry>, path: &str, errors: &mut Errors) {
    let at = entry.map_or(Place::default(), |entry| entry.node.at);
    if !(1.0..=100.0).contains(&restart.factor) {
        errors.push(
            at,
            format!("{path}.factor is {}, but must be 1 to 100", restart.factor),
        );
    }
}

fn env(entry: Option<&Entry>, path: &str, errors: &mut Errors) -> BTreeMap<String, String> {
    let Some(table) = entry.and_then(|entry| table_or_error(entry, path, errors)) else {
        return BTreeMap::new();
    };
    let mut variables = BTreeMap::new();
    for (key, entry) in table {
        if key.is_empty() || key.contains(['=', '\0']) {
            errors.push(
                entry.key_at,
                format!("{path} has a variable {key:?}, which no environment can hold"),
            );
        }
        match entry.node.plain() {
            toml::Value::String(text) if !text.contains('\0') => {
                check_variables(&text, &[], entry.node.at, &format!("{path}.{key}"), errors);
                variables.insert(key.clone(), text);
            }
            other => errors.push(
                entry.node.at,
                format!("{path}.{key} is {other}, but must be text in quotes"),
            ),
        }
    }
    variables
}

fn check_cores(cores: &[u32], entry: Option<&Entry>, path: &str, errors: &mut Errors) {
    let at = entry.map_or(Place::default(), |entry| entry.node.at);
    for core in cores.iter().filter(|core| **core > MAX_CORE) {
        let message = format!("{path}.cores has {core}, but cores are 0 to {MAX_CORE}");
        errors.push(at, message);
    }
}

/// Whoever takes part in lockstep comes after the daemon, which it joins.
fn order_lockstep(processes: &mut [(Place, Process)], file: &Table, errors: &mut Errors) {
    let daemon = processes
        .iter()
        .map(|(_, process)| process)
        .find(|process| process.is_daemon())
        .map(|process| process.name.clone());
    for (_, process) in processes.iter_mut().filter(|(_, process)| process.lockstep) {
        let path = format!("process.{}.lockstep", process.name);
        let at = nearest_place(file, &path);
        match &daemon {
            None => errors.push(
                at,
                format!("{path} is true, but no process of the launch runs simd or gantry-replay, whose ticks could wait for it"),
            ),
            Some(_) if process.is_daemon() => errors.push(
                at,
                format!("{path} is true, but this process is the simulator, with which the others keep step"),
            ),
            Some(daemon) if process.after.contains(daemon) => {}
            Some(daemon) => process.after.push(daemon.clone()),
        }
    }
}

/// Checks that `after` names processes of the file and that these do not wait for one another.
fn check_order(processes: &[(Place, Process)], errors: &mut Errors) {
    let names: Vec<&str> = processes
        .iter()
        .map(|(_, process)| process.name.as_str())
        .collect();
    for (at, process) in processes {
        for before in &process.after {
            if !names.contains(&before.as_str()) {
                let hint = did_you_mean(
                    before,
                    names.iter().copied().filter(|name| *name != process.name),
                );
                errors.push(
                    *at,
                    format!(
                        "process.{}.after is {before:?}, but there is no [process.{before}]{hint}",
                        process.name
                    ),
                );
            }
        }
    }
    let mut started: Vec<&str> = Vec::new();
    loop {
        let can_start = |process: &Process| {
            process
                .after
                .iter()
                .all(|name| started.contains(&name.as_str()) || !names.contains(&name.as_str()))
        };
        let next: Vec<&str> = processes
            .iter()
            .filter(|(_, p)| !started.contains(&p.name.as_str()) && can_start(p))
            .map(|(_, p)| p.name.as_str())
            .collect();
        if next.is_empty() {
            break;
        }
        started.extend(next);
    }
    let stuck: Vec<_> = processes
        .iter()
        .filter(|(_, process)| !started.contains(&process.name.as_str()))
        .collect();
    if let Some((at, _)) = stuck.first() {
        let names: Vec<_> = stuck
            .iter()
            .map(|(_, process)| process.name.as_str())
            .collect();
        errors.push(
            *at,
            format!(
                "processes {} wait for one another through \"after\"; break the circle",
                names.join(", ")
            ),
        );
    }
}
