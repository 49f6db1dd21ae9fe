//! Which actors were put elsewhere by a command although the engine moves them: the way there is no
//! motion.

use std::collections::BTreeSet;

use schema_types::ActorId;

/// Actors that were put elsewhere.
#[derive(Clone, Debug, Default)]
pub(crate) struct Jumps {
    /// Since the last step.
    coming: BTreeSet<ActorId>,
    /// Between the last two steps.
    done: BTreeSet<ActorId>,
}

impl Jumps {
    /// Takes note of an actor.
    pub fn note(&mut self, actor: ActorId) {
        self.coming.insert(actor);
    }

    /// A step begins: what was noted leads to its end.
    pub fn begin_step(&mut self) {
        self.done = std::mem::take(&mut self.coming);
    }

    /// The actors that were put elsewhere before the last step.
    pub fn before_last_step(&self) -> &BTreeSet<ActorId> {
        &self.done
    }
}
