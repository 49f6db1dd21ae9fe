//! `gantry-replay`: publishes a recording into a domain, so that every consumer works on it.

use std::io::IsTerminal as _;
use std::path::PathBuf;
use std::process::ExitCode;

use crate::options::{Options, Rate, Results, idle_nanos, rate, renaming};
use crate::{Report, replay};
use clap::Parser;
use launch_cli::values::span_nanos;
use launch_cli::{CommonArgs, Exit, Shutdown, run, wrong_usage};
use schema_frames::Seal;

/// Publishes a recording into a domain, so that every consumer works on it as on the simulator: the
/// same frames with their ticks and times, the world, and results of users' programs. It can stand
/// still, step, jump and be waited for; what would change the world is refused.
#[derive(Debug, Parser)]
#[command(name = "gantry-replay", version, after_help = EXAMPLES)]
struct Args {
    /// The recording; files of other programs play as far as their messages map
    #[arg(value_name = "FILE")]
    file: PathBuf,

    /// Speed: a factor of real time from 0.01 to 100, or max, as fast as the disk and the lockstep
    /// participants allow
    #[arg(long, value_name = "SPEED", default_value = "1", value_parser = rate)]
    rate: Rate,

    /// Begin again at the end, in a new epoch: readers see a restart
    #[arg(long = "loop")]
    again: bool,

    /// First simulated time, e.g. 10s [default: the beginning]
    #[arg(long, value_name = "TIME", value_parser = span_nanos)]
    from: Option<u64>,

    /// Simulated time at which to end, e.g. 20s [default: the end]
    #[arg(long, value_name = "TIME", value_parser = span_nanos)]
    to: Option<u64>,

    /// Topics of frames to publish, with * and ?; default: all. Snapshots and documents of the world
    /// are always published
    #[arg(long, value_name = "GLOB", num_args = 1..)]
    topics: Vec<String>,

    /// Publish a topic, or all below a name, under another name
    #[arg(long, value_name = "OLD=NEW", num_args = 1.., value_parser = renaming)]
    map_topics: Vec<(String, String)>,

    /// Results of users' programs to publish: all (of the topics that are published), none, so that
    /// a new program can take their place, or patterns with * and ?
    #[arg(long, value_name = "WHICH", num_args = 1.., default_value = "all")]
    results: Vec<String>,

    /// Wait for a lockstep participant before the first tick, and for all of them at each tick: as
    /// --await-lockstep 1
    #[arg(long)]
    lockstep: bool,

    /// Wait for this many lockstep participants before the first tick
    #[arg(long, value_name = "N", default_value_t = 0)]
    await_lockstep: u32,

    /// Wait for the lockstep participant of this name before the first tick; may be repeated
    #[arg(long, value_name = "NAME")]
    await_participant: Vec<String>,

    /// Remove a lockstep participant that has been idle for this many seconds although it lives
    /// [default: wait for ever]
    #[arg(long, value_name = "SECONDS", value_parser = idle_nanos)]
    lockstep_timeout: Option<u64>,

    /// Begin paused, in stepped mode
    #[arg(long)]
    paused: bool,

    /// Stay at the end, for jumps back, instead of ending
    #[arg(long, conflicts_with = "again")]
    hold: bool,

    /// Show what sensors measure and nothing else of the world, and obey one process: a seal as
    /// JSON, see the chapter on sealed worlds in the frame contract
    #[arg(long, value_name = "JSON", value_parser = Seal::from_json, hide = true)]
    sealed: Option<Seal>,

    #[command(flatten)]
    common: CommonArgs,
}

const EXAMPLES: &str = "On a terminal: space pauses, n steps, left and right go 1 s, down and up 10 s, + and - change the
speed, q ends.

Examples:
  gantry-replay drive.mcap
  gantry-replay drive.mcap --rate 2 --from 10s --to 20s --loop
  gantry-replay drive.mcap --results none --lockstep --rate max
  gantry-replay drive.mcap --topics 'ego/*' --map-topics ego=recorded --domain second";

/// The program `gantry-replay`, from its arguments to its exit code.
pub fn main() -> ExitCode {
    run(|args: Args| {
        args.common.init_logging();
        let options = options(&args)?;
        let shutdown = Shutdown::install()?;
        launch_cli::raise_file_limit()?;
        let report = replay(&options, &shutdown)?;
        Ok(tell(&report))
    })
}

fn options(args: &Args) -> anyhow::Result<Options> {
    if let (Some(from), Some(to)) = (args.from, args.to)
        && from >= to
    {
        return Err(wrong_usage(format!(
            "--from {} s is not before --to {} s",
            from as f64 * 1e-9,
            to as f64 * 1e-9
        )));
    }
    let results = match args.results.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["all"] => Results::All,
        ["none"] => Results::None,
        _ => Results::Matching(args.results.clone()),
    };
    let at_least = u32::from(args.lockstep);
    Ok(Options {
        rate: args.rate,
        again: args.again,
        from_nanos: args.from,
        to_nanos: args.to,
        topics: args.topics.clone(),
        renamed: args.map_topics.clone(),
        results,
        n_awaited: args.await_lockstep.max(at_least) as usize,
        awaited: args.await_participant.clone(),
        lockstep_timeout_nanos: args.lockstep_timeout,
        paused: args.paused,
        hold: args.hold,
        keys: std::io::stdin().is_terminal() && std::io::stderr().is_terminal(),
        seal: args.sealed.clone(),
        ..Options::new(&args.common.domain, args.file.clone())
    })
}

fn tell(report: &Report) -> Exit {
    tracing::info!(
        ticks = report.n_ticks,
        frames = report.n_frames,
        results = report.n_results,
        late_ticks = report.n_late,
        "replayed {:.1} MB of payloads",
        report.payload_bytes as f64 / 1e6
    );
    let (sentences, n) = &report.damage;
    for sentence in sentences {
        tracing::warn!("left out: {sentence}");
    }
    if *n == 0 && report.n_dropped == 0 {
        return Exit::Done;
    }
    tracing::warn!(
        unreadable = n,
        dropped = report.n_dropped,
        "not everything was replayed"
    );
    Exit::DataLost
}
