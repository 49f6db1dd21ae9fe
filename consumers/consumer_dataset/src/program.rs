//! `gantry-dataset`: makes data sets from recipes, and checks finished ones.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use crate::digest::verify;
use crate::estimate::{Room, size};
use crate::make::{Options, Outcome, Prepared, make, prepare};
use clap::{Parser, Subcommand};
use launch_cli::{BasicArgs, Exit, Progress, Shutdown, run};

/// Makes data sets: a matrix of maps, weathers, times of day, rigs and seeds, recorded, labelled and
/// exported.
#[derive(Debug, Parser)]
#[command(
    name = "gantry-dataset",
    version,
    after_help = "Examples:\n  gantry-dataset make launch/datasets/smoke.toml --out smoke\n  gantry-dataset make launch/datasets/city.toml --out city --jobs 4\n  gantry-dataset verify smoke"
)]
struct Args {
    #[command(subcommand)]
    action: Action,

    #[command(flatten)]
    basic: BasicArgs,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Make a set, or go on with one that was stopped
    Make(MakeArgs),
    /// Compare a finished set with its manifest
    Verify {
        /// Folder of the set
        #[arg(value_name = "DIR")]
        set: PathBuf,
        /// One JSON object instead of lines
        #[arg(long)]
        json: bool,
    },
}

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  gantry-dataset make launch/datasets/smoke.toml --out smoke\n  gantry-dataset make launch/datasets/city.toml --dry-run\n  gantry-dataset make launch/datasets/city.toml --out city --jobs 4 --retries 5"
)]
struct MakeArgs {
    /// The recipe
    #[arg(value_name = "RECIPE")]
    recipe: PathBuf,

    /// Folder of the set; a set of the same recipe that was stopped there is continued [default: the
    /// recipe's name]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    /// Scenarios beside one another [default: one for every two cores, as far as memory goes]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    jobs: Option<u32>,

    /// New attempts of a scenario that fails, e.g. because its simulator was killed; the pause before
    /// each doubles from 1 s on
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(..=100))]
    retries: u32,

    /// Seconds without a finished tick after which a scenario counts as hanging and is begun anew
    #[arg(long, value_name = "SECONDS", default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..=86_400))]
    stall: u32,

    /// Make it although it does not seem to fit on the disk or in memory
    #[arg(long)]
    anyway: bool,

    /// GPU whose name contains this text, for all simulators [default: a real GPU if there is one]
    #[arg(long, value_name = "TEXT")]
    adapter: Option<String>,

    /// Print the scenarios and what they will cost, and start nothing
    #[arg(long)]
    dry_run: bool,

    /// With --dry-run: one JSON object
    #[arg(long, requires = "dry_run")]
    json: bool,
}

/// The program `gantry-dataset`, from its arguments to its exit code.
pub fn main() -> ExitCode {
    run(|args: Args| {
        args.basic.init_logging();
        match &args.action {
            Action::Make(make) => start(make),
            Action::Verify { set, json } => check(&args.basic, set, *json),
        }
    })
}

fn start(args: &MakeArgs) -> anyhow::Result<Exit> {
    let prepared = prepare(&args.recipe)?;
    let default = PathBuf::from(&prepared.plan.recipe.name);
    let out = args.out.as_ref().unwrap_or(&default);
    let options = Options {
        jobs: args.jobs.map(|jobs| jobs as usize),
        retries: args.retries,
        anyway: args.anyway,
        stall: Duration::from_secs(args.stall.into()),
        adapter: args.adapter.clone(),
    };
    if args.dry_run {
        return print_plan(&prepared, out, &options, args.json);
    }
    let shutdown = Shutdown::install()?;
    let outcome = make(&prepared, out, &options, &|| shutdown.requested())?;
    let shown = out.display();
    let mut stdout = std::io::stdout().lock();
    match outcome {
        Outcome::Finished { n_files, n_bytes } => {
            writeln!(
                stdout,
                "{shown}: {n_files} files, {}; look at {}",
                size(n_bytes),
                out.join("index.html").display()
            )?;
            Ok(Exit::Done)
        }
        Outcome::AlreadyFinished => {
            writeln!(stdout, "{shown}: this set is finished already")?;
            Ok(Exit::Done)
        }
        Outcome::Stopped { n_recorded } => {
            let n = prepared.plan.scenarios.len();
            writeln!(
                stdout,
                "{shown}: stopped with {n_recorded} of {n} scenarios recorded; the same command goes on"
            )?;
            Ok(Exit::Done)
        }
        Outcome::Failed(failed) => {
            for (name, reason) in &failed {
                eprintln!("error: {name}: {reason}");
            }
            eprintln!(
                "error: {} of the set in {shown} failed; the same command tries them again",
                failed.len()
            );
            Ok(Exit::Failed)
        }
    }
}

fn print_plan(
    prepared: &Prepared,
    out: &Path,
    options: &Options,
    json: bool,
) -> anyhow::Result<Exit> {
    let (plan, estimate) = (&prepared.plan, &prepared.estimate);
    let room = Room::look(out);
    let jobs = estimate.jobs(options.jobs, plan.scenarios.len(), &room);
    let mut stdout = std::io::stdout().lock();
    if json {
        let plan = serde_json::json!({
            "scenarios": plan.scenarios,
            "jobs": jobs,
            "disk_bytes": estimate.disk_bytes,
            "disk_free_bytes": room.disk_bytes,
            "memory_bytes": estimate.memory_bytes.saturating_mul(jobs as u64),
            "memory_free_bytes": room.memory_bytes,
        });
        writeln!(stdout, "{plan}")?;
        return fits(prepared, out, options, jobs, &room);
    }
    for scenario in &plan.scenarios {
        writeln!(
            stdout,
            "{}: {} ticks after {}, {} vehicles, {} people",
            scenario.name,
            scenario.frames,
            scenario.warm_up_ticks,
            scenario.vehicles,
            scenario.walkers
        )?;
    }
    writeln!(
        stdout,
        "{} scenarios, {jobs} at a time; at most {} on disk ({} is free), {} of memory at a time ({} is free)",
        plan.scenarios.len(),
        size(estimate.disk_bytes),
        size(room.disk_bytes),
        size(estimate.memory_bytes.saturating_mul(jobs as u64)),
        size(room.memory_bytes)
    )?;
    fits(prepared, out, options, jobs, &room)
}

/// Refuses a set that does not fit, unless it is to be made anyway.
fn fits(
    prepared: &Prepared,
    out: &Path,
    options: &Options,
    jobs: usize,
    room: &Room,
) -> anyhow::Result<Exit> {
    if !options.anyway {
        prepared.estimate.check(jobs, room, out)?;
    }
    Ok(Exit::Done)
}

fn check(basic: &BasicArgs, set: &Path, json: bool) -> anyhow::Result<Exit> {
    let progress = Progress::endless(basic, &format!("reading {}", set.display()));
    let (manifest, difference) = verify(set)?;
    drop(progress);
    let outcome = match difference.is_empty() {
        true => Exit::Done,
        false => Exit::DataLost,
    };
    if json {
        let found = serde_json::json!({
            "set": set, "files": manifest.files.len(), "missing": difference.missing,
            "changed": difference.changed, "new": difference.new,
        });
        writeln!(std::io::stdout().lock(), "{found}")?;
        return Ok(outcome);
    }
    let mut stdout = std::io::stdout().lock();
    for (word, paths) in [
        ("missing", &difference.missing),
        ("changed", &difference.changed),
        ("not in the manifest", &difference.new),
    ] {
        for path in paths {
            writeln!(stdout, "{word}: {path}")?;
        }
    }
    if difference.is_empty() {
        let n = manifest.files.len();
        writeln!(
            stdout,
            "{}: all {n} files are as they were made",
            set.display()
        )?;
    }
    Ok(outcome)
}
