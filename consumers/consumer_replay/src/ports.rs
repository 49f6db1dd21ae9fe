//! The services into which a recording is published.

use schema_bus::{
    AckReader, Bus, CommandServer, FrameLoan, FramePublisher, Listener, LoanError, Notifier,
    ResultPublisher, SnapshotPublisher, check_shared_memory, names,
};
use schema_frames::FrameHeader;
use schema_frames::limits::MAX_ACTORS;

use crate::plan::{Plan, PlannedFrames};
use crate::world::Documents;

/// A topic of frames.
#[derive(Debug)]
pub struct FramePort {
    publisher: FramePublisher,
    wake: Notifier,
    /// Number of its rig in [`Ports::rigs`].
    pub rig: usize,
    /// Whether longer slots are made when a longer frame comes, and how long they are now.
    grows: bool,
    slot_bytes: usize,
    planned: PlannedFrames,
    pub n_sent: u64,
    pub n_dropped: u64,
}

impl FramePort {
    /// Name without the domain.
    pub fn name(&self) -> &str {
        &self.planned.name
    }

    /// Number of readers now.
    pub fn n_readers(&self) -> usize {
        self.publisher.n_readers()
    }

    /// A slot for a frame with this header.
    ///
    /// # Errors
    /// [`LoanError`].
    pub fn loan(&mut self, header: &FrameHeader) -> Result<FrameLoan, LoanError> {
        let len = header.payload_bytes as usize;
        if len > self.slot_bytes {
            self.grow(len)?;
        }
        let mut loan = self.publisher.loan(len)?;
        *loan.header_mut() = *header;
        Ok(loan)
    }

    /// Makes sure that there is room for longer slots, before they are made.
    fn grow(&mut self, len: usize) -> Result<(), LoanError> {
        if !self.grows {
            return Err(LoanError::TooLong {
                topic: self.planned.name.clone(),
                len,
                limit: self.slot_bytes,
            });
        }
        let grown = len.checked_next_power_of_two().unwrap_or(len);
        let mut spec = self.planned.spec;
        spec.max_payload_bytes = grown;
        let need_bytes = spec.segment_bytes(self.planned.modality);
        check_shared_memory(need_bytes, 0).map_err(|short| LoanError::Memory {
            topic: self.planned.name.clone(),
            need_bytes,
            free_bytes: short.free_bytes.unwrap_or(0),
        })?;
        self.slot_bytes = grown;
        Ok(())
    }

    /// Wakes those that wait for the topic.
    pub fn notify(&self) {
        self.wake.notify_listeners();
    }
}

/// All services, in the order in which they must be dropped.
#[derive(Debug)]
pub struct Ports {
    pub frames: Vec<FramePort>,
    /// Names of the rigs and their events.
    pub rigs: Vec<(String, Notifier)>,
    /// `None` for a topic that another program publishes.
    pub results: Vec<Option<ResultPublisher>>,
    pub snapshot: SnapshotPublisher,
    pub snapshot_wake: Notifier,
    pub commands: CommandServer,
    pub acks: AckReader,
    pub wake: Listener,
    pub documents: Documents,
    /// Whether snapshots have no actors.
    pub is_sealed: bool,
}

impl Ports {
    /// Opens all services.
    ///
    /// # Errors
    /// [`schema_bus::BusError`].
    pub fn open(bus: &Bus, plan: &Plan, is_sealed: bool) -> anyhow::Result<Ports> {
        // Commands come first: whoever finds a topic may join the lockstep at once.
        let (commands, wake) = (bus.command_server()?, bus.listener(names::CONTROL_WAKE)?);
        let mut rigs: Vec<(String, Notifier)> = Vec::new();
        let mut frames = Vec::new();
        for planned in &plan.frames {
            let rig_name = names::rig_of(&planned.name);
            let rig = match rigs.iter().position(|(name, _)| name == rig_name) {
                Some(rig) => rig,
                None => {
                    let event = bus.notifier(&names::rig_tick(rig_name))?;
                    rigs.push((rig_name.to_owned(), event));
                    rigs.len().saturating_sub(1)
                }
            };
            let service = bus.frame_service(&planned.name, planned.spec)?;
            let publisher = match planned.is_list {
                true => service.growing_publisher()?,
                false => service.publisher()?,
            };
            frames.push(FramePort {
                wake: bus.notifier(&planned.name)?,
                rig,
                grows: planned.is_list,
                slot_bytes: publisher.max_payload_bytes(),
                publisher,
                planned: planned.clone(),
                n_sent: 0,
                n_dropped: 0,
            });
        }
        let mut results = Vec::new();
        for planned in &plan.results {
            results.push(match bus.result_publisher(&planned.name, &planned.spec) {
                Ok(publisher) => Some(publisher),
                Err(error @ schema_bus::BusError::TopicTaken { .. }) => {
                    tracing::warn!("recorded results are left out: {error}");
                    None
                }
                Err(other) => return Err(other.into()),
            });
        }
        Ok(Ports {
            frames,
            rigs,
            results,
            snapshot: bus.snapshot_publisher(MAX_ACTORS)?,
            snapshot_wake: bus.notifier(names::WORLD_SNAPSHOT)?,
            commands,
            acks: bus.ack_reader()?,
            wake,
            documents: Documents::open(bus, is_sealed)?,
            is_sealed,
        })
    }

    /// Sends the latest snapshot and documents to readers that joined since the last call.
    pub fn greet(&self) {
        self.snapshot.greet();
        self.documents.greet();
    }
}
