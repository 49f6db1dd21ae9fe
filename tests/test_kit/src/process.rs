//! One child process with its output, signals and end.

use std::ffi::OsStr;
use std::io::{BufRead as _, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use crate::patience::PATIENCE;

/// How long is waited for the last lines of a process that has failed a test.
const LAST_WORDS: Duration = Duration::from_secs(5);

/// A running child; killed when dropped.
#[derive(Debug)]
pub struct Process {
    name: String,
    child: Child,
    lines: Arc<Mutex<Vec<String>>>,
    readers: Vec<std::thread::JoinHandle<()>>,
}

/// How a process ended, and everything that it printed.
#[derive(Debug)]
pub struct Ended {
    /// Exit status.
    pub status: ExitStatus,
    /// Lines of stdout and stderr in the order they came.
    pub lines: Vec<String>,
}

impl Ended {
    /// Exit code; panics with the output if a signal ended it.
    pub fn code(&self) -> i32 {
        self.status.code().unwrap_or_else(|| {
            panic!(
                "ended by a signal: {:?}\n{}",
                self.status,
                self.lines.join("\n")
            )
        })
    }

    /// Asserts an exit code; the output is in the message.
    pub fn expect_code(self, code: i32) -> Self {
        assert_eq!(
            self.status.code(),
            Some(code),
            "output:\n{}",
            self.lines.join("\n")
        );
        self
    }

    /// Whether a line contains `text`.
    pub fn says(&self, text: &str) -> bool {
        self.lines.iter().any(|line| line.contains(text))
    }
}

impl Process {
    pub(crate) fn start(
        name: &str,
        program: &Path,
        args: &[&str],
        dir: &Path,
        env: &[(&str, &OsStr)],
    ) -> Self {
        let mut child = Command::new(program)
            .args(args)
            .current_dir(dir)
            .env("NO_COLOR", "1")
            .envs(env.iter().copied())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap_or_else(|error| panic!("cannot start {name}: {error}"));
        let lines = Arc::new(Mutex::new(Vec::new()));
        let out = child.stdout.take().expect("stdout is piped");
        let err = child.stderr.take().expect("stderr is piped");
        let readers = vec![collect(out, lines.clone()), collect(err, lines.clone())];
        Process {
            name: name.to_owned(),
            child,
            lines,
            readers,
        }
    }

    /// Process id.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// The lines that it has printed so far.
    pub fn lines(&self) -> Vec<String> {
        self.lines
            .lock()
            .expect("reader threads do not panic")
            .clone()
    }

    /// Waits until a line contains `text` and returns it.
    ///
    /// # Panics
    /// If the process ends first or [`PATIENCE`] runs out; the message holds its output.
    pub fn wait_line(&mut self, text: &str) -> String {
        let start = Instant::now();
        loop {
            let found = self.lines().into_iter().find(|line| line.contains(text));
            if let Some(line) = found {
                return line;
            }
            let ended = !self.is_running();
            if ended || start.elapsed() > PATIENCE {
                self.hear_out(LAST_WORDS);
                let lines = self.lines();
                if let Some(line) = lines.iter().find(|line| line.contains(text)) {
                    return line.clone();
                }
                let how = match self.child.try_wait() {
                    Ok(Some(status)) => format!("ended ({status})"),
                    _ => "hangs".to_owned(),
                };
                panic!(
                    "{} {how} without saying {text:?}; output:\n{}",
                    self.name,
                    lines.join("\n")
                );
            }
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
    }

    /// Waits until its output is read to the end, which a process that it started may hold open;
    /// whether that happened within `limit`.
    fn hear_out(&self, limit: Duration) -> bool {
        let start = Instant::now();
        while !self.readers.iter().all(|reader| reader.is_finished()) {
            if start.elapsed() > limit {
                return false;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        true
    }

    /// Whether it still runs.
    pub fn is_running(&mut self) -> bool {
        self.child
            .try_wait()
            .expect("child can be waited for")
            .is_none()
    }

    /// Sends a signal.
    pub fn signal(&self, signal: Signal) {
        kill(Pid::from_raw(self.child.id() as i32), signal)
            .unwrap_or_else(|error| panic!("cannot signal {}: {error}", self.name));
    }

    /// `kill -9`, and waits until it is gone.
    pub fn kill9(mut self) -> Ended {
        self.signal(Signal::SIGKILL);
        self.wait_end(PATIENCE)
    }

    /// SIGTERM, and waits for its end.
    pub fn stop(mut self) -> Ended {
        self.signal(Signal::SIGTERM);
        self.wait_end(PATIENCE)
    }

    /// Waits until it ends by itself.
    pub fn wait(mut self) -> Ended {
        self.wait_end(PATIENCE)
    }

    /// Waits for the end of a program that works longer than [`PATIENCE`] and has a watchdog of its
    /// own, whose output says where it stands; `limit` is for a watchdog that fails.
    pub fn wait_longer(mut self, limit: Duration) -> Ended {
        self.wait_end(limit)
    }

    /// Resident memory, bytes.
    pub fn resident_bytes(&self) -> u64 {
        let statm =
            std::fs::read_to_string(format!("/proc/{}/statm", self.child.id())).unwrap_or_default();
        statm
            .split_whitespace()
            .nth(1)
            .and_then(|pages| pages.parse::<u64>().ok())
            .unwrap_or(0)
            * 4096
    }

    fn wait_end(&mut self, limit: Duration) -> Ended {
        let start = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait().expect("child can be waited for") {
                break status;
            }
            assert!(
                start.elapsed() < limit,
                "{} still runs after {limit:?}; output:\n{}",
                self.name,
                self.lines().join("\n")
            );
            std::thread::sleep(Duration::from_millis(10));
        };
        assert!(
            self.hear_out(PATIENCE),
            "{} ended ({status}), but a process that it started still holds its output open after \
             {PATIENCE:?}; output:\n{}",
            self.name,
            self.lines().join("\n")
        );
        Ended {
            status,
            lines: self.lines(),
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let start = Instant::now();
        while matches!(self.child.try_wait(), Ok(None)) {
            // A test that failed is to say so, and not to wait for a process that cannot end.
            if start.elapsed() > PATIENCE {
                eprintln!("{} did not end {PATIENCE:?} after SIGKILL", self.name);
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

/// Output of a command that ends by itself, without a sandbox. In place of [`Command::output`], which
/// waits without limit for a program that hangs, and for every process that holds its output.
///
/// # Panics
/// If it cannot be started, or goes on for longer than `limit`; the message holds its output.
pub fn output_within(command: &mut Command, limit: Duration) -> Output {
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap_or_else(|error| panic!("cannot start {command:?}: {error}"));
    let out = read_all(child.stdout.take().expect("stdout is piped"));
    let err = read_all(child.stderr.take().expect("stderr is piped"));
    let start = Instant::now();
    loop {
        let status = child.try_wait().expect("child can be waited for");
        if let (Some(status), true, true) = (status, out.1.is_finished(), err.1.is_finished()) {
            let [stdout, stderr] = [out.0, err.0].map(|bytes| bytes_of(&bytes));
            return Output {
                status,
                stdout,
                stderr,
            };
        }
        if start.elapsed() > limit {
            let _ = child.kill();
            let _ = child.wait();
            let how = match status {
                Some(status) => {
                    format!("ended ({status}), but a process that it started holds its output")
                }
                None => "has not ended".to_owned(),
            };
            let [out, err] = [out.0, err.0].map(|bytes| bytes_of(&bytes));
            panic!(
                "{command:?} {how} after {limit:?}; output:\n{}\n{}",
                String::from_utf8_lossy(&out),
                String::from_utf8_lossy(&err)
            );
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// What has been read of a pipe, and the thread that reads it to its end.
type Reading = (Arc<Mutex<Vec<u8>>>, std::thread::JoinHandle<()>);

fn read_all(mut pipe: impl Read + Send + 'static) -> Reading {
    let read = Arc::new(Mutex::new(Vec::new()));
    let into = read.clone();
    let thread = std::thread::Builder::new()
        .name("output".into())
        .spawn(move || {
            let mut piece = vec![0; 1 << 16];
            while let Ok(n @ 1..) = pipe.read(&mut piece) {
                let mut into = into.lock().expect("reader threads do not panic");
                into.extend_from_slice(&piece[..n]);
            }
        })
        .expect("a thread can be started");
    (read, thread)
}

fn bytes_of(read: &Mutex<Vec<u8>>) -> Vec<u8> {
    read.lock().expect("reader threads do not panic").clone()
}

fn collect(
    pipe: impl Read + Send + 'static,
    lines: Arc<Mutex<Vec<String>>>,
) -> std::thread::JoinHandle<()> {
    let read = move || {
        for line in BufReader::new(pipe).split(b'\n').map_while(Result::ok) {
            lines
                .lock()
                .expect("reader threads do not panic")
                .push(String::from_utf8_lossy(&line).into_owned());
        }
    };
    // Without a name it would have its test's, which it outlives while somebody holds the pipe.
    std::thread::Builder::new()
        .name("output".into())
        .spawn(read)
        .expect("a thread can be started")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(line: &str) -> Command {
        let mut command = Command::new("/bin/sh");
        command.args(["-c", line]);
        command
    }

    #[test]
    fn output_comes_whole_with_the_exit_code() {
        let line = "head -c 300000 /dev/zero; echo said >&2; exit 3";
        let output = output_within(&mut shell(line), PATIENCE);
        assert_eq!(output.status.code(), Some(3));
        assert_eq!(output.stdout, vec![0; 300_000]);
        assert_eq!(output.stderr, b"said\n");
    }

    #[test]
    #[should_panic(expected = "has not ended after 200ms; output:\nhere")]
    fn a_program_that_hangs_ends_its_test() {
        output_within(
            &mut shell("echo here; exec sleep 600"),
            Duration::from_millis(200),
        );
    }

    #[test]
    #[should_panic(expected = "but a process that it started holds its output")]
    fn output_that_another_process_holds_ends_its_test() {
        // It ends by itself soon.
        output_within(&mut shell("sleep 3 & exit 0"), Duration::from_millis(500));
    }
}
