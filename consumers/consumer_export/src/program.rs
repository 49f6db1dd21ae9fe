//! `gantry-export`: writes training sets from recordings, or from launch files that it runs first.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use crate::live::Live;
use clap::{Parser, ValueEnum};
use consumer_sets::formats::Format;
use consumer_sets::options::{ImageForm, MaskForm, Options, parse_split};
use consumer_sets::run::{Input, Report, export};
use launch_cli::values::span_nanos;
use launch_cli::{BasicArgs, Exit, Shutdown, run, wrong_usage};

/// Writes images, clouds, poses, calibrations and labels of recordings as training sets that the
/// formats' own tools open.
#[derive(Debug, Parser)]
#[command(
    name = "gantry-export",
    version,
    after_help = "Examples:\n  gantry-export drive.mcap --format kitti --out kitti\n  gantry-export runs/*.mcap --format coco --cameras front --every 5 --split train=0.8,val=0.2 --out coco\n  gantry-export launch/quickstart.toml --frames 100 --format yolo --out yolo\n  gantry-export drive.mcap --format nuscenes --out nuscenes --resume"
)]
struct Args {
    /// Recordings, each a scenario of the set; or launch files (.toml), which are run and recorded
    /// first, as fast as this machine can
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,

    /// Format to write
    #[arg(long, value_enum)]
    format: Format,

    /// Folder to write; it must not exist or be empty, unless --resume is given
    #[arg(long, value_name = "DIR")]
    out: PathBuf,

    /// Rig whose sensors are exported [default: ego, or the only one]
    #[arg(long, value_name = "NAME")]
    rig: Option<String>,

    /// Cameras to export, in this order [default: all that the format can hold, by name]
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    cameras: Vec<String>,

    /// Where to begin, after each recording's start, e.g. 10s
    #[arg(long, value_name = "TIME", value_parser = span_nanos, default_value = "0s")]
    from: u64,

    /// Where to end, after each recording's start, e.g. 1m [default: its end]
    #[arg(long, value_name = "TIME", value_parser = span_nanos)]
    to: Option<u64>,

    /// Export every Nth keyframe, a tick in which all sensors that the format joins have a frame
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    every: u64,

    /// Export at most N keyframes of each scenario; of a launch file, run it as long as that takes
    /// [default: all; 100 of launch files]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    frames: Option<u64>,

    /// Parts of the set and their shares; every scenario goes to one of them
    #[arg(long, value_name = "PART=SHARE,…", value_parser = parse_split, default_value = "train=1")]
    split: Shares,

    /// Seed by which scenarios are dealt to the parts
    #[arg(long, value_name = "N", default_value_t = 0)]
    split_seed: u64,

    /// Name of the scenario; once for each FILE [default: the file's name]
    #[arg(long, value_name = "NAME")]
    scenario: Vec<String>,

    /// Form of colour images; nuScenes' is jpg by its own rules, and png all the same works there
    #[arg(long, value_enum, default_value_t = ImageArg::Png)]
    images: ImageArg,

    /// Quality of JPEG, 1 to 100
    #[arg(long, value_name = "Q", default_value_t = 95, value_parser = clap::value_parser!(u8).range(1..=100))]
    jpeg_quality: u8,

    /// Form of COCO's masks
    #[arg(long, value_enum, default_value_t = MaskForm::Rle)]
    masks: MaskForm,

    /// Objects that fewer pixels show get no label
    #[arg(long, value_name = "N", default_value_t = 10)]
    min_pixels: u64,

    /// Go on with an export that was stopped, with the same files and options
    #[arg(long)]
    resume: bool,

    /// Print the outcome as one JSON object
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    basic: BasicArgs,
}

/// Parts of the set and their shares.
type Shares = std::vec::Vec<(String, f64)>;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ImageArg {
    /// Lossless
    Png,
    /// Smaller, with losses
    Jpg,
}

/// The program `gantry-export`, from its arguments to its exit code.
pub fn main() -> ExitCode {
    run(|args: Args| {
        args.basic.init_logging();
        start(&args)
    })
}

fn start(args: &Args) -> anyhow::Result<Exit> {
    if !args.scenario.is_empty() && args.scenario.len() != args.files.len() {
        return Err(wrong_usage(format!(
            "there are {} names (--scenario) for {} files; give one for each, or none",
            args.scenario.len(),
            args.files.len()
        )));
    }
    if args.to.is_some_and(|to| to <= args.from) {
        return Err(wrong_usage("--to must lie behind --from"));
    }
    if let Some(name) = args.scenario.iter().find(|name| !is_tame(name)) {
        return Err(wrong_usage(format!(
            "{name:?} is no name of a scenario: 1 to 64 letters, digits, '-', '_' or '.', not beginning with '.'"
        )));
    }
    let is_launch = |path: &Path| path.extension().is_some_and(|ending| ending == "toml");
    let n_launch = args.files.iter().filter(|path| is_launch(path)).count();
    let mut options = Options::new(args.format, args.out.clone());
    options.rig = args.rig.clone();
    options.cameras = args.cameras.clone();
    options.from_nanos = args.from;
    options.to_nanos = args.to;
    options.every = args.every;
    options.frames = args.frames.or((n_launch > 0).then_some(100));
    options.split = args.split.clone();
    options.split_seed = args.split_seed;
    options.images = match args.images {
        ImageArg::Png => ImageForm::Png,
        ImageArg::Jpg => ImageForm::Jpeg(args.jpeg_quality),
    };
    options.masks = args.masks;
    options.min_pixels = args.min_pixels;
    options.resume = args.resume;
    let shutdown = Shutdown::install()?;
    let live = Live::new(&options)?;
    let mut inputs = Vec::new();
    for (at, file) in args.files.iter().enumerate() {
        let mut name = args.scenario.get(at).cloned();
        let mut path = file.clone();
        if is_launch(file) {
            let own = consumer_truth::recording::scenario_name(file);
            let own = own.strip_suffix(".toml").unwrap_or(&own).to_string();
            match live.record(file, at, &options, &|| shutdown.requested())? {
                Some(recording) => path = recording,
                None => return stopped(args),
            }
            name.get_or_insert(own);
        }
        inputs.push(Input { path, name });
    }
    let report = export(&inputs, &options, &|| shutdown.requested())?;
    print_report(&report, args.json)?;
    if !report.complete {
        return stopped(args);
    }
    Ok(if report.n_lost > 0 {
        Exit::DataLost
    } else {
        Exit::Done
    })
}

fn stopped(args: &Args) -> anyhow::Result<Exit> {
    tracing::info!(out = %args.out.display(), "stopped; --resume goes on");
    Ok(Exit::Done)
}

fn is_tame(name: &str) -> bool {
    (1..=64).contains(&name.len())
        && !name.starts_with('.')
        && name
            .chars()
            .all(|c| c.is_ascii_alphanumeric() || "-_.".contains(c))
}

fn print_report(report: &Report, json: bool) -> anyhow::Result<()> {
    let mut stdout = std::io::stdout().lock();
    if json {
        writeln!(stdout, "{}", serde_json::to_string(report)?)?;
        return Ok(());
    }
    for scenario in &report.scenarios {
        let (name, split, n) = (&scenario.name, &scenario.split, scenario.n_ticks);
        writeln!(stdout, "{name}: {n} keyframes into {split}")?;
    }
    if report.complete {
        writeln!(
            stdout,
            "{}: {} is complete",
            report.out.display(),
            report.format
        )?;
    }
    if report.n_lost > 0 {
        writeln!(
            stdout,
            "{} things of the recordings could not be read and are missing:",
            report.n_lost
        )?;
        for sentence in &report.lost {
            writeln!(stdout, "  {sentence}")?;
        }
    }
    Ok(())
}
