//! `gantry-carla`: lets CARLA 0.9.16 clients connect to the simulator on the bus.

use std::net::{IpAddr, Ipv4Addr, TcpListener};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::feeds::Feeds;
use crate::gateway::Gateway;
use crate::state::{commander, known_world::World};
use crate::stream_server::MAX_STREAM_CONNECTIONS;
use crate::{follower, rpc_server, stream_server};
use anyhow::Context as _;
use clap::Parser;
use consumer_rpc::door::{Admits, Door, within_file_limit};
use consumer_rpc::server::MAX_RPC_CONNECTIONS;
use launch_cli::{CommonArgs, Exit, Shutdown, run};

/// Lets unmodified CARLA 0.9.16 clients look at the world on the bus and drive in it.
#[derive(Debug, Parser)]
#[command(
    name = "gantry-carla",
    version,
    after_help = "Examples:\n  gantry-carla\n  gantry-carla --port 0\n  gantry-carla --any-user\n  gantry-carla --bind 0.0.0.0"
)]
struct Args {
    /// Port of the RPC server; streams are at the next one. 0 chooses two free ports and prints
    /// them
    #[arg(long, value_name = "PORT", default_value_t = 2000, value_parser = clap::value_parser!(u16).range(..=65534))]
    port: u16,

    /// Port of the streams, 0 for any free one [default: the one after --port]
    #[arg(long, value_name = "PORT")]
    stream_port: Option<u16>,

    /// Begin in CARLA's no-rendering mode, in which cameras send nothing, until a client leaves it
    #[arg(long)]
    no_rendering: bool,

    /// Address to listen on; 0.0.0.0 lets clients of other machines in, and there is no password
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    bind: IpAddr,

    /// Let programs of all users of this machine in, not only your own and root's
    #[arg(long)]
    any_user: bool,

    /// Folder for recordings of `start_recorder` [default: gantry in the XDG data folder]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,

    #[command(flatten)]
    common: CommonArgs,
}

/// The program `gantry-carla`, from its arguments to its exit code.
pub fn main() -> ExitCode {
    run(|args: Args| {
        args.common.init_logging();
        let shutdown = Shutdown::install()?;
        serve(&args, &shutdown)?;
        Ok(Exit::Done)
    })
}

fn listen(bind: IpAddr, port: u16) -> anyhow::Result<(TcpListener, u16)> {
    let listener = TcpListener::bind((bind, port)).with_context(|| {
        format!("cannot listen on {bind}, port {port}; choose another with --port")
    })?;
    let port = listener
        .local_addr()
        .context("cannot tell the port")?
        .port();
    Ok((listener, port))
}

fn serve(args: &Args, shutdown: &Shutdown) -> anyhow::Result<()> {
    let admits = if args.any_user {
        Admits::AnyUser
    } else {
        Admits::SameUser
    };
    let (calls, port) = listen(args.bind, args.port)?;
    let behind = if args.port == 0 { 0 } else { port + 1 };
    let (listener, stream_port) = listen(args.bind, args.stream_port.unwrap_or(behind))?;
    let most = within_file_limit(MAX_RPC_CONNECTIONS);
    let calls = Door::new(calls, "RPC connections", most, admits)?;
    let most = within_file_limit(MAX_STREAM_CONNECTIONS);
    let streams = Door::new(listener, "streaming connections", most, admits)?;
    let (world, stop) = (Arc::new(World::default()), Arc::new(AtomicBool::new(false)));
    let (commander, work) = commander::commander();
    let feeds = Arc::new(Feeds::new(world.clone()));
    feeds.join(schema_bus::Bus::open(
        &args.common.domain,
        "gantry-carla-sensors",
    )?);
    let gateway = Arc::new(Gateway::new(
        world.clone(),
        commander,
        feeds.clone(),
        stream_port,
    ));
    if args.no_rendering {
        gateway.begin_without_rendering();
    }
    if let Some(data) = &args.data {
        gateway.recorder.keep_in(data.clone());
    }
    let domain = args.common.domain.clone();
    let (here, flag) = (gateway.clone(), stop.clone());
    let follower = std::thread::Builder::new()
        .name("world".into())
        .spawn(move || follower::follow(&domain, &here, &flag))?;
    let domain = args.common.domain.clone();
    let flag = stop.clone();
    let at_the_end = gateway.clone();
    let talker = std::thread::Builder::new()
        .name("commands".into())
        .spawn(move || commander::run(&domain, &world, &work, &flag))?;
    // These two threads wait for clients until the process ends, so nobody joins them.
    std::thread::Builder::new().name("streams".into()).spawn({
        let feeds = feeds.clone();
        move || stream_server::serve(streams, &feeds)
    })?;
    std::thread::Builder::new()
        .name("calls".into())
        .spawn(move || rpc_server::serve(calls, &gateway))?;
    println!(
        "listening on {0}:{port}, streams on {0}:{stream_port}",
        args.bind
    );
    while !shutdown.wait(Duration::from_millis(100))
        && !follower.is_finished()
        && !talker.is_finished()
    {
        feeds.sweep();
    }
    stop.store(true, Ordering::Release);
    let ended = |thread: std::thread::JoinHandle<anyhow::Result<()>>| {
        thread
            .join()
            .unwrap_or_else(|_| anyhow::bail!("a thread panicked"))
    };
    let all_ended = ended(follower).and(ended(talker));
    at_the_end.recorder.stop();
    all_ended
}
