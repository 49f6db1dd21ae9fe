//! `gantry up`: starts the processes of a launch file, watches them, and stops all of them.

mod child;
mod extras;
mod lockstep;
mod memory;
mod outcome;
mod output;
mod params;
mod plan;
mod ready;
mod restarts;
mod run_dir;
mod signals;
mod supervise;
mod surroundings;
mod topics;

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context as _;
use launch_cli::{CommonArgs, Exit, wrong_usage};
use launch_spec::{FileText, Launch, LaunchErrors, Process};

pub use signals::Signals;
use topics::own_topics;

use crate::bus::Bus;
use crate::cli::{UpArgs, ViewMode};

/// The launch file that runs when none is named.
const QUICKSTART: (&str, &str) = (
    "launch/quickstart.toml",
    include_str!("../../quickstart.toml"),
);

/// Launch files that need no program but ours: whoever has installed Gantry without its repository
/// names them as if it were there, on the command line and in `include`.
const BUILT_IN: [(&str, &str); 4] = [
    QUICKSTART,
    ("launch/minimal.toml", include_str!("../../minimal.toml")),
    ("launch/two_rigs.toml", include_str!("../../two_rigs.toml")),
    ("launch/carla.toml", include_str!("../../carla.toml")),
];

/// The JSON schema of launch files; a test compares it with what the reader accepts.
const SCHEMA: &str = include_str!("../../launch.schema.json");

pub fn run(args: &UpArgs, common: &CommonArgs) -> anyhow::Result<Exit> {
    if args.schema {
        print!("{SCHEMA}");
        return Ok(Exit::Done);
    }
    let launch = extras::with_extras(read(args)?, args);
    if args.dry_run {
        println!(
            "{}\n{}",
            launch.to_toml_with_defaults().trim_end(),
            memory::table(&launch, &common.domain)
        );
        return Ok(Exit::Done);
    }
    anyhow::ensure!(
        !launch.processes.is_empty(),
        wrong_usage("the launch file has no [process.NAME]; there is nothing to start")
    );
    check_files(args)?;
    let data = args.data.as_deref();
    // The launcher starts no logging, which would do this.
    common.end_with_parent();
    start(&launch, data, args.run_for(), common, Signals::install)
}

/// Runs the processes of a launch file until the end, with the run's folder in the data folder
/// `data`. `signals` is called when nothing speaks against the start any more.
///
/// # Errors
/// A sentence if the processes cannot be started.
pub fn start(
    launch: &Launch,
    data: Option<&Path>,
    run_for: Option<Duration>,
    common: &CommonArgs,
    signals: impl FnOnce() -> anyhow::Result<Signals>,
) -> anyhow::Result<Exit> {
    if launch.processes.iter().any(Process::is_daemon) || !launch.topics.is_empty() {
        memory::check(launch)?;
    }
    let bus = Bus::open(&common.domain)?;
    if launch.processes.iter().any(Process::is_daemon) && bus.daemon_alive()? {
        let domain = &common.domain;
        return Err(wrong_usage(format!(
            "a simulator or a replay runs on domain {domain:?} already; stop it, or choose another name with --domain"
        )));
    }
    let signals = signals()?;
    // Processes may run in other folders, so every path that they are given is a whole one.
    let used = run_dir::make(data)?;
    let run_dir = std::path::absolute(&used.path)?;
    let resolved = run_dir.join("launch.toml");
    std::fs::write(&resolved, launch.to_toml_with_defaults())
        .with_context(|| format!("cannot write {}", resolved.display()))?;
    let run = plan::Run {
        launch,
        common,
        dir: &run_dir,
        resolved: &resolved,
    };
    let plans = run.plans()?;
    let names: Vec<&str> = plans.iter().map(|plan| plan.name.as_str()).collect();
    let output = output::Output::new(&names, common);
    output.say(&format!(
        "logs and the full launch file are in {}",
        run_dir.display()
    ));
    let notes = launch_run::NoteWriter::make(&run_dir)?;
    // A launcher that was killed may have left its topics behind.
    bus.clean();
    let kept: Vec<&str> = own_topics(launch)
        .map(|(name, _)| name)
        .filter(|name| bus.exists(name))
        .collect();
    if !kept.is_empty() {
        output.warn(&format!(
            "another process keeps {} open, so the limits of the launch file do not act on it",
            kept.join(", ")
        ));
    }
    // Kept for as long as the processes run: their readers may come before their writers.
    let _topics: Vec<_> = own_topics(launch)
        .map(|(name, topic)| bus.hold_topic(name, &topic))
        .collect::<anyhow::Result<_>>()?;
    let supervisor = supervise::Supervisor::new(plans, output, notes, bus, run_for, signals)?;
    Ok(supervisor.run())
}

/// Shared memory that the built-in quickstart needs, bytes.
pub fn quickstart_bytes() -> u64 {
    let launch =
        Launch::parse(QUICKSTART.1, QUICKSTART.0).expect("a test parses every launch file we ship");
    memory::total_bytes(&launch)
}

/// Checks that the recording is there, and that the files to be written do not exist yet. Files are
/// never overwritten, and the user should learn that before the town is built.
fn check_files(args: &UpArgs) -> anyhow::Result<()> {
    if let Some(file) = &args.replay {
        anyhow::ensure!(
            file.is_file(),
            wrong_usage(format!("there is no recording {}", file.display()))
        );
    }
    let saved = match &args.view {
        Some(ViewMode::Save(file)) => Some(file),
        _ => None,
    };
    for file in args.record.iter().chain(saved) {
        let folder = file
            .parent()
            .filter(|folder| !folder.as_os_str().is_empty())
            .unwrap_or(Path::new("."));
        anyhow::ensure!(
            !file.exists(),
            wrong_usage(format!(
                "{} exists already; choose another name, or remove it first",
                file.display()
            ))
        );
        anyhow::ensure!(
            folder.is_dir(),
            wrong_usage(format!("there is no folder {}", folder.display()))
        );
    }
    Ok(())
}

/// Reads the launch files with what `--set` says.
///
/// # Errors
/// All errors of the files in one.
pub fn read(args: &UpArgs) -> anyhow::Result<Launch> {
    let mut folders = Vec::new();
    let mut read_file = |path: &Path| {
        let file = read_or_built_in(path)?;
        folders.push(file.folder.clone());
        Ok(file)
    };
    let read = match &args.files[..] {
        [] => Launch::load(&[QUICKSTART.0.into()], &args.set, &mut read_file),
        files => Launch::load(files, &args.set, &mut read_file),
    };
    let mut launch = read.map_err(all_of)?;
    if let Some(map) = map_beside(&launch.scenario.map, &folders) {
        launch.scenario.map = map.display().to_string();
    }
    Ok(launch)
}

/// A file, or the one of this name that is built in, as if it lay in the working folder.
fn read_or_built_in(path: &Path) -> io::Result<FileText> {
    let missing = match FileText::read(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => error,
        read => return read,
    };
    let folder = std::env::current_dir()?;
    let asked = std::path::absolute(path)?;
    let built_in = BUILT_IN.iter().find(|(name, _)| asked == folder.join(name));
    let Some((name, text)) = built_in else {
        return Err(missing);
    };
    Ok(FileText {
        identity: name.into(),
        folder,
        text: (*text).to_owned(),
    })
}

fn all_of(errors: LaunchErrors) -> anyhow::Error {
    match &errors.0[..] {
        [one] => wrong_usage(one),
        several => wrong_usage(format!(
            "the launch file has {} errors\n{errors}",
            several.len()
        )),
    }
}

/// The whole path of a map that lies beside a launch file and not in the working folder: the daemon
/// reads another file, in the folder of the run.
fn map_beside(map: &str, folders: &[PathBuf]) -> Option<PathBuf> {
    if !map.ends_with(".xodr") || Path::new(map).exists() {
        return None;
    }
    folders
        .iter()
        .rev()
        .map(|folder| folder.join(map))
        .find(|path| path.is_file())
}
