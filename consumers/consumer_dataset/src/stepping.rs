//! Stepping a simulator that waits for its cues, while somebody looks after the processes that take
//! part.

use std::time::{Duration, Instant};

use schema_bus::CommandClient;
use schema_frames::{Command, CommandBatch, CommandReply};

/// Pause between two looks at a simulator or at a process.
pub const ASK_EVERY: Duration = Duration::from_millis(20);
/// Longest wait for an answer before the processes are looked at again.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(1);

/// The user asked to stop.
#[derive(Debug)]
pub struct Stopped;

impl std::fmt::Display for Stopped {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.write_str("stopped")
    }
}

impl std::error::Error for Stopped {}

/// The last finished tick, if the simulator answers.
fn tick(client: &mut CommandClient) -> Option<u64> {
    let ping = CommandBatch::new(vec![Command::Ping]);
    let answer = client.request(&ping, ANSWER_TIMEOUT).ok()?;
    Some(answer.tick)
}

/// Waits until the simulator answers; its last finished tick. `look` looks after the processes,
/// pauses, and gives up by its error; it is told since when nothing has happened.
///
/// # Errors
/// Those of `look`.
pub fn wait_for_daemon(
    client: &mut CommandClient,
    look: &mut dyn FnMut(Instant) -> anyhow::Result<()>,
) -> anyhow::Result<u64> {
    let start = Instant::now();
    loop {
        match tick(client) {
            Some(tick) => return Ok(tick),
            None => look(start)?,
        }
    }
}

/// Lets `n` ticks pass; the simulator has `stall` to accept the cue. `progress` is told each tick
/// that was seen to be done.
///
/// # Errors
/// Those of `look`, see [`wait_for_daemon`], and if somebody else steps the simulator.
pub fn step(
    client: &mut CommandClient,
    n: u64,
    stall: Duration,
    look: &mut dyn FnMut(Instant) -> anyhow::Result<()>,
    progress: &dyn Fn(u64),
) -> anyhow::Result<()> {
    let first = wait_for_daemon(client, look)?;
    let last = first + n;
    let cue = CommandBatch::new(vec![Command::Step { n }]);
    let answer = client.request(&cue, stall)?;
    match answer.replies.first() {
        Some(CommandReply::Stepping { last_tick }) if *last_tick == last => {}
        other => anyhow::bail!(
            "the simulator was to step to tick {last} and answered {other:?}; somebody else steps it"
        ),
    }
    let (mut done, mut since) = (first, Instant::now());
    while done < last {
        look(since)?;
        if let Some(tick) = tick(client).filter(|tick| *tick > done) {
            (done, since) = (tick, Instant::now());
            progress(done);
        }
    }
    Ok(())
}
