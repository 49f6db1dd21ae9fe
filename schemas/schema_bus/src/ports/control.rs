//! `control/vehicles` and `control/ack`: records that are sent in bulk every tick.

use std::sync::Arc;

use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::service::port_factory::PortFactory as _;

use schema_frames::control::{CONTROL_MAGIC, ControlHeader};
use schema_frames::limits::MAX_CONTROL_RECORDS;
use schema_frames::{AckRecord, SCHEMA_VERSION, VehicleControlRecord};

use crate::contract::error::BusError;
use crate::contract::names::{CONTROL_ACK, CONTROL_VEHICLES, CONTROL_WAKE, name_bytes, name_text};
use crate::contract::origin::Origin;
use crate::contract::qos::{self, Qos};
use crate::contract::wire::Wire;
use crate::place::complaints::Complaints;
use crate::place::node::{BusNode, Service};
use crate::place::origins::Origins;
use crate::place::service::{Slices, make};
use crate::ports::drain::{Gaps, drain};
use crate::ports::reader::{SampleFault, Stamp, receive, subscribe};
use crate::ports::records::{Record, RecordReader, RecordWriter};
use crate::ports::writer::Writer;

/// Records of a slot before the segment grows for the first time.
const FIRST_SLOT_RECORDS: usize = 64;

/// Writes vehicle controls.
#[derive(Debug)]
pub struct ControlWriter {
    writer: Writer<ControlHeader>,
    name: [u8; 40],
    seq: u64,
}

impl ControlWriter {
    pub(crate) fn open(node: &BusNode, name: &str) -> Result<ControlWriter, BusError> {
        let service = make::<ControlHeader>(node, CONTROL_VEHICLES, &qos::CONTROL)?;
        let len = FIRST_SLOT_RECORDS * size_of::<VehicleControlRecord>();
        Ok(ControlWriter {
            writer: Writer::copying(service, len)?,
            name: name_bytes(name),
            seq: 0,
        })
    }

    /// Sends controls that answer the snapshot of `tick`. The daemon applies them before its next
    /// tick.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn send(&mut self, tick: u64, records: &[VehicleControlRecord]) -> Result<(), BusError> {
        let bytes: &[u8] = bytemuck::cast_slice(records);
        let mut loan = self.writer.copy(CONTROL_VEHICLES, bytes)?;
        // The number is used up even if sending fails, so that a gap shows the loss.
        self.seq += 1;
        *loan.header_mut() = ControlHeader {
            magic: CONTROL_MAGIC,
            schema_version: SCHEMA_VERSION,
            reserved0: 0,
            tick,
            seq: self.seq,
            writer: self.name,
        };
        loan.send("write to", CONTROL_VEHICLES).map(drop)
    }
}

/// One sample of vehicle controls.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlBatch {
    /// Name of the writer.
    pub writer: String,
    /// The writer's count.
    pub seq: u64,
    /// Tick of the snapshot it answers.
    pub tick: u64,
    /// The controls.
    pub records: Vec<VehicleControlRecord>,
    /// The process that sent it.
    pub origin: Arc<Origin>,
}

/// Reads vehicle controls.
#[derive(Debug)]
pub struct ControlReader {
    port: Subscriber<Service, [u8], Wire<ControlHeader>>,
    origins: Origins,
    gaps: Gaps,
    complaints: Complaints,
    n_lost: u64,
    service: Slices<ControlHeader>,
}

impl ControlReader {
    pub(crate) fn open(node: &BusNode) -> Result<ControlReader, BusError> {
        let service = make::<ControlHeader>(node, CONTROL_VEHICLES, &qos::CONTROL)?;
        let port = subscribe(&service)?;
        Ok(ControlReader {
            port,
            origins: Origins::default(),
            gaps: Gaps::default(),
            complaints: Complaints::default(),
            n_lost: 0,
            service,
        })
    }

    /// Takes the samples that wait, at most 64 of each writer and about
    /// [`qos::MAX_TURN_CONTROL_BYTES`] of all, sorted by (writer, seq), so that applying them in
    /// order lets the last one count. The next call takes what is left. Samples that break the contract are dropped
    /// and counted; the first one of a process is logged, and so is the first time that a process
    /// sent more than can wait.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn drain(&mut self) -> Result<Vec<ControlBatch>, BusError> {
        let ControlReader {
            port,
            origins,
            gaps,
            complaints,
            n_lost,
            service,
        } = self;
        let mut batches = Vec::new();
        drain(
            &qos::CONTROL,
            qos::MAX_TURN_CONTROL_BYTES,
            || receive(service, port),
            |sample| {
                let id = sample.origin().value();
                let origin = origins.of_writer(id, service);
                let header = sample.user_header().0;
                let writer = name_text(&header.writer);
                match records_of(&header, sample.payload()) {
                    Ok(records) => {
                        let gap = gaps.before(id, header.seq);
                        *n_lost = n_lost.saturating_add(gap);
                        if gap > 0 && complaints.count(&origin, "flood") {
                            tracing::warn!(
                                "{origin} floods control/vehicles as {writer:?}: {gap} samples were lost, because at most {} of one writer wait for a tick; send one sample a tick with the records of all its vehicles. Further losses are only counted",
                                qos::CONTROL.buffer
                            );
                        }
                        batches.push(ControlBatch {
                            writer,
                            seq: header.seq,
                            tick: header.tick,
                            records,
                            origin,
                        });
                        sample.payload().len()
                    }
                    Err(fault) => {
                        if complaints.count(&origin, "garbage") {
                            tracing::warn!(
                                "{origin} sent a sample on control/vehicles as {writer:?} that {fault}; it was dropped, further ones are only counted"
                            );
                        }
                        0
                    }
                }
            },
        )?;
        batches.sort_by(|a, b| (&a.writer, a.seq).cmp(&(&b.writer, b.seq)));
        Ok(batches)
    }

    /// Samples that broke the contract or were too many for one writer to wait.
    pub fn n_faults(&self) -> u64 {
        self.complaints.n()
    }

    /// Samples that were lost because their writer sent more than can wait.
    pub fn n_lost(&self) -> u64 {
        self.n_lost
    }

    /// Number of writers now.
    pub fn n_writers(&self) -> usize {
        self.service.dynamic_config().number_of_publishers()
    }
}

/// The records of a sample, or the rule that it breaks as a predicate.
fn records_of(
    header: &ControlHeader,
    payload: &[u8],
) -> Result<Vec<VehicleControlRecord>, SampleFault> {
    let stamp = Stamp {
        magic: header.magic,
        schema_version: header.schema_version,
    };
    stamp.check(CONTROL_MAGIC, "this simulator reads")?;
    let record_bytes = size_of::<VehicleControlRecord>();
    let found = payload.len();
    if found > MAX_CONTROL_RECORDS * record_bytes {
        return Err(SampleFault::TooMany {
            found,
            limit: MAX_CONTROL_RECORDS,
            record_bytes,
        });
    }
    let records = payload.chunks_exact(record_bytes);
    if !records.remainder().is_empty() {
        return Err(SampleFault::Cut {
            found,
            record_bytes,
        });
    }
    // Wherever the bytes begin: another writer's need not be aligned, nor those of no records.
    Ok(records.map(bytemuck::pod_read_unaligned).collect())
}

/// Writes lockstep acknowledgements.
pub type AckWriter = RecordWriter<AckRecord>;
/// Reads lockstep acknowledgements.
pub type AckReader = RecordReader<AckRecord>;

/// One acknowledgement, with the process that sent it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ack {
    /// Number of the participant.
    pub participant: u32,
    /// Epoch the tick belongs to.
    pub epoch: u64,
    /// The tick that is done.
    pub tick: u64,
    /// Who sent it; the name of its port is the participant's.
    pub origin: Arc<Origin>,
}

impl Record for AckRecord {
    const TOPIC: &'static str = CONTROL_ACK;
    const WAKE: &'static str = CONTROL_WAKE;
    const QOS: Qos = qos::CONTROL;
    type Taken = Ack;

    fn taken(self, origin: Arc<Origin>) -> Ack {
        Ack {
            participant: self.participant,
            epoch: self.epoch,
            tick: self.tick,
            origin,
        }
    }
}

impl RecordWriter<AckRecord> {
    /// Says that participant `participant` is done with `tick`, and wakes the daemon.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn send(&self, participant: u32, epoch: u64, tick: u64) -> Result<(), BusError> {
        self.put(AckRecord {
            participant,
            reserved: 0,
            epoch,
            tick,
            reserved1: 0,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_that_are_no_records_are_told_apart() {
        let good = ControlHeader {
            magic: CONTROL_MAGIC,
            schema_version: SCHEMA_VERSION,
            ..bytemuck::Zeroable::zeroed()
        };
        let fault = |header: &ControlHeader, n_bytes| {
            records_of(header, &vec![0; n_bytes])
                .err()
                .map(|fault| fault.to_string())
        };
        assert_eq!(records_of(&good, &[]).unwrap(), []);
        let other = ControlHeader { magic: 7, ..good };
        assert!(fault(&other, 0).unwrap().contains("starts with 0x00000007"));
        let other = ControlHeader {
            schema_version: 9,
            ..good
        };
        assert!(fault(&other, 0).unwrap().contains("schema 9"));
        assert!(fault(&good, 33).unwrap().contains("whole number"));
        let too_long = (MAX_CONTROL_RECORDS + 1) * size_of::<VehicleControlRecord>();
        assert!(fault(&good, too_long).unwrap().contains("at most 16384"));
    }
}
