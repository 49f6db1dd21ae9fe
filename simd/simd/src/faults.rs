//! Faults of other processes and of the machine that the daemon met: said once per process and kind,
//! and counted.

use schema_bus::{BusError, Complaints, ControlBatch};

/// What the daemon complained about.
#[derive(Debug, Default)]
pub struct Faults {
    /// Controls that could not be applied.
    controls: Complaints,
    /// Acknowledgements that did not count.
    acks: Complaints,
    is_unreadable_said: bool,
    n_unsent: u64,
}

impl Faults {
    /// Notes that a control could not be applied.
    pub fn refused_control(&mut self, batch: &ControlBatch, error: &anyhow::Error) {
        if self.controls.count(&batch.origin, "control") {
            tracing::warn!(
                "{} sent a control as {:?} that was refused: {error}; further refusals are only counted",
                batch.origin,
                batch.writer
            );
        }
    }

    /// Number of controls that could not be applied.
    pub fn n_refused_controls(&self) -> u64 {
        self.controls.n()
    }

    /// Complaints about acknowledgements.
    pub fn of_acks(&mut self) -> &mut Complaints {
        &mut self.acks
    }

    /// Number of acknowledgements that did not count.
    pub fn n_refused_acks(&self) -> u64 {
        self.acks.n()
    }

    /// Notes that something could not be published. It is said the first time and then ever more
    /// rarely; the tick goes on.
    pub fn unsent(&mut self, what: &str, error: &BusError) {
        self.n_unsent += 1;
        if self.n_unsent.is_power_of_two() {
            tracing::warn!(
                %error,
                n = self.n_unsent,
                "{what} of this tick cannot be published; the world goes on, and its readers see a gap"
            );
        }
    }

    /// Number of snapshots and documents that could not be published.
    pub fn n_unsent(&self) -> u64 {
        self.n_unsent
    }

    /// Says once that a topic could not be read this time. The tick goes on without what waits there,
    /// which the next tick finds.
    pub fn unreadable(&mut self, error: &BusError) {
        if !std::mem::replace(&mut self.is_unreadable_said, true) {
            tracing::warn!(%error, "a topic could not be read in this tick; trying again at the next one");
        }
    }
}
