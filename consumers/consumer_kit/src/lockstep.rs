//! Takes part in lockstep: the daemon begins tick N + 1 only after every participant has
//! acknowledged tick N.

use std::time::{Duration, Instant};

use schema_bus::{AckWriter, Bus, BusError, CommandClient, CommandError, CompleteReader, names};
use schema_frames::{Command, CommandBatch, CommandReply, ReplyBatch};

/// How long leaving may take; a daemon that is gone has forgotten this participant anyway.
const LEAVE_TIMEOUT: Duration = Duration::from_millis(200);

/// How long the daemon may take to say that a tick is complete before it is asked again.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);

/// A simulator that tells by itself which tick is complete is asked all the same after this silence,
/// in case that what it told was lost.
const ASK_AFTER: Duration = Duration::from_millis(250);

/// Why lockstep could not be joined.
#[derive(Debug, thiserror::Error)]
pub enum LockstepError {
    /// The daemon did not answer.
    #[error("cannot join lockstep: {0}")]
    Command(#[from] CommandError),
    /// The daemon refused.
    #[error("cannot join lockstep as {name:?}: {reason}")]
    Refused {
        /// Name asked for.
        name: String,
        /// The daemon's sentence.
        reason: String,
    },
    /// The bus failed.
    #[error(transparent)]
    Bus(#[from] BusError),
}

/// A place in the lockstep gate. Dropped, it leaves.
#[derive(Debug)]
pub struct Lockstep {
    client: CommandClient,
    acks: AckWriter,
    complete: CompleteReader,
    /// Whether the simulator tells by itself which tick is complete. Replays and bridges are asked.
    is_told: bool,
    /// The newest tick that is known to be complete.
    newest: u64,
    last_heard: Instant,
    participant: u32,
    epoch: u64,
    first_tick: u64,
}

impl Lockstep {
    /// Joins as `name`, which no other process may use.
    ///
    /// # Errors
    /// [`LockstepError`].
    pub fn join(bus: &Bus, name: &str, timeout: Duration) -> Result<Lockstep, LockstepError> {
        // The writer comes first: the daemon recognises living participants by their writers'
        // names.
        let acks = bus.ack_writer(name)?;
        let complete = bus.complete_reader()?;
        let mut client = bus.command_client(name)?;
        let batch = CommandBatch::new(vec![Command::JoinLockstep { name: name.into() }]);
        let answer = client.request(&batch, timeout)?;
        let (participant, first_tick) = joined(name, &answer)?;
        let epoch = answer.epoch.parse().map_err(|_| CommandError::Answer {
            cause: format!("epoch is {:?}", answer.epoch),
        })?;
        tracing::debug!(name, participant, first_tick, "joined lockstep");
        Ok(Lockstep {
            client,
            acks,
            is_told: !complete.writers().is_empty(),
            complete,
            newest: 0,
            last_heard: Instant::now(),
            participant,
            epoch,
            first_tick,
        })
    }

    /// Acknowledges `tick`: everything this consumer wants of it has arrived, and its controls are
    /// sent. Ticks before the first one are ignored.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn ack(&self, tick: u64) -> Result<(), BusError> {
        if tick < self.first_tick {
            return Ok(());
        }
        self.acks.send(self.participant, self.epoch, tick)
    }

    /// The event to sleep on until the next tick may be complete.
    pub fn event(&self) -> &'static str {
        match self.is_told {
            true => names::WORLD_COMPLETE,
            false => names::WORLD_SNAPSHOT,
        }
    }

    /// Whether every frame of `tick` was sent. The simulator tells on `world/complete`. Who does not
    /// is asked: the answer comes only between two ticks, so it says so. `false` if it did not answer
    /// in time, or is gone.
    ///
    /// # Errors
    /// [`LockstepError`] for an answer that cannot be read, or if the bus failed.
    pub fn is_complete(&mut self, tick: u64) -> Result<bool, LockstepError> {
        for record in self.complete.drain()? {
            if record.epoch == self.epoch {
                self.newest = self.newest.max(record.tick);
                self.last_heard = Instant::now();
            }
        }
        if self.newest >= tick {
            return Ok(true);
        }
        if self.is_told && self.last_heard.elapsed() < ASK_AFTER {
            return Ok(false);
        }
        let ping = CommandBatch::new(vec![Command::Ping]);
        let answer = self.client.request(&ping, ANSWER_TIMEOUT);
        self.last_heard = Instant::now();
        match answer {
            Ok(answer) => {
                self.newest = self.newest.max(answer.tick);
                Ok(answer.tick >= tick)
            }
            Err(CommandError::Timeout { .. } | CommandError::NoServer { .. }) => Ok(false),
            Err(other) => Err(other.into()),
        }
    }

    /// First tick that waits for this participant.
    pub fn first_tick(&self) -> u64 {
        self.first_tick
    }

    /// Epoch that was joined. If frames carry another epoch, the simulator was restarted and this
    /// place is lost: join again.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }
}

impl Drop for Lockstep {
    fn drop(&mut self) {
        let batch = CommandBatch::new(vec![Command::LeaveLockstep {
            participant: self.participant,
        }]);
        if let Err(error) = self.client.request(&batch, LEAVE_TIMEOUT) {
            tracing::debug!(%error, "left lockstep without an answer");
        }
    }
}

fn joined(name: &str, answer: &ReplyBatch) -> Result<(u32, u64), LockstepError> {
    match answer.replies.first() {
        Some(CommandReply::Joined {
            participant,
            first_tick,
        }) => Ok((*participant, *first_tick)),
        Some(CommandReply::Refused { error }) => Err(LockstepError::Refused {
            name: name.into(),
            reason: error.clone(),
        }),
        other => Err(CommandError::Answer {
            cause: format!("{other:?} is no answer to join_lockstep"),
        }
        .into()),
    }
}
