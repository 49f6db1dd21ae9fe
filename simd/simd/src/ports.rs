//! Ports of the daemon that are not topics of sensors, and its place on the bus.

mod documents;

use std::sync::Arc;
use std::time::Duration;

use schema_bus::{
    AckReader, Bus, BusError, Claim, CommandServer, ControlBatch, ControlReader, GpuServer,
    Listener, Notifier, Request, SnapshotPublisher, names,
};
use schema_frames::limits::MAX_ACTORS;
use schema_frames::{ActorRecord, ReplyBatch, Seal, SnapshotHeader};
use simd_world::World;

use crate::faults::Faults;
use crate::files::Files;
use documents::Documents;
pub use documents::State;

/// What the daemon publishes besides frames, and what it is asked through.
///
/// The order of the fields is that in which they are dropped: the services before the right to
/// publish the world, so that the next daemon finds none of them left, and the bus last.
pub struct Ports {
    services: Services,
    /// Where readers ask for frames that stay on the GPU.
    gpu_server: Option<Arc<GpuServer>>,
    /// The right to publish the domain's world.
    _claim: Claim,
    bus: Bus,
}

/// The services of the daemon.
pub struct Services {
    /// `world/snapshot`.
    snapshot: SnapshotPublisher,
    /// Event that wakes controllers that read no sensor topic.
    snapshot_wake: Notifier,
    /// `control/world`.
    commands: CommandServer,
    /// `control/vehicles`.
    controls: ControlReader,
    /// `control/ack`.
    acks: AckReader,
    /// `control/wake`.
    wake: Listener,
    /// `world/info`, `map`, `actors`, `catalogue`.
    documents: Documents,
    /// What is shown of the world, if programs are scored against it.
    seal: Option<Arc<Seal>>,
}

impl Services {
    /// Opens all services.
    pub fn open(bus: &Bus, seal: Option<Arc<Seal>>) -> anyhow::Result<Services> {
        Ok(Services {
            snapshot: bus.snapshot_publisher(MAX_ACTORS)?,
            snapshot_wake: bus.notifier(names::WORLD_SNAPSHOT)?,
            commands: bus.command_server()?,
            controls: bus.control_reader()?,
            acks: bus.ack_reader()?,
            wake: bus.listener(names::CONTROL_WAKE)?,
            documents: Documents::open(bus, seal.is_some())?,
            seal,
        })
    }
}

/// Samples of others that were lost or could not be read.
#[derive(Clone, Copy, Debug)]
pub struct IntakeCounts {
    /// Samples of controls that were lost.
    pub n_controls_lost: u64,
    /// Samples of controls that could not be read.
    pub n_controls_refused: u64,
    /// Requests that could not be read.
    pub n_requests_refused: u64,
}

impl Ports {
    /// The services of a daemon, and what they need for as long as they are open.
    pub fn new(
        services: Services,
        gpu_server: Option<Arc<GpuServer>>,
        claim: Claim,
        bus: Bus,
    ) -> Ports {
        Ports {
            services,
            gpu_server,
            _claim: claim,
            bus,
        }
    }

    /// The bus.
    pub fn bus(&self) -> &Bus {
        &self.bus
    }

    /// Where readers ask for frames that stay on the GPU; `None` if they cannot.
    pub fn gpu_server(&self) -> Option<&Arc<GpuServer>> {
        self.gpu_server.as_ref()
    }

    /// Sends the latest snapshot and documents to readers that joined since the last call.
    pub fn greet(&self) {
        self.services.snapshot.greet();
        self.services.documents.greet();
    }

    /// Waits until somebody asks for something; returns whether that happened within `most`.
    ///
    /// # Errors
    /// [`BusError`] if the event cannot be read.
    pub fn wait(&self, most: Duration) -> Result<bool, BusError> {
        self.services.wake.wait(most)
    }

    /// Whether requests wait for which nobody wakes the daemon again.
    pub fn is_behind(&self) -> bool {
        self.services.commands.is_behind()
    }

    /// Number of clients now.
    pub fn n_clients(&self) -> usize {
        self.services.commands.n_clients()
    }

    /// The requests that have their turn, by (client, seq), without those of clients of which one
    /// waits for files.
    pub fn take_requests(&mut self, files: &Files, faults: &mut Faults) -> Vec<Request> {
        let is_busy = |client_port| files.is_busy(client_port);
        let taken = self.services.commands.take_all_but(is_busy);
        taken.unwrap_or_else(|error| {
            faults.unreadable(&error);
            Vec::new()
        })
    }

    /// Lets a request wait until its client's earlier one is answered.
    pub fn hold(&mut self, request: Request) {
        self.services.commands.hold(request);
    }

    /// What is shown of the world, and whom it obeys, if it is sealed.
    pub fn seal(&self) -> Option<&Seal> {
        self.services.seal.as_deref()
    }

    /// Answers a request.
    pub fn reply(&self, request: Request, answer: &ReplyBatch) {
        if let Err(error) = self.services.commands.reply(request, answer) {
            tracing::warn!(%error, "an answer could not be sent");
        }
    }

    /// The controls that wait.
    pub fn take_controls(&mut self, faults: &mut Faults) -> Vec<ControlBatch> {
        self.services.controls.drain().unwrap_or_else(|error| {
            faults.unreadable(&error);
            Vec::new()
        })
    }

    /// Where participants acknowledge ticks.
    pub fn acks(&self) -> &AckReader {
        &self.services.acks
    }

    /// Where participants acknowledge ticks, to be read.
    pub fn acks_mut(&mut self) -> &mut AckReader {
        &mut self.services.acks
    }

    /// Samples of others that were lost or could not be read, so far.
    pub fn intake_counts(&self) -> IntakeCounts {
        IntakeCounts {
            n_controls_lost: self.services.controls.n_lost(),
            n_controls_refused: self.services.controls.n_faults(),
            n_requests_refused: self.services.commands.n_faults(),
        }
    }

    /// Revision of the `world/actors` that lists the world's actors as they are.
    pub fn actors_revision(&self, world: &World) -> u64 {
        self.services.documents.actors_revision(world)
    }

    /// Sends a snapshot, and wakes those that wait for it.
    ///
    /// # Errors
    /// [`BusError`] if it cannot be sent.
    pub fn send_snapshot(
        &self,
        header: SnapshotHeader,
        records: &[ActorRecord],
    ) -> Result<(), BusError> {
        match self.services.seal.is_some() {
            true => self.services.snapshot.send(header.sealed(), &[])?,
            false => self.services.snapshot.send(header, records)?,
        }
        self.services.snapshot_wake.notify();
        Ok(())
    }

    /// Marks `world/info` as possibly changed.
    pub fn touch_info(&mut self) {
        self.services.documents.touch_info();
    }

    /// Publishes the documents that changed. One that cannot be sent is said and counted, and tried
    /// again with the next tick: until then its readers have the older one.
    pub fn publish_documents(&mut self, state: &State<'_>, faults: &mut Faults) {
        if let Err(error) = self.services.documents.publish(state) {
            faults.unsent("a document", &error);
        }
    }
}
