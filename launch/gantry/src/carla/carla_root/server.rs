//! The launcher behind the front, in a session of its own: it runs the processes of one server
//! until the front says so, or is gone.

use std::io::Write as _;
use std::net::TcpListener;
use std::os::fd::AsFd as _;
use std::os::unix::net::UnixStream;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use launch_cli::{CommonArgs, Exit, WrongUsage};
use launch_spec::Process;

use crate::bus::Bus;
use crate::cli::{CarlaServerArgs, UpArgs};
use crate::programs;
use crate::up::{self, Signals};

/// Longest wait for a server of the same port that is about to end.
const PREDECESSOR: Duration = Duration::from_secs(15);
/// Time between two looks whether it has.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Longest wait for the list of GPUs.
const LIST_WITHIN: Duration = Duration::from_secs(20);

/// Runs the hidden word `carla-server`.
///
/// # Errors
/// As `gantry up`.
pub fn run(args: &CarlaServerArgs, common: &CommonArgs) -> anyhow::Result<Exit> {
    if args.detach {
        return detach();
    }
    let stdin = std::io::stdin();
    let socket = stdin.as_fd().try_clone_to_owned();
    let mut front = UnixStream::from(socket.context("there is no socket to the front")?);
    let signals = Signals::install()?;
    signals.heed(front.try_clone().context("cannot share the socket")?);
    let outcome = serve(args, common, signals);
    let code = match &outcome {
        Ok(exit) => exit.code(),
        Err(error) if error.chain().any(|cause| cause.is::<WrongUsage>()) => {
            Exit::WrongUsage.code()
        }
        Err(_) => Exit::Failed.code(),
    };
    if let Err(error) = &outcome {
        eprintln!("error: {error:#}");
    }
    // The front may be gone, and need not know then.
    let _ = front.write_all(&[code]);
    Ok(Exit::Code(code))
}

/// Starts this program once more in a session of its own, where no signal to the caller's process
/// group reaches it, and ends; so it is nobody's child whom callers could find and kill with theirs.
fn detach() -> anyhow::Result<Exit> {
    nix::unistd::setsid().context("cannot leave the session")?;
    let own = std::env::current_exe().context("cannot tell where this program is")?;
    let args = std::env::args_os().skip(1).filter(|arg| arg != "--detach");
    Command::new(own)
        .args(args)
        .stdin(Stdio::inherit())
        .spawn()
        .context("cannot start the launcher")?;
    Ok(Exit::Done)
}

fn serve(args: &CarlaServerArgs, common: &CommonArgs, signals: Signals) -> anyhow::Result<Exit> {
    // As quiet as CARLA: warnings, and one line about where it listens.
    let mut common = common.clone();
    common.basic.quiet = common.quiet.max(1);
    let up = UpArgs {
        files: vec![args.launch.clone()],
        set: overrides(args),
        ..UpArgs::default()
    };
    let mut launch = up::read(&up)?;
    for process in &mut launch.processes {
        complete(process, args);
    }
    let data = launch
        .processes
        .iter()
        .find_map(|process| data_of(&process.cmd));
    if !wait_for_predecessor(args, &common, &signals)? {
        return Ok(Exit::Done);
    }
    println!(
        "gantry: server for CARLA clients on port {}, domain {}",
        args.port, common.domain
    );
    up::start(&launch, data.as_deref(), None, &common, || Ok(signals))
}

/// What the launch file is told by arguments.
fn overrides(args: &CarlaServerArgs) -> Vec<String> {
    let map = args.map.as_ref().map(|map| format!("scenario.map={map:?}"));
    let hz = args.tick_hz.map(|hz| format!("scenario.tick_hz={hz}"));
    map.into_iter().chain(hz).collect()
}

/// What daemon and gateway are told by arguments, in place of what the launch file says.
fn complete(process: &mut Process, args: &CarlaServerArgs) {
    let flags: Vec<(&str, Option<String>)> = if process.is_simulator() {
        vec![
            ("--quality", args.quality.clone()),
            ("--adapter", args.adapter.map(chosen_adapter)),
            ("--unpaced", args.unpaced.then(String::new)),
        ]
    } else if is_gateway(process) {
        vec![
            ("--port", Some(args.port.to_string())),
            ("--stream-port", Some(args.stream_port.to_string())),
            ("--no-rendering", args.no_rendering.then(String::new)),
        ]
    } else {
        vec![]
    };
    for (flag, value) in flags {
        if let Some(value) = value {
            set_flag(&mut process.cmd, flag, value);
        }
    }
}

fn is_gateway(process: &Process) -> bool {
    process
        .cmd
        .first()
        .is_some_and(|program| program.rsplit('/').next() == Some("gantry-carla"))
}

/// Gives a flag this value; an empty one is that of a switch.
fn set_flag(cmd: &mut Vec<String>, flag: &str, value: String) {
    cmd.retain(|word| {
        let is_switch = word == flag && value.is_empty();
        !(is_switch || word.starts_with(&format!("{flag}=")))
    });
    if let Some(at) = cmd.iter().position(|word| word == flag) {
        cmd.drain(at..(at + 2).min(cmd.len()));
    }
    cmd.push(if value.is_empty() {
        flag.to_owned()
    } else {
        format!("{flag}={value}")
    });
}

/// The data folder that a command names, which is the run's too.
fn data_of(cmd: &[String]) -> Option<std::path::PathBuf> {
    let at = cmd.iter().position(|word| word == "--data");
    let spelt = cmd.iter().find_map(|word| word.strip_prefix("--data="));
    at.and_then(|at| cmd.get(at + 1).map(String::as_str))
        .or(spelt)
        .map(Into::into)
}

/// The index as the daemon understands it. As in CARLA's engine, an index beyond the last GPU is the
/// first.
fn chosen_adapter(index: usize) -> String {
    let listed = programs::find("simd")
        .and_then(|simd| programs::output_of(&simd, &["--adapters", "--json"], LIST_WITHIN));
    let n_adapters = listed.map_or(0, |text| text.lines().count());
    if index < n_adapters || n_adapters == 0 {
        return index.to_string();
    }
    eprintln!(
        "warning: -graphicsadapter={index}, but this machine has {n_adapters} adapter(s) that can render (`simd --adapters` lists them); using the first"
    );
    "0".to_owned()
}

/// Waits until the server that had this port before has ended, if there is one: programs start the
/// next server at once after they killed one. Whatever else holds the port is for the gateway to
/// complain about. Returns `false` if this server is to end before it has begun.
fn wait_for_predecessor(
    args: &CarlaServerArgs,
    common: &CommonArgs,
    signals: &Signals,
) -> anyhow::Result<bool> {
    let bus = Bus::open(&common.domain)?;
    let is_free = |port: u16| port == 0 || TcpListener::bind(("127.0.0.1", port)).is_ok();
    let start = Instant::now();
    while start.elapsed() < PREDECESSOR
        && (bus.daemon_alive()? || !is_free(args.port) || !is_free(args.stream_port))
    {
        if signals.asked_within(LOOK_EVERY) {
            return Ok(false);
        }
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(words: &str, flag: &str, value: &str) -> String {
        let mut cmd: Vec<String> = words.split(' ').map(str::to_owned).collect();
        set_flag(&mut cmd, flag, value.to_owned());
        cmd.join(" ")
    }

    #[test]
    fn arguments_win_over_the_launch_file() {
        assert_eq!(after("simd", "--adapter", "1"), "simd --adapter=1");
        assert_eq!(
            after("simd --adapter H200 --staged", "--adapter", "1"),
            "simd --staged --adapter=1"
        );
        assert_eq!(
            after("simd --adapter=H200", "--adapter", "1"),
            "simd --adapter=1"
        );
        assert_eq!(
            after("simd --unpaced --staged", "--unpaced", ""),
            "simd --staged --unpaced"
        );
    }

    #[test]
    fn the_data_folder_of_the_processes_is_that_of_the_run() {
        let cmd = |words: &str| words.split(' ').map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(data_of(&cmd("simd --data /d")), Some("/d".into()));
        assert_eq!(data_of(&cmd("simd --data=/d")), Some("/d".into()));
        assert_eq!(data_of(&cmd("simd --staged")), None);
    }
}
