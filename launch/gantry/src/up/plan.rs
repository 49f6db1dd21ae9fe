//! Turns the processes of a launch file into commands that can be started.

use std::path::{Path, PathBuf};

use launch_cli::{CommonArgs, LogFormat, wrong_usage};
use launch_spec::{Launch, Process, READY_WITHIN, ReadyWhen, Restart, Stop};
use regex::Regex;
use schema_bus::names::DOMAIN_VARIABLE;

use super::params;
use super::surroundings::{self, Surroundings};
use crate::programs;

/// Everything needed to start, watch and stop one process.
#[derive(Debug)]
pub struct Plan {
    pub name: String,
    pub program: PathBuf,
    pub args: Vec<String>,
    pub surroundings: Surroundings,
    /// Whether it is the daemon, which all who take part in lockstep join.
    pub is_daemon: bool,
    /// Whether it takes part in lockstep under its name.
    pub lockstep: bool,
    pub run_dir: PathBuf,
    pub required: bool,
    /// Indices of the plans that must be ready first.
    pub after: Vec<usize>,
    pub ready: Option<ReadySign>,
    /// Longest wait for the sign, and for joining lockstep.
    pub ready_within: std::time::Duration,
    pub restart: Restart,
    pub stop: Stop,
}

/// A sign of readiness, prepared for looking.
#[derive(Clone, Debug)]
pub enum ReadySign {
    Service(String),
    Line(Regex),
    Tcp(String),
}

/// What the plans of one run have in common.
pub struct Run<'a> {
    /// What runs.
    pub launch: &'a Launch,
    /// The launcher's own flags.
    pub common: &'a CommonArgs,
    /// Folder of the run.
    pub dir: &'a Path,
    /// The launch file with all overrides and defaults, in that folder.
    pub resolved: &'a Path,
}

impl Run<'_> {
    /// One plan per process, in the order of the file.
    ///
    /// # Errors
    /// One line for each process that cannot be started as its table says.
    pub fn plans(&self) -> anyhow::Result<Vec<Plan>> {
        let mut missing = Vec::new();
        let mut plans = Vec::new();
        for process in &self.launch.processes {
            match self.plan(process) {
                Ok(plan) => plans.push(plan),
                Err(error) => missing.push(format!("process {}: {error}", process.name)),
            }
        }
        if missing.is_empty() {
            Ok(plans)
        } else {
            Err(wrong_usage(missing.join("\n")))
        }
    }

    fn plan(&self, process: &Process) -> anyhow::Result<Plan> {
        let (program, args) = process
            .cmd
            .split_first()
            .expect("a launch file's cmd names a program");
        let replaced = |text: &str| self.replace_variables(text, process);
        let params = params::Params::of(process, self.dir, &replaced)?;
        let surroundings = surroundings::of(process, &self.common.domain, &replaced)?;
        let index_of = |name: &String| {
            self.launch
                .processes
                .iter()
                .position(|other| other.name == *name)
                .expect("the launch file checked `after`")
        };
        let ready = process.ready.as_ref();
        let program = programs::find_from(&replaced(program), &surroundings.search())?;
        let mut args: Vec<String> = args.iter().map(|arg| replaced(arg)).collect();
        if let Some(params) = params {
            params.hand_over(&mut args);
        }
        self.add_shared_flags(&mut args, process);
        Ok(Plan {
            name: process.name.clone(),
            program,
            args,
            surroundings,
            is_daemon: process.is_daemon(),
            lockstep: process.lockstep,
            run_dir: self.dir.to_owned(),
            required: process.required,
            after: process.after.iter().map(index_of).collect(),
            ready: ready.and_then(|ready| sign_of(&ready.when)),
            ready_within: ready.map_or(READY_WITHIN, |ready| ready.within).duration(),
            restart: process.restart,
            stop: process.stop,
        })
    }

    /// Replaces the variables `${…}`, which are known only when a run begins.
    fn replace_variables(&self, text: &str, process: &Process) -> String {
        text.replace("${run_dir}", &self.dir.to_string_lossy())
            .replace("${name}", &process.name)
            .replace("${domain}", &self.common.domain)
            .replace("${launch}", &self.resolved.to_string_lossy())
    }

    /// Programs of Gantry get the launcher's domain and log flags, the daemon also the launch file,
    /// unless they name them themselves.
    fn add_shared_flags(&self, args: &mut Vec<String>, process: &Process) {
        let (common, resolved) = (self.common, self.resolved);
        if !process
            .cmd
            .first()
            .is_some_and(|program| programs::is_ours(program))
        {
            return;
        }
        let has = |args: &[String], flag: &str| {
            args.iter().any(|arg| {
                arg == flag
                    || arg
                        .strip_prefix(flag)
                        .is_some_and(|rest| rest.starts_with('='))
            })
        };
        if process.is_simulator() && !has(args, "--launch") {
            args.extend(["--launch".into(), resolved.display().to_string()]);
        }
        // `resolved` is DATA/runs/<start>/launch.toml; daemon and gateway keep their files in DATA.
        let keeps = process.is_simulator()
            || process
                .cmd
                .first()
                .is_some_and(|program| program.ends_with("gantry-carla"));
        if let Some(data) = resolved
            .ancestors()
            .nth(3)
            .filter(|data| keeps && !data.as_os_str().is_empty() && !has(args, "--data"))
        {
            args.extend(["--data".into(), data.display().to_string()]);
        }
        if process.lockstep && !process.is_daemon() {
            // Ours take the name as the value of the flag; without one they have a name of their own.
            args.retain(|arg| arg != "--lockstep");
            if !has(args, "--lockstep") {
                args.push(format!("--lockstep={}", process.name));
            }
        }
        // A domain in the process's own environment is meant for it.
        let is_free = !has(args, "--domain") && !process.env.contains_key(DOMAIN_VARIABLE);
        if is_free && programs::takes_domain(&process.cmd) {
            args.extend(["--domain".into(), common.domain.clone()]);
        }
        if common.log_format == LogFormat::Json && !has(args, "--log-format") {
            args.extend(["--log-format".into(), "json".into()]);
        }
        if !has(args, "--color") {
            args.extend([
                "--color".into(),
                if common.color.on_stderr() {
                    "always"
                } else {
                    "never"
                }
                .into(),
            ]);
        }
        args.extend((0..common.verbose).map(|_| "-v".to_owned()));
        args.extend((0..common.quiet).map(|_| "-q".to_owned()));
    }
}

fn sign_of(when: &ReadyWhen) -> Option<ReadySign> {
    match when {
        ReadyWhen::Service(topic) => Some(ReadySign::Service(topic.clone())),
        ReadyWhen::Line(pattern) => Some(ReadySign::Line(
            Regex::new(pattern).expect("the launch file checked the pattern"),
        )),
        ReadyWhen::Tcp(address) => Some(ReadySign::Tcp(address.clone())),
        ReadyWhen::Lockstep => None,
    }
}

#[cfg(test)]
mod tests {
    use launch_cli::BasicArgs;

    use super::*;

    const LAUNCH: &str = "version = 1\n[process.world]\ncmd = [\"simd\"]\n[process.view]\ncmd = [\"gantry-view\"]\nstop = { grace = \"9s\" }\n\
        [process.other]\ncmd = [\"sh\", \"-c\", \"${domain} ${name} ${run_dir}\"]\nafter = [\"world\"]\n";

    #[test]
    fn flags_reach_our_programs_and_only_them() {
        let common = BasicArgs {
            verbose: 2,
            ..Default::default()
        }
        .on("lab");
        let launch = Launch::parse(LAUNCH, "x").unwrap();
        let run = Run {
            launch: &launch,
            common: &common,
            dir: Path::new("d"),
            resolved: Path::new("run/launch.toml"),
        };
        let flags = |name: &str| {
            let process = launch.process(name).unwrap();
            let mut args = process.cmd[1..].to_vec();
            run.add_shared_flags(&mut args, process);
            args.join(" ")
        };
        assert!(
            flags("world").starts_with("--launch run/launch.toml --domain lab"),
            "{}",
            flags("world")
        );
        assert!(
            flags("view").starts_with("--domain lab") && flags("view").ends_with("-v -v"),
            "{}",
            flags("view")
        );
        assert!(flags("other").starts_with("-c"));
        let other = launch.process("other").unwrap();
        let recorded = format!(
            "{LAUNCH}[process.record]\ncmd = [\"gantry-record\", \"--lockstep\", \"--out\", \"a.mcap\"]\nlockstep = true\n"
        );
        let recorded = Launch::parse(&recorded, "x").unwrap();
        let recorder = recorded.process("record").unwrap();
        let mut args = recorder.cmd[1..].to_vec();
        run.add_shared_flags(&mut args, recorder);
        assert!(
            args.join(" ")
                .starts_with("--out a.mcap --lockstep=record --domain lab"),
            "{args:?}"
        );
        let text = run.replace_variables("${domain} ${name} ${run_dir}", other);
        assert_eq!(text, "lab other d");
    }

    #[test]
    fn a_missing_program_is_named_with_its_process() {
        let launch = Launch::parse(
            "version = 1\n[process.a]\ncmd = [\"gantry-nothing\"]\n",
            "x",
        )
        .unwrap();
        let run = Run {
            launch: &launch,
            common: &CommonArgs::default(),
            dir: Path::new("."),
            resolved: Path::new("x"),
        };
        let message = run.plans().unwrap_err().to_string();
        assert!(
            message.starts_with("process a: there is no program \"gantry-nothing\""),
            "{message}"
        );
    }

    #[test]
    fn the_domain_has_one_name_everywhere() {
        assert_eq!(launch_cli::args::DOMAIN_VARIABLE, DOMAIN_VARIABLE);
        assert_eq!(
            launch_cli::args::DEFAULT_DOMAIN,
            schema_bus::names::DEFAULT_DOMAIN
        );
    }
}
