//! The programs that a new run needs: the simulator, and a recorder if it is recorded. They end with
//! this program, whatever ends it.

use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use launch_cli::CommonArgs;
use launch_cli::programs::find;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

/// How long a program may take to end after it was asked.
const GRACE: Duration = Duration::from_secs(20);

/// A program that this one started.
#[derive(Debug)]
pub struct Running {
    name: &'static str,
    child: Child,
}

impl Running {
    /// Starts `name`, one of Gantry's programs, found beside this one or on `PATH`. Its log lines go
    /// where this program's go.
    ///
    /// # Errors
    /// If it is not there or cannot be started.
    pub fn start(
        name: &'static str,
        args: &[String],
        common: &CommonArgs,
    ) -> anyhow::Result<Running> {
        let program = find(name)?;
        let mut command = Command::new(&program);
        command
            .args(args)
            .args(["--domain", &common.domain])
            .args(["--parent", &std::process::id().to_string()])
            .stdin(Stdio::null())
            .stdout(Stdio::null());
        match (common.verbose, common.quiet) {
            (0, quiet) => command.args(vec!["-q"; usize::from(quiet) + 1]),
            (verbose, _) => command.args(vec!["-v"; usize::from(verbose) - 1]),
        };
        tracing::debug!(?command, "starting");
        let child = command
            .spawn()
            .with_context(|| format!("cannot start {}", program.display()))?;
        Ok(Running { name, child })
    }

    /// How it ended, if it did.
    ///
    /// # Errors
    /// If that cannot be told.
    pub fn ended(&mut self) -> anyhow::Result<Option<ExitStatus>> {
        self.child
            .try_wait()
            .with_context(|| format!("cannot tell whether {} runs", self.name))
    }

    /// Fails with a sentence if it has ended.
    ///
    /// # Errors
    /// If it has.
    pub fn must_run(&mut self, doing: &str) -> anyhow::Result<()> {
        match self.ended()? {
            None => Ok(()),
            Some(status) => bail!(
                "{} ended {doing} ({status}); its own lines above say why",
                self.name
            ),
        }
    }

    /// Asks it to end and waits; after a while it is killed.
    pub fn stop(&mut self) {
        // It is this program's child and not waited for yet, so the id is still its own.
        let pid = Pid::from_raw(self.child.id().cast_signed());
        if self.ended().is_ok_and(|ended| ended.is_some()) || kill(pid, Signal::SIGTERM).is_err() {
            return;
        }
        let asked = Instant::now();
        while asked.elapsed() < GRACE {
            if self.ended().is_ok_and(|ended| ended.is_some()) {
                return;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        tracing::warn!("{} does not end, so it is killed", self.name);
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop();
    }
}

/// The names of the GPUs that the simulator finds.
///
/// # Errors
/// If the simulator cannot be asked.
pub fn adapters() -> anyhow::Result<Vec<String>> {
    #[derive(serde::Deserialize)]
    struct Adapter {
        name: String,
    }
    let program = find("simd")?;
    let answer = Command::new(&program)
        .args(["--adapters", "--json", "-qq"])
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .output()
        .with_context(|| format!("cannot start {}", program.display()))?;
    let text = String::from_utf8_lossy(&answer.stdout);
    Ok(text
        .lines()
        .filter_map(|line| serde_json::from_str(line).ok())
        .map(|adapter: Adapter| adapter.name)
        .collect())
}
