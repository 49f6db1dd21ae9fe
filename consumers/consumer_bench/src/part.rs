//! A process that takes part in a bench: this program again, which says "ready", works until its
//! input is closed, and then prints what it saw as one line of JSON.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use anyhow::{Context as _, ensure};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The parent's handle of a part. Dropped before [`Part::finish`], it kills the process.
pub struct Part {
    child: Child,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
}

impl Part {
    /// Starts this program with these arguments, and waits until it is ready.
    pub fn start(args: &[&str]) -> anyhow::Result<Self> {
        let program = launch_cli::programs::own().context("cannot find this program's file")?;
        let mut child = Command::new(program)
            .args(args)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .with_context(|| format!("cannot start {:?}", args.first()))?;
        let input = child.stdin.take();
        let output = child.stdout.take().expect("stdout is a pipe, see above");
        let mut part = Part {
            child,
            input,
            output: BufReader::new(output),
        };
        let mut line = String::new();
        part.output.read_line(&mut line)?;
        ensure!(
            line.trim() == "ready",
            "a process of the bench ended before it was ready; its reason stands above"
        );
        Ok(part)
    }

    /// Ends the process and takes what it saw.
    pub fn finish<T: DeserializeOwned>(mut self) -> anyhow::Result<T> {
        drop(self.input.take());
        let mut text = String::new();
        self.output.read_to_string(&mut text)?;
        let status = self.child.wait()?;
        ensure!(
            status.success(),
            "a process of the bench failed with {status}; its reason stands above"
        );
        serde_json::from_str(&text).context("the answer of a process of the bench cannot be read")
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        // Both fail for a process that has already ended, which is the normal case.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The process itself: tells the parent that it is ready, and watches for the end of its input.
pub struct Parent {
    is_over: Arc<AtomicBool>,
}

impl Parent {
    /// Says "ready".
    pub fn tell_ready() -> anyhow::Result<Parent> {
        let is_over = Arc::new(AtomicBool::new(false));
        let over = is_over.clone();
        std::thread::spawn(move || {
            // The end of input and a failure to read mean the same: the parent is done or gone.
            let _ = std::io::stdin().read_to_end(&mut Vec::new());
            over.store(true, Relaxed);
        });
        println!("ready");
        std::io::stdout().flush().context("the bench hung up")?;
        Ok(Parent { is_over })
    }

    /// Whether the parent is done or gone.
    pub fn is_over(&self) -> bool {
        self.is_over.load(Relaxed)
    }

    /// Prints what was seen.
    pub fn answer(self, seen: &impl Serialize) -> anyhow::Result<()> {
        println!("{}", serde_json::to_string(seen)?);
        Ok(())
    }
}
