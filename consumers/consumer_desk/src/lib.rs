//! `gantry-desk`: a page for the browser that shows the world and rules it: pause, step, speed, weather,
//! time of day, spawn, follow. For those who look rather than script.
//!
//! It is a client like any other: it reads the world's snapshots and documents, and what is asked for
//! on the page goes to the simulator as commands. In reading order: `http` (requests of a browser,
//! and who may make them), `server` (which request is answered how), `facts` (what is known of the
//! world), `commands` (to the simulator), `flight` (the spectator's picture, rendered while somebody
//! looks).

#![forbid(unsafe_code)]

mod commands;
mod facts;
mod flight;
mod http;
mod server;

use std::io::{Read as _, Write as _};
use std::net::TcpListener;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use clap::Parser;
use consumer_rpc::door::{Admits, Door};
use launch_cli::browser::{has_display, open_page};
use launch_cli::{CommonArgs, Exit, Shutdown, run, wrong_usage};

/// Port that is tried first.
const USUAL_PORT: u16 = 8800;
/// Most connections at a time.
pub const MAX_CONNECTIONS: usize = 64;

/// Shows the world on a page for the browser, on this machine, and rules it from there: pause,
/// step, speed, weather, time of day, spawn, follow, fly.
#[derive(Debug, Parser)]
#[command(
    name = "gantry-desk",
    version,
    after_help = "Examples:\n  gantry-desk\n  gantry-desk --port 8801 --domain second\n  ssh -L 8800:127.0.0.1:8800 there gantry desk --no-open"
)]
struct Args {
    /// Port on 127.0.0.1; another one means another address of the page [default: 8800, or any free
    /// one if that is taken]
    #[arg(long, value_name = "PORT", value_parser = clap::value_parser!(u16).range(1..))]
    port: Option<u16>,

    /// Do not open the page in a browser; without a display it is never opened
    #[arg(long)]
    no_open: bool,

    /// Let programs of all users of this machine in who know the page's address
    #[arg(long)]
    any_user: bool,

    #[command(flatten)]
    common: CommonArgs,
}

/// The program `gantry-desk`, from its arguments to its exit code.
pub fn main() -> ExitCode {
    run(|args: Args| {
        args.common.init_logging();
        start(&args)
    })
}

fn start(args: &Args) -> anyhow::Result<Exit> {
    let shutdown = Shutdown::install()?;
    let listener = listen(args.port)?;
    let port = listener.local_addr()?.port();
    let admits = match args.any_user {
        true => Admits::AnyUser,
        false => Admits::SameUser,
    };
    let door = Door::new(listener, "pages", MAX_CONNECTIONS, admits)?;
    let token = secret()?;
    let desk = Arc::new(server::Desk::new(&args.common.domain, &token));
    let threads = desk.start()?;
    let serving = desk.clone();
    std::thread::Builder::new()
        .name("door".into())
        .spawn(move || Arc::new(door).serve(move |guest| server::serve(&serving, guest)))
        .context("cannot start the thread that takes connections")?;
    let page = format!("http://127.0.0.1:{port}/");
    writeln!(std::io::stdout(), "open {page}?token={token}")?;
    if !args.no_open && has_display() {
        // Arguments of programs can be read by everybody on this machine.
        let code = secret()?;
        desk.invite(&code);
        open_page(&format!("{page}?code={code}"));
    }
    while !shutdown.requested() && !threads.iter().any(std::thread::JoinHandle::is_finished) {
        std::thread::sleep(Duration::from_millis(50));
    }
    desk.stop();
    for thread in threads {
        let ended = thread.join();
        ended.map_err(|_| anyhow::anyhow!("a thread of this program failed"))??;
    }
    Ok(Exit::Done)
}

/// The port that was asked for, or the usual one or any that is free.
fn listen(port: Option<u16>) -> anyhow::Result<TcpListener> {
    match port {
        Some(port) => TcpListener::bind(("127.0.0.1", port)).map_err(|error| {
            wrong_usage(format!(
                "port {port} of 127.0.0.1 cannot be had ({error}); name another with --port"
            ))
        }),
        None => TcpListener::bind(("127.0.0.1", USUAL_PORT))
            .or_else(|_| TcpListener::bind(("127.0.0.1", 0)))
            .context("no free port on 127.0.0.1"),
    }
}

/// 128 random bits as text.
fn secret() -> anyhow::Result<String> {
    let mut bytes = [0u8; 16];
    std::fs::File::open("/dev/urandom")
        .and_then(|mut file| file.read_exact(&mut bytes))
        .context("cannot read /dev/urandom")?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}
