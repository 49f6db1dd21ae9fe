//! Turns the processes of a launch file into commands that can be started.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use launch_cli::{CommonArgs, LogFormat, wrong_usage};
use launch_spec::{Launch, Period, Process, ReadyWhen, Restart, Stop};
use regex::Regex;

use crate::cli::{UpArgs, ViewMode};
use crate::programs;

/// Everything needed to start, watch and stop one process.
#[derive(Debug)]
pub struct Plan {
    pub name: String,
    pub program: PathBuf,
    pub args: Vec<String>,
    pub env: BTreeMap<String, String>,
    pub cpus: Vec<u32>,
    pub run_dir: PathBuf,
    pub required: bool,
    /// Indices of the plans that must be ready first.
    pub after: Vec<usize>,
    pub ready: Option<ReadySign>,
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

/// Whether this process is the simulation daemon.
pub fn is_daemon(process: &Process) -> bool {
    process.cmd.first().is_some_and(|program| {
        Path::new(program)
            .file_name()
            .is_some_and(|name| name == "simd")
    })
}

/// The launch file with what `--record` and `--view` ask for.
pub fn with_extras(mut launch: Launch, args: &UpArgs) -> Launch {
    if let Some(file) = &args.record {
        // In lockstep the world waits for the disk: nothing is lost, from the first tick on.
        let cmd = vec![
            "gantry-record".into(),
            "--lockstep".into(),
            "--out".into(),
            file.display().to_string(),
        ];
        if let Some(daemon) = launch
            .processes
            .iter_mut()
            .find(|process| is_daemon(process))
        {
            daemon.cmd.extend(["--await-lockstep".into(), "1".into()]);
        }
        // To finish a file, the recorder writes what is queued, and the index.
        let stop = Stop {
            grace: Period::from_millis(60_000),
            ..Stop::default()
        };
        // Required, so that a run without its recording does not look like a success.
        let recorder = Extra {
            name: "record",
            cmd,
            stop: Some(stop),
            required: true,
        };
        recorder.put_into(&mut launch);
    }
    match args.view.as_ref().map(view_command) {
        None => {}
        Some(None) => launch.processes.retain(|process| process.name != "view"),
        Some(Some(cmd)) => {
            let viewer = Extra {
                name: "view",
                cmd,
                stop: None,
                required: false,
            };
            viewer.put_into(&mut launch);
        }
    }
    launch
}

/// A process that a flag asks for.
struct Extra {
    name: &'static str,
    cmd: Vec<String>,
    /// How it ends; `None` keeps what the launch file says.
    stop: Option<Stop>,
    required: bool,
}

impl Extra {
    /// Replaces the process of this name, or adds it behind the daemon.
    fn put_into(self, launch: &mut Launch) {
        let Extra {
            name,
            cmd,
            stop,
            required,
        } = self;
        let daemon = launch
            .processes
            .iter()
            .find(|process| is_daemon(process))
            .map(|process| process.name.clone());
        let env = launch
            .processes
            .first()
            .map(|process| process.env.clone())
            .unwrap_or_default();
        if let Some(process) = launch
            .processes
            .iter_mut()
            .find(|process| process.name == name)
        {
            process.cmd = cmd;
            process.stop = stop.unwrap_or(process.stop);
            process.required |= required;
            return;
        }
        launch.processes.push(Process {
            name: name.into(),
            cmd,
            required,
            ready: None,
            after: daemon.into_iter().collect(),
            restart: Restart::default(),
            stop: stop.unwrap_or_default(),
            env,
            cpus: Vec::new(),
        });
    }
}

fn view_command(mode: &ViewMode) -> Option<Vec<String>> {
    let words: Vec<String> = match mode {
        ViewMode::None => return None,
        // The viewer chooses by itself: a window if there is a display, else a page.
        ViewMode::Auto => vec![],
        ViewMode::Native => vec!["--native".into()],
        ViewMode::Web => vec!["--web".into()],
        ViewMode::Save(file) => vec!["--save".into(), file.display().to_string()],
    };
    Some(
        std::iter::once("gantry-view".to_owned())
            .chain(words)
            .collect(),
    )
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
    /// One line for each program that is missing.
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
        let replaced = |text: &String| self.replace_variables(text, process);
        let index_of = |name: &String| {
            self.launch
                .processes
                .iter()
                .position(|other| other.name == *name)
                .expect("the launch file checked `after`")
        };
        let ready = process.ready.as_ref();
        let program = programs::find(&replaced(program))?;
        let mut args: Vec<String> = args.iter().map(replaced).collect();
        self.add_shared_flags(&mut args, process);
        Ok(Plan {
            name: process.name.clone(),
            program,
            args,
            env: process
                .env
                .iter()
                .map(|(key, value)| (key.clone(), replaced(value)))
                .collect(),
            cpus: process.cpus.clone(),
            run_dir: self.dir.to_owned(),
            required: process.required,
            after: process.after.iter().map(index_of).collect(),
            ready: ready.map(|ready| match &ready.when {
                ReadyWhen::Service(topic) => ReadySign::Service(topic.clone()),
                ReadyWhen::Line(pattern) => ReadySign::Line(
                    Regex::new(pattern).expect("the launch file checked the pattern"),
                ),
                ReadyWhen::Tcp(address) => ReadySign::Tcp(address.clone()),
            }),
            ready_within: ready.map_or(std::time::Duration::ZERO, |ready| ready.within.duration()),
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
        if is_daemon(process) && !has(args, "--launch") {
            args.extend(["--launch".into(), resolved.display().to_string()]);
        }
        // `resolved` is DATA/runs/<start>/launch.toml; daemon and gateway keep their files in DATA.
        let keeps = is_daemon(process)
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
        if !has(args, "--domain") {
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

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser as _;

    fn up(words: &[&str]) -> UpArgs {
        let args = crate::cli::Args::try_parse_from(["gantry", "up"].iter().chain(words)).unwrap();
        let crate::cli::Word::Up(up) = args.word else {
            panic!("up is up")
        };
        up
    }

    const LAUNCH: &str = "version = 1\n[process.world]\ncmd = [\"simd\"]\n[process.view]\ncmd = [\"gantry-view\"]\nstop = { grace = \"9s\" }\n\
        [process.other]\ncmd = [\"sh\", \"-c\", \"${domain} ${name} ${run_dir}\"]\nafter = [\"world\"]\n";

    fn launch(words: &[&str]) -> Launch {
        with_extras(Launch::parse(LAUNCH, "x").unwrap(), &up(words))
    }

    #[test]
    fn record_and_view_become_processes_after_the_daemon() {
        let both = launch(&["--record", "a.mcap", "--view", "save:b.rrd"]);
        let record = both.process("record").unwrap();
        assert_eq!(
            record.cmd,
            ["gantry-record", "--lockstep", "--out", "a.mcap"]
        );
        assert_eq!(
            both.process("world").unwrap().cmd,
            ["simd", "--await-lockstep", "1"]
        );
        assert_eq!(record.after, ["world"]);
        let view = both.process("view").unwrap();
        assert_eq!(view.cmd, ["gantry-view", "--save", "b.rrd"]);
        assert_eq!(
            view.stop.grace,
            Period::from_millis(9_000),
            "what the file says of its view holds"
        );
        assert!(launch(&["--view", "none"]).process("view").is_none());
        assert!(launch(&[]).process("view").is_some());
    }

    #[test]
    fn flags_reach_our_programs_and_only_them() {
        let common = CommonArgs {
            domain: "lab".into(),
            verbose: 2,
            ..Default::default()
        };
        let launch = launch(&[]);
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
}
