//! Starts the daemon and its consumers in a sandbox.

use crate::process::Process;
use crate::sandbox::Sandbox;

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
