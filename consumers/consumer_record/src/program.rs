//! `gantry-record`: records a domain into MCAP files or a ring in memory; tells what a file holds,
//! cuts, joins and converts files, and rescues one that was cut off.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::cat::cat;
use crate::convert::convert;
use crate::dump::{Server, ask_all};
use crate::edit::{Cut, merge, trim};
use crate::options::{Coding, Options, Ring, Split};
use crate::select::Select;
use crate::session::{Report, record};
use crate::{info::file_info, recover::recover_file};
use anyhow::Context as _;
use clap::{Parser, Subcommand, ValueEnum};
use launch_cli::values::{bytes, some_span_nanos, span_nanos};
use launch_cli::{BasicArgs, DomainArgs, Exit, Progress, Shutdown, run, wrong_usage};
use schema_recording::write::ChunkCompression;

/// Records every sensor, every result of users' programs, every snapshot and the map into one MCAP
/// file that Foxglove and rerun open.
#[derive(Debug, Parser)]
#[command(
    name = "gantry-record",
    version,
    args_conflicts_with_subcommands = true,
    after_help = "Examples:\n  gantry-record --out drive.mcap\n  gantry-record --out front.mcap --topics 'ego/front/*' --lockstep\n  gantry-record info drive.mcap\n  gantry-record --out drive.mcap --split-size 1GB\n  gantry-record --out crash.mcap --keep 30s --dump-at-end\n  gantry-record dump --note 'hard braking'\n  gantry-record cat drive.mcap --json --topics 'ego/imu/*' --to 5s\n  gantry-record trim drive.mcap short.mcap --from 5s --to 10s\n  gantry-record merge drive_0001.mcap drive_0002.mcap whole.mcap\n  gantry-record recover drive.mcap.part rescued.mcap"
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

    /// Compression of the file's chunks [default: lz4, or none if payloads are coded, which leaves
    /// little to find]
    #[arg(long, value_enum)]
    compression: Option<CompressionArg>,

    /// How payloads of frames are stored
    #[arg(long, value_enum, default_value_t = CodecArg::Lossless)]
    codec: CodecArg,

    /// Small pictures, for Foxglove and rerun, of payloads that are coded
    #[arg(long, value_enum, default_value_t = PreviewsArg::Small)]
    previews: PreviewsArg,

    /// Store colour images as JPEG of quality Q, 1 to 100, and nothing else of them: much smaller,
    /// not lossless
    #[arg(long, value_name = "Q", value_parser = clap::value_parser!(u8).range(1..=100))]
    jpeg: Option<u8>,

    /// Store colour images as video of this format and nothing else of them: smallest, not lossless
    #[arg(long, value_enum, value_name = "FORMAT", conflicts_with = "jpeg")]
    video: Option<VideoArg>,

    /// Quantiser of --video, 1 to 51: the lower, the better and larger
    #[arg(long, value_name = "N", default_value_t = 23, value_parser = clap::value_parser!(u8).range(1..=51), requires = "video")]
    video_qp: u8,

    /// Threads that code payloads [default: half of the processors, at most 4]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64))]
    threads: Option<u16>,

    /// Begin a new file, FILE_0002 and so on, once one has this size, e.g. 500MB or 1GB
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    split_size: Option<u64>,

    /// Begin a new file once one covers this much simulated time, e.g. 60s or 5m
    #[arg(long, value_name = "TIME", value_parser = some_span_nanos)]
    split_duration: Option<u64>,

    /// Keep the newest TIME of simulated time in memory and write it to FILE_0001, FILE_0002 and so
    /// on whenever `gantry-record dump` or SIGUSR1 asks for it
    #[arg(long, value_name = "TIME", value_parser = some_span_nanos, conflicts_with_all = ["split_size", "split_duration"])]
    keep: Option<u64>,

    /// Most memory that --keep may take, MiB; what does not fit is forgotten, oldest first
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(1..=1_048_576), requires = "keep")]
    ring_mb: u32,

    /// With --keep: write what is kept at the end as well
    #[arg(long, requires = "keep")]
    dump_at_end: bool,

    /// Most that waits for the disk, MiB; what does not fit is dropped and counted (in lockstep the
    /// simulator waits instead)
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    queue_mb: u32,

    #[command(subcommand)]
    action: Option<Action>,

    #[command(flatten)]
    on: DomainArgs,

    #[command(flatten)]
    basic: BasicArgs,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Tell what recordings hold, whole or not
    Info {
        /// The recordings
        #[arg(required = true)]
        files: Vec<PathBuf>,
        /// One JSON object a file instead of a table
        #[arg(long)]
        json: bool,
    },
    /// Write what recorders with --keep hold now; the names of the files
    Dump {
        /// Why, for the file's metadata
        #[arg(long, value_name = "TEXT", default_value = "")]
        note: String,
        /// One JSON object a file
        #[arg(long)]
        json: bool,
        #[command(flatten)]
        on: DomainArgs,
    },
    /// Write the messages of a recording as text, one a line
    Cat {
        /// The recording
        file: PathBuf,
        #[command(flatten)]
        cut: CutArgs,
        /// One JSON object a line, with every field; of bytes their number
        #[arg(long)]
        json: bool,
    },
    /// Copy what lies between two times; documents, map and journal stay whole
    Trim {
        /// The recording
        input: PathBuf,
        /// New file to write
        output: PathBuf,
        #[command(flatten)]
        cut: CutArgs,
    },
    /// Join recordings of one run: the files of a set, or those of several recorders
    Merge {
        /// The recordings, then the new file to write
        #[arg(value_name = "IN IN OUT", required = true, num_args = 3..)]
        files: Vec<PathBuf>,
    },
    /// Convert to a file of the rerun viewer, as gantry-view shows it
    Convert {
        /// The recording
        input: PathBuf,
        /// New file to write, ending in .rrd
        output: PathBuf,
    },
    /// Rescue every complete chunk of a recording that was cut off or damaged
    Recover {
        /// The damaged recording, e.g. drive.mcap.part
        input: PathBuf,
        /// New file to write
        output: PathBuf,
    },
}

#[derive(Debug, clap::Args)]
struct CutArgs {
    /// First simulated time, as `info` tells it, e.g. 5s [default: the beginning]
    #[arg(long, value_name = "TIME", value_parser = span_nanos)]
    from: Option<u64>,

    /// First simulated time that is left out [default: none]
    #[arg(long, value_name = "TIME", value_parser = some_span_nanos)]
    to: Option<u64>,

    /// Topics of frames and results, with * and ?; default: all. What is of the world stays
    #[arg(long, value_name = "GLOB", num_args = 1..)]
    topics: Vec<String>,

    /// Topics of those to leave out, with * and ?
    #[arg(long, value_name = "GLOB", num_args = 1..)]
    exclude: Vec<String>,
}

impl CutArgs {
    fn cut(&self) -> Cut {
        Cut {
            from_nanos: self.from.unwrap_or(0),
            to_nanos: self.to.unwrap_or(u64::MAX),
            select: Select {
                topics: self.topics.clone(),
                exclude: self.exclude.clone(),
            },
        }
    }
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

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum CodecArg {
    /// As they are on the bus, in messages that other programs show; largest
    None,
    /// Smaller by filters, PNG and zstd; every byte comes back
    Lossless,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum VideoArg {
    /// H.264 in foxglove.CompressedVideo, a key frame every simulated second
    H264,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum PreviewsArg {
    /// None
    None,
    /// Half the size, every sixteenth point
    Small,
}

/// The program `gantry-record`, from its arguments to its exit code.
pub fn main() -> ExitCode {
    run(|args: Args| {
        args.basic.init_logging();
        match &args.action {
            Some(Action::Info { files, json }) => print_info(files, *json),
            Some(Action::Cat { file, cut, json }) => {
                let mut out = std::io::BufWriter::new(std::io::stdout().lock());
                cat(file, &cut.cut(), *json, &mut out)?;
                ended(out.flush())
            }
            Some(Action::Trim { input, output, cut }) => {
                let _sign = sign_of_life(&args.basic, "trimming", std::slice::from_ref(input));
                told(output, trim(input, output, &cut.cut())?)
            }
            Some(Action::Merge { files }) => match files.split_last() {
                Some((output, inputs)) => {
                    let _sign = sign_of_life(&args.basic, "merging", inputs);
                    told(output, merge(inputs, output)?)
                }
                None => Err(wrong_usage("name the recordings and the new file")),
            },
            Some(Action::Convert { input, output }) => {
                let _sign = sign_of_life(&args.basic, "converting", std::slice::from_ref(input));
                convert(input, output).map(|()| Exit::Done)
            }
            Some(Action::Dump { note, json, on }) => dump(&on.domain, note, *json),
            Some(Action::Recover { input, output }) => {
                let _sign = sign_of_life(&args.basic, "rescuing", std::slice::from_ref(input));
                rescue(input, output)
            }
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
    let server = match args.keep {
        Some(_) => Some(Server::start(&args.on.domain)?),
        None => None,
    };
    let signalled = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(signal_hook::consts::SIGUSR1, signalled.clone())
        .context("cannot wait for SIGUSR1")?;
    let options = Options {
        domain: args.on.domain.clone(),
        bus: Default::default(),
        select: Select {
            topics: args.topics.clone(),
            exclude: args.exclude.clone(),
        },
        out: out.clone(),
        compression: match args.compression {
            None if args.codec == CodecArg::Lossless => ChunkCompression::None,
            Some(CompressionArg::None) => ChunkCompression::None,
            None | Some(CompressionArg::Lz4) => ChunkCompression::Lz4,
            Some(CompressionArg::Zstd) => ChunkCompression::Zstd,
        },
        coding: Coding {
            lossless: args.codec == CodecArg::Lossless,
            previews: args.previews == PreviewsArg::Small,
            jpeg_quality: args.jpeg,
            video_qp: args.video.map(|VideoArg::H264| args.video_qp),
            n_threads: args.threads.unwrap_or(0) as usize,
        },
        split: Split {
            max_bytes: args.split_size,
            max_sim_nanos: args.split_duration,
        },
        ring: args
            .keep
            .zip(server.as_ref())
            .map(|(keep_nanos, server)| Ring {
                keep_nanos,
                max_bytes: (args.ring_mb as usize) << 20,
                dump_at_end: args.dump_at_end,
                requests: server.requests.clone(),
            }),
        queue_bytes: (args.queue_mb as usize) << 20,
        lockstep: args.lockstep.is_some(),
        lockstep_name: args.lockstep.clone().filter(|name| !name.is_empty()),
    };
    tracing::info!(file = %out.display(), domain = options.domain, "recording");
    let report = record(&options, &|| {
        if signalled.swap(false, Ordering::AcqRel) {
            match &server {
                Some(server) => server.ask("SIGUSR1"),
                None => tracing::warn!("SIGUSR1 dumps a ring, and there is none; see --keep"),
            }
        }
        shutdown.requested()
    })?;
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

/// What terminals show while files are copied: their number, size, and the time that has passed.
fn sign_of_life(basic: &BasicArgs, verb: &str, files: &[PathBuf]) -> Progress {
    let sizes = files.iter().filter_map(|file| file.metadata().ok());
    let megabytes = sizes.map(|it| it.len()).sum::<u64>() as f64 / 1e6;
    let what = match files {
        [only] => only.display().to_string(),
        _ => format!("{} recordings", files.len()),
    };
    Progress::endless(basic, &format!("{verb} {what} ({megabytes:.1} MB)"))
}

fn dump(domain: &str, note: &str, json: bool) -> anyhow::Result<Exit> {
    let mut outcome = Exit::Done;
    for answer in ask_all(domain, note)? {
        match answer {
            Ok(done) => {
                let mut stdout = std::io::stdout().lock();
                if json {
                    writeln!(stdout, "{}", serde_json::to_string(&done)?)?;
                    continue;
                }
                writeln!(
                    stdout,
                    "{}: {} messages, {:.2} simulated seconds, {:.1} MB",
                    done.file,
                    done.n_messages,
                    done.secs,
                    done.file_bytes as f64 / 1e6
                )?;
            }
            Err(error) => {
                tracing::error!(%error, "a recorder could not dump");
                outcome = Exit::Failed;
            }
        }
    }
    Ok(outcome)
}

fn print_info(files: &[PathBuf], json: bool) -> anyhow::Result<Exit> {
    let mut outcome = Exit::Done;
    for (number, file) in files.iter().enumerate() {
        let found = file_info(file)?;
        let mut text = String::new();
        if json {
            text = serde_json::to_string(&found)? + "\n";
        } else {
            if files.len() > 1 {
                let gap = if number > 0 { "\n" } else { "" };
                text = format!("{gap}{}\n", file.display());
            }
            text += &found.text();
        }
        std::io::stdout().write_all(text.as_bytes())?;
        if !found.complete {
            outcome = Exit::DataLost;
        }
    }
    Ok(outcome)
}

/// Says what was written.
fn told(output: &std::path::Path, n_messages: u64) -> anyhow::Result<Exit> {
    let mut stdout = std::io::stdout().lock();
    writeln!(stdout, "{}: {n_messages} messages", output.display())?;
    Ok(Exit::Done)
}

/// Nobody reading any more is no failure.
fn ended(outcome: std::io::Result<()>) -> anyhow::Result<Exit> {
    match outcome {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(Exit::Done),
    }
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
