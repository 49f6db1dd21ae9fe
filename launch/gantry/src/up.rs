//! `gantry up`: starts the processes of a launch file, watches them, and stops all of them.

mod child;
mod memory;
mod outcome;
mod output;
mod plan;
mod ready;
mod run_dir;
mod signals;
mod supervise;

use std::path::Path;

use anyhow::Context as _;
use launch_cli::{CommonArgs, Exit, wrong_usage};
use launch_spec::Launch;

use crate::bus::Bus;
use crate::cli::{UpArgs, ViewMode};

/// The launch file that runs when none is named.
const QUICKSTART: (&str, &str) = (
    "launch/quickstart.toml",
    include_str!("../../quickstart.toml"),
);

pub fn run(args: &UpArgs, common: &CommonArgs) -> anyhow::Result<Exit> {
    let launch = plan::with_extras(read(args)?, args);
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
    check_new_files(args)?;
    if launch.processes.iter().any(plan::is_daemon) {
        memory::check(&launch)?;
    }
    let bus = Bus::open(&common.domain)?;
    if launch.processes.iter().any(plan::is_daemon) && bus.daemon_alive()? {
        let domain = &common.domain;
        return Err(wrong_usage(format!(
            "a simulator runs on domain {domain:?} already; stop it, or choose another name with --domain"
        )));
    }
    let signals = signals::Signals::install()?;
    let run_dir = run_dir::make(args.data.as_deref())?;
    let resolved = run_dir.join("launch.toml");
    std::fs::write(&resolved, launch.to_toml_with_defaults())
        .with_context(|| format!("cannot write {}", resolved.display()))?;
    let run = plan::Run {
        launch: &launch,
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
    let supervisor = supervise::Supervisor::new(plans, output, bus, args.run_for(), signals)?;
    Ok(supervisor.run())
}

/// Shared memory that the built-in quickstart needs, bytes.
pub fn quickstart_bytes() -> u64 {
    let launch =
        Launch::parse(QUICKSTART.1, QUICKSTART.0).expect("a test parses every launch file we ship");
    memory::total_bytes(&launch)
}

/// Checks that the files to be written do not exist yet. Files are never overwritten, and the user
/// should learn that before the town is built.
fn check_new_files(args: &UpArgs) -> anyhow::Result<()> {
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

fn read(args: &UpArgs) -> anyhow::Result<Launch> {
    let (name, text) = match args.file.as_deref() {
        None if Path::new(QUICKSTART.0).exists() => {
            (QUICKSTART.0.to_owned(), read_file(Path::new(QUICKSTART.0))?)
        }
        None => (QUICKSTART.0.to_owned(), QUICKSTART.1.to_owned()),
        Some(path) => (path.display().to_string(), read_file(path)?),
    };
    Launch::parse_with(&text, &name, &args.set).map_err(|errors| match &errors.0[..] {
        [one] => wrong_usage(one),
        several => wrong_usage(format!(
            "the launch file has {} errors\n{errors}",
            several.len()
        )),
    })
}

fn read_file(path: &Path) -> anyhow::Result<String> {
    std::fs::read_to_string(path).map_err(|error| {
        wrong_usage(format!(
            "cannot read the launch file {}: {error}",
            path.display()
        ))
    })
}
