//! Stepping a simulator that waits for its cues, while somebody looks after the processes that take
//! part.

use std::time::{Duration, Instant};

use schema_bus::CommandClient;
use schema_frames::{Command, CommandBatch, CommandReply};

use crate::error::RunError;
use crate::watch::Watch;

/// Longest wait for an answer before the processes are looked at again.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(1);

/// The last finished tick, if the simulator answers.
fn tick(client: &mut CommandClient) -> Option<u64> {
    let ping = CommandBatch::new(vec![Command::Ping]);
    let answer = client.request(&ping, ANSWER_TIMEOUT).ok()?;
    Some(answer.tick)
}

/// Waits until the simulator answers; its last finished tick. It has `stall`.
///
/// # Errors
/// Those of [`Watch::rest`].
pub fn await_simulator(
    client: &mut CommandClient,
    stall: Duration,
    watch: &mut Watch<'_>,
) -> Result<u64, RunError> {
    let start = Instant::now();
    loop {
        match tick(client) {
            Some(tick) => return Ok(tick),
            None => watch.rest(start, stall)?,
        }
    }
}

/// Lets `n` ticks pass; the simulator has `stall` to accept the cue, and for each tick. `progress`
/// is told each tick that was seen to be done.
///
/// # Errors
/// Those of [`Watch::rest`], and if somebody else steps the simulator.
pub fn step(
    client: &mut CommandClient,
    n: u64,
    stall: Duration,
    watch: &mut Watch<'_>,
    progress: &dyn Fn(u64),
) -> Result<(), RunError> {
    let first = await_simulator(client, stall, watch)?;
    let last = first + n;
    let cue = CommandBatch::new(vec![Command::Step { n }]);
    let answer = client.request(&cue, stall)?;
    match answer.replies.first() {
        Some(CommandReply::Stepping { last_tick }) if *last_tick == last => {}
        other => {
            return Err(RunError::OtherStepper {
                tick: last,
                answer: format!("{other:?}"),
            });
        }
    }
    let (mut done, mut since) = (first, Instant::now());
    while done < last {
        watch.rest(since, stall)?;
        if let Some(tick) = tick(client).filter(|tick| *tick > done) {
            (done, since) = (tick, Instant::now());
            progress(done);
        }
    }
    Ok(())
}
