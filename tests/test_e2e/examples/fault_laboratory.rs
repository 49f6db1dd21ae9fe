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
use std::path::Path;
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use launch_cli::bench::{BenchResult, take_json_argument};
use nix::sys::signal::Signal;
use test_e2e::laboratory::table::Blow;
use test_e2e::laboratory::{Tally, Violation, run_episode};

const ALLOWED: &str = "--seed N, --minutes M, --episodes E, --steps S, --beside B, --json FILE and --go-on (after a violation)";

const BLOWS: [Blow; 6] = [
    Blow::Signal(Signal::SIGKILL),
    Blow::Signal(Signal::SIGSTOP),
    Blow::Signal(Signal::SIGTERM),
    Blow::Signal(Signal::SIGSEGV),
    Blow::Interrupt,
    Blow::Delay,
];

/// What is known of all episodes that have ended.
struct Found {
    tally: Tally,
    n_begun: u64,
    n_violations: u64,
}

fn main() -> ExitCode {
    let mut seed = fastrand::u64(0..1_000_000_000);
    let (mut minutes, mut n_episodes, mut n_steps, mut beside) = (10.0, u64::MAX, 12, 1);
    let mut goes_on = false;
    let (words, json) = take_json_argument(std::env::args().skip(1));
    let mut words = words.iter().map(String::as_str);
    while let Some(word) = words.next() {
        let mut number = || -> u64 {
            let text = words.next().unwrap_or_default();
            let parsed = text.parse();
            parsed.unwrap_or_else(|_| panic!("{word} takes a whole number, not {text:?}"))
        };
        match word {
            "--seed" => seed = number(),
            "--minutes" => minutes = number() as f64,
            "--episodes" => (n_episodes, minutes) = (number(), f64::INFINITY),
            "--steps" => n_steps = number() as usize,
            "--beside" => beside = number().clamp(1, 64),
            "--go-on" => goes_on = true,
            _ => panic!("unknown argument {word:?}; allowed are {ALLOWED}"),
        }
    }
    println!("first seed {seed}");
    // A violation is told at the end of its episode, with its story.
    std::panic::set_hook(Box::new(|_| {}));
    let began = Instant::now();
    let found = Mutex::new(Found {
        tally: Tally::default(),
        n_begun: 0,
        n_violations: 0,
    });
    let next = || -> Option<u64> {
        let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
        let is_over = found.n_begun >= n_episodes
            || began.elapsed().as_secs_f64() >= minutes * 60.0
            || (found.n_violations > 0 && !goes_on);
        found.n_begun += u64::from(!is_over);
        (!is_over).then(|| seed + found.n_begun - 1)
    };
    std::thread::scope(|scope| {
        for _ in 0..beside {
            scope.spawn(|| {
                while let Some(of) = next() {
                    let mut tally = Tally::default();
                    let ended = run_episode(of, n_steps, &mut tally);
                    let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
                    found.tally.add_all(&tally);
                    tell(&mut found, of, ended, began.elapsed(), json.as_deref());
                }
            });
        }
    });
    let found = found.into_inner().unwrap_or_else(PoisonError::into_inner);
    ExitCode::from(u8::from(found.n_violations > 0))
}

/// Prints how an episode ended, and writes what all have done until then, so that a run that is
/// broken off has its figures.
fn tell(
    found: &mut Found,
    of: u64,
    ended: Result<(), Violation>,
    elapsed: Duration,
    json: Option<&Path>,
) {
    if let Err(violation) = ended {
        println!("{violation}");
        found.n_violations += 1;
    }
    let (total, took) = (found.tally.total(), Duration::from_secs(elapsed.as_secs()));
    println!(
        "episode {of} ended; {} faults, {} of them exactly at their moment, {} violations, {took:?}",
        total.n_faults, total.n_at_their_moment, found.n_violations
    );
    let written = figures(found, elapsed).write(json);
    written.unwrap_or_else(|error| panic!("{error:#}"));
}

/// A row for each process and moment, with how often it was struck by what, and one for all.
fn figures(found: &Found, elapsed: Duration) -> BenchResult {
    let mut result = BenchResult::new("fault_laboratory", None);
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
    result
}
