//! The gateway and CARLA's own client, from the repository's environment, in a sandbox.

use test_kit::sandbox::repository;
use test_kit::{Ended, Process, Sandbox};

use crate::{spawn_consumer, venv_program};

/// Starts the gateway on ports of its own choice; returns them too, RPC first. Its data folder is the sandbox's `data`.
pub fn start_gateway(sandbox: &Sandbox) -> (Process, u16, u16) {
    let data = sandbox.path("data");
    let mut gateway = spawn_consumer(sandbox, "gantry-carla", &["--port", "0", "--data", data.to_str().expect("paths are UTF-8")]);
    let line = gateway.wait_line("listening on");
    let ports: Vec<u16> = line
        .split(':')
        .skip(1)
        .map(|part| part.split(',').next().unwrap_or_default().trim().parse().expect("a port stands behind each colon"))
        .collect();
    (gateway, ports[0], ports[1])
}

/// Starts a script of `tests/test_e2e/python` under the stock client.
pub fn start_script(sandbox: &Sandbox, script: &str, args: &[&str]) -> Process {
    let script = repository().join("tests/test_e2e/python").join(script);
    let args: Vec<&str> = std::iter::once(script.to_str().expect("paths are UTF-8")).chain(args.iter().copied()).collect();
    // The client keeps a cache in its home folder, which must not be the tester's.
    let home = sandbox.path("");
    let package = repository().join("schemas/python/src");
    let text = |path: &std::path::Path| path.to_str().expect("paths are UTF-8").to_owned();
    let (home, package) = (text(&home), text(&package));
    let env = [("HOME", home.as_str()), ("PYTHONPATH", package.as_str()), ("PYTHONDONTWRITEBYTECODE", "1"), ("PYTHONUNBUFFERED", "1")];
    sandbox.spawn_program("python", &venv_program("python"), &args, &env)
}

/// Runs such a script to its end, and looks for `NAME passed` of each theme.
///
/// # Panics
/// With its output if it fails or a theme is missing.
pub fn run_script(sandbox: &Sandbox, script: &str, args: &[&str], themes: &[&str]) -> Ended {
    let ended = start_script(sandbox, script, args).wait().expect_code(0);
    for theme in themes {
        assert!(ended.says(&format!("{theme} passed")), "{theme} is missing:\n{}", ended.lines.join("\n"));
    }
    ended
}
