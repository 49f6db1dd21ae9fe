//! The process that callers of `CarlaUE4.sh` see, signal and wait for.

use std::ffi::OsString;
use std::io::{Read as _, Write as _};
use std::net::Shutdown;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::Context as _;
use launch_cli::{ColorWhen, Exit};

use super::arguments::{self, Wishes};
use super::place::{LAUNCH_FILE, PROGRAM, root_of};

/// The hidden word of the launcher behind the front.
const WORD: &str = "carla-server";

/// The path by which this process was called, if it was called as the front of a CARLA folder.
pub fn is_front() -> Option<PathBuf> {
    let called = PathBuf::from(std::env::args_os().next()?);
    (called.file_name() == Some(PROGRAM.as_ref())).then_some(called)
}

/// Starts the launcher, hands signals on to it, and ends as it does.
///
/// # Errors
/// A sentence if an argument cannot be, or the launcher cannot be started.
pub fn run(called: &Path) -> anyhow::Result<Exit> {
    let root = root_of(called)?;
    let args: Vec<String> = std::env::args_os()
        .skip(1)
        .map(|arg: OsString| arg.to_string_lossy().into_owned())
        .collect();
    let wishes = arguments::read(&args)?;
    for warning in &wishes.warnings {
        eprintln!("warning: {warning}");
    }
    let mut signals = signal_hook::iterator::Signals::new([
        signal_hook::consts::SIGINT,
        signal_hook::consts::SIGTERM,
        signal_hook::consts::SIGHUP,
    ])
    .context("cannot listen for signals")?;
    let (own, other) = UnixStream::pair().context("cannot make a socket")?;
    let starter = command(&root, &wishes)?
        .stdin(Stdio::from(OwnedFd::from(other)))
        .status()
        .context("cannot start the launcher")?;
    anyhow::ensure!(
        starter.success(),
        "the launcher could not leave the caller's session: {starter}"
    );
    let mut words = own.try_clone().context("cannot share the socket")?;
    std::thread::spawn(move || {
        // One byte per signal. If the launcher is gone, the front ends by itself.
        for _ in signals.forever() {
            if words.write_all(&[1]).is_err() {
                return;
            }
        }
    });
    let mut code = [0];
    let mut answer = &own;
    let told = answer.read_exact(&mut code);
    // Tells the launcher that its answer has come.
    let _ = own.shutdown(Shutdown::Both);
    Ok(told.map_or(Exit::Failed, |()| Exit::Code(code[0])))
}

/// The launcher with the wishes in its own words. Those of CARLA do not appear on its command line:
/// programs that look for them and kill what they find shall find the front.
fn command(root: &Path, wishes: &Wishes) -> anyhow::Result<Command> {
    let own = std::env::current_exe().context("cannot tell where this program is")?;
    let mut command = Command::new(own);
    command
        .args([WORD, "--domain", &domain(wishes.port), "--detach"])
        .arg("--launch")
        .arg(root.join(LAUNCH_FILE))
        .args(["--port", &wishes.port.to_string()])
        .args(["--stream-port", &wishes.stream_port.to_string()]);
    let options = [
        ("--map", wishes.map.clone()),
        ("--tick-hz", wishes.tick_hz.map(|hz| hz.to_string())),
        ("--quality", wishes.quality.map(str::to_owned)),
        ("--adapter", wishes.adapter.map(|idx| idx.to_string())),
    ];
    for (flag, value) in options {
        if let Some(value) = value {
            command.args([flag, &value]);
        }
    }
    if wishes.unpaced {
        command.arg("--unpaced");
    }
    if wishes.no_rendering {
        command.arg("--no-rendering");
    }
    if ColorWhen::Auto.on_stderr() {
        command.args(["--color", "always"]);
    }
    Ok(command)
}

/// Domain of the server of a port.
fn domain(port: u16) -> String {
    format!("carla_{port}")
}
