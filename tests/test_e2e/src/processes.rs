//! Starts the daemon and its consumers in a sandbox, and asserts that they leave nothing.

use std::path::PathBuf;

use test_kit::{Process, Sandbox};

use crate::client::join_bus;

/// Starts `simd` with a launch file's text and waits until it is ready.
pub fn start_daemon(sandbox: &Sandbox, launch: &str, extra: &[&str]) -> Process {
    let mut daemon = spawn_daemon(sandbox, launch, extra);
    daemon.wait_line("ready");
    daemon
}

/// Starts `simd` with a launch file's text.
pub fn spawn_daemon(sandbox: &Sandbox, launch: &str, extra: &[&str]) -> Process {
    let file = sandbox.write("launch.toml", launch);
    let file = file.to_str().expect("sandbox paths are text");
    let mut args = vec!["--launch", file, "--domain", sandbox.domain()];
    args.extend(extra);
    sandbox.spawn("simd", &args)
}

/// Starts one of the consumers on the sandbox's domain.
pub fn spawn_consumer(sandbox: &Sandbox, binary: &str, args: &[&str]) -> Process {
    sandbox.spawn(binary, &[args, &["--domain", sandbox.domain()]].concat())
}

/// A program of the repository's own Python environment.
///
/// # Panics
/// With the command that makes the environment, if it is not there.
pub fn venv_program(name: &str) -> PathBuf {
    let program = test_kit::sandbox::repository().join(".venv/bin").join(name);
    assert!(
        program.exists(),
        "{} is missing: run ./gantry test, which makes the Python environment .venv",
        program.display()
    );
    program
}

/// Cleans up after killed processes, and asserts that nothing of the sandbox is left in shared
/// memory.
pub fn assert_nothing_left(sandbox: &Sandbox) {
    let bus = join_bus(sandbox, "cleaner");
    bus.clean_dead_nodes();
    drop(bus);
    assert_eq!(sandbox.leftovers(), Vec::<String>::new());
}
