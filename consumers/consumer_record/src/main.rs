//! `gantry-record`: records a domain into an MCAP file; tells what a file holds; rescues a file
//! that was cut off.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand, ValueEnum};
use consumer_record::options::Options;
use consumer_record::select::Select;
use consumer_record::session::{Report, record};
use consumer_record::{info::file_info, recover::recover_file};
use launch_cli::{CommonArgs, Exit, Shutdown, run, wrong_usage};
use schema_recording::write::ChunkCompression;

/// Records every sensor, every result of users' programs, every snapshot and the map into one MCAP
/// file that Foxglove and rerun open.
#[derive(Debug, Parser)]
#[command(
    name = "gantry-record",
    version,
    args_conflicts_with_subcommands = true,
    after_help = "Examples:\n  gantry-record --out drive.mcap\n  gantry-record --out front.mcap --topics 'ego/front/*' --lockstep\n  gantry-record info drive.mcap\n  gantry-record recover drive.mcap.part rescued.mcap"
)]
struct Args {
    /// File to write; never overwritten. It is called FILE.part until it is finished
    #[arg(long, value_name = "FILE", required = true)]
    out: Option<PathBuf>,

    /// Topics of frames and results to record, with * and ?; default: all. Snapshots and documents
    /// of the world are always recorded
    #[arg(long, value_name = "GLOB", num_args = 1..)]
    topics: Vec<String>,

    /// Topics of those to leave out, with * and ?
    #[arg(long, value_name = "GLOB", num_args = 1..)]
    exclude: Vec<String>,

    /// Let the simulator wait for this recorder, so that nothing is lost; NAME is the name to take
    /// part under [default: gantry-record- and the process id]
    #[arg(long, value_name = "NAME", num_args = 0..=1, require_equals = true, default_missing_value = "")]
    lockstep: Option<String>,

    /// Compression of the file's chunks
    #[arg(long, value_enum, default_value_t = CompressionArg::Lz4)]
    compression: CompressionArg,

    /// Most that waits for the disk, MiB; what does not fit is dropped and counted (in lockstep the
    /// simulator waits instead)
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    queue_mb: u32,

    #[command(subcommand)]
    action: Option<Action>,

    #[command(flatten)]
    common: CommonArgs,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Tell what a recording holds, whole or not
    Info {
        /// The recording
        file: PathBuf,
        /// One JSON object instead of a table
        #[arg(long)]
        json: bool,
    },
    /// Rescue every complete chunk of a recording that was cut off or damaged
    Recover {
        /// The damaged recording, e.g. drive.mcap.part
        input: PathBuf,
        /// New file to write
        output: PathBuf,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum CompressionArg {
    /// Fastest, largest
    None,
    /// Fast
    Lz4,
    /// Smaller, slower
    Zstd,
}

fn main() -> ExitCode {
    run(|args: Args| {
        args.common.init_logging();
        match &args.action {
            Some(Action::Info { file, json }) => print_info(file, *json),
            Some(Action::Recover { input, output }) => rescue(input, output),
            None => start(&args),
        }
    })
}

fn start(args: &Args) -> anyhow::Result<Exit> {
    let out = args
        .out
        .clone()
        .ok_or_else(|| wrong_usage("--out FILE is missing"))?;
    let shutdown = Shutdown::install()?;
    launch_cli::raise_file_limit()?;
    let options = Options {
        domain: args.common.domain.clone(),
        bus: Default::default(),
        select: Select {
            topics: args.topics.clone(),
            exclude: args.exclude.clone(),
        },
        out: out.clone(),
        compression: match args.compression {
            CompressionArg::None => ChunkCompression::None,
            CompressionArg::Lz4 => ChunkCompression::Lz4,
            CompressionArg::Zstd => ChunkCompression::Zstd,
        },
        queue_bytes: (args.queue_mb as usize) << 20,
        lockstep: args.lockstep.is_some(),
        lockstep_name: args.lockstep.clone().filter(|name| !name.is_empty()),
    };
    tracing::info!(file = %out.display(), domain = options.domain, "recording");
    let report = record(&options, &|| shutdown.requested())?;
    print_report(&report)
}

fn print_report(report: &Report) -> anyhow::Result<Exit> {
    let mut stdout = std::io::stdout().lock();
    for (file, written) in &report.files {
        let n_messages: u64 = written.messages.values().sum();
        writeln!(
            stdout,
            "{}: {n_messages} messages on {} channels, {:.1} MB",
            file.display(),
            written.messages.len(),
            written.file_bytes as f64 / 1e6
        )?;
    }
    for (topic, n) in &report.bad_items {
        writeln!(
            stdout,
            "{topic}: {n} items are only in /{topic}/gantry, because they are broken"
        )?;
    }
    if report.lost.is_empty() {
        return Ok(Exit::Done);
    }
    for (topic, loss) in &report.lost {
        let (bus, full, refused) = (loss.on_the_bus, loss.queue_full, loss.refused);
        writeln!(
            stdout,
            "lost of {topic}: {} samples ({bus} overwritten before they were taken, {full} did not fit the queue, {refused} broken)",
            loss.total()
        )?;
    }
    writeln!(
        stdout,
        "--lockstep loses nothing; fewer --topics or --compression none lose less"
    )?;
    Ok(Exit::DataLost)
}

fn print_info(file: &std::path::Path, json: bool) -> anyhow::Result<Exit> {
    let found = file_info(file)?;
    let text = if json {
        serde_json::to_string(&found)? + "\n"
    } else {
        found.text()
    };
    std::io::stdout().write_all(text.as_bytes())?;
    Ok(if found.complete {
        Exit::Done
    } else {
        Exit::DataLost
    })
}

fn rescue(input: &std::path::Path, output: &std::path::Path) -> anyhow::Result<Exit> {
    let found = recover_file(input, output)?;
    let mut stdout = std::io::stdout().lock();
    writeln!(
        stdout,
        "{}: {} messages of {} chunks, {} attachments",
        output.display(),
        found.n_messages,
        found.n_chunks,
        found.n_attachments
    )?;
    if found.n_bad_chunks > 0 {
        writeln!(
            stdout,
            "{} damaged chunks were left out",
            found.n_bad_chunks
        )?;
        return Ok(Exit::DataLost);
    }
    Ok(Exit::Done)
}
