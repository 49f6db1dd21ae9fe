//! What must have happened before the next tick may start: cues in stepped mode, acknowledgements
//! of lockstep participants.

use schema_frames::StepMode;

/// A consumer that the daemon waits for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Participant {
    /// Number that it puts into its acknowledgements.
    pub number: u32,
    /// Name under which it joined, and of its writer on `control/ack`. When that writer is gone, the
    /// gate no longer waits for it.
    pub name: String,
    /// Last tick that it has acknowledged.
    pub acked_tick: u64,
}

/// Decides whether tick `last_tick + 1` may start. Pure state; the daemon feeds it.
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
        });
        number
    }

    /// Removes a participant; `None` if there is none of that number.
    pub fn leave(&mut self, number: u32) -> Option<Participant> {
        let idx = self.participants.iter().position(|p| p.number == number)?;
        Some(self.participants.remove(idx))
    }

    /// Notes that a participant has acknowledged `tick`. An unknown number is ignored.
    pub fn ack(&mut self, number: u32, tick: u64) {
        if let Some(participant) = self.participants.iter_mut().find(|p| p.number == number) {
            participant.acked_tick = participant.acked_tick.max(tick);
        }
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
        gate.ack(number + 1, 8);
        assert!(!gate.is_open(8));
        gate.ack(number, 8);
        assert!(gate.is_open(8));
        assert_eq!(
            gate.leave(number).map(|p| p.name).as_deref(),
            Some("recorder")
        );
        assert!(gate.is_open(1000));
    }
}
