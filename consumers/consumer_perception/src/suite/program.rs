//! Programs: what is started, which inputs it gets, and what its results are scored as.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use launch_spec::Restart;
use serde::Deserialize;
use toml::Table;

use super::fault::SuiteFault;
use crate::capture::Mode;

/// A program that is measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Program {
    /// Its name.
    pub name: String,
    /// Its processes; one, unless the suite names several.
    pub processes: Vec<ProgramProcess>,
    /// Patterns of topics that it gets; empty: all inputs.
    pub inputs: Vec<String>,
    /// Topics of results and the tasks that they are scored as; empty: by their types.
    pub results: BTreeMap<String, String>,
    /// Simulated seconds that do not count, besides the suite's.
    pub warm_up_s: f64,
    /// Modes in which it runs.
    pub modes: Vec<Mode>,
}

impl Program {
    /// A program that is a command and nothing else, run in the caller's folder.
    ///
    /// # Errors
    /// A sentence if there is no command.
    pub fn of_command(cmd: &[String]) -> Result<Program, SuiteFault> {
        let table = ProgramTable {
            cmd: cmd.to_vec(),
            ..ProgramTable::default()
        };
        table.program(&name_of(cmd), Path::new(""))
    }

    /// Its command, for reports; those of several processes one after the other.
    pub fn command(&self) -> Vec<String> {
        let all = self.processes.iter().map(|process| process.cmd.clone());
        all.collect::<Vec<_>>().join(&"&".to_owned())
    }

    /// Whether one of its processes takes part in lockstep by itself.
    pub fn joins_lockstep(&self) -> bool {
        self.processes.iter().any(|process| process.lockstep)
    }
}

/// A process of a program.
#[derive(Clone, Debug, PartialEq)]
pub struct ProgramProcess {
    /// Its name among all processes of a run, and in lockstep.
    pub name: String,
    /// Program and arguments.
    pub cmd: Vec<String>,
    /// Folder it runs in; the caller's if there is none.
    pub cwd: Option<PathBuf>,
    /// Virtual environment of Python.
    pub venv: Option<PathBuf>,
    /// Environment on top of the caller's.
    pub env: BTreeMap<String, String>,
    /// Settings of its own.
    pub params: Option<Table>,
    /// Processor cores; empty: the caller's.
    pub cores: Vec<u32>,
    /// Priority.
    pub nice: Option<i32>,
    /// GPUs that it sees, as `CUDA_VISIBLE_DEVICES` names them.
    pub gpu: Option<String>,
    /// What happens when it ends by itself.
    pub restart: Option<Restart>,
    /// Whether it takes part in lockstep by itself, under its name.
    pub lockstep: bool,
}

/// `[program.NAME]`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ProgramTable {
    cmd: Vec<String>,
    cwd: Option<PathBuf>,
    venv: Option<PathBuf>,
    env: BTreeMap<String, String>,
    params: Option<Table>,
    cores: Vec<u32>,
    nice: Option<i32>,
    gpu: Option<String>,
    restart: Option<Restart>,
    lockstep: bool,
    process: BTreeMap<String, ProcessTable>,
    inputs: Vec<String>,
    results: BTreeMap<String, String>,
    warm_up_s: f64,
    modes: Vec<Mode>,
}

/// `[program.NAME.process.NAME]` and `[input.NAME]`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct ProcessTable {
    cmd: Vec<String>,
    cwd: Option<PathBuf>,
    venv: Option<PathBuf>,
    env: BTreeMap<String, String>,
    params: Option<Table>,
    cores: Vec<u32>,
    nice: Option<i32>,
    gpu: Option<String>,
    restart: Option<Restart>,
    lockstep: bool,
}

/// Names of processes that the benchmark starts itself.
const RESERVED: [&str; 6] = ["simd", "replay", "drive", "record", "bench", "gantry"];

impl ProgramTable {
    /// The program; relative paths begin in `folder`.
    ///
    /// # Errors
    /// A sentence with the key and what is allowed.
    pub(super) fn program(self, name: &str, folder: &Path) -> Result<Program, SuiteFault> {
        let at = format!("[program.{name}]");
        check_name(&at, name)?;
        let mut processes = Vec::new();
        let alone = ProcessTable {
            cmd: self.cmd,
            cwd: self.cwd,
            venv: self.venv,
            env: self.env,
            params: self.params,
            cores: self.cores,
            nice: self.nice,
            gpu: self.gpu,
            restart: self.restart,
            lockstep: self.lockstep,
        };
        match (alone.cmd.is_empty(), self.process.is_empty()) {
            (false, true) => processes.push(alone.process(name, folder)?),
            (true, false) => {
                for (part, table) in self.process {
                    processes.push(table.process(&part, folder)?);
                }
            }
            (true, true) => {
                return Err(format!(
                    "{at} has no cmd; give cmd = [\"PROGRAM\", \"ARGUMENT\"], or several [program.{name}.process.NAME]"
                ).into());
            }
            (false, false) => {
                return Err(format!("{at} has cmd and processes; give one or the other").into());
            }
        }
        if !(0.0..=3600.0).contains(&self.warm_up_s) {
            return Err(
                format!("{at}: warm_up_s = {}; it lies in 0 to 3600", self.warm_up_s).into(),
            );
        }
        Ok(Program {
            name: name.to_owned(),
            processes,
            inputs: self.inputs,
            results: self.results,
            warm_up_s: self.warm_up_s,
            modes: match self.modes.is_empty() {
                true => vec![Mode::Offline, Mode::Streaming],
                false => self.modes,
            },
        })
    }
}

impl ProcessTable {
    /// The process; relative paths begin in `folder`.
    ///
    /// # Errors
    /// A sentence with the key and what is allowed.
    pub(crate) fn process(self, name: &str, folder: &Path) -> Result<ProgramProcess, SuiteFault> {
        check_name("a process", name)?;
        if self.cmd.first().is_none_or(String::is_empty) {
            return Err(format!(
                "the process {name:?} has no cmd; give cmd = [\"PROGRAM\", \"ARGUMENT\"]"
            )
            .into());
        }
        let from_here = |path: PathBuf| folder.join(path);
        Ok(ProgramProcess {
            name: name.to_owned(),
            cmd: self.cmd,
            cwd: self.cwd.map(from_here),
            venv: self.venv.map(from_here),
            env: self.env,
            params: self.params,
            cores: self.cores,
            nice: self.nice,
            gpu: self.gpu,
            restart: self.restart,
            lockstep: self.lockstep,
        })
    }
}

fn check_name(at: &str, name: &str) -> Result<(), SuiteFault> {
    let is_plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    let is_name = (1..=32).contains(&name.len()) && name.chars().all(is_plain);
    match is_name && !RESERVED.contains(&name) {
        true => Ok(()),
        false => Err(format!(
            "{at}: {name:?} is no name for a program; use 1 to 32 lower-case letters, digits or '_', and not {}",
            RESERVED.join(", ")
        ).into()),
    }
}

/// A name made of a command: that of the script that an interpreter runs, else of the program.
fn name_of(cmd: &[String]) -> String {
    let stem = |word: &String| {
        let stem = Path::new(word).file_stem().unwrap_or_default();
        stem.to_string_lossy().to_ascii_lowercase()
    };
    let first = cmd.first().map(stem).unwrap_or_default();
    let is_interpreter = ["python", "bash", "sh", "env"]
        .iter()
        .any(|it| first.trim_end_matches(|c: char| c.is_ascii_digit() || c == '.') == *it);
    let script = cmd.iter().skip(1).find(|word| !word.starts_with('-'));
    let name = match script.filter(|_| is_interpreter) {
        Some(script) => stem(script),
        None => first,
    };
    let tame = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let name: String = name.chars().map(tame).take(32).collect();
    match name.is_empty() || RESERVED.contains(&name.as_str()) {
        true => "program".to_owned(),
        false => name,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_names_its_program() {
        for (cmd, name) in [
            (
                &["python3", "-u", "my/Detector-2.py", "x"][..],
                "detector_2",
            ),
            (&["./flow", "--fast"], "flow"),
            (&["python3.11"], "python3"),
            (&["simd"], "program"),
        ] {
            let cmd: Vec<String> = cmd.iter().map(|word| (*word).to_owned()).collect();
            assert_eq!(Program::of_command(&cmd).unwrap().name, name);
        }
        assert!(
            Program::of_command(&[])
                .unwrap_err()
                .to_string()
                .contains("no cmd")
        );
    }

    #[test]
    fn several_processes_are_one_program() {
        let text = "results = { \"t/tracks\" = \"tracking\" }\n[process.find]\ncmd = [\"find\"]\ncwd = \"x\"\n[process.follow]\ncmd = [\"follow\", \"me\"]\nlockstep = true\n";
        let table: ProgramTable = toml::from_str(text).unwrap();
        let program = table.program("chain", Path::new("/suites")).unwrap();
        assert_eq!(program.command(), ["find", "&", "follow", "me"]);
        assert_eq!(program.processes[0].cwd, Some("/suites/x".into()));
        assert!(program.joins_lockstep());
        let both: ProgramTable = toml::from_str(&format!("cmd = [\"x\"]\n{text}")).unwrap();
        assert!(both.program("chain", Path::new("")).is_err());
    }
}
