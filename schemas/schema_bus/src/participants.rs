//! Who takes part in the lockstep: joining, acknowledging, and leaving without a word.
//!
//! The publisher of a world calls this between its ticks, so that a participant that is killed or
//! stopped means the same to a simulator and to a replay.

use crate::bus::Bus;
use crate::contract::origin::Origin;
use crate::place::complaints::Complaints;
use crate::ports::control::{Ack, AckReader};
use crate::time::gate::Gate;

/// Longest name of a participant, bytes.
const MAX_NAME_BYTES: usize = 64;

/// When a look at the participants happens.
#[derive(Clone, Copy, Debug)]
pub struct Look {
    /// The last tick that was begun.
    pub tick: u64,
    /// Whether no tick has begun and the first one waits for participants: nobody owes an
    /// acknowledgement then, but who is gone may not be counted.
    pub before_first: bool,
    /// How long the world has waited, nanoseconds.
    pub idle_nanos: u64,
    /// Wait after which a living participant is removed.
    pub timeout_nanos: Option<u64>,
}

/// Why a process cannot join.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum JoinError {
    /// The name is empty or too long.
    #[error("name is {0:?}, but must have 1 to 64 characters")]
    Name(String),
    /// Another process has it.
    #[error("name is {name:?}, but {owner} has joined under it; choose another")]
    Taken {
        /// The name.
        name: String,
        /// Who has joined under it.
        owner: Origin,
    },
    /// The process itself has it.
    #[error(
        "name is {0:?}, but this process has joined under it already; leave first, or choose another"
    )]
    Twice(String),
}

impl Gate {
    /// Lets the process `asker` join under `name`, after `last_tick` was begun. The place of a
    /// participant that was killed and comes back under its name is given up: both cannot be there,
    /// because participants are known by the names of their writers.
    ///
    /// # Errors
    /// [`JoinError`].
    pub fn admit(
        &mut self,
        name: &str,
        asker: &Origin,
        bus: &Bus,
        acks: &AckReader,
        last_tick: u64,
    ) -> Result<u32, JoinError> {
        if name.is_empty() || name.len() > MAX_NAME_BYTES {
            return Err(JoinError::Name(name.to_owned()));
        }
        let before = self.participants().iter().find(|p| p.name == name);
        if let Some(number) = before.map(|p| p.number) {
            bus.clean_dead_nodes();
            let mut same = acks.writers();
            same.retain(|writer| writer.port == name);
            if let Some(other) = same.iter().find(|writer| writer.pid != asker.pid) {
                return Err(JoinError::Taken {
                    name: name.to_owned(),
                    owner: other.clone(),
                });
            }
            if same.len() > 1 {
                return Err(JoinError::Twice(name.to_owned()));
            }
            tracing::warn!(
                name,
                participant = number,
                "a participant of this name joins again; its former place in the lockstep ends"
            );
            self.leave(number);
        }
        let participant = self.join(name.to_owned(), last_tick);
        tracing::info!(
            name,
            participant,
            first_tick = last_tick.saturating_add(1),
            "joined the lockstep"
        );
        Ok(participant)
    }

    /// Notes acknowledgements while `last_tick` of `epoch` is the last that was begun. Those of
    /// another epoch, and of processes that have gone, which the gate no longer waits for, are passed
    /// over. Others that do not count are counted in `complaints`, and the first of a process is
    /// said.
    pub fn note(
        &mut self,
        acks: Vec<Ack>,
        epoch: u64,
        last_tick: u64,
        complaints: &mut Complaints,
    ) {
        for ack in acks {
            if ack.epoch != epoch || ack.origin.pid.is_none() {
                continue;
            }
            let noted = self.ack(ack.participant, &ack.origin.port, ack.tick, last_tick);
            if let Err(fault) = noted
                && complaints.count(&ack.origin, fault.kind())
            {
                tracing::warn!(
                    "{} acknowledged {fault}; this and further ones of it do not count",
                    ack.origin
                );
            }
        }
    }

    /// Removes participants whose process is gone, and idle ones if a time-out is set; says for whom
    /// the world waits long. Returns how many were removed.
    pub fn look_after(&mut self, bus: &Bus, acks: &AckReader, look: &Look) -> usize {
        let looked_at: Vec<_> = match look.before_first {
            true => self.participants().to_vec(),
            false => self.missing(look.tick).cloned().collect(),
        };
        if looked_at.is_empty() {
            return 0;
        }
        bus.clean_dead_nodes();
        let writers = acks.writers();
        let timed_out = look
            .timeout_nanos
            .is_some_and(|limit_nanos| look.idle_nanos > limit_nanos);
        let n_before = self.participants().len();
        for participant in looked_at {
            let name = &participant.name;
            let why = match writers.iter().find(|writer| writer.port == *name) {
                None => "is gone".to_owned(),
                Some(_) if look.before_first => continue,
                Some(process) if timed_out => {
                    format!("is idle for longer than the lockstep time-out ({process})")
                }
                Some(process) => {
                    if self.must_say(participant.number, look.idle_nanos) {
                        say_wait(name, process, look);
                    }
                    continue;
                }
            };
            tracing::warn!(
                name,
                tick = look.tick,
                "lockstep participant {why}; going on without it"
            );
            self.leave(participant.number);
        }
        n_before - self.participants().len()
    }
}

fn say_wait(name: &str, process: &Origin, look: &Look) {
    let state = if process.is_stopped() {
        ", which is stopped"
    } else {
        ""
    };
    tracing::warn!(
        name,
        tick = look.tick,
        "the world waits for lockstep participant {name:?}, {process}{state}, for {} s; let it go on, end it, or set scenario.lockstep_timeout_s (--lockstep-timeout)",
        look.idle_nanos / 1_000_000_000
    );
}
