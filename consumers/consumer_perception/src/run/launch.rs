//! The launch file of one run: a replay or a simulator, and the program.

use std::fmt::Write as _;
use std::fs;

use anyhow::Context as _;
use schema_frames::{JournalHead, Seal};
use schema_recording::journal::Piece;
use schema_recording::read::{RecordingFile, TopicKind, What};
use toml::{Table, Value};

use super::job::{Drive, Job, Source, drive_recording};
use crate::suite::ProgramProcess;
use crate::up::{cores, process_table};

/// Name of the process that publishes the world.
pub(super) const WORLD: &str = "world";
/// Name of the sensor that feels collisions of a program that drives.
const COLLISIONS: &str = "bench_collision";
/// Name of the sensor that stands for the vehicle in the recording of such a run.
const MOTION: &str = "bench_motion";
/// Seconds beyond the suite's own limit after which the replay drops an idle participant.
const SLACK_S: f64 = 5.0;

/// The launch file of a run.
///
/// # Errors
/// If the journal of a run that is to be simulated again cannot be read.
pub(super) fn launch(job: &Job<'_>, inputs: &[String]) -> anyhow::Result<Table> {
    let mut launch = Table::new();
    let words = match job.options.source {
        _ if job.suite.is_closed_loop() => {
            launch = job
                .truth
                .scenario
                .launch(job.suite)
                .map_err(launch_cli::wrong_usage)?;
            closed_loop(job, &mut launch)
        }
        Source::Replay => replay(job, inputs),
        Source::Live => {
            let (words, recorded) = simulator(job, inputs)?;
            launch = recorded;
            words
        }
    };
    launch.insert("version".into(), Value::Integer(1));
    let words = words.into_iter().map(Value::String).collect();
    let ready = [("service".to_owned(), Value::from("world/snapshot"))];
    let mut world: Table = [
        ("cmd", Value::Array(words)),
        ("ready", Value::Table(ready.into_iter().collect())),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .into_iter()
    .collect();
    if !job.options.cores_world.is_empty() {
        world.insert("cores".into(), cores(&job.options.cores_world));
    }
    let mut processes = Table::new();
    processes.insert(WORLD.into(), world.into());
    for process in &job.program.processes {
        let joins = process.lockstep && job.drive.is_in_lockstep();
        let mut table = process_table(process, joins, &[WORLD]);
        if process.cores.is_empty() && !job.options.cores_program.is_empty() {
            table.insert("cores".into(), cores(&job.options.cores_program));
        }
        processes.insert(process.name.clone(), table.into());
    }
    if job.suite.is_closed_loop() {
        let recorder = vec![
            "gantry-record".to_owned(),
            "--out".into(),
            drive_recording(job).display().to_string(),
            "--previews".into(),
            "none".into(),
            "--topics".into(),
            format!("ego/{COLLISIONS}/*"),
            format!("ego/{MOTION}/*"),
        ];
        processes.insert("record".into(), beside(job, recorder).into());
        if job.suite.drive {
            let driver = ["gantry-drive", "--vehicles", "others"].map(str::to_owned);
            processes.insert("drive".into(), beside(job, driver.into()).into());
        }
    }
    launch.insert("process".into(), processes.into());
    Ok(launch)
}

/// A program of Gantry's beside the simulator, which waits for it in lockstep.
fn beside(job: &Job<'_>, words: Vec<String>) -> Table {
    let words = words.into_iter().map(Value::String).collect();
    let mut table: Table = [
        ("cmd", Value::Array(words)),
        ("after", Value::Array(vec![WORLD.into()])),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .into_iter()
    .collect();
    if job.drive.is_in_lockstep() {
        table.insert("lockstep".into(), true.into());
    }
    table
}

/// The command of a simulator in which the program drives the ego vehicle, whose collisions are
/// felt.
fn closed_loop(job: &Job<'_>, launch: &mut Table) -> Vec<String> {
    if let Some(scenario) = launch.get_mut("scenario").and_then(Value::as_table_mut) {
        scenario.insert("mode".into(), "free_running".into());
    }
    if let Some(sensors) = launch.get_mut("sensor").and_then(Value::as_table_mut) {
        let collisions = [("kind".to_owned(), Value::from("collision"))];
        let collisions: Table = collisions.into_iter().collect();
        sensors.insert(COLLISIONS.into(), collisions.into());
        // Collisions may never come, and a recording needs a sensor that tells which vehicle it is.
        let motion = [("kind".to_owned(), Value::from("imu"))];
        let motion: Table = motion.into_iter().collect();
        sensors.insert(MOTION.into(), motion.into());
    }
    let mut words = ["simd", "--await-participant", "bench"]
        .map(str::to_owned)
        .to_vec();
    if let Some(adapter) = &job.options.adapter {
        words.extend(["--adapter".into(), adapter.clone()]);
    }
    if job.drive.is_in_lockstep() {
        words.push("--unpaced".into());
    }
    words
}

/// What the program is shown of the world besides its inputs, and who commands: this process.
fn seal(job: &Job<'_>, inputs: &[String]) -> Seal {
    let joins = |process: &&ProgramProcess| process.lockstep && job.drive.is_in_lockstep();
    let participants = job.program.processes.iter().filter(joins);
    Seal {
        owner_pid: std::process::id(),
        participants: participants.map(|process| process.name.clone()).collect(),
        topics: inputs.to_vec(),
        exact_topics: job.suite.exact_inputs.clone(),
    }
}

/// The command of a replay that stands still until it is told to begin.
fn replay(job: &Job<'_>, inputs: &[String]) -> Vec<String> {
    let truth = job.truth;
    let mut words = vec![
        "gantry-replay".to_owned(),
        truth.path.display().to_string(),
        "--paused".into(),
    ];
    match job.drive {
        Drive::Offline | Drive::Single { .. } => words.extend(["--rate".into(), "max".into()]),
        Drive::Streaming { speed } | Drive::Constant { speed, .. } => {
            words.extend(["--rate".into(), speed.to_string()]);
        }
    }
    words.push(match job.drive.n_frames() {
        Some(_) => "--loop".into(),
        None => "--hold".into(),
    });
    if job.drive.is_in_lockstep() {
        let secs = (job.suite.answer_within_s + SLACK_S).ceil();
        words.extend(["--lockstep-timeout".into(), secs.to_string()]);
    }
    let of_programs = |topic: &&String| {
        let input = truth.inputs.iter().find(|input| input.topic == **topic);
        input.is_some_and(|input| input.sensor.is_empty())
    };
    words.extend(["--sealed".into(), seal(job, inputs).to_json()]);
    words.push("--results".into());
    let results: Vec<String> = inputs.iter().filter(of_programs).cloned().collect();
    match results.is_empty() {
        true => words.push("none".into()),
        false => words.extend(results),
    }
    // Last, because it takes all words behind it.
    words.push("--topics".into());
    words.extend(inputs.iter().cloned());
    words
}

/// The command of a simulator that runs the recorded run again, and the launch file of that run.
fn simulator(job: &Job<'_>, inputs: &[String]) -> anyhow::Result<(Vec<String>, Table)> {
    let (head, lines) = journal(job)?;
    fs::create_dir_all(job.folder)
        .with_context(|| format!("cannot make the folder {}", job.folder.display()))?;
    let path = job.folder.join("journal.jsonl");
    fs::write(&path, lines).with_context(|| format!("cannot write {}", path.display()))?;
    let mut launch: Table = head
        .launch
        .parse()
        .context("the recording's launch file cannot be read")?;
    launch.remove("process");
    if let Some(scenario) = launch.get_mut("scenario").and_then(Value::as_table_mut) {
        scenario.insert("mode".into(), "free_running".into());
    }
    let mut words: Vec<String> = [
        "simd",
        "--journal",
        &path.display().to_string(),
        "--journal-until",
        &job.truth.end_nanos.to_string(),
        "--quality",
        &head.quality,
        "--lidars-on",
        &head.lidars_on,
        "--await-participant",
        "bench",
        "--sealed",
        &seal(job, inputs).to_json(),
    ]
    .map(str::to_owned)
    .into();
    if let Some(adapter) = &job.options.adapter {
        words.extend(["--adapter".into(), adapter.clone()]);
    }
    if job.drive.is_in_lockstep() {
        words.push("--unpaced".into());
    }
    for name in &head.added_sensors {
        words.extend(["--added-sensor".into(), name.clone()]);
    }
    Ok((words, launch))
}

/// What the recorded run began with, and everything that acted on it, as lines for the simulator.
fn journal(job: &Job<'_>) -> anyhow::Result<(JournalHead, String)> {
    let shown = job.truth.path.display();
    let file = RecordingFile::open(&job.truth.path)?;
    let mut samples = file.samples_of((0, u64::MAX), |topic| topic.kind == TopicKind::Journal);
    let (mut lines, mut head, mut last) = (String::new(), None, 0);
    while let Some(sample) = samples.next()? {
        let What::Journal { text } = sample.what else {
            continue;
        };
        let piece: Piece = serde_json::from_str(text)
            .with_context(|| format!("the journal of {shown} cannot be read"))?;
        if let (None, Some(found)) = (&head, piece.head) {
            writeln!(lines, "{}", serde_json::to_string(&found)?)?;
            head = Some(found);
        }
        for entry in piece.entries {
            if entry.n <= last {
                continue;
            }
            anyhow::ensure!(
                entry.n == last + 1 && head.is_some(),
                "{shown} cannot be simulated again: its journal lacks entries; show it with --source replay"
            );
            last = entry.n;
            writeln!(lines, "{}", serde_json::to_string(&entry)?)?;
        }
    }
    let head = head.with_context(|| {
        format!(
            "{shown} cannot be simulated again: it has no journal; show it with --source replay"
        )
    })?;
    Ok((head, lines))
}
