//! Ports of the daemon that are not topics of sensors.

use schema_bus::{
    AckReader, Bus, CommandServer, ControlReader, Listener, Notifier, SnapshotPublisher, names,
};
use schema_frames::limits::MAX_ACTORS;

use crate::documents::Documents;

/// What the daemon publishes besides frames, and what it is asked through.
pub struct Ports {
    /// `world/snapshot`.
    pub snapshot: SnapshotPublisher,
    /// Event that wakes controllers that read no sensor topic.
    pub snapshot_wake: Notifier,
    /// `control/world`.
    pub commands: CommandServer,
    /// `control/vehicles`.
    pub controls: ControlReader,
    /// `control/ack`.
    pub acks: AckReader,
    /// `control/wake`.
    pub wake: Listener,
    /// `world/info`, `map`, `actors`, `catalogue`.
    pub documents: Documents,
}

impl Ports {
    /// Opens all services.
    pub fn open(bus: &Bus) -> anyhow::Result<Ports> {
        Ok(Ports {
            snapshot: bus.snapshot_publisher(MAX_ACTORS)?,
            snapshot_wake: bus.notifier(names::WORLD_SNAPSHOT)?,
            commands: bus.command_server()?,
            controls: bus.control_reader()?,
            acks: bus.ack_reader()?,
            wake: bus.listener(names::CONTROL_WAKE)?,
            documents: Documents::open(bus)?,
        })
    }

    /// Sends the latest snapshot and documents to readers that joined since the last call.
    pub fn greet(&self) {
        self.snapshot.greet();
        self.documents.greet();
    }
}
