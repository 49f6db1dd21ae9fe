//! The gateway and CARLA's own client in a sandbox. The client is that of the repository's Python
//! environment.

use std::net::TcpListener;
use std::sync::atomic::{AtomicU16, Ordering};
use std::time::Duration;

use test_kit::client::assert_nothing_left;
use test_kit::programs::{spawn_consumer, start_daemon};
use test_kit::sandbox::repository;
use test_kit::{Ended, Process, Sandbox};

use crate::processes::{python_package, venv_program};

/// Longest run of a script. Scripts that hang end themselves and say where (`carla_kit.py`); this
/// limit is far beyond theirs on any machine.
pub const SCRIPT_LIMIT: Duration = Duration::from_secs(3600);

/// Launch text of a town without sensors, so that nothing is rendered, and without any cars.
pub fn empty_town(map: &str) -> String {
    format!("version = 1\n[scenario]\nmap = {map:?}\nseed = 7\ntick_hz = 20\nvehicles = 0\n")
}

/// Ports for Traffic Managers: the first, how many follow one another, and how many such places
/// there are.
const FIRST_PORT: u16 = 20_000;
const PORTS_APART: u16 = 4;
const N_PLACES: u16 = 3000;

/// A daemon and a gateway in a sandbox of their own, for scripts with the stock client.
#[derive(Debug)]
pub struct Stage {
    // Fields drop in this order, so that the processes end before their directory is removed.
    gateway: Process,
    daemon: Process,
    /// Port of the gateway's RPC server.
    pub port: u16,
    /// Where they run.
    pub sandbox: Sandbox,
}

impl Stage {
    /// Starts both with a launch file's text.
    pub fn new(name: &str, launch: &str) -> Stage {
        Stage::with(Sandbox::new(name), launch, &[])
    }

    /// As [`Stage::new`], in an existing sandbox and with more arguments for the daemon.
    pub fn with(sandbox: Sandbox, launch: &str, extra: &[&str]) -> Stage {
        let daemon = start_daemon(&sandbox, launch, extra);
        let (gateway, port, _) = start_gateway(&sandbox);
        Stage {
            gateway,
            daemon,
            port,
            sandbox,
        }
    }

    /// Runs a script with the port and more arguments, as [`run_script`] does.
    pub fn run(&self, script: &str, more: &[&str], themes: &[&str]) -> Ended {
        let port = self.port.to_string();
        run_script(
            &self.sandbox,
            script,
            &[&[port.as_str()], more].concat(),
            themes,
        )
    }

    /// The gateway.
    pub fn gateway(&self) -> &Process {
        &self.gateway
    }

    /// Stops both, asserts that they end well, and returns the sandbox with what they left in it.
    pub fn stop(self) -> Sandbox {
        self.gateway.stop().expect_code(0);
        self.daemon.stop().expect_code(0);
        self.sandbox
    }

    /// Stops both, asserts that they end well and leave nothing, and returns what the gateway said.
    pub fn end(self) -> Ended {
        let said = self.gateway.stop().expect_code(0);
        self.daemon.stop().expect_code(0);
        assert_nothing_left(&self.sandbox);
        said
    }
}

/// A port that is free now, and so are the [`PORTS_APART`] − 1 above it: for a client's own Traffic
/// Managers. They lie below those that systems give to outgoing connections, one of which would
/// otherwise take the port before its program binds it.
///
/// # Panics
/// If the machine has none.
pub fn free_port() -> u16 {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    let begin = std::process::id() as u16 % N_PLACES;
    let is_free = |port: &u16| {
        (*port..port + PORTS_APART).all(|port| TcpListener::bind(("0.0.0.0", port)).is_ok())
    };
    (0..N_PLACES)
        .map(|_| begin.wrapping_add(NEXT.fetch_add(1, Ordering::Relaxed)) % N_PLACES)
        .map(|place| FIRST_PORT + PORTS_APART * place)
        .find(is_free)
        .expect("a free port")
}

/// Starts the gateway on free ports, and also returns the RPC port and the streaming port. Its data
/// folder is the sandbox's `data`.
pub fn start_gateway(sandbox: &Sandbox) -> (Process, u16, u16) {
    let data = sandbox.path("data");
    let mut gateway = spawn_consumer(
        sandbox,
        "gantry-carla",
        &[
            "--port",
            "0",
            "--data",
            data.to_str().expect("paths are UTF-8"),
        ],
    );
    let line = gateway.wait_line("listening on");
    let ports: Vec<u16> = line
        .split(':')
        .skip(1)
        .map(|part| {
            part.split(',')
                .next()
                .unwrap_or_default()
                .trim()
                .parse()
                .expect("a port stands behind each colon")
        })
        .collect();
    (gateway, ports[0], ports[1])
}

/// Starts a script of `tests/test_e2e/python`, which uses the stock client.
pub fn start_script(sandbox: &Sandbox, script: &str, args: &[&str]) -> Process {
    let script = repository().join("tests/test_e2e/python").join(script);
    let args: Vec<&str> = std::iter::once(script.to_str().expect("paths are UTF-8"))
        .chain(args.iter().copied())
        .collect();
    // The client keeps a cache in the home folder, so the script gets one of its own.
    let home = sandbox.path("");
    let package = python_package();
    let text = |path: &std::path::Path| path.to_str().expect("paths are UTF-8").to_owned();
    let (home, package) = (text(&home), text(&package));
    let env = [
        ("HOME", home.as_str()),
        ("PYTHONPATH", package.as_str()),
        ("PYTHONDONTWRITEBYTECODE", "1"),
        ("PYTHONUNBUFFERED", "1"),
    ];
    sandbox.spawn_program("python", &venv_program("python"), &args, &env)
}

/// Runs such a script to its end, and asserts that it printed `NAME passed` for each theme.
///
/// # Panics
/// With its output if it fails or a theme is missing.
pub fn run_script(sandbox: &Sandbox, script: &str, args: &[&str], themes: &[&str]) -> Ended {
    let ended = start_script(sandbox, script, args)
        .wait_longer(SCRIPT_LIMIT)
        .expect_code(0);
    for theme in themes {
        assert!(
            ended.says(&format!("{theme} passed")),
            "{theme} is missing:\n{}",
            ended.lines.join("\n")
        );
    }
    ended
}
