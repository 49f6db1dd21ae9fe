//! Both runs side by side: the recorded one from its file, the new one in lockstep.

use std::io::Write as _;
use std::path::Path;
use std::time::Duration;

use anyhow::Context as _;
use launch_cli::{Exit, Progress, Shutdown, wrong_usage};
use launch_run::Process;
use schema_bus::Bus;
use schema_recording::read::RecordingFile;

use crate::children;
use crate::cli::{Args, Then};
use crate::compare::{self, Difference, Sample};
use crate::live::Live;
use crate::plan::{added_sensors, simulator_args};
use crate::recorded::{Reader, Recorded};
use crate::report::{Report, WORLD, secs};
use crate::script::{self, Script};

/// How often the end of a run that was handed over is looked for.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// How the folders of runs in the folder for temporary files are called, before the process id.
const FOLDER: &str = "gantry-rerun-";
/// Steps of the progress bar.
const NANOS_PER_MS: u64 = 1_000_000;

/// Runs a recording again as the arguments ask.
///
/// # Errors
/// If it cannot be run again, or the new run ends early.
pub fn run(args: &Args, shutdown: &Shutdown) -> anyhow::Result<Exit> {
    let sensors = added_sensors(&args.sensor)?;
    let file = RecordingFile::open(&args.file)?;
    let folder =
        launch_run::domain::temporary_folder(FOLDER).context("cannot make a folder for the run")?;
    let script = script::read(&file, folder.path(), &args.command)?;
    let bus = Bus::open(&args.common.domain, "gantry-rerun")?;
    if bus.daemon_alive()? {
        return Err(wrong_usage(format!(
            "domain {0:?} already has a simulator or a replay; stop it, or choose another name with --domain",
            args.common.domain
        )));
    }
    let mut report = Report::default();
    let until_nanos = args
        .until
        .map_or(script.end_nanos, |until| until.min(script.end_nanos));
    if args.until.is_some_and(|until| until > script.end_nanos) {
        report.note(format!(
            "the recording ends at {}, so the run does too",
            secs(script.end_nanos)
        ));
    }
    let name = format!("gantry-rerun-{}", std::process::id());
    let recorder_name = format!("{name}-record");
    let plan = simulator_args(args, &script, &sensors, folder.path(), &mut report)?;
    let mut simulator = {
        let mut plan = plan;
        plan.extend(["--await-participant".into(), name.clone()]);
        if args.record.is_some() {
            plan.extend(["--await-participant".into(), recorder_name.clone()]);
        }
        if args.then != Then::Stop {
            plan.extend(["--journal-until".into(), until_nanos.to_string()]);
        } else {
            // The journal holds until this program ends the simulator.
            plan.extend(["--journal-until".into(), u64::MAX.to_string()]);
        }
        children::start("simd", &plan, &args.common)?
    };
    let mut recorder = match &args.record {
        Some(out) => Some(start_recorder(out, &recorder_name, args)?),
        None => None,
    };
    let Some(mut live) = Live::join(bus, &name, &script.topics, &mut simulator, shutdown)? else {
        return Ok(Exit::Done);
    };
    let made_later: Vec<&String> = script.made_at.values().flatten().collect();
    report.not_there = live
        .missing()
        .filter(|topic| !made_later.iter().any(|later| ***later == ***topic))
        .map(|topic| topic.to_string())
        .collect();
    let mut pair = Pair {
        script: &script,
        until_nanos,
        has_added: !sensors.is_empty(),
        reader: Reader::new(&file),
        is_complete: file.is_complete(),
        report,
    };
    let progress = Progress::steps(
        &args.common,
        "running again",
        until_nanos / NANOS_PER_MS,
        "ms of simulated time",
    );
    let is_whole = pair.run(
        &mut live,
        &mut simulator,
        &mut recorder,
        &progress,
        shutdown,
    )?;
    drop(progress);
    let mut report = pair.finish();
    report.close();
    print(&report, args.json)?;
    if is_whole && args.then != Then::Stop {
        live.leave();
        hand_over(args, &report, &mut simulator, shutdown)?;
    }
    // Readers end before what they read.
    if let Some(recorder) = &mut recorder {
        recorder.end()?;
    }
    drop(live);
    simulator.end()?;
    Ok(match report.is_equal {
        // A run that was broken off shows nothing about the rest.
        true if is_whole && report.is_undamaged => Exit::Done,
        true if is_whole => Exit::DataLost,
        _ => Exit::Failed,
    })
}

/// Both runs.
struct Pair<'a> {
    script: &'a Script,
    until_nanos: u64,
    has_added: bool,
    reader: Reader,
    is_complete: bool,
    report: Report,
}

impl Pair<'_> {
    /// Steps both to their end; `false` if this program is asked to end before.
    fn run(
        &mut self,
        live: &mut Live,
        simulator: &mut Process,
        recorder: &mut Option<Process>,
        progress: &Progress,
        shutdown: &Shutdown,
    ) -> anyhow::Result<bool> {
        let mut tick = 0;
        live.await_world(simulator, shutdown)?;
        self.compare(live, tick)?;
        self.await_topics(live, simulator, tick)?;
        live.acknowledge(tick)?;
        loop {
            let Some((next, sim_nanos)) = live.next_tick(tick, simulator, shutdown)? else {
                return Ok(false);
            };
            tick = next;
            self.report.end_nanos = sim_nanos;
            progress.set(sim_nanos / NANOS_PER_MS);
            self.compare(live, tick)?;
            let is_last = self.reader.is_at_end()
                || tick >= self.script.complete_to
                || sim_nanos >= self.until_nanos;
            if is_last {
                return Ok(true);
            }
            if let Some(recorder) = recorder {
                recorder.must_run_while("while it recorded the new run")?;
            }
            self.await_topics(live, simulator, tick)?;
            live.acknowledge(tick)?;
        }
    }

    /// Opens the topics of sensors that commands made behind this tick.
    fn await_topics(
        &mut self,
        live: &mut Live,
        simulator: &mut Process,
        tick: u64,
    ) -> anyhow::Result<()> {
        let Some(wanted) = self.script.made_at.get(&tick) else {
            return Ok(());
        };
        let missing = live.await_topics(wanted, simulator)?;
        self.report.not_there.extend(missing);
        Ok(())
    }

    /// Compares everything that was recorded up to `tick`.
    fn compare(&mut self, live: &mut Live, tick: u64) -> anyhow::Result<()> {
        let (report, has_added) = (&mut self.report, self.has_added);
        self.reader.up_to(tick, |recorded| {
            match recorded {
                Recorded::Snapshot { header, records } => {
                    let Some(now) = live.snapshot(header.tick) else {
                        return Ok(());
                    };
                    let before = Sample {
                        header: *header,
                        content: records,
                    };
                    let now = Sample {
                        header: now.header(),
                        content: now.records(),
                    };
                    let found = compare::snapshots(before, now, has_added);
                    report.saw(header.tick);
                    report
                        .topic(WORLD)
                        .count(header.tick, header.sim_nanos, found);
                }
                Recorded::Frame {
                    topic,
                    header,
                    payload,
                } => {
                    let is_read = live.reads(topic);
                    let of_topic = report.topic(topic);
                    let payload = match payload {
                        Ok(payload) => payload,
                        Err(error) => {
                            if of_topic.damaged == 0 {
                                tracing::warn!(
                                    topic,
                                    tick = header.tick,
                                    "a recorded frame cannot be compared: {error}; further ones are only counted"
                                );
                            }
                            of_topic.damaged += 1;
                            return Ok(());
                        }
                    };
                    let found = live.with_frame(topic, header.tick, |now, bytes| {
                        let before = Sample {
                            header: *header,
                            content: payload,
                        };
                        let now = Sample {
                            header: now,
                            content: bytes,
                        };
                        compare::frames(before, now)
                    });
                    match found {
                        Some(difference) => {
                            of_topic.count(header.tick, header.sim_nanos, difference)
                        }
                        None if is_read => {
                            of_topic.missing += 1;
                            let none = Difference::new("frame", "there", "not there");
                            of_topic.count(header.tick, header.sim_nanos, Some(none));
                        }
                        None => {}
                    }
                    report.saw(header.tick);
                }
            }
            Ok(())
        })
    }

    fn finish(self) -> Report {
        let mut report = self.report;
        let damage = self.reader.damage();
        report.is_undamaged = self.is_complete
            && damage.is_empty()
            && report.topics.values().all(|topic| topic.damaged == 0);
        for sentence in damage {
            report.note(format!("the recording is damaged: {sentence}"));
        }
        report
    }
}

fn start_recorder(out: &Path, name: &str, args: &Args) -> anyhow::Result<Process> {
    let words = [
        "--out".to_owned(),
        out.display().to_string(),
        format!("--lockstep={name}"),
    ];
    children::start("gantry-record", &words, &args.common)
}

fn print(report: &Report, json: bool) -> anyhow::Result<()> {
    let text = match json {
        true => serde_json::to_string(report)? + "\n",
        false => report.text(),
    };
    let mut stdout = std::io::stdout().lock();
    stdout.write_all(text.as_bytes())?;
    stdout.flush()?;
    Ok(())
}

/// Waits while the run is the user's.
fn hand_over(
    args: &Args,
    report: &Report,
    simulator: &mut Process,
    shutdown: &Shutdown,
) -> anyhow::Result<()> {
    let how = match args.then {
        Then::Stepped => "waits for cues",
        _ => "runs on in real time",
    };
    tracing::info!(
        "from {} on the run is yours and {how}: gantry view --domain {1}, gantry-drive --domain {1}, gantry record --domain {1}; Ctrl-C ends it",
        secs(report.end_nanos),
        args.common.domain
    );
    while !shutdown.wait(LOOK_EVERY) {
        if simulator.ended()?.is_some() {
            simulator.must_run_while("after it was handed over")?;
        }
    }
    Ok(())
}
