//! `world/snapshot`: one record per actor after every tick.

use std::sync::Arc;

use schema_frames::snapshot::SNAPSHOT_MAGIC;
use schema_frames::{ActorRecord, SCHEMA_VERSION, SnapshotHeader};

use crate::contract::error::BusError;
use crate::contract::names::{CONTROL_WAKE, WORLD_SNAPSHOT};
use crate::contract::origin::Origin;
use crate::contract::qos;
use crate::place::event::Notifier;
use crate::place::node::BusNode;
use crate::place::service::{join, make};
use crate::ports::reader::{Moment, Reader, Received, SampleFault, SampleKind, Stamp, bad_sample};
use crate::ports::writer::Writer;
use crate::time::clock::mono_now;

/// Records of a slot before the segment grows for the first time. It grows by doubling, so that a
/// world pays for the actors that it has and not for the most that it may have.
const FIRST_SLOT_RECORDS: usize = 256;

/// Writes snapshots.
#[derive(Debug)]
pub struct SnapshotPublisher {
    writer: Writer<SnapshotHeader>,
    max_actors: usize,
}

impl SnapshotPublisher {
    pub(crate) fn open(node: &BusNode, max_actors: usize) -> Result<SnapshotPublisher, BusError> {
        let service = make::<SnapshotHeader>(node, WORLD_SNAPSHOT, &qos::SNAPSHOT)?;
        let len = max_actors.clamp(1, FIRST_SLOT_RECORDS) * size_of::<ActorRecord>();
        Ok(SnapshotPublisher {
            writer: Writer::copying(service, len)?,
            max_actors,
        })
    }

    /// Sends the records, which must come by rising id. The header's magic, version, sizes, count
    /// and time of publishing are set here.
    ///
    /// # Errors
    /// [`BusError::TooLong`] if there are more than `max_actors`, [`BusError::Memory`] if
    /// `/dev/shm` has no room for them. Nothing is sent then, and the next one may be.
    pub fn send(
        &self,
        mut header: SnapshotHeader,
        records: &[ActorRecord],
    ) -> Result<(), BusError> {
        assert!(
            records.is_sorted_by_key(|record| record.id),
            "snapshot records come by rising id"
        );
        let bytes: &[u8] = bytemuck::cast_slice(records);
        if records.len() > self.max_actors {
            let limit = self.max_actors * size_of::<ActorRecord>();
            return Err(BusError::TooLong {
                service: WORLD_SNAPSHOT.into(),
                len: bytes.len(),
                limit,
            });
        }
        header.magic = SNAPSHOT_MAGIC;
        header.schema_version = SCHEMA_VERSION;
        header.header_bytes = size_of::<SnapshotHeader>() as u16;
        header.n_actors = records.len() as u32;
        let mut loan = self.writer.copy(WORLD_SNAPSHOT, bytes)?;
        header.published_mono_nanos = mono_now().0;
        *loan.header_mut() = header;
        loan.send("write to", WORLD_SNAPSHOT).map(drop)
    }

    /// Sends the newest snapshot to readers that joined since the last call; see
    /// [`crate::DocumentPublisher::greet`].
    pub fn greet(&self) {
        self.writer.greet(WORLD_SNAPSHOT);
    }
}

/// Snapshots of the world.
#[derive(Debug)]
pub struct Snapshots;

/// Reads snapshots.
pub type SnapshotReader = Reader<Snapshots>;

impl SampleKind for Snapshots {
    type Header = SnapshotHeader;
    type Sample = Snapshot;
    type Fault = SampleFault;

    fn admit(
        &self,
        sample: Received<SnapshotHeader>,
        _: &Arc<str>,
    ) -> Result<Snapshot, SampleFault> {
        let header = sample.user_header().0;
        let stamp = Stamp {
            magic: header.magic,
            schema_version: header.schema_version,
        };
        stamp.check(SNAPSHOT_MAGIC, "this reader understands")?;
        if header.n_actors as usize * size_of::<ActorRecord>() != sample.payload().len() {
            return Err(SampleFault::Actors {
                claimed: header.n_actors,
                found: sample.payload().len(),
            });
        }
        if bytemuck::try_cast_slice::<u8, ActorRecord>(sample.payload()).is_err() {
            return Err(SampleFault::Unaligned);
        }
        Ok(Snapshot { sample, header })
    }

    fn moment(snapshot: &Snapshot) -> Moment {
        let header = &snapshot.header;
        Moment {
            epoch: header.epoch,
            tick: header.tick,
            seq: header.tick,
        }
    }

    fn refuse(service: String, writer: Option<Arc<Origin>>, fault: SampleFault) -> BusError {
        bad_sample(service, writer, &fault)
    }
}

impl Reader<Snapshots> {
    pub(crate) fn open(node: &BusNode) -> Result<SnapshotReader, BusError> {
        let service = join::<SnapshotHeader>(node, WORLD_SNAPSHOT)?;
        let reader = Reader::of(service, WORLD_SNAPSHOT, Snapshots)?;
        Notifier::open(node, CONTROL_WAKE)?.notify();
        Ok(reader)
    }
}

/// A snapshot in shared memory. A reader may hold four at a time.
#[derive(Debug)]
pub struct Snapshot {
    sample: Received<SnapshotHeader>,
    header: SnapshotHeader,
}

impl Snapshot {
    /// The header, checked.
    pub fn header(&self) -> &SnapshotHeader {
        &self.header
    }

    /// Actors by rising id.
    pub fn records(&self) -> &[ActorRecord] {
        bytemuck::cast_slice(self.sample.payload())
    }

    /// The actor with this id.
    pub fn actor(&self, id: u32) -> Option<&ActorRecord> {
        let records = self.records();
        records
            .binary_search_by_key(&id, |record| record.id)
            .ok()
            .map(|idx| &records[idx])
    }
}
