//! `[defaults]` and `[process.NAME]`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::sections::named;
use crate::error::{Errors, Place, did_you_mean};
use crate::fill::{fill, fill_entry, refuse_unknown, table_or_error};
use crate::period::Period;
use crate::process::{Process, Ready, ReadyWhen, Restart, Stop};
use crate::tree::{Entry, Table};

/// Names that `${…}` may hold in `cmd` and `env`.
const VARIABLES: [&str; 4] = ["run_dir", "name", "domain", "launch"];
/// Default time in which a process must become ready. It is long because the first start on a
/// software adapter builds a town and shaders.
const READY_WITHIN: Period = Period::from_millis(180_000);

/// The keys of a process that need no reading of their own.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Plain {
    cmd: Vec<String>,
    required: bool,
    after: Vec<String>,
    cpus: Vec<u32>,
    restart: Restart,
    stop: Stop,
}

/// `[process.NAME.ready]`; exactly one of the first three is not empty.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlainReady {
    service: String,
    line: String,
    tcp: String,
    within: Period,
}

#[derive(Default)]
struct Defaults {
    env: BTreeMap<String, String>,
    restart: Restart,
    stop: Stop,
}

pub(super) fn read(file: &Table, errors: &mut Errors) -> Vec<Process> {
    let defaults = defaults(file, errors);
    let mut processes: Vec<(Place, Process)> = Vec::new();
    for (name, entry) in named(file, "process", errors) {
        if let Some(process) = process(name, entry, &defaults, errors) {
            processes.push((entry.key_at, process));
        }
    }
    processes.sort_by_key(|(at, _)| *at);
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

fn process(name: &str, entry: &Entry, defaults: &Defaults, errors: &mut Errors) -> Option<Process> {
    let path = format!("process.{name}");
    let table = table_or_error(entry, &path, errors)?;
    let base = Plain {
        cmd: vec![],
        required: false,
        after: vec![],
        cpus: vec![],
        restart: defaults.restart,
        stop: defaults.stop,
    };
    let plain = fill(&base, table, &path, &["ready", "env"], errors);
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
        Some(cmd) => plain
            .cmd
            .iter()
            .for_each(|word| check_variables(word, cmd.node.at, &format!("{path}.cmd"), errors)),
    }
    let mut environment = defaults.env.clone();
    environment.extend(env(table.get("env"), &format!("{path}.env"), errors));
    Some(Process {
        name: name.to_owned(),
        cmd: plain.cmd,
        required: plain.required,
        ready: table
            .get("ready")
            .and_then(|entry| ready(entry, &format!("{path}.ready"), errors)),
        after: plain.after,
        restart: plain.restart,
        stop: plain.stop,
        env: environment,
        cpus: plain.cpus,
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
                check_variables(&text, entry.node.at, &format!("{path}.{key}"), errors);
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

/// Reports `${…}` with a name that the launcher does not replace: it is a spelling mistake.
fn check_variables(text: &str, at: Place, path: &str, errors: &mut Errors) {
    for part in text.split("${").skip(1) {
        let name = part.split('}').next().unwrap_or_default();
        if !part.contains('}') || !VARIABLES.contains(&name) {
            let hint = did_you_mean(name, VARIABLES);
            errors.push(
                at,
                format!("{path} has \"${{{name}}}\", which is nothing the launcher replaces{hint}"),
            );
        }
    }
}

fn ready(entry: &Entry, path: &str, errors: &mut Errors) -> Option<Ready> {
    let none = PlainReady {
        service: String::new(),
        line: String::new(),
        tcp: String::new(),
        within: READY_WITHIN,
    };
    let signs = fill_entry(&none, Some(entry), path, &[], errors);
    entry.node.table()?;
    let mut given = Vec::new();
    if !signs.service.is_empty() {
        given.push(ReadyWhen::Service(signs.service));
    }
    if !signs.line.is_empty() {
        if let Err(error) = regex::Regex::new(&signs.line) {
            let reason = error.to_string();
            let reason = reason
                .lines()
                .last()
                .unwrap_or_default()
                .trim_start_matches("error: ");
            errors.push(
                entry.node.at,
                format!(
                    "{path}.line is {:?}, which is no regular expression: {reason}",
                    signs.line
                ),
            );
        }
        given.push(ReadyWhen::Line(signs.line));
    }
    if !signs.tcp.is_empty() {
        let port = signs
            .tcp
            .rsplit_once(':')
            .filter(|(host, _)| !host.is_empty())
            .and_then(|(_, port)| port.parse::<u16>().ok());
        if port.is_none_or(|port| port == 0) {
            errors.push(
                entry.node.at,
                format!(
                    "{path}.tcp is {:?}, but must be host:port, e.g. \"127.0.0.1:2000\"",
                    signs.tcp
                ),
            );
        }
        given.push(ReadyWhen::Tcp(signs.tcp));
    }
    if given.len() != 1 {
        errors.push(
            entry.key_at,
            format!(
                "{path} has {} signs, but must have one of service, line, tcp",
                given.len()
            ),
        );
    }
    given.pop().map(|when| Ready {
        when,
        within: signs.within,
    })
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
