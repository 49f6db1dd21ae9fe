//! `gantry bench perception`: from the command line to the report.

mod assemble;
mod kept;
mod stopped;
pub mod verify;

use std::io::{IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use anyhow::Context as _;
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressStyle};
use launch_cli::values::{WrongValue, number};
use launch_cli::{CommonArgs, Exit, Shutdown, wrong_usage};
use launch_run::is_stopped;
use schema_recording::pattern;

use crate::capture::{Capture, Mode};
use crate::report::{self, Report};
use crate::run::{self, Drive, Source};
use crate::scenario::{Scenario, scenarios};
use crate::score::Scorer;
use crate::suite::{Program, Suite};
use crate::truth_pass::hidden::{self, Hidden};
use crate::truth_pass::{self, TruthRecording};
use assemble::Assembly;
use stopped::{FinishedRuns, Makings};

/// Frames of a stream, if nothing else is asked for: what MLPerf Automotive asks of a constant one.
const STRESS_FRAMES: u64 = 100_000;

/// Most GiB of recordings, if nothing else is asked for.
const CACHE_GIB: f64 = 64.0;

const EXAMPLES: &str = "Examples:
  gantry bench perception launch/bench/smoke.toml -- python my_detector.py
  gantry bench perception launch/bench/worked.toml --only dis --modes streaming --speed 0.5
  gantry bench perception launch/bench/standard.toml --seed --out cited -- ./detector
  gantry bench perception launch/bench/standard.toml --recording drive.mcap -- ./detector
  gantry bench perception launch/bench/smoke.toml --modes constant,single --frames 20000 --fps 60 -- ./flow
  gantry bench perception launch/bench/full.toml --scenarios 'Town01_*' --part --out whole -- ./detector
  gantry bench perception launch/bench/full.toml --resume whole -- ./detector
  gantry bench perception launch/bench/smoke.toml --dry-run";

/// Runs programs through the scenarios of a suite, and says how late and how right they are.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct PerceptionArgs {
    /// The suite: what is shown, what is asked, and perhaps which programs run
    #[arg(value_name = "SUITE")]
    suite: PathBuf,

    /// A program to run, in place of those of the suite; it gets all inputs
    #[arg(value_name = "CMD", last = true)]
    cmd: Vec<String>,

    /// Folder for the report, which is made [default: bench_ and the suite's name, with a number if
    /// that is there]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    /// Go on with a benchmark that was stopped: the folder of its report. Runs that had finished are
    /// taken from there; say the other options as they were said then
    #[arg(long, value_name = "DIR", conflicts_with_all = ["out", "truth_only"])]
    resume: Option<PathBuf>,

    /// These runs are a part: keep them, score nothing, and let --resume run the rest and score all
    #[arg(long, conflicts_with_all = ["truth_only", "json"])]
    part: bool,

    /// Show drives that nobody can know beforehand, for figures to be cited: of a seed that is
    /// drawn, or of N, which the report of an earlier draw names [default: the suite's seed, whose
    /// drives everybody can make]
    #[arg(long, value_name = "N", num_args = 0..=1, conflicts_with = "recording", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: Option<Option<u64>>,

    /// How programs run: offline (every frame is waited for), streaming (real time), constant (a
    /// stream of --frames at one rate), single (a stream whose next frame comes with the answer)
    /// [default: what the suite says, else offline,streaming]
    #[arg(long, value_name = "MODE,…", value_delimiter = ',', value_enum)]
    modes: Vec<ModeArg>,

    /// Speed of streaming: simulated seconds per second, 0.01 to 100; several are several runs
    #[arg(long, value_name = "X,…", value_delimiter = ',', default_value = "1", value_parser = speed)]
    speed: Vec<f64>,

    /// Count every result of streaming as later by this many milliseconds
    #[arg(long, value_name = "MS", default_value_t = 0.0, value_parser = number("delay in milliseconds", 0.0..=10_000.0))]
    added_delay: f64,

    /// Frames of a constant or single stream
    #[arg(long, value_name = "N", default_value_t = STRESS_FRAMES, value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    frames: u64,

    /// Frames per second of a constant stream [default: the sensor's rate]
    #[arg(long, value_name = "HZ", value_parser = number("rate in frames per second", 0.01..=10_000.0))]
    fps: Option<f64>,

    /// Run these programs of the suite only, with * and ?
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    only: Vec<String>,

    /// Run these scenarios of the suite only, with * and ?
    #[arg(long, value_name = "GLOB,…", value_delimiter = ',')]
    scenarios: Vec<String>,

    /// Where frames come from: the recording of the truth pass, or a simulator that runs the same
    /// again and renders beside the program
    #[arg(long, value_enum, default_value_t = Source::Replay)]
    source: Source,

    /// Show this recording in place of the suite's scenarios; it needs the suite's inputs, and exact
    /// images as its truth
    #[arg(long, value_name = "FILE", conflicts_with = "scenarios")]
    recording: Option<PathBuf>,

    /// Processor cores of the replay or the simulator, e.g. 0 or 0,1 [default: all]
    #[arg(long, value_name = "N,…", value_delimiter = ',')]
    cores_world: Vec<u32>,

    /// Processor cores of programs that name none [default: all]
    #[arg(long, value_name = "N,…", value_delimiter = ',')]
    cores_program: Vec<u32>,

    /// GPU for the simulator whose name contains this text [default: a real GPU if there is one]
    #[arg(long, value_name = "TEXT")]
    adapter: Option<String>,

    /// Folder in which recordings of truth passes are kept [default: gantry/bench in the XDG cache
    /// folder]
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,

    /// Most GiB of recordings in that folder: the one that was not used for longest goes first, and
    /// none that is in use
    #[arg(long, value_name = "GIB", default_value_t = CACHE_GIB, value_parser = number("size in GiB", 0.0..=1_000_000.0))]
    cache_limit: f64,

    /// Longest time without a finished tick before a simulator counts as hanging
    #[arg(long, value_name = "SECONDS", default_value_t = 300, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    stall: u64,

    /// Make the recordings, run nothing
    #[arg(long)]
    truth_only: bool,

    /// Print scenarios, tasks and programs, and start nothing
    #[arg(long)]
    dry_run: bool,

    /// Keep the logs of all processes [default: only if something went wrong]
    #[arg(long)]
    keep_logs: bool,

    /// Print the report as JSON instead of tables
    #[arg(long)]
    json: bool,
}

/// Choice for `--modes`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ModeArg {
    /// Lockstep: every frame is waited for
    Offline,
    /// Real time, or --speed times it
    Streaming,
    /// A constant stream of --frames
    Constant,
    /// A single stream of --frames
    Single,
}

fn speed(text: &str) -> Result<f64, WrongValue> {
    let (least, most) = schema_frames::command::SPEED_RATIO;
    number("speed", least..=most)(text.trim_end_matches('x'))
}

/// Runs the benchmark.
///
/// # Errors
/// [`launch_cli::WrongUsage`] for what the user can mend, or if the benchmark itself fails. Programs
/// that fail are no error but [`Exit::Failed`] if they crash; the report says it.
pub fn run(args: &PerceptionArgs, common: &CommonArgs) -> anyhow::Result<Exit> {
    let mut suite = Suite::read(&args.suite)?;
    choose_programs(&mut suite, args)?;
    if let Some(seed) = drawn_seed(args)? {
        suite.draw(seed);
    }
    let scenarios = choose_scenarios(&suite, args)?;
    let runs = plan(&suite, args)?;
    if args.dry_run {
        print_plan(&suite, &scenarios, &runs)?;
        return Ok(Exit::Done);
    }
    let shutdown = Shutdown::install()?;
    launch_cli::raise_file_limit()?;
    let out = out_folder(args, &suite)?;
    let bench = Bench {
        args,
        common,
        suite: &suite,
        runs: &runs,
        out: &out,
        truth_options: truth_pass::Options {
            cache: match &args.cache {
                Some(cache) => std::path::absolute(cache)?,
                None => truth_pass::cache_folder()?,
            },
            cache_limit_bytes: (args.cache_limit * f64::from(1 << 30)) as u64,
            adapter: args.adapter.clone(),
            stall: Duration::from_secs(args.stall),
            build: match args.recording {
                // Whoever made a recording elsewhere need not have its simulator here.
                Some(_) => env!("CARGO_PKG_VERSION").to_owned(),
                None => truth_pass::build()?,
            },
        },
        run_options: run::Options {
            source: args.source,
            added_delay_nanos: (args.added_delay * 1e6).round() as u64,
            cores_world: args.cores_world.clone(),
            cores_program: args.cores_program.clone(),
            adapter: args.adapter.clone(),
        },
        began: SystemTime::now(),
        shutdown: &shutdown,
    };
    match bench.run(&scenarios) {
        Err(error) if is_stopped(&error) => {
            match args.truth_only {
                true => tracing::info!("stopped; truth that was recorded is kept"),
                false => tracing::info!(
                    "stopped; the same command with --resume {} in place of --out goes on with the runs that have finished",
                    out.display()
                ),
            }
            Ok(Exit::Failed)
        }
        other => other,
    }
}

/// The seed in place of the suite's, if one is asked for or was drawn when the benchmark that is
/// gone on with began.
fn drawn_seed(args: &PerceptionArgs) -> anyhow::Result<Option<u64>> {
    let before = match &args.resume {
        Some(folder) => stopped::drawn_seed(folder)?,
        None => None,
    };
    Ok(match args.seed {
        Some(Some(seed)) => Some(seed),
        Some(None) => before.or_else(|| Some(fastrand::u64(0..=u64::from(u32::MAX)))),
        None => before,
    })
}

/// The programs that run: the command, or those of the suite that were chosen.
fn choose_programs(suite: &mut Suite, args: &PerceptionArgs) -> anyhow::Result<()> {
    if !args.cmd.is_empty() {
        suite.programs = vec![Program::of_command(&args.cmd).map_err(wrong_usage)?];
    }
    let matches = |name: &str| {
        args.only.is_empty() || args.only.iter().any(|only| pattern::matches(only, name))
    };
    let names: Vec<String> = suite.programs.iter().map(|it| it.name.clone()).collect();
    suite.programs.retain(|program| matches(&program.name));
    if suite.programs.is_empty() && !args.truth_only {
        return Err(wrong_usage(match names.is_empty() {
            true => format!(
                "{} has no [program.NAME]; give a command behind --, e.g. -- python my_detector.py",
                args.suite.display()
            ),
            false => format!(
                "--only {}: there is {}",
                args.only.join(","),
                names.join(", ")
            ),
        }));
    }
    Ok(())
}

fn choose_scenarios(suite: &Suite, args: &PerceptionArgs) -> anyhow::Result<Vec<Scenario>> {
    if args.recording.is_some() {
        return Ok(Vec::new());
    }
    let all = scenarios(suite).map_err(wrong_usage)?;
    let matches = |scenario: &&Scenario| {
        let of = |glob: &String| pattern::matches(glob, &scenario.name);
        args.scenarios.is_empty() || args.scenarios.iter().any(of)
    };
    let chosen: Vec<Scenario> = all.iter().filter(matches).cloned().collect();
    if chosen.is_empty() {
        let names: Vec<&str> = all.iter().map(|it| it.name.as_str()).collect();
        return Err(wrong_usage(format!(
            "--scenarios {}: there is {}",
            args.scenarios.join(","),
            names.join(", ")
        )));
    }
    Ok(chosen)
}

/// Which programs run, and how.
fn plan(suite: &Suite, args: &PerceptionArgs) -> anyhow::Result<Vec<(String, Drive)>> {
    let mut runs = Vec::new();
    for program in &suite.programs {
        let modes = match args.modes.is_empty() {
            false => args.modes.clone(),
            true => program.modes.iter().map(|mode| mode_arg(*mode)).collect(),
        };
        for mode in modes {
            let name = || program.name.clone();
            match mode {
                ModeArg::Offline => runs.push((name(), Drive::Offline)),
                ModeArg::Streaming => {
                    for speed in &args.speed {
                        runs.push((name(), Drive::Streaming { speed: *speed }));
                    }
                }
                ModeArg::Constant => {
                    let (n_frames, speed) = (args.frames, stream_speed(suite, args)?);
                    runs.push((name(), Drive::Constant { n_frames, speed }));
                }
                ModeArg::Single => {
                    let n_frames = args.frames;
                    runs.push((name(), Drive::Single { n_frames }));
                }
            }
        }
    }
    let live_streams = runs
        .iter()
        .any(|(_, drive)| drive.mode() == Mode::Stress && args.source == Source::Live);
    if live_streams {
        return Err(wrong_usage(
            "a stream repeats a recording until it has --frames; --modes constant and single need --source replay",
        ));
    }
    let acts = suite.is_closed_loop();
    let waits = |(name, drive): &&(String, Drive)| {
        let joins = suite.program(name).is_some_and(Program::joins_lockstep);
        *drive == Drive::Offline && !joins
    };
    if let Some((name, _)) = runs.iter().find(waits).filter(|_| acts) {
        return Err(wrong_usage(format!(
            "[program.{name}] drives offline, but has no lockstep = true: nobody can tell from outside when its controls are complete; join lockstep, or run it with --modes streaming"
        )));
    }
    let is_stream = |(_, drive): &(String, Drive)| drive.mode() == Mode::Stress;
    if acts && (runs.iter().any(is_stream) || args.recording.is_some()) {
        return Err(wrong_usage(
            "a program that drives needs a world that it can change; run it with --modes offline,streaming and without --recording",
        ));
    }
    Ok(runs)
}

fn mode_arg(mode: Mode) -> ModeArg {
    match mode {
        Mode::Offline => ModeArg::Offline,
        Mode::Streaming => ModeArg::Streaming,
        Mode::Stress => ModeArg::Constant,
    }
}

/// The speed of a replay whose fastest camera or lidar that a task is about gives `--fps`.
fn stream_speed(suite: &Suite, args: &PerceptionArgs) -> anyhow::Result<f64> {
    let Some(fps) = args.fps else { return Ok(1.0) };
    let all = scenarios(suite).map_err(wrong_usage)?;
    let first = all.first().context("a suite has scenarios")?;
    let inputs = first.inputs(suite).map_err(wrong_usage)?;
    let is_about = |sensor: &str| {
        let mut tasks = suite.tasks.iter();
        tasks.any(|task| task.sensor.as_deref() == Some(sensor))
    };
    let rates = inputs.iter().filter(|input| is_about(&input.sensor));
    let rate_hz = rates.filter_map(|input| input.rate_hz).fold(0.0, f64::max);
    let (least, most) = schema_frames::command::SPEED_RATIO;
    let ratio = fps / rate_hz;
    if !(least..=most).contains(&ratio) {
        return Err(wrong_usage(format!(
            "--fps {fps}: the sensor has {rate_hz} frames per second, and a replay goes {least} to {most} times as fast"
        )));
    }
    Ok(ratio)
}

fn print_plan(
    suite: &Suite,
    scenarios: &[Scenario],
    runs: &[(String, Drive)],
) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        "{}: {} s after {} s of warm-up, {} ticks and {} queries a second",
        suite.name, suite.secs, suite.warm_up_s, suite.tick_hz, suite.query_hz
    )?;
    for scenario in scenarios {
        writeln!(
            out,
            "scenario {}: {} vehicles, {} people",
            scenario.name, scenario.vehicles, scenario.walkers
        )?;
    }
    if !suite.matrix.training_maps.is_empty() {
        let maps = suite.matrix.training_maps.join(", ");
        writeln!(out, "training maps, which are not scored on: {maps}")?;
    }
    for task in &suite.tasks {
        let sensor = task.sensor.as_deref().unwrap_or("the ego");
        writeln!(out, "task {}: {} of {sensor}", task.name, task.kind.name())?;
    }
    for (program, drive) in runs {
        let command = suite.program(program).map(Program::command);
        let how = match drive {
            Drive::Offline => "offline".to_owned(),
            Drive::Streaming { speed } => format!("streaming at {speed} of real time"),
            Drive::Constant { n_frames, speed } => {
                format!("constant stream of {n_frames} frames at {speed} of real time")
            }
            Drive::Single { n_frames } => format!("single stream of {n_frames} frames"),
        };
        let command = command.unwrap_or_default().join(" ");
        writeln!(out, "run {program} {how}: {command}")?;
    }
    Ok(())
}

/// The folder of the report, new and empty.
fn out_folder(args: &PerceptionArgs, suite: &Suite) -> anyhow::Result<PathBuf> {
    let refused = |folder: &Path, error: std::io::Error| {
        wrong_usage(format!(
            "cannot make the folder {}: {error}; choose another with --out",
            folder.display()
        ))
    };
    if let Some(folder) = &args.resume {
        return Ok(std::path::absolute(folder)?);
    }
    if let Some(out) = &args.out {
        let holds_anything = std::fs::read_dir(out).is_ok_and(|mut all| all.next().is_some());
        if holds_anything {
            return Err(wrong_usage(format!(
                "{} is not empty; remove it or choose another --out",
                out.display()
            )));
        }
        std::fs::create_dir_all(out).map_err(|error| refused(out, error))?;
        return Ok(std::path::absolute(out)?);
    }
    for number in 1..10_000 {
        let name = match number {
            1 => format!("bench_{}", suite.name),
            _ => format!("bench_{}_{number}", suite.name),
        };
        let folder = PathBuf::from(name);
        match std::fs::create_dir(&folder) {
            Ok(()) => return Ok(std::path::absolute(folder)?),
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(refused(&folder, error)),
        }
    }
    Err(wrong_usage(
        "there are 9999 reports of this suite here; choose a folder with --out",
    ))
}

/// Everything that a benchmark needs.
struct Bench<'a> {
    args: &'a PerceptionArgs,
    common: &'a CommonArgs,
    suite: &'a Suite,
    runs: &'a [(String, Drive)],
    out: &'a Path,
    truth_options: truth_pass::Options,
    run_options: run::Options,
    began: SystemTime,
    shutdown: &'a Shutdown,
}

impl Bench<'_> {
    fn run(&self, scenarios: &[Scenario]) -> anyhow::Result<Exit> {
        if self.args.truth_only {
            return self.record(scenarios);
        }
        let finished_runs = self.finished_runs()?;
        let mut logs = Vec::new();
        let outcome = self.run_all(scenarios, &finished_runs, &mut logs);
        let is_clean = matches!(&outcome, Ok(Some(report)) if report.runs.iter().all(|run| run.faults.is_empty()));
        if self.args.keep_logs || !is_clean {
            for hidden in logs {
                hidden.reveal()?;
            }
        } else {
            let _ = std::fs::remove_dir_all(self.out.join("logs"));
        }
        match outcome {
            Err(error) => {
                // Also if the benchmark itself failed: hours may have gone into what has finished.
                if is_stopped(&error) || finished_runs.has_any() {
                    finished_runs.stop()?;
                }
                Err(error)
            }
            Ok(None) => {
                finished_runs.stop()?;
                println!(
                    "the runs are kept in {}; the same command with --resume {} runs others, and without --part scores all",
                    self.out.display(),
                    self.out.display()
                );
                Ok(Exit::Done)
            }
            Ok(Some(report)) => {
                finished_runs.end();
                Ok(match report.has_crash {
                    true => Exit::Failed,
                    false => Exit::Done,
                })
            }
        }
    }

    /// Makes the recordings, and nothing else.
    fn record(&self, scenarios: &[Scenario]) -> anyhow::Result<Exit> {
        let n = scenarios.len().max(1);
        for at in 0..n {
            let truth = self.truth(scenarios.get(at), at, n)?;
            let name = &truth.scenario.name;
            println!("{name} {} {}", truth.frames_hash, truth.path.display());
        }
        Ok(Exit::Done)
    }

    /// Runs and scores everything, and writes the report; runs alone if they are a part.
    fn run_all(
        &self,
        scenarios: &[Scenario],
        finished_runs: &FinishedRuns,
        logs: &mut Vec<Hidden>,
    ) -> anyhow::Result<Option<Report>> {
        let mut assembly = Assembly::new(self.suite, self.args.source, self.began);
        let mut scorer = Scorer::new(self.suite)?;
        let pictures = Hidden::new(&self.truth_options.cache, self.out)?;
        let n = scenarios.len().max(1);
        for at in 0..n {
            let truth = self.truth(scenarios.get(at), at, n)?;
            tracing::debug!(path = %truth.path.display(), "truth of {}", truth.scenario.name);
            let captures = self.captures(&truth, (at, n), finished_runs, logs)?;
            if self.args.part {
                continue;
            }
            let scoring = spinner(format!("{}/{n} scoring {}", at + 1, truth.scenario.name));
            assembly.add(&truth, &captures);
            scorer
                .add(&truth, &captures, pictures.folder())
                .with_context(|| format!("scoring {}", truth.scenario.name))?;
            scoring.finish_and_clear();
        }
        if self.args.part {
            return Ok(None);
        }
        pictures.reveal()?;
        let finished = scorer.finish();
        let mut report =
            assembly.report(finished.runs, &self.run_options, &self.truth_options.build);
        if report.is_sealed {
            let led = hidden::led(self.suite, &self.truth_options.cache);
            report.warnings.extend(led);
        }
        let written = report::write_all(&report, self.out, &finished.files)?;
        match self.args.json {
            true => println!("{}", serde_json::to_string(&report)?),
            false => {
                let colour = report::terminal::colours(self.common.color);
                print!("{}", report::terminal(&report, colour));
                println!("{written}");
            }
        }
        Ok(Some(report))
    }

    /// Runs that had finished when the benchmark was stopped, or none.
    fn finished_runs(&self) -> anyhow::Result<FinishedRuns> {
        let makings = Makings {
            suite: self.suite,
            build: &self.truth_options.build,
            source: self.args.source,
            added_delay_nanos: self.run_options.added_delay_nanos,
            n_frames: self.args.frames,
            recording: self.args.recording.as_deref(),
        };
        let cache = &self.truth_options.cache;
        match self.args.resume {
            Some(_) => FinishedRuns::resume(self.out, cache, &makings),
            None => FinishedRuns::begin(self.out, cache, &makings),
        }
    }

    fn truth(
        &self,
        scenario: Option<&Scenario>,
        at: usize,
        n: usize,
    ) -> anyhow::Result<TruthRecording> {
        if let Some(file) = &self.args.recording {
            return truth_pass::of_file(file, self.suite, &self.truth_options);
        }
        let scenario = scenario.context("a suite has scenarios")?;
        if self.suite.is_closed_loop() {
            return truth_pass::of_closed_loop(self.suite, scenario, &self.truth_options);
        }
        let bar = bar(
            format!("{}/{n} truth of {}", at + 1, scenario.name),
            "ticks",
        );
        let progress = |done: u64, of: u64| {
            bar.set_length(of);
            bar.set_position(done);
        };
        let stop = || self.shutdown.requested();
        let truth =
            truth_pass::recording(self.suite, scenario, &self.truth_options, &stop, &progress);
        bar.finish_and_clear();
        truth
    }

    fn captures(
        &self,
        truth: &TruthRecording,
        (at, n): (usize, usize),
        finished: &FinishedRuns,
        hidden_logs: &mut Vec<Hidden>,
    ) -> anyhow::Result<Vec<Capture>> {
        let mut captures = Vec::new();
        let scenario = &truth.scenario.name;
        for (name, drive) in self.runs {
            // A stream repeats one scenario.
            if drive.mode() == Mode::Stress && at > 0 {
                continue;
            }
            let program = self.suite.program(name).context("programs were chosen")?;
            let label = label(name, *drive);
            if let Some(capture) = finished.take(truth, &label)? {
                tracing::info!("{label} in {scenario} had finished");
                captures.push(capture);
                continue;
            }
            let bar = bar(format!("{}/{n} {label} in {scenario}", at + 1), "done");
            let progress = |done: u64, of: u64| {
                bar.set_length(of);
                bar.set_position(done);
            };
            let logs = self.out.join("logs").join(scenario).join(&label);
            // What is not sealed need not be hidden.
            let hidden = match self.suite.is_closed_loop() {
                true => None,
                false => Some(Hidden::new(&self.truth_options.cache, &logs)?),
            };
            let job = run::Job {
                suite: self.suite,
                program,
                truth,
                drive: *drive,
                options: &self.run_options,
                folder: hidden.as_ref().map_or(&*logs, Hidden::folder),
            };
            let capture = run::run(&job, &|| self.shutdown.requested(), &progress);
            bar.finish_and_clear();
            hidden_logs.extend(hidden);
            let capture = capture.with_context(|| format!("{label} in {scenario}"))?;
            finished.put(truth, &label, &capture)?;
            captures.push(capture);
        }
        Ok(captures)
    }
}

/// A run in a word that is safe in paths.
fn label(program: &str, drive: Drive) -> String {
    match drive {
        Drive::Offline => format!("{program}-offline"),
        Drive::Streaming { speed } => format!("{program}-streaming-{speed}x"),
        Drive::Constant { speed, .. } => format!("{program}-constant-{speed}x"),
        Drive::Single { .. } => format!("{program}-single"),
    }
}

/// A sign of life on terminals, nothing elsewhere.
fn spinner(message: String) -> ProgressBar {
    let bar = match std::io::stderr().is_terminal() {
        true => ProgressBar::new_spinner(),
        false => ProgressBar::hidden(),
    };
    bar.set_message(message);
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

/// A bar on terminals, nothing elsewhere.
fn bar(message: String, unit: &str) -> ProgressBar {
    let bar = match std::io::stderr().is_terminal() {
        true => ProgressBar::new(0),
        false => ProgressBar::hidden(),
    };
    let template = format!("{{msg}} {{wide_bar}} {{pos}}/{{len}} {unit}, {{eta}} left");
    let style = ProgressStyle::with_template(&template);
    bar.set_style(style.expect("the template is constant"));
    bar.set_message(message);
    bar
}
