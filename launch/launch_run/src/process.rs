//! A process that runs: what it said, whether it still runs, and its end.

use std::io::{BufRead as _, BufReader, Read, Seek as _, SeekFrom};
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, ExitStatus};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use launch_cli::files::open_plain;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use parking_lot::Mutex;

use crate::error::RunError;
use crate::watch::Watched;

/// How often a process that shall end or say something is looked at.
const LOOK_EVERY: Duration = Duration::from_millis(5);
/// Most bytes of a log in which the lines that are quoted are looked for.
const QUOTED_BYTES: u64 = 1 << 14;
/// Longest wait for the last lines of a process that has ended.
const LAST_WORDS: Duration = Duration::from_secs(5);

/// The signals that ask a process to end, each with the time that it has; SIGKILL comes last.
#[derive(Clone, Debug)]
pub struct Ending(Vec<(Signal, Duration)>);

impl Ending {
    /// It is not asked.
    pub fn kill() -> Ending {
        Ending(Vec::new())
    }

    /// SIGTERM.
    pub fn term(within: Duration) -> Ending {
        Ending(vec![(Signal::SIGTERM, within)])
    }

    /// SIGINT twice, as somebody would on a terminal: a launcher ends its processes in order at the
    /// first, and kills them at the second.
    pub fn interrupt_twice(within: Duration) -> Ending {
        Ending(vec![(Signal::SIGINT, within), (Signal::SIGINT, within)])
    }
}

/// What a process has said.
#[derive(Debug)]
pub(crate) enum Said {
    /// It stands in a file.
    Log(PathBuf),
    /// The user has seen it.
    Above,
    /// It was collected.
    Lines {
        lines: Arc<Mutex<Vec<String>>>,
        readers: Vec<JoinHandle<()>>,
    },
}

impl Said {
    /// Collects what comes through the pipes of a child.
    pub(crate) fn collect(child: &mut Child) -> Said {
        let lines = Arc::new(Mutex::new(Vec::new()));
        let pipes: [Option<Box<dyn Read + Send>>; 2] = [
            child.stdout.take().map(|pipe| Box::new(pipe) as _),
            child.stderr.take().map(|pipe| Box::new(pipe) as _),
        ];
        let readers = pipes
            .into_iter()
            .flatten()
            .map(|pipe| {
                let lines = lines.clone();
                std::thread::spawn(move || {
                    for line in BufReader::new(pipe).split(b'\n').map_while(Result::ok) {
                        lines
                            .lock()
                            .push(String::from_utf8_lossy(&line).into_owned());
                    }
                })
            })
            .collect();
        Said::Lines { lines, readers }
    }
}

/// A process that was started. Dropped, it is ended.
#[derive(Debug)]
pub struct Process {
    pub(crate) name: String,
    pub(crate) child: Child,
    pub(crate) said: Said,
    pub(crate) ending: Ending,
    pub(crate) n_quoted: usize,
    pub(crate) status: Option<ExitStatus>,
}

impl Process {
    /// Its name in sentences.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Process id.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// How it ended, if it did.
    ///
    /// # Errors
    /// [`RunError::Unknown`].
    pub fn ended(&mut self) -> Result<Option<ExitStatus>, RunError> {
        if self.status.is_none() {
            self.status = self.child.try_wait().map_err(|source| RunError::Unknown {
                name: self.name.clone(),
                source,
            })?;
        }
        Ok(self.status)
    }

    /// Fails if it has ended while it was `doing` something.
    ///
    /// # Errors
    /// [`RunError::EndedAbove`] for one whose lines the user sees, else [`RunError::Ended`].
    pub fn must_run_while(&mut self, doing: &str) -> Result<(), RunError> {
        match self.ended()? {
            None => Ok(()),
            Some(status) => Err(self.obituary(status, doing)),
        }
    }

    /// Why the run cannot go on now that it has ended.
    fn obituary(&self, status: ExitStatus, doing: &str) -> RunError {
        let name = self.name.clone();
        match self.said {
            Said::Above => RunError::EndedAbove {
                name,
                doing: doing.to_owned(),
                status,
            },
            _ => RunError::Ended {
                name,
                status,
                last: self.last_words(),
            },
        }
    }

    /// Sends a signal; `false` if it cannot be sent.
    pub fn signal(&self, signal: Signal) -> bool {
        // It is this process's child, so until it is waited for, the id is still its own.
        self.status.is_none() && kill(Pid::from_raw(self.child.id().cast_signed()), signal).is_ok()
    }

    /// Waits so long for its end.
    ///
    /// # Errors
    /// [`RunError::Unknown`].
    pub fn wait(&mut self, within: Duration) -> Result<Option<ExitStatus>, RunError> {
        let start = Instant::now();
        loop {
            if let Some(status) = self.ended()? {
                return Ok(Some(status));
            }
            if start.elapsed() >= within {
                return Ok(None);
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }

    /// Ends it as its program says.
    ///
    /// # Errors
    /// If it cannot be waited for.
    pub fn end(&mut self) -> Result<ExitStatus, RunError> {
        let ending = self.ending.clone();
        self.end_by(&ending)
    }

    /// Ends it in another way.
    ///
    /// # Errors
    /// If it cannot be waited for.
    pub fn end_by(&mut self, ending: &Ending) -> Result<ExitStatus, RunError> {
        if let Some(status) = self.ended()? {
            return Ok(status);
        }
        for (signal, within) in &ending.0 {
            self.signal(*signal);
            if let Some(status) = self.wait(*within)? {
                return Ok(status);
            }
        }
        if !ending.0.is_empty() {
            tracing::warn!("{} does not end, so it is killed", self.name);
        }
        let unknown = |source| RunError::Unknown {
            name: self.name.clone(),
            source,
        };
        self.child.kill().map_err(unknown)?;
        let status = self.child.wait().map_err(unknown)?;
        self.status = Some(status);
        Ok(status)
    }

    /// Ends it in another way, and fails if its exit code is not 0.
    ///
    /// # Errors
    /// [`RunError::Ended`], also if it had to be killed.
    pub fn finish(&mut self, ending: &Ending) -> Result<(), RunError> {
        match self.end_by(ending)? {
            status if status.success() => Ok(()),
            status => Err(self.obituary(status, "when it was to finish")),
        }
    }

    /// All lines that were collected so far, of stdout and stderr in the order they came.
    pub fn lines(&self) -> Vec<String> {
        match &self.said {
            Said::Lines { lines, .. } => lines.lock().clone(),
            Said::Log(_) | Said::Above => Vec::new(),
        }
    }

    /// Its last lines, indented for a sentence before them.
    pub fn last_words(&self) -> String {
        let said = match &self.said {
            Said::Log(path) => end_of(path).unwrap_or_default(),
            Said::Lines { .. } => self.lines().join("\n"),
            Said::Above => String::new(),
        };
        let lines: Vec<&str> = said.lines().collect();
        lines[lines.len().saturating_sub(self.n_quoted)..].join("\n  ")
    }

    /// Waits until a collected line contains `text`, and returns it.
    ///
    /// # Errors
    /// [`RunError::Silent`] if it ends first, or `within` is over; with all that it said.
    pub fn await_line(&mut self, text: &str, within: Duration) -> Result<String, RunError> {
        let start = Instant::now();
        let found = |process: &Process| {
            let mut lines = process.lines().into_iter();
            lines.find(|line| line.contains(text))
        };
        loop {
            if let Some(line) = found(self) {
                return Ok(line);
            }
            let status = self.ended()?;
            if status.is_some() || start.elapsed() > within {
                self.hear_out(LAST_WORDS);
                return found(self).ok_or_else(|| RunError::Silent {
                    name: self.name.clone(),
                    how: status.map_or("hangs".into(), |status| format!("ended ({status})")),
                    wanted: text.to_owned(),
                    output: self.lines().join("\n"),
                });
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }

    /// Waits until its output is collected to the end, which another process may hold open.
    pub fn hear_out(&self, within: Duration) {
        let start = Instant::now();
        if let Said::Lines { readers, .. } = &self.said {
            while !readers.iter().all(JoinHandle::is_finished) && start.elapsed() < within {
                std::thread::sleep(LOOK_EVERY);
            }
        }
    }
}

impl Watched for Process {
    fn must_run(&mut self) -> Result<(), RunError> {
        self.must_run_while("too early")
    }

    fn hint(&self) -> String {
        format!("{} said last:\n  {}", self.name, self.last_words())
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if let Err(error) = self.end() {
            tracing::warn!(%error, "{} could not be ended", self.name);
        }
    }
}

/// The last part of a log.
fn end_of(path: &Path) -> std::io::Result<String> {
    let (mut file, length) = open_plain(path)?;
    file.seek(SeekFrom::Start(length.saturating_sub(QUOTED_BYTES)))?;
    let mut bytes = Vec::new();
    file.take(QUOTED_BYTES).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// A status in words: `exit code 3`, `signal SIGKILL`.
pub fn describe(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("exit code {code}"),
        (_, Some(number)) => Signal::try_from(number).map_or_else(
            |_| format!("signal {number}"),
            |signal| format!("signal {signal}"),
        ),
        _ => status.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::program::{Output, Program};

    fn shell(script: &str) -> Program {
        Program::new("shell", Path::new("/bin/sh")).words(["-c", script])
    }

    #[test]
    fn a_line_is_waited_for_and_an_early_end_quotes_the_output() {
        let mut process = shell("echo one; echo two >&2; exit 3")
            .start(Output::Collected)
            .unwrap();
        let within = Duration::from_secs(60);
        assert_eq!(process.await_line("tw", within).unwrap(), "two");
        let error = process.await_line("three", within).unwrap_err().to_string();
        assert!(
            error.contains("shell ended (exit status: 3) without saying \"three\""),
            "{error}"
        );
        assert!(error.contains("one"), "{error}");
    }

    #[test]
    fn an_early_end_quotes_the_last_lines_of_the_log() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("log");
        let script = "for i in 1 2 3 4 5 6 7; do echo line$i; done; exit 1";
        let mut process = shell(script).start(Output::Log(&log)).unwrap();
        process.wait(Duration::from_secs(60)).unwrap();
        assert_eq!(
            process.must_run().unwrap_err().to_string(),
            "shell ended (exit status: 1); it said last:\n  line3\n  line4\n  line5\n  line6\n  line7"
        );
    }

    #[test]
    fn a_process_that_does_not_heed_signals_is_killed() {
        let mut deaf = shell("trap '' TERM; echo deaf; while :; do sleep 0.01; done")
            .start(Output::Collected)
            .unwrap();
        deaf.await_line("deaf", Duration::from_secs(60)).unwrap();
        let ending = Ending::term(Duration::from_millis(50));
        assert_eq!(deaf.end_by(&ending).unwrap().signal(), Some(9));
        assert_eq!(describe(deaf.end().unwrap()), "signal SIGKILL");
    }
}
