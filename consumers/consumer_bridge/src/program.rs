//! `gantry-bridge`: topics of one machine appear on another.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;

use crate::bridge::bridge;
use crate::coding::{Rules, Wanted};
use crate::keys::valid_network;
use crate::options::{Direction, Options, PORT, Ros2Options, endpoint};
use crate::people::gate::allowed;
use clap::{Parser, ValueEnum};
use launch_cli::{CommonArgs, Exit, Shutdown, run};

/// Carries topics between machines over zenoh: frames, results, the world, commands and controls
/// appear on the other machine under the same names and with the same bytes, so that every program
/// works there as beside the simulator. What nobody reads there is neither sent nor rendered.
#[derive(Debug, Parser)]
#[command(name = "gantry-bridge", version, after_help = EXAMPLES)]
struct Args {
    /// Connect to the bridge or router there, and again whenever the link was lost: tcp/HOST:7447,
    /// tls/HOST:7447 or HOST
    #[arg(long, value_name = "ENDPOINT", num_args = 1.., value_parser = endpoint)]
    connect: Vec<String>,

    /// Listen there; 0.0.0.0 lets other machines in [default without --connect: tcp/127.0.0.1:7447]
    #[arg(long, value_name = "ENDPOINT", num_args = 1.., value_parser = endpoint)]
    listen: Vec<String>,

    /// A configuration file of zenoh (JSON5), for TLS, access lists and the like; --listen and
    /// --connect are set over it
    #[arg(long, value_name = "FILE")]
    zenoh_config: Option<PathBuf>,

    /// First part of all keys; bridges of one network meet
    #[arg(long, value_name = "NAME", default_value = "gantry", value_parser = network)]
    network: String,

    /// Topics of frames and results that cross, with * and ? [default: all]; the world always does
    #[arg(long, value_name = "GLOB", num_args = 1..)]
    topics: Vec<String>,

    /// Which way topics cross: out of this machine, in from others
    #[arg(long, value_name = "WAY", value_enum, default_value_t)]
    direction: Way,

    /// Pass on no commands and no controls of vehicles: other machines only look
    #[arg(long)]
    no_control: bool,

    /// Let programs of other machines join the lockstep; both bridges need it
    #[arg(long, conflicts_with = "no_control")]
    lockstep: bool,

    /// Compress topics that this bridge sends: GLOB=none, lz4, zstd, lossless (as recordings),
    /// jpeg or jpeg:QUALITY (colour images, for people to look at); the first that fits holds
    #[arg(long, value_name = "GLOB=HOW", num_args = 1.., value_parser = rule)]
    compress: Vec<(String, Wanted)>,

    /// Be a node of ROS 2 over zenoh (rmw_zenoh_cpp, Jazzy and later): sensors, /tf, odometry and
    /// detections as /carla/RIG/…; without --connect the bridge is the router of the nodes here
    #[arg(long)]
    ros2: bool,

    /// ROS_DOMAIN_ID of the nodes
    #[arg(long, value_name = "ID", default_value_t = 0, requires = "ros2", value_parser = clap::value_parser!(u32).range(0..=232))]
    ros2_domain_id: u32,

    /// Publish no /clock
    #[arg(long, requires = "ros2")]
    no_ros2_clock: bool,

    /// Serve Foxglove on this address [without one: 127.0.0.1:8765]
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1, default_missing_value = "127.0.0.1:8765")]
    foxglove: Option<SocketAddr>,

    /// Let pages of this site (https://HOST) connect to the Foxglove server, or be called HOST; pages
    /// of https://app.foxglove.dev and programs that are no browsers always may
    #[arg(long, value_name = "SITE", num_args = 1.., requires = "foxglove", value_parser = allowed)]
    foxglove_allow: Vec<String>,

    /// Log what crossed every so many seconds; it is always logged at the end
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..=86_400))]
    report: Option<u64>,

    #[command(flatten)]
    common: CommonArgs,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum Way {
    /// Both ways
    #[default]
    Both,
    /// From this machine to others
    Out,
    /// From others to this machine
    In,
}

const EXAMPLES: &str = "Other machines see everything that they are let in to see; give them a network of their own, or TLS
and access lists by --zenoh-config.

Examples:
  gantry-bridge --listen 0.0.0.0                      # beside the simulator
  gantry-bridge --connect tcp/192.168.1.7:7447        # on the other machine; then gantry-view, gantry-record, …
  gantry-bridge --connect 192.168.1.7 --topics 'ego/*' --compress '*/rgb=jpeg:80' '*=lz4'
  gantry-bridge --ros2                                # then, with rmw_zenoh_cpp: ros2 topic list
  gantry-bridge --foxglove                            # open ws://127.0.0.1:8765 in Foxglove";

/// The program `gantry-bridge`, from its arguments to its exit code.
pub fn main() -> ExitCode {
    run(|args: Args| {
        args.common.init_logging();
        let options = options(args);
        let shutdown = Shutdown::install()?;
        launch_cli::raise_file_limit()?;
        for line in bridge(&options, &shutdown)? {
            tracing::info!("{line}");
        }
        Ok(Exit::Done)
    })
}

fn options(args: Args) -> Options {
    let mut listen = args.listen;
    if listen.is_empty() && args.connect.is_empty() && args.zenoh_config.is_none() {
        listen.push(format!("tcp/127.0.0.1:{PORT}"));
    }
    Options {
        network: args.network,
        listen,
        connect: args.connect,
        zenoh_config: args.zenoh_config,
        topics: args.topics,
        direction: match args.direction {
            Way::Both => Direction::Both,
            Way::Out => Direction::Out,
            Way::In => Direction::In,
        },
        control: !args.no_control,
        lockstep: args.lockstep,
        compress: Rules::new(args.compress),
        ros2: args.ros2.then_some(Ros2Options {
            domain_id: args.ros2_domain_id,
            clock: !args.no_ros2_clock,
        }),
        foxglove: args.foxglove,
        foxglove_allow: args.foxglove_allow,
        report_secs: args.report,
        ..Options::new(&args.common.domain)
    }
}

fn network(text: &str) -> Result<String, String> {
    match valid_network(text) {
        true => Ok(text.to_owned()),
        false => Err(format!(
            "{text:?} names no network; letters, digits, _, -, . and / between them are allowed, 64 at most"
        )),
    }
}

fn rule(text: &str) -> Result<(String, Wanted), String> {
    let (pattern, how) = text.rsplit_once('=').ok_or_else(|| {
        format!("{text:?} says not how; write GLOB=HOW, for example '*/rgb=jpeg:80'")
    })?;
    Ok((pattern.to_owned(), how.parse()?))
}
