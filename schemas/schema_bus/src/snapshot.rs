//! `world/snapshot`: one record per actor after every tick.

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections as _;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;

use schema_frames::snapshot::SNAPSHOT_MAGIC;
use schema_frames::{ActorRecord, SCHEMA_VERSION, SnapshotHeader};

use crate::clock::mono_now;
use crate::error::BusError;
use crate::event::Notifier;
use crate::iceoryx_error::{other_error, writer_error};
use crate::intake::{receive, subscribe};
use crate::memory::segment_bytes;
use crate::names::{CONTROL_WAKE, WORLD_SNAPSHOT};
use crate::node::{BusNode, Service};
use crate::origins::Origins;
use crate::qos;
use crate::service::{Slices, join, make};
use crate::shortage::backed;
use crate::wire::Wire;

/// Records of a slot before the segment grows for the first time. It grows by doubling, so that a
/// world pays for the actors that it has and not for the most that it may have.
const FIRST_SLOT_RECORDS: usize = 256;

/// Writes snapshots.
#[derive(Debug)]
pub struct SnapshotPublisher {
    port: Publisher<Service, [u8], Wire<SnapshotHeader>>,
    max_actors: usize,
    _service: Slices<SnapshotHeader>,
}

impl SnapshotPublisher {
    pub(crate) fn open(node: &BusNode, max_actors: usize) -> Result<SnapshotPublisher, BusError> {
        let service = make::<SnapshotHeader>(node, WORLD_SNAPSHOT, &qos::SNAPSHOT)?;
        let len = max_actors.clamp(1, FIRST_SLOT_RECORDS) * size_of::<ActorRecord>();
        let full = service.name().as_str().to_string();
        let port = service
            .publisher_builder()
            .initial_max_slice_len(len)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .create()
            .map_err(|e| {
                writer_error(
                    &full,
                    qos::SNAPSHOT.publishers,
                    segment_bytes(&qos::SNAPSHOT, qos::USUAL_LOANS, len),
                    e,
                )
            })?;
        Ok(SnapshotPublisher {
            port,
            max_actors,
            _service: service,
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
        let failed = |e: &dyn std::fmt::Debug| other_error("write to", WORLD_SNAPSHOT, e);
        let loan = self
            .port
            .loan_slice_uninit(bytes.len())
            .map_err(|e| failed(&e))?;
        let mut sample = loan.write_from_slice(bytes);
        backed(WORLD_SNAPSHOT, sample.payload().as_ptr(), bytes.len())?;
        header.published_mono_nanos = mono_now().0;
        sample.user_header_mut().0 = header;
        sample.send().map(drop).map_err(|e| failed(&e))
    }

    /// Sends the newest snapshot to readers that joined since the last call; see
    /// [`crate::DocumentPublisher::greet`].
    pub fn greet(&self) {
        if let Err(e) = self.port.update_connections() {
            tracing::warn!(service = WORLD_SNAPSHOT, cause = ?e, "cannot greet a new reader");
        }
    }
}

/// Reads snapshots.
#[derive(Debug)]
pub struct SnapshotReader {
    port: Subscriber<Service, [u8], Wire<SnapshotHeader>>,
    origins: Origins,
    service: Slices<SnapshotHeader>,
}

impl SnapshotReader {
    pub(crate) fn open(node: &BusNode) -> Result<SnapshotReader, BusError> {
        let service = join::<SnapshotHeader>(node, WORLD_SNAPSHOT)?;
        let port = subscribe(&service)?;
        Notifier::open(node, CONTROL_WAKE)?.notify();
        Ok(SnapshotReader {
            port,
            origins: Origins::default(),
            service,
        })
    }

    /// Takes the oldest snapshot that waits, if any.
    ///
    /// # Errors
    /// [`BusError::BadSample`] for a snapshot that breaks the contract; the next call continues
    /// after it.
    #[expect(
        clippy::should_implement_trait,
        reason = "polled, like `FrameReader::next`"
    )]
    pub fn next(&mut self) -> Result<Option<Snapshot>, BusError> {
        let Some(sample) = receive(&self.service, &self.port)? else {
            return Ok(None);
        };
        let header = sample.user_header().0;
        let fault = if header.magic != SNAPSHOT_MAGIC {
            Some(format!(
                "starts with {:#010x}, not with \"GSNP\"",
                header.magic
            ))
        } else if header.schema_version != SCHEMA_VERSION {
            Some(format!(
                "carries schema {}, this reader understands {SCHEMA_VERSION}",
                header.schema_version
            ))
        } else if header.n_actors as usize * size_of::<ActorRecord>() != sample.payload().len() {
            Some(format!(
                "claims {} actors in {} bytes",
                header.n_actors,
                sample.payload().len()
            ))
        } else if bytemuck::try_cast_slice::<u8, ActorRecord>(sample.payload()).is_err() {
            Some("is not aligned".to_string())
        } else {
            None
        };
        match fault {
            Some(fault) => Err(BusError::BadSample {
                service: self.service.name().as_str().into(),
                writer: Some(
                    self.origins
                        .of_writer(sample.origin().value(), &self.service),
                ),
                fault,
            }),
            None => Ok(Some(Snapshot { sample, header })),
        }
    }

    /// Takes the newest snapshot that waits, if any; older ones are dropped.
    ///
    /// # Errors
    /// As [`SnapshotReader::next`].
    pub fn latest(&mut self) -> Result<Option<Snapshot>, BusError> {
        let mut newest = None;
        // Bounded, as in `FrameReader::latest`.
        for _ in 0..qos::MAX_PASSED_OVER {
            match self.next()? {
                Some(snapshot) => newest = Some(snapshot),
                None => break,
            }
        }
        Ok(newest)
    }
}

/// A snapshot in shared memory. A reader may hold four at a time.
#[derive(Debug)]
pub struct Snapshot {
    sample: Sample<Service, [u8], Wire<SnapshotHeader>>,
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
