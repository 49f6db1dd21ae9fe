//! What the journal costs: round trips to a daemon that waits for cues, with and without it, taken in
//! turns.
//!
//!     simd --set 'scenario.mode="stepped"' --domain bench &
//!     cargo run --release --example journal_cost -- bench 20000

use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::bail;
use launch_cli::bench::{self, BenchResult, Samples, clap};
use schema_bus::{Bus, CommandClient};
use schema_frames::{Command, CommandBatch, CommandReply};

/// How long an answer may take.
const PATIENCE: Duration = Duration::from_secs(10);

/// Times round trips to a daemon that keeps a journal
#[derive(Debug, clap::Args)]
struct Args {
    domain: String,
    rounds: usize,
}

fn main() -> ExitCode {
    bench::run("journal_cost", measure)
}

fn measure(args: &Args, result: &mut BenchResult) -> anyhow::Result<()> {
    let bus = Bus::open(&args.domain, "journal-cost")?;
    let mut client = bus.command_client("journal-cost")?;
    let (_, mut after) = ask(&mut client, Command::Journal { after: 0 })?;
    let names = [
        "ping",
        "journal, nothing new",
        "clear_debug (noted)",
        "journal, one entry",
    ];
    let mut times: [Vec<f64>; 4] = Default::default();
    for _ in 0..args.rounds {
        let questions = [
            Command::Ping,
            Command::Journal { after },
            Command::ClearDebug {
                what: Default::default(),
            },
            Command::Journal { after },
        ];
        for (idx, question) in questions.into_iter().enumerate() {
            let (took, next) = ask(&mut client, question)?;
            times[idx].push(took.as_secs_f64() * 1e6);
            after = after.max(next);
        }
    }
    println!("| request | p50 | p99 | max |\n|---|---|---|---|");
    for (name, times) in names.into_iter().zip(times) {
        let times: Samples = times.into_iter().collect();
        let [p50, p99, max] = [0.5, 0.99, 1.0].map(|share| times.at(share));
        println!("| {name} | {p50:.1} µs | {p99:.1} µs | {max:.0} µs |");
        result.row(name, &[("p50_us", p50), ("p99_us", p99), ("max_us", max)]);
    }
    Ok(())
}

/// How long an answer takes, and what to ask the journal for next.
fn ask(client: &mut CommandClient, command: Command) -> anyhow::Result<(Duration, u64)> {
    let batch = CommandBatch::new(vec![command]);
    let start = Instant::now();
    let answer = client.request(&batch, PATIENCE)?;
    let took = start.elapsed();
    match answer.replies.first() {
        Some(CommandReply::Journal { next, .. }) => Ok((took, *next)),
        Some(CommandReply::Refused { error }) => bail!("{error}"),
        _ => Ok((took, 0)),
    }
}
