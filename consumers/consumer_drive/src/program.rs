//! `gantry-drive`: drives vehicles along the lanes of the map on the bus.

use std::net::{IpAddr, Ipv4Addr};
use std::process::ExitCode;

use crate::selection::Selection;
use crate::served::{self, Served};
use crate::session;
use crate::share::Share;
use clap::Parser;
use consumer_driver::crowd::CrowdOptions;
use consumer_driver::parameters::Parameters;
use consumer_rpc::door::Admits;
use launch_cli::values::number;
use launch_cli::{CommonArgs, Exit, Shutdown, run};

/// Drives vehicles along lanes: keeps distance, stops at red lights, turns at junctions, gets out
/// of jams.
#[derive(Debug, Parser)]
#[command(
    name = "gantry-drive",
    version,
    after_help = "Examples:\n  gantry-drive\n  gantry-drive --vehicles ego --speed-factor 0.8\n  gantry-drive --vehicles others --lockstep --seed 7\n  gantry-drive --vehicles 24,31\n  gantry-drive --share 1/2\n  gantry-drive --serve 8000\n  gantry-drive --walkers 200 --walkers-crossing 10"
)]
struct Args {
    /// Whom to drive: "ego" (role ego_vehicle or hero), "others" (role autopilot), "all" (both), or
    /// actor ids; several with commas [default: all, and none besides those that clients register
    /// with --serve]
    #[arg(long, value_name = "WHO")]
    vehicles: Option<Selection>,

    /// Drive one share of these vehicles, beside processes that drive the others: 2/3 is the second
    /// of three. Each vehicle keeps its driver; if a process falls silent, the others drive its
    /// vehicles until it is back
    #[arg(long, value_name = "I/N", conflicts_with = "serve")]
    share: Option<Share>,

    /// Be the Traffic Manager of CARLA's clients, at the ports at which they look for it: the
    /// gateway of this domain sends them here
    #[arg(long, value_name = "PORTS", value_delimiter = ',', value_parser = clap::value_parser!(u16).range(1..))]
    serve: Vec<u16>,

    /// Address to listen on with --serve; 0.0.0.0 lets clients of other machines in, and there is no
    /// password
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST), requires = "serve")]
    bind: IpAddr,

    /// Let programs of all users of this machine in with --serve, not only your own and root's
    #[arg(long, requires = "serve")]
    any_user: bool,

    /// Let the simulator wait for these controls before each tick, so that the run is repeatable;
    /// NAME is the name to take part under [default: drive- and whom]
    #[arg(long, value_name = "NAME", num_args = 0..=1, require_equals = true, default_missing_value = "")]
    lockstep: Option<String>,

    /// Decides the turns taken at junctions; default: the seed of the simulator
    #[arg(long, value_name = "N")]
    seed: Option<u64>,

    /// Populate the pavements with this many people, who walk from place to place and cross when the
    /// traffic has red or leaves a gap; they go with this process. Fewer come where there is no room
    #[arg(long, value_name = "N", default_value_t = 0)]
    walkers: u16,

    /// Share of these people who cross roads anywhere and not on crosswalks alone, percent
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0, value_parser = number("share in percent", 0.0..=100.0), requires = "walkers")]
    walkers_crossing: f64,

    /// Speed driven, as a share of the speed limit
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = number("share of the speed limit", 0.05..=3.0))]
    speed_factor: f64,

    #[command(flatten)]
    common: CommonArgs,
}

/// The program `gantry-drive`, from its arguments to its exit code.
pub fn main() -> ExitCode {
    run(|args: Args| {
        args.common.init_logging();
        let shutdown = Shutdown::install()?;
        let is_served = !args.serve.is_empty();
        let base = if is_served {
            served::parameters()
        } else {
            Parameters::default()
        };
        let options = session::Options {
            domain: args.common.domain,
            vehicles: match args.vehicles {
                None if is_served => Selection::default(),
                given => given.unwrap_or_else(Selection::all),
            },
            share: args.share,
            lockstep: args.lockstep.is_some(),
            lockstep_name: args.lockstep.filter(|name| !name.is_empty()),
            seed: args.seed,
            crowd: CrowdOptions {
                walkers: usize::from(args.walkers),
                crossing_percent: args.walkers_crossing,
            },
            parameters: Parameters {
                speed_difference_percent: 100.0 * (1.0 - args.speed_factor),
                ..base
            },
        };
        let admits = if args.any_user {
            Admits::AnyUser
        } else {
            Admits::SameUser
        };
        let served = match is_served {
            true => Some(Served::start(
                &options.domain,
                args.bind,
                admits,
                args.serve,
            )?),
            false => None,
        };
        if let Some(served) = &served {
            let place = served.place();
            println!("listening on {}:{}", place.host, place.port);
        }
        session::drive(&options, served, &|| shutdown.requested())?;
        Ok(Exit::Done)
    })
}
