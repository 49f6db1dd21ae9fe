//! What must have happened before the next tick may start: cues in stepped mode, acknowledgements
//! of lockstep participants. Whoever publishes a world keeps a [`Gate`]: the simulator, a replay.

use schema_frames::StepMode;

/// A consumer that the world waits for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Participant {
    /// Number that it puts into its acknowledgements.
    pub number: u32,
    /// Name under which it joined, and of its writer on `control/ack`. When that writer is gone, the
    /// gate no longer waits for it.
    pub name: String,
    /// Last tick that it has acknowledged.
    pub acked_tick: u64,
    /// How long the world must wait for it until that is said, nanoseconds.
    say_after_nanos: u64,
}

/// How long the world waits for a participant until that is said, the first time and each further
/// time.
const SAY_EVERY_NANOS: u64 = 5_000_000_000;

/// Why an acknowledgement does not count.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AckFault {
    /// Nobody has this number.
    #[error(
        "participant {0}, which has left the lockstep, was removed from it, or never joined; join again"
    )]
    Unknown(u32),
    /// The number is another's.
    #[error("participant {number}, which is {owner:?}; each participant acknowledges for itself")]
    NotItsOwn {
        /// The number.
        number: u32,
        /// Who joined under it.
        owner: String,
    },
    /// The tick has not begun.
    #[error("tick {tick}, but the world has only begun tick {last_tick}")]
    Future {
        /// The tick.
        tick: u64,
        /// The last tick that was begun.
        last_tick: u64,
    },
}

impl AckFault {
    /// Name of the fault, the same for all numbers.
    pub fn kind(&self) -> &'static str {
        match self {
            AckFault::Unknown(_) => "unknown participant",
            AckFault::NotItsOwn { .. } => "participant of another",
            AckFault::Future { .. } => "future tick",
        }
    }
}

/// Decides whether tick `last_tick + 1` may start. Pure state; the publisher of the world feeds it.
#[derive(Clone, Debug, Default)]
pub struct Gate {
    mode: StepMode,
    cued_tick: u64,
    participants: Vec<Participant>,
    next_number: u32,
}

impl Gate {
    /// A gate without participants.
    pub fn new(mode: StepMode) -> Self {
        Gate {
            mode,
            next_number: 1,
            ..Default::default()
        }
    }

    /// The mode.
    pub fn mode(&self) -> StepMode {
        self.mode
    }

    /// Changes the mode. Remaining cues are dropped.
    pub fn set_mode(&mut self, mode: StepMode, last_tick: u64) {
        self.mode = mode;
        self.cued_tick = last_tick;
    }

    /// Adds `n` cues to the remaining ones, and returns the last tick that they will cause.
    pub fn cue(&mut self, n: u64, last_tick: u64) -> u64 {
        self.cued_tick = self.cued_tick.max(last_tick).saturating_add(n);
        self.cued_tick
    }

    /// Lets a consumer join; its first tick to acknowledge is `last_tick + 1`.
    pub fn join(&mut self, name: String, last_tick: u64) -> u32 {
        let number = self.next_number;
        self.next_number += 1;
        self.participants.push(Participant {
            number,
            name,
            acked_tick: last_tick,
            say_after_nanos: SAY_EVERY_NANOS,
        });
        number
    }

    /// Removes a participant; `None` if there is none of that number.
    pub fn leave(&mut self, number: u32) -> Option<Participant> {
        let idx = self.participants.iter().position(|p| p.number == number)?;
        Some(self.participants.remove(idx))
    }

    /// Notes that a participant has acknowledged `tick` on the writer of this name, while
    /// `last_tick` is the last that was begun.
    ///
    /// # Errors
    /// [`AckFault`]; nothing is noted then.
    pub fn ack(
        &mut self,
        number: u32,
        writer: &str,
        tick: u64,
        last_tick: u64,
    ) -> Result<(), AckFault> {
        let participant = self
            .participants
            .iter_mut()
            .find(|p| p.number == number)
            .ok_or(AckFault::Unknown(number))?;
        if participant.name != writer {
            return Err(AckFault::NotItsOwn {
                number,
                owner: participant.name.clone(),
            });
        }
        if tick > last_tick {
            return Err(AckFault::Future { tick, last_tick });
        }
        participant.acked_tick = participant.acked_tick.max(tick);
        Ok(())
    }

    /// Whether it is time to say that the world has waited for a participant for so long.
    pub fn must_say(&mut self, number: u32, waited_nanos: u64) -> bool {
        let Some(participant) = self.participants.iter_mut().find(|p| p.number == number) else {
            return false;
        };
        let must = waited_nanos >= participant.say_after_nanos;
        if must {
            participant.say_after_nanos = waited_nanos.saturating_add(SAY_EVERY_NANOS);
        } else if waited_nanos < SAY_EVERY_NANOS {
            // Another wait than that of which something was said.
            participant.say_after_nanos = SAY_EVERY_NANOS;
        }
        must
    }

    /// Whether stepped mode has a cue for the next tick, or none is needed.
    pub fn is_cued(&self, last_tick: u64) -> bool {
        self.mode == StepMode::FreeRunning || last_tick < self.cued_tick
    }

    /// Participants that have not acknowledged `last_tick`.
    pub fn missing(&self, last_tick: u64) -> impl Iterator<Item = &Participant> {
        self.participants
            .iter()
            .filter(move |p| p.acked_tick < last_tick)
    }

    /// Whether the next tick may start.
    pub fn is_open(&self, last_tick: u64) -> bool {
        self.is_cued(last_tick) && self.missing(last_tick).next().is_none()
    }

    /// The name under which a participant joined; `None` if there is none of that number.
    pub fn name_of(&self, number: u32) -> Option<String> {
        let found = self.participants.iter().find(|p| p.number == number);
        found.map(|participant| participant.name.clone())
    }

    /// All participants.
    pub fn participants(&self) -> &[Participant] {
        &self.participants
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cues_add_up_and_leaving_stepped_mode_drops_the_rest() {
        let mut gate = Gate::new(StepMode::Stepped);
        assert!(!gate.is_open(0));
        assert_eq!(gate.cue(2, 0), 2);
        assert_eq!(gate.cue(3, 1), 5);
        assert!(gate.is_open(4) && !gate.is_open(5));
        gate.set_mode(StepMode::FreeRunning, 2);
        assert!(gate.is_open(2));
        gate.set_mode(StepMode::Stepped, 3);
        assert!(!gate.is_open(3));
    }

    #[test]
    fn a_participant_holds_the_next_tick_until_it_acknowledges() {
        let mut gate = Gate::new(StepMode::FreeRunning);
        let number = gate.join("recorder".into(), 7);
        assert!(gate.is_open(7), "tick 8 is the first it acknowledges");
        assert!(!gate.is_open(8));
        assert_eq!(
            gate.ack(number + 1, "recorder", 8, 8),
            Err(AckFault::Unknown(number + 1))
        );
        assert!(matches!(
            gate.ack(number, "other", 8, 8),
            Err(AckFault::NotItsOwn { owner, .. }) if owner == "recorder"
        ));
        let (tick, last_tick) = (9, 8);
        assert_eq!(
            gate.ack(number, "recorder", tick, last_tick),
            Err(AckFault::Future { tick, last_tick })
        );
        assert!(!gate.is_open(8));
        assert_eq!(gate.ack(number, "recorder", 8, 8), Ok(()));
        assert!(gate.is_open(8));
        assert_eq!(gate.ack(number, "recorder", 3, 8), Ok(()), "a late one");
        assert!(gate.is_open(8), "takes nothing back");
        assert_eq!(
            gate.leave(number).map(|p| p.name).as_deref(),
            Some("recorder")
        );
        assert!(gate.is_open(1000));
    }

    #[test]
    fn a_long_wait_is_said_every_few_seconds() {
        let mut gate = Gate::new(StepMode::FreeRunning);
        let number = gate.join("planner".into(), 0);
        let mut said = |secs: std::ops::RangeInclusive<u64>| {
            let is_said = |secs: &u64| gate.must_say(number, secs * 1_000_000_000);
            secs.filter(is_said).collect::<Vec<u64>>()
        };
        assert_eq!(said(0..=21), [5, 10, 15, 20]);
        // It went on for a while, and is waited for again.
        assert_eq!(said(0..=12), [5, 10]);
        assert!(!gate.must_say(number + 1, u64::MAX));
    }
}
