//! One scenario from the start of its simulator to a whole recording.
//!
//! The simulator is stepped; its driver, its recorder and the suite's input programs take part in
//! lockstep, and the recorder joins between two ticks, when the traffic is under way. So what is
//! recorded follows from the suite alone.

use std::fs::{self, File};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use consumer_dataset::stepping::{self, ASK_EVERY, Stopped};
use launch_cli::programs::find;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use schema_bus::{Bus, CommandClient, names};
use schema_frames::WorldInfo;
use toml::{Table, Value};

use super::found::Options;
use crate::scenario::Scenario;
use crate::suite::Suite;
use crate::up::{Up, new_domain, process_table};

/// Time in which the recorder ends after it was asked to.
const END_WITHIN: Duration = Duration::from_secs(600);
/// The recorder's name in lockstep.
const RECORDER: &str = "record";

/// The launch file of a truth pass.
///
/// # Errors
/// A sentence if a weather or a time of day is unknown.
pub fn launch(suite: &Suite, scenario: &Scenario, options: &Options) -> Result<Table, String> {
    let mut launch = scenario.launch_with_truth(suite)?;
    let mut processes = Table::new();
    let mut words: Vec<Value> = ["simd", "--on-lost-client", "wait"].map(Into::into).into();
    if let Some(adapter) = &options.adapter {
        words.extend(["--adapter".into(), adapter.clone().into()]);
    }
    let simulator: Table = [
        ("cmd", Value::Array(words)),
        ("required", true.into()),
        (
            "ready",
            Value::Table(
                [("service".to_owned(), "world/snapshot".into())]
                    .into_iter()
                    .collect(),
            ),
        ),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .into_iter()
    .collect();
    processes.insert("simd".into(), simulator.into());
    if suite.drive {
        let driver: Table = [
            ("cmd", Value::Array(vec!["gantry-drive".into()])),
            ("lockstep", true.into()),
            ("required", true.into()),
            ("after", Value::Array(vec!["simd".into()])),
        ]
        .map(|(key, value)| (key.to_owned(), value))
        .into_iter()
        .collect();
        processes.insert("drive".into(), driver.into());
    }
    for process in &suite.input_programs {
        let mut table = process_table(process, true, &["simd"]);
        table.insert("lockstep".into(), true.into());
        table.insert("required".into(), true.into());
        processes.insert(process.name.clone(), table.into());
    }
    launch.insert("process".into(), processes.into());
    Ok(launch)
}

/// What a truth pass needs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Job<'a> {
    pub suite: &'a Suite,
    pub launch: &'a Table,
    /// Folder for logs.
    pub folder: &'a Path,
    /// Where the recording goes.
    pub recording: &'a Path,
    /// Longest time without a finished tick before it counts as hanging.
    pub stall: Duration,
}

/// Runs and records a scenario.
///
/// # Errors
/// [`Stopped`], or which process failed and what it said.
pub(super) fn record(
    job: &Job<'_>,
    stop: &dyn Fn() -> bool,
    progress: &dyn Fn(u64, u64),
) -> anyhow::Result<()> {
    let suite = job.suite;
    let ticks = |secs: f64| (secs * suite.tick_hz).round() as u64;
    let (n_settle, n_recorded) = (
        ticks(suite.settle_s),
        ticks(suite.warm_up_s + suite.secs).max(1),
    );
    let domain = new_domain();
    let mut run = Run {
        up: Up::start(&domain, job.launch, &job.folder.join("up"))?,
        recorder: None,
        job,
        stop,
        progress,
        n_ticks: n_settle + n_recorded,
    };
    // Ports go before the node that made them.
    let bus = Bus::open(&domain, "gantry-bench")?;
    let mut client = bus.command_client("bench")?;
    stepping::wait_for_daemon(&mut client, &mut |since| run.look(since))?;
    if n_settle > 0 {
        run.step(&mut client, n_settle)?;
    }
    run.start_recorder(&domain, &bus)?;
    run.step(&mut client, n_recorded)?;
    drop(client);
    drop(bus);
    run.finish_recorder()?;
    run.up.stop()
}

/// A truth pass under way.
struct Run<'a> {
    // Readers end before what they read.
    recorder: Option<Recorder>,
    up: Up,
    job: &'a Job<'a>,
    stop: &'a dyn Fn() -> bool,
    progress: &'a dyn Fn(u64, u64),
    n_ticks: u64,
}

/// The recorder; killed when dropped.
struct Recorder {
    child: Child,
    log: PathBuf,
}

impl Drop for Recorder {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Recorder {
    fn last_words(&self) -> String {
        let text = fs::read_to_string(&self.log).unwrap_or_default();
        let lines: Vec<&str> = text.lines().collect();
        lines[lines.len().saturating_sub(5)..].join("\n  ")
    }
}

impl Run<'_> {
    /// Looks after stop requests and processes, then pauses.
    fn look(&mut self, since: Instant) -> anyhow::Result<()> {
        if (self.stop)() {
            return Err(Stopped.into());
        }
        self.up.must_run()?;
        if let Some(recorder) = &mut self.recorder
            && let Some(status) = recorder.child.try_wait()?
        {
            anyhow::bail!(
                "gantry-record ended ({status}); it said last:\n  {}",
                recorder.last_words()
            );
        }
        if since.elapsed() > self.job.stall {
            anyhow::bail!(
                "nothing has happened for {} s; gantry up said last:\n  {}",
                self.job.stall.as_secs(),
                self.up.last_words()
            );
        }
        std::thread::sleep(ASK_EVERY);
        Ok(())
    }

    fn step(&mut self, client: &mut CommandClient, n: u64) -> anyhow::Result<()> {
        let (stall, progress, n_ticks) = (self.job.stall, self.progress, self.n_ticks);
        let progress = |done| progress(done, n_ticks);
        stepping::step(client, n, stall, &mut |since| self.look(since), &progress)
    }

    /// Starts the recorder, and waits until the simulator waits for it.
    fn start_recorder(&mut self, domain: &str, bus: &Bus) -> anyhow::Result<()> {
        let log = self.job.folder.join("gantry-record.log");
        let out = File::create(&log).with_context(|| format!("cannot write {}", log.display()))?;
        let child = Command::new(find("gantry-record")?)
            .arg("--out")
            .arg(self.job.recording)
            .arg(format!("--lockstep={RECORDER}"))
            .args(["--previews", "none", "--domain", domain])
            .args(["--parent", &std::process::id().to_string()])
            .env("NO_COLOR", "1")
            .stdin(Stdio::null())
            .stdout(out.try_clone()?)
            .stderr(out)
            .process_group(0)
            .spawn()
            .context("cannot start gantry-record")?;
        self.recorder = Some(Recorder { child, log });
        let mut info = bus.document_reader(names::WORLD_INFO)?;
        let start = Instant::now();
        loop {
            if let Some(document) = info.latest()? {
                let info: WorldInfo = document.json()?;
                if info.lockstep.iter().any(|name| name == RECORDER) {
                    return Ok(());
                }
            }
            self.look(start)?;
        }
    }

    /// Asks the recorder to end, and waits until its file is whole.
    fn finish_recorder(&mut self) -> anyhow::Result<()> {
        let Some(mut recorder) = self.recorder.take() else {
            return Ok(());
        };
        let _ = kill(
            Pid::from_raw(recorder.child.id().cast_signed()),
            Signal::SIGTERM,
        );
        let asked = Instant::now();
        loop {
            if let Some(status) = recorder.child.try_wait()? {
                anyhow::ensure!(
                    status.success(),
                    "gantry-record ended ({status}); it said last:\n  {}",
                    recorder.last_words()
                );
                return Ok(());
            }
            anyhow::ensure!(
                asked.elapsed() < END_WITHIN,
                "gantry-record did not end within {} s",
                END_WITHIN.as_secs()
            );
            std::thread::sleep(ASK_EVERY);
        }
    }
}
