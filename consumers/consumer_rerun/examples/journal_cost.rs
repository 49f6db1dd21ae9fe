//! What the journal costs: round trips to a daemon that waits for cues, with and without it, taken in
//! turns.
//!
//!     simd --set 'scenario.mode="stepped"' --domain bench &
//!     cargo run --release --example journal_cost -- bench 20000

use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use schema_bus::{Bus, CommandClient};
use schema_frames::{Command, CommandBatch, CommandReply};

/// How long an answer may take.
const PATIENCE: Duration = Duration::from_secs(10);

fn main() -> anyhow::Result<()> {
    let mut args = std::env::args().skip(1);
    let domain = args.next().context("the domain is missing")?;
    let n: usize = args
        .next()
        .context("the number of rounds is missing")?
        .parse()?;
    let bus = Bus::open(&domain, "journal-cost")?;
    let mut client = bus.command_client("journal-cost")?;
    let (_, mut after) = ask(&mut client, Command::Journal { after: 0 })?;
    let names = [
        "ping",
        "journal, nothing new",
        "clear_debug (noted)",
        "journal, one entry",
    ];
    let mut times: [Vec<f64>; 4] = Default::default();
    for _ in 0..n {
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
    for (name, times) in names.iter().zip(&mut times) {
        times.sort_by(f64::total_cmp);
        let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
        println!(
            "| {name} | {:.1} µs | {:.1} µs | {:.0} µs |",
            at(0.5),
            at(0.99),
            at(1.0)
        );
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
