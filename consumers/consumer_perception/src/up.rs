//! `gantry up` as a child of the benchmark: the launch file that is made for it, which processes
//! run, how they ended, and its own end, whatever happens.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{Read as _, Seek as _, SeekFrom};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use launch_cli::programs::find;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use toml::{Table, Value};

use crate::suite::ProgramProcess;

/// How often a process that was asked to end is looked at.
const LOOK_EVERY: Duration = Duration::from_millis(10);
/// Time in which the launcher ends with all its processes, after which it is killed.
const END_WITHIN: Duration = Duration::from_secs(30);
/// How much of a log is quoted when something fails.
const QUOTED_LINES: usize = 8;
/// Most bytes of the log that are read in one look, so that a program that prints without end
/// cannot hold the benchmark here.
const MAX_LOOK_BYTES: u64 = 1 << 20;

/// A domain that no other run has.
pub fn new_domain() -> String {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let number = COUNT.fetch_add(1, Ordering::Relaxed);
    format!("bench{}x{number}", std::process::id())
}

/// `[process.NAME]` of a program's process. With a name in lockstep it is told to join under it, by
/// a key of its settings.
pub fn process_table(process: &ProgramProcess, lockstep: bool, after: &[&str]) -> Table {
    let mut table = Table::new();
    let texts = |all: &[String]| Value::Array(all.iter().map(|it| it.clone().into()).collect());
    table.insert("cmd".into(), texts(&process.cmd));
    for (key, folder) in [("cwd", &process.cwd), ("venv", &process.venv)] {
        if let Some(folder) = folder {
            table.insert(key.into(), folder.display().to_string().into());
        }
    }
    let mut env: Table = process
        .env
        .iter()
        .map(|(key, value)| (key.clone(), value.clone().into()))
        .collect();
    if let Some(gpu) = &process.gpu {
        env.insert("CUDA_VISIBLE_DEVICES".into(), gpu.clone().into());
    }
    if !env.is_empty() {
        table.insert("env".into(), env.into());
    }
    let mut params = process.params.clone();
    if lockstep {
        let params = params.get_or_insert_default();
        params.insert("lockstep".into(), process.name.clone().into());
    }
    if let Some(params) = params {
        table.insert("params".into(), params.into());
    }
    if !process.cores.is_empty() {
        table.insert("cores".into(), cores(&process.cores));
    }
    if let Some(nice) = process.nice {
        table.insert("nice".into(), i64::from(nice).into());
    }
    if let Some(restart) = process.restart
        && let Ok(restart) = Value::try_from(restart)
    {
        table.insert("restart".into(), restart);
    }
    table.insert(
        "after".into(),
        Value::Array(after.iter().map(|name| (*name).into()).collect()),
    );
    table
}

/// A list of cores as launch files have it.
pub fn cores(cores: &[u32]) -> Value {
    Value::Array(cores.iter().map(|core| i64::from(*core).into()).collect())
}

/// What the launcher said.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Note {
    /// A process was started.
    Started {
        /// Its name.
        name: String,
        /// Its id, which is its group's too.
        pid: u32,
    },
    /// A process ended.
    Ended {
        /// Its name.
        name: String,
        /// How: `exit code 3`, `signal SIGKILL`.
        how: String,
    },
    /// A process is started again, or anything else that went wrong, in the launcher's words.
    Said(String),
}

/// A launcher that runs.
#[derive(Debug)]
pub struct Up {
    child: Child,
    log: PathBuf,
    read_to: u64,
    rest: Vec<u8>,
    status: Option<ExitStatus>,
    /// Process ids by name, of those that run.
    pub pids: BTreeMap<String, u32>,
}

impl Up {
    /// Starts the processes of a launch file in `domain`. Logs and the file go to `folder`.
    ///
    /// # Errors
    /// If the folder cannot be written or the launcher cannot be started.
    pub fn start(domain: &str, launch: &Table, folder: &Path) -> anyhow::Result<Up> {
        fs::create_dir_all(folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))?;
        let file = folder.join("launch.toml");
        fs::write(&file, toml::to_string(launch)?)
            .with_context(|| format!("cannot write {}", file.display()))?;
        let log = folder.join("up.log");
        let out = File::create(&log).with_context(|| format!("cannot write {}", log.display()))?;
        let child = Command::new(find("gantry")?)
            .args(["--domain", domain, "--color", "never", "up"])
            .arg(&file)
            .args(["--view", "none", "--data"])
            .arg(folder)
            // A benchmark that is killed takes them with it.
            .args(["--parent", &std::process::id().to_string()])
            .env("NO_COLOR", "1")
            .stdin(Stdio::null())
            .stdout(out.try_clone()?)
            .stderr(out)
            // Ctrl-C on the terminal is for the benchmark, which ends its processes in order.
            .process_group(0)
            .spawn()
            .context("cannot start gantry")?;
        Ok(Up {
            child,
            log,
            read_to: 0,
            rest: Vec::new(),
            status: None,
            pids: BTreeMap::new(),
        })
    }

    /// What the launcher has said since the last look.
    ///
    /// # Errors
    /// If the log cannot be read.
    pub fn look(&mut self) -> anyhow::Result<Vec<Note>> {
        let mut file = File::open(&self.log)?;
        file.seek(SeekFrom::Start(self.read_to))?;
        let mut new = Vec::new();
        file.take(MAX_LOOK_BYTES).read_to_end(&mut new)?;
        self.read_to += new.len() as u64;
        self.rest.extend(new);
        let mut notes = Vec::new();
        while let Some(end) = self.rest.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = self.rest.drain(..=end).collect();
            notes.extend(note(&String::from_utf8_lossy(&line)));
        }
        for note in &notes {
            match note {
                Note::Started { name, pid } => drop(self.pids.insert(name.clone(), *pid)),
                Note::Ended { name, .. } => drop(self.pids.remove(name)),
                Note::Said(_) => {}
            }
        }
        Ok(notes)
    }

    /// How the launcher ended, if it did.
    ///
    /// # Errors
    /// If that cannot be told.
    pub fn ended(&mut self) -> anyhow::Result<Option<ExitStatus>> {
        if self.status.is_none() {
            self.status = self.child.try_wait()?;
        }
        Ok(self.status)
    }

    /// Fails if the launcher has ended.
    ///
    /// # Errors
    /// With what it said last.
    pub fn must_run(&mut self) -> anyhow::Result<()> {
        match self.ended()? {
            None => Ok(()),
            Some(status) => anyhow::bail!(
                "gantry up ended ({status}); it said last:\n  {}",
                self.last_words()
            ),
        }
    }

    /// The last lines of the log.
    pub fn last_words(&self) -> String {
        let bytes = fs::read(&self.log).unwrap_or_default();
        let end = &bytes[bytes.len().saturating_sub(1 << 14)..];
        let text = String::from_utf8_lossy(end).into_owned();
        let lines: Vec<&str> = text.lines().collect();
        lines[lines.len().saturating_sub(QUOTED_LINES)..].join("\n  ")
    }

    /// Ends all processes in order, and waits for it.
    ///
    /// # Errors
    /// If the launcher cannot be waited for.
    pub fn stop(&mut self) -> anyhow::Result<()> {
        if self.ended()?.is_some() {
            return Ok(());
        }
        let pid = Pid::from_raw(self.child.id().cast_signed());
        // It is this program's child and not waited for yet, so the id is still its own.
        let _ = kill(pid, Signal::SIGINT);
        let asked = Instant::now();
        let mut killed = false;
        while self.ended()?.is_none() {
            if asked.elapsed() > END_WITHIN && !killed {
                killed = true;
                // A second time kills its processes at once.
                let _ = kill(pid, Signal::SIGINT);
            }
            if asked.elapsed() > END_WITHIN * 2 {
                self.child.kill()?;
            }
            std::thread::sleep(LOOK_EVERY);
        }
        Ok(())
    }
}

impl Drop for Up {
    fn drop(&mut self) {
        if let Err(error) = self.stop() {
            tracing::warn!(%error, "gantry up could not be ended");
        }
    }
}

/// What a line of the launcher's own says.
fn note(line: &str) -> Option<Note> {
    let (name, text) = line.split_once(" │ ")?;
    if name.trim() != "gantry" {
        return None;
    }
    let text = text.trim_end();
    if let Some((name, pid)) = text
        .strip_prefix("started ")
        .and_then(|rest| rest.strip_suffix(')')?.split_once(" (pid "))
    {
        let (name, pid) = (name.to_owned(), pid.parse().ok()?);
        return Some(Note::Started { name, pid });
    }
    if let Some((name, how)) = text.split_once(" ended with ")
        && let Some((how, _)) = how.rsplit_once(" after ")
    {
        let (name, how) = (name.to_owned(), how.to_owned());
        return Some(Note::Ended { name, how });
    }
    Some(Note::Said(text.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_the_launcher_are_understood_and_those_of_others_are_not() {
        let started = Note::Started {
            name: "quick".into(),
            pid: 3724,
        };
        let ended = Note::Ended {
            name: "quick".into(),
            how: "signal SIGKILL".into(),
        };
        assert_eq!(note("gantry   │ started quick (pid 3724)\n"), Some(started));
        assert_eq!(
            note("gantry │ quick ended with signal SIGKILL after 7.1 s\n"),
            Some(ended)
        );
        assert_eq!(
            note("gantry │ restarting quick in 500 ms (1 of 5)\n"),
            Some(Note::Said("restarting quick in 500 ms (1 of 5)".into()))
        );
        assert_eq!(note("quick │ started quick (pid 1)\n"), None);
        assert_eq!(note("no line of anybody\n"), None);
    }

    #[test]
    fn a_process_of_a_launch_file_says_all_that_the_suite_does() {
        let text = "cmd = [\"python\", \"a.py\"]\ncwd = \"x\"\ncores = [1]\nnice = 5\ngpu = \"0\"\nparams = { a = 1 }\nrestart = { policy = \"on-failure\" }\n";
        let suite = format!("{}[program.other]\n{text}", crate::suite::tests::SMALL);
        let suite = crate::suite::tests::read(&suite).unwrap();
        let process = &suite.program("other").unwrap().processes[0];
        let table = process_table(process, true, &["replay"]);
        let mut launch: Table = "version = 1\n[process.replay]\ncmd = [\"gantry-replay\"]\n"
            .parse()
            .unwrap();
        launch["process"]
            .as_table_mut()
            .unwrap()
            .insert("other".into(), table.into());
        let text = toml::to_string(&launch).unwrap();
        let read = launch_spec::Launch::parse(&text, "made").unwrap();
        let made = read.process("other").unwrap();
        assert_eq!((made.nice, made.cores.as_slice()), (Some(5), &[1][..]));
        assert_eq!(made.env["CUDA_VISIBLE_DEVICES"], "0");
        let params = made.params.as_ref().unwrap();
        assert_eq!(params["lockstep"].as_str(), Some("other"));
        assert_eq!(params["a"].as_integer(), Some(1));
    }
}
