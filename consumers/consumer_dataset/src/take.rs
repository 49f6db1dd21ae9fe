//! One scenario from the start of its simulator to a whole recording.
//!
//! The simulator is stepped, its driver and its recorder take part in lockstep, and the recorder
//! joins between two ticks, when the traffic is under way. So what is recorded follows from the
//! scenario alone, however fast the machine is and whatever else it does.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use launch_cli::programs::find;
use schema_bus::{Bus, CommandClient, names};
use schema_frames::WorldInfo;

use crate::children::{Children, Quarters};
use crate::matrix::Scenario;
use crate::stepping::{self, ASK_EVERY, Stopped};

/// Time in which processes end that were asked to.
const END_WITHIN: Duration = Duration::from_secs(60);
/// Names in lockstep.
const DRIVER: &str = "drive";
const RECORDER: &str = "record";

/// Where the programs are.
#[derive(Clone, Debug)]
pub struct Programs {
    /// `simd`.
    pub simd: PathBuf,
    /// `gantry-drive`.
    pub drive: PathBuf,
    /// `gantry-record`.
    pub record: PathBuf,
    /// `gantry-export`.
    pub export: PathBuf,
}

impl Programs {
    /// Looks for the programs beside this one, then on `PATH`.
    ///
    /// # Errors
    /// If one is missing.
    pub fn find() -> anyhow::Result<Programs> {
        Ok(Programs {
            simd: find("simd")?,
            drive: find("gantry-drive")?,
            record: find("gantry-record")?,
            export: find("gantry-export")?,
        })
    }
}

/// What a scenario needs to run.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// The scenario.
    pub scenario: &'a Scenario,
    /// Its launch file's text.
    pub launch: &'a str,
    /// Unique number of this attempt.
    pub number: u64,
    /// File in which it is written down which processes run.
    pub register: &'a Path,
    /// Folder for logs and the unfinished recording.
    pub folder: &'a Path,
    /// Where the finished recording goes.
    pub recording: &'a Path,
    /// Words for `simd` besides its own.
    pub simd_words: &'a [String],
    /// Words for `gantry-record` besides its own.
    pub record_words: &'a [String],
    /// Longest time without a finished tick before it counts as hanging.
    pub stall: Duration,
}

/// Runs and records a scenario. `stop` is asked several times a second and ends it; `progress` is
/// told the ticks that are done, warm-up included.
///
/// # Errors
/// [`Stopped`], or which process failed and what it said.
pub fn record(
    job: &Job<'_>,
    programs: &Programs,
    stop: &dyn Fn() -> bool,
    progress: &dyn Fn(u64),
) -> anyhow::Result<()> {
    // What an earlier attempt left must not be mistaken for this one's.
    let _ = fs::remove_dir_all(job.folder);
    fs::create_dir_all(job.folder)
        .with_context(|| format!("cannot make the folder {}", job.folder.display()))?;
    let launch = job.folder.join("launch.toml");
    fs::write(&launch, job.launch)?;
    let quarters = Quarters::take(job.number, job.register)?;
    let mut run = Run {
        children: Children::new(quarters),
        job: *job,
        stop,
        progress,
    };
    run.start_simulator(programs, &launch)?;
    // Ports go before the node that made them, and both before the quarters.
    let bus = run.join_bus()?;
    let mut client = bus.command_client("dataset")?;
    stepping::wait_for_daemon(&mut client, &mut |since| run.look(since))?;
    let scenario = job.scenario;
    if scenario.warm_up_ticks > 0 {
        run.step(&mut client, scenario.warm_up_ticks)?;
    }
    let part = job.folder.join("recording.mcap");
    run.start_recorder(programs, &part, &bus)?;
    run.step(&mut client, scenario.frames)?;
    drop(client);
    drop(bus);
    run.children.finish("gantry-record", END_WITHIN)?;
    run.children.finish("gantry-drive", END_WITHIN)?;
    run.children.finish("simd", END_WITHIN)?;
    if let Some(folder) = job.recording.parent() {
        fs::create_dir_all(folder)?;
    }
    launch_cli::files::rename(&part, job.recording)
        .with_context(|| format!("cannot move the recording to {}", job.recording.display()))
}

/// A scenario that runs.
struct Run<'a> {
    children: Children,
    job: Job<'a>,
    stop: &'a dyn Fn() -> bool,
    progress: &'a dyn Fn(u64),
}

impl Run<'_> {
    fn log(&self, name: &str) -> PathBuf {
        self.job.folder.join(format!("{name}.log"))
    }

    fn start_simulator(&mut self, programs: &Programs, launch: &Path) -> anyhow::Result<()> {
        let mut words: Vec<String> = vec![
            "--launch".into(),
            launch.display().to_string(),
            // Nobody ticks this world but this program.
            "--on-lost-client".into(),
            "wait".into(),
        ];
        words.extend_from_slice(self.job.simd_words);
        if self.job.scenario.drive {
            words.extend(["--await-participant".into(), DRIVER.into()]);
        }
        let log = self.log("simd");
        self.children.start("simd", &programs.simd, &words, &log)?;
        if self.job.scenario.drive {
            let words = [format!("--lockstep={DRIVER}")];
            let log = self.log("gantry-drive");
            self.children
                .start("gantry-drive", &programs.drive, &words, &log)?;
        }
        Ok(())
    }

    fn join_bus(&self) -> anyhow::Result<Bus> {
        let quarters = self.children.quarters();
        Ok(Bus::open_with(
            quarters.domain(),
            "dataset",
            &quarters.bus_options(),
        )?)
    }

    /// Looks after stop requests and processes, then pauses.
    fn look(&mut self, since: Instant) -> anyhow::Result<()> {
        if (self.stop)() {
            return Err(Stopped.into());
        }
        self.children.check()?;
        if since.elapsed() > self.job.stall {
            anyhow::bail!(
                "nothing has happened for {} s; logs are in {}",
                self.job.stall.as_secs(),
                self.job.folder.display()
            );
        }
        std::thread::sleep(ASK_EVERY);
        Ok(())
    }

    fn step(&mut self, client: &mut CommandClient, n: u64) -> anyhow::Result<()> {
        let (stall, progress) = (self.job.stall, self.progress);
        stepping::step(client, n, stall, &mut |since| self.look(since), progress)
    }

    /// Starts the recorder, and waits until the simulator waits for it.
    fn start_recorder(
        &mut self,
        programs: &Programs,
        part: &Path,
        bus: &Bus,
    ) -> anyhow::Result<()> {
        let mut words = vec![
            "--out".to_owned(),
            part.display().to_string(),
            format!("--lockstep={RECORDER}"),
        ];
        words.extend_from_slice(self.job.record_words);
        let log = self.log("gantry-record");
        self.children
            .start("gantry-record", &programs.record, &words, &log)?;
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
}
