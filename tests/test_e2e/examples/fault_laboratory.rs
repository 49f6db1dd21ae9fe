//! The fault laboratory for minutes or hours.
//!
//! `cargo run --release -p test_e2e --example fault_laboratory -- [--seed N] [--minutes M |
//! --episodes E] [--steps S] [--beside B] [--go-on] [--json FILE]` (`./gantry soak --faults` runs
//! it): episodes with the seeds N, N+1, … until the time is over or a violation is found, which is
//! printed with the seed that repeats it. Without `--seed` the first seed is drawn and printed. With
//! `--beside` so many episodes run beside one another, each with processes of its own: most of an
//! episode is spent waiting. FILE gets how often each process was struck by what at which moment.
//! Exit code 1 means a violation.

use std::collections::BTreeMap;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use launch_cli::bench::{self, BenchResult, anyhow, clap};
use nix::sys::signal::Signal;
use parking_lot::Mutex;
use test_e2e::laboratory::table::Blow;
use test_e2e::laboratory::{Tally, Violation, run_episode};

const BLOWS: [Blow; 6] = [
    Blow::Signal(Signal::SIGKILL),
    Blow::Signal(Signal::SIGSTOP),
    Blow::Signal(Signal::SIGTERM),
    Blow::Signal(Signal::SIGSEGV),
    Blow::Interrupt,
    Blow::Delay,
];

/// What is known of all episodes that have ended.
struct Found<'a> {
    tally: Tally,
    n_begun: u64,
    n_violations: u64,
    /// Rows of all episodes until now.
    result: &'a mut BenchResult,
}

/// Strikes processes at chosen moments
#[derive(Debug, clap::Args)]
struct Args {
    /// First seed [default: drawn and printed]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Minutes after which no episode begins
    #[arg(long, value_name = "M", default_value_t = 10)]
    minutes: u64,
    /// Episodes, in place of a time
    #[arg(long, value_name = "E")]
    episodes: Option<u64>,
    /// Steps of an episode
    #[arg(long, value_name = "S", default_value_t = 12)]
    steps: usize,
    /// Episodes beside one another, at most 64
    #[arg(long, value_name = "B", default_value_t = 1)]
    beside: u64,
    /// Go on after a violation
    #[arg(long)]
    go_on: bool,
}

fn main() -> ExitCode {
    bench::run("fault_laboratory", |args: &Args, result| {
        let n_violations = strike(args, result)?;
        anyhow::ensure!(n_violations == 0, "{n_violations} violations");
        Ok(())
    })
}

/// Runs the episodes; how many rules were broken.
fn strike(args: &Args, result: &mut BenchResult) -> anyhow::Result<u64> {
    let seed = args.seed.unwrap_or_else(|| fastrand::u64(0..1_000_000_000));
    let minutes = match args.episodes {
        Some(_) => f64::INFINITY,
        None => args.minutes as f64,
    };
    let n_episodes = args.episodes.unwrap_or(u64::MAX);
    println!("first seed {seed}");
    // A violation is told at the end of its episode, with its story.
    std::panic::set_hook(Box::new(|_| {}));
    let began = Instant::now();
    let found = Mutex::new(Found {
        tally: Tally::default(),
        n_begun: 0,
        n_violations: 0,
        result,
    });
    let next = || -> Option<u64> {
        let mut found = found.lock();
        let is_over = found.n_begun >= n_episodes
            || began.elapsed().as_secs_f64() >= minutes * 60.0
            || (found.n_violations > 0 && !args.go_on);
        found.n_begun += u64::from(!is_over);
        (!is_over).then(|| seed + found.n_begun - 1)
    };
    std::thread::scope(|scope| {
        for _ in 0..args.beside.clamp(1, 64) {
            scope.spawn(|| {
                while let Some(of) = next() {
                    let mut tally = Tally::default();
                    let ended = run_episode(of, args.steps, &mut tally);
                    let mut found = found.lock();
                    found.tally.add_all(&tally);
                    tell(&mut found, of, ended, began.elapsed());
                }
            });
        }
    });
    let found = found.into_inner();
    Ok(found.n_violations)
}

/// Prints how an episode ended, and writes what all have done until then, so that a run that is
/// broken off has its figures.
fn tell(found: &mut Found<'_>, of: u64, ended: Result<(), Violation>, elapsed: Duration) {
    if let Err(violation) = ended {
        println!("{violation}");
        found.n_violations += 1;
    }
    let (total, took) = (found.tally.total(), Duration::from_secs(elapsed.as_secs()));
    println!(
        "episode {of} ended; {} faults, {} of them exactly at their moment, {} violations, {took:?}",
        total.n_faults, total.n_at_their_moment, found.n_violations
    );
    figures(found, elapsed);
    let written = found.result.write();
    written.unwrap_or_else(|error| panic!("{error:#}"));
}

/// A row for each process and moment, with how often it was struck by what, and one for all.
fn figures(found: &mut Found<'_>, elapsed: Duration) {
    let result = &mut *found.result;
    result.clear();
    let mut rows: BTreeMap<String, BTreeMap<String, f64>> = BTreeMap::new();
    for (fault, count) in found.tally.faults() {
        let place = format!("{:?}, {:?}", fault.role, fault.moment);
        for row in [place, "all".to_owned()] {
            let row = rows.entry(row).or_insert_with(|| {
                let blows = BLOWS.map(|blow| (blow.to_string(), 0.0));
                blows.into_iter().collect()
            });
            let mut add = |name: &str, n: u64| {
                *row.entry(name.to_owned()).or_default() += n as f64;
            };
            add(&fault.blow.to_string(), count.n_faults);
            add("faults", count.n_faults);
            add("at_their_moment", count.n_at_their_moment);
        }
    }
    if let Some(all) = rows.get_mut("all") {
        all.insert("episodes".into(), found.tally.n_episodes as f64);
        all.insert("violations".into(), found.n_violations as f64);
        all.insert("minutes".into(), (elapsed.as_secs_f64() / 60.0).round());
    }
    for (name, row) in &rows {
        let row: Vec<(&str, f64)> = row.iter().map(|(key, n)| (key.as_str(), *n)).collect();
        result.row(name, &row);
    }
}
