//! `gantry-bench lockstep`: ticks per second with programs in lockstep. It starts a `simd` of its
//! own with a car and no sensors, so that nothing but waiting for the participants is measured;
//! each participant acknowledges a tick as soon as it is told that it is complete.

use std::io::{BufRead as _, BufReader};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, ensure};
use consumer_kit::Steps;
use launch_cli::{Exit, Machine, bench};
use schema_bus::Bus;
use serde::Serialize;

use crate::output;
use crate::part::{Parent, Part};

/// Longest wait for a tick, after which a participant looks whether it is to end.
const LOOK_EVERY: Duration = Duration::from_millis(50);

#[derive(Debug, clap::Args)]
pub struct LockstepArgs {
    /// Numbers of participants
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "1,2,4,8", value_parser = clap::value_parser!(u16).range(1..=32))]
    participants: Vec<u16>,

    /// Ticks of a turn
    #[arg(long, value_name = "N", default_value_t = 2000)]
    ticks: u64,

    /// Turns: every number of participants is measured once in each
    #[arg(long, value_name = "N", default_value_t = 3)]
    turns: u32,

    /// Write the table as JSON too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Arguments of one participant.
#[derive(Debug, clap::Args)]
pub struct ParticipantArgs {
    /// Name in lockstep
    #[arg(long)]
    name: String,
}

#[derive(Debug, Serialize)]
struct Row {
    name: String,
    n_participants: u16,
    ticks_per_sec: Vec<f64>,
    /// Median of the turns.
    ticks_per_sec_p50: f64,
}

#[derive(Debug, Serialize)]
struct Report {
    bench: &'static str,
    machine: Machine,
    n_ticks: u64,
    rows: Vec<Row>,
}

/// Measures every number by turns, 0 first, and prints one table.
pub fn run(args: &LockstepArgs) -> anyhow::Result<Exit> {
    let machine = Machine::read();
    println!("{}", machine.heading());
    let numbers: Vec<u16> = std::iter::once(0)
        .chain(args.participants.iter().copied())
        .collect();
    let mut rates: Vec<Vec<f64>> = vec![Vec::new(); numbers.len()];
    for turn in 0..args.turns {
        for (n, rates) in numbers.iter().zip(&mut rates) {
            rates.push(one_turn(*n, turn, args.ticks)?);
        }
    }
    let row = |(n, ticks_per_sec): (u16, Vec<f64>)| {
        let mut sorted = ticks_per_sec.clone();
        sorted.sort_by(f64::total_cmp);
        Row {
            name: format!("{n} participants"),
            n_participants: n,
            ticks_per_sec_p50: sorted[sorted.len() / 2],
            ticks_per_sec,
        }
    };
    let report = Report {
        bench: "lockstep",
        machine,
        n_ticks: args.ticks,
        rows: numbers.into_iter().zip(rates).map(row).collect(),
    };
    let cells = |row: &Row| {
        let all: Vec<String> = row
            .ticks_per_sec
            .iter()
            .map(|it| format!("{it:.0}"))
            .collect();
        vec![
            row.n_participants.to_string(),
            format!("{:.0}", row.ticks_per_sec_p50),
            all.join(" "),
        ]
    };
    let rows: Vec<Vec<String>> = report.rows.iter().map(cells).collect();
    print!(
        "{}",
        output::table(&["participants", "ticks/s", "turns"], &rows)
    );
    bench::write_json(args.json.as_deref(), &report)?;
    Ok(Exit::Done)
}

/// Ticks per second of one run, from the first tick to the last.
fn one_turn(n: u16, turn: u32, ticks: u64) -> anyhow::Result<f64> {
    let domain = format!("bench{}-{turn}-{n}", std::process::id());
    let own = std::env::current_exe().context("cannot find this program's file")?;
    let simd = own.with_file_name("simd");
    ensure!(
        simd.exists(),
        "there is no simd beside {}; build it with cargo build --release --workspace",
        own.display()
    );
    let launch = tempfile::Builder::new().suffix(".toml").tempfile()?;
    std::fs::write(launch.path(), LAUNCH)?;
    let (ticks_word, n_word) = (ticks.to_string(), n.to_string());
    let mut child = Command::new(simd)
        .arg("--launch")
        .arg(launch.path())
        .args(["--domain", &domain, "--unpaced", "--ticks", &ticks_word])
        .args(["--await-lockstep", &n_word])
        .stderr(Stdio::piped())
        .spawn()
        .context("cannot start simd")?;
    let mut lines =
        BufReader::new(child.stderr.take().expect("stderr is a pipe, see above")).lines();
    let ready = lines
        .by_ref()
        .map_while(Result::ok)
        .any(|line| line.contains("ready"));
    ensure!(ready, "simd ended before it was ready");
    let began = Instant::now();
    let mut parts = Vec::new();
    for i in 0..n {
        let name = format!("participant{i}");
        parts.push(Part::start(&[
            "lockstep-participant",
            "--domain",
            &domain,
            "--name",
            &name,
        ])?);
    }
    // The first tick begins when the last participant has joined.
    let began = if n == 0 { began } else { Instant::now() };
    for line in lines.map_while(Result::ok) {
        if line.contains("ERROR") {
            eprintln!("{line}");
        }
    }
    let status = child.wait()?;
    let secs = began.elapsed().as_secs_f64();
    ensure!(status.success(), "simd failed with {status}");
    for part in parts {
        let _n_steps: u64 = part.finish()?;
    }
    Ok(ticks as f64 / secs)
}

const LAUNCH: &str =
    "version = 1\n[scenario]\nmap = \"Town01\"\nseed = 1\ntick_hz = 20\nvehicles = 1\n";

/// One participant.
pub fn participant(args: &ParticipantArgs, domain: &str) -> anyhow::Result<Exit> {
    let bus = Bus::open(domain, &args.name)?;
    let mut steps = Steps::join_on(&bus, &args.name, Duration::from_secs(60))?;
    let parent = Parent::tell_ready()?;
    let mut n_steps = 0u64;
    while !parent.is_over() {
        n_steps += u64::from(steps.next(&bus, LOOK_EVERY)?.is_some());
    }
    parent.answer(&n_steps)?;
    Ok(Exit::Done)
}
