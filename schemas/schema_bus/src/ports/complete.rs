//! `world/complete`: the simulator says which tick's frames were all sent.

use std::sync::Arc;

use schema_frames::CompleteRecord;

use crate::contract::error::BusError;
use crate::contract::names::WORLD_COMPLETE;
use crate::contract::origin::Origin;
use crate::contract::qos::{self, Qos};
use crate::ports::records::{Record, RecordReader, RecordWriter};

/// Says that ticks are complete.
pub type CompleteWriter = RecordWriter<CompleteRecord>;
/// Reads which ticks are complete.
pub type CompleteReader = RecordReader<CompleteRecord>;

impl Record for CompleteRecord {
    const TOPIC: &'static str = WORLD_COMPLETE;
    const WAKE: &'static str = WORLD_COMPLETE;
    const QOS: Qos = qos::COMPLETE;
    type Taken = CompleteRecord;

    fn taken(self, _: Arc<Origin>) -> CompleteRecord {
        self
    }
}

impl RecordWriter<CompleteRecord> {
    /// Says that every frame of `tick` was sent, and wakes those who wait for that.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn send(&self, epoch: u64, tick: u64) -> Result<(), BusError> {
        self.put(CompleteRecord {
            epoch,
            tick,
            reserved: [0; 2],
        })
    }
}
