//! Faults of other processes that the daemon met: said once per process and kind, and counted.

use schema_bus::{BusError, Complaints};

/// What the daemon complained about.
#[derive(Debug, Default)]
pub struct Faults {
    /// Controls that could not be applied.
    pub controls: Complaints,
    /// Acknowledgements that did not count.
    pub acks: Complaints,
    is_unreadable_said: bool,
}

impl Faults {
    /// Says once that a topic could not be read this time. The tick goes on without what waits there,
    /// which the next tick finds.
    pub fn unreadable(&mut self, error: &BusError) {
        if !std::mem::replace(&mut self.is_unreadable_said, true) {
            tracing::warn!(%error, "a topic could not be read in this tick; trying again at the next one");
        }
    }
}
