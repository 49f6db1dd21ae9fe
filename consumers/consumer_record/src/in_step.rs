//! The recorder in lockstep: the simulator waits until everything of a tick is queued.

use std::time::Duration;

use consumer_kit::Lockstep;
use schema_bus::{Bus, CommandClient, Listener, names};

use crate::documents::Run;
use crate::journal::Journal;
use crate::sink::Sink;

/// How long the daemon may take to answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);

/// Membership in lockstep, and the client that tells when a tick is complete.
pub(crate) struct InStep {
    gate: Lockstep,
    barrier: CommandClient,
    wake: Listener,
    acked: u64,
}

impl InStep {
    /// Joins as `name`; all topics must be open before, else the first tick would be missed.
    pub(crate) fn join(bus: &Bus, name: &str, client: &str) -> anyhow::Result<InStep> {
        let gate = Lockstep::join(bus, name, ANSWER_TIMEOUT)?;
        tracing::info!(
            first_tick = gate.first_tick(),
            "in lockstep: the simulator waits for this recorder"
        );
        Ok(InStep {
            acked: gate.first_tick().saturating_sub(1),
            gate,
            barrier: bus.command_client(client)?,
            wake: bus.listener(names::WORLD_SNAPSHOT)?,
        })
    }

    /// Epoch of the simulator that it takes part in.
    pub(crate) fn epoch(&self) -> u64 {
        self.gate.epoch()
    }

    /// Waits for the next snapshot, with which a tick begins.
    pub(crate) fn wait(&self, timeout: Duration) -> anyhow::Result<()> {
        self.wake.wait(timeout)?;
        Ok(())
    }

    /// Whether `tick` is to be acknowledged and all of it was sent: once the daemon answers with
    /// tick N or later, all frames of tick N were sent. What is asked is the run's journal, so that
    /// it is complete up to every tick.
    pub(crate) fn is_complete(
        &mut self,
        tick: u64,
        journal: &mut Journal,
        run: Run,
        sink: &mut Sink,
    ) -> anyhow::Result<bool> {
        if tick <= self.acked {
            return Ok(false);
        }
        loop {
            match self.barrier.request(&journal.question(), ANSWER_TIMEOUT) {
                Ok(answer) => {
                    if !journal.take(&answer, run, sink)? {
                        return Ok(answer.tick >= tick);
                    }
                }
                Err(error) => {
                    tracing::warn!(%error, tick, "cannot learn whether the tick is complete, asking again");
                    return Ok(false);
                }
            }
        }
    }

    /// Acknowledges a tick.
    pub(crate) fn ack(&mut self, tick: u64) -> anyhow::Result<()> {
        self.gate.ack(tick)?;
        self.acked = tick;
        Ok(())
    }
}
