//! `control/vehicles` and `control/ack`: records that are sent in bulk every tick.

use std::sync::Arc;

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use schema_frames::control::{CONTROL_MAGIC, ControlHeader};
use schema_frames::limits::MAX_CONTROL_RECORDS;
use schema_frames::{AckRecord, SCHEMA_VERSION, VehicleControlRecord};

use crate::complaints::Complaints;
use crate::drain::{Gaps, drain};
use crate::error::BusError;
use crate::event::Notifier;
use crate::iceoryx_error::{other_error, reader_error, receive_error, service_error, writer_error};
use crate::intake::{receive, subscribe};
use crate::memory::segment_bytes;
use crate::names::{CONTROL_ACK, CONTROL_VEHICLES, CONTROL_WAKE};
use crate::node::{BusNode, Service};
use crate::origin::Origin;
use crate::origins::{Origins, pid_of};
use crate::qos;
use crate::service::{Slices, check_schema, make, schema_attribute, settle};
use crate::shortage::backed;
use crate::wire::Wire;

/// Records of a slot before the segment grows for the first time.
const FIRST_SLOT_RECORDS: usize = 64;

fn ack_service(node: &BusNode) -> Result<Acks, BusError> {
    let (full, name) = node.service_name(CONTROL_ACK)?;
    settle(node, || {
        check_schema(
            node,
            &full,
            &name,
            MessagingPattern::PublishSubscribe,
            "rebuild the older of the two",
        )?;
        node.iceoryx()
            .service_builder(&name)
            .publish_subscribe::<Wire<AckRecord>>()
            .max_publishers(qos::CONTROL.publishers)
            .max_subscribers(qos::CONTROL.readers)
            .max_nodes(qos::MAX_NODES)
            .subscriber_max_buffer_size(qos::CONTROL.buffer)
            .subscriber_max_borrowed_samples(qos::CONTROL.borrowed)
            .enable_safe_overflow(true)
            .open_or_create_with_attributes(&schema_attribute())
            .map_err(|e| service_error("open", &full, &e))
    })
}

type Acks = PortFactory<Service, Wire<AckRecord>, ()>;

/// `name` cut to 40 bytes and padded with zeros.
pub(crate) fn name_bytes(name: &str) -> [u8; 40] {
    let mut bytes = [0; 40];
    let mut len = name.len().min(40);
    while !name.is_char_boundary(len) {
        len -= 1;
    }
    bytes[..len].copy_from_slice(&name.as_bytes()[..len]);
    bytes
}

/// The text before the padding; bytes that are not UTF-8 become �.
pub(crate) fn name_text(bytes: &[u8; 40]) -> String {
    let len = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..len]).into_owned()
}

/// Writes vehicle controls.
#[derive(Debug)]
pub struct ControlWriter {
    port: Publisher<Service, [u8], Wire<ControlHeader>>,
    name: [u8; 40],
    seq: u64,
    _service: Slices<ControlHeader>,
}

impl ControlWriter {
    pub(crate) fn open(node: &BusNode, name: &str) -> Result<ControlWriter, BusError> {
        let service = make::<ControlHeader>(node, CONTROL_VEHICLES, &qos::CONTROL)?;
        let full = service.name().as_str().to_string();
        let len = FIRST_SLOT_RECORDS * size_of::<VehicleControlRecord>();
        let port = service
            .publisher_builder()
            .initial_max_slice_len(len)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .create()
            .map_err(|e| {
                writer_error(
                    &full,
                    qos::CONTROL.publishers,
                    segment_bytes(&qos::CONTROL, qos::USUAL_LOANS, len),
                    e,
                )
            })?;
        Ok(ControlWriter {
            port,
            name: name_bytes(name),
            seq: 0,
            _service: service,
        })
    }

    /// Sends controls that answer the snapshot of `tick`. The daemon applies them before its next
    /// tick.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn send(&mut self, tick: u64, records: &[VehicleControlRecord]) -> Result<(), BusError> {
        let failed = |e: &dyn std::fmt::Debug| other_error("write to", CONTROL_VEHICLES, e);
        let bytes: &[u8] = bytemuck::cast_slice(records);
        let loan = self
            .port
            .loan_slice_uninit(bytes.len())
            .map_err(|e| failed(&e))?;
        let mut sample = loan.write_from_slice(bytes);
        backed(CONTROL_VEHICLES, sample.payload().as_ptr(), bytes.len())?;
        // The number is used up even if sending fails, so that a gap shows the loss.
        self.seq += 1;
        sample.user_header_mut().0 = ControlHeader {
            magic: CONTROL_MAGIC,
            schema_version: SCHEMA_VERSION,
            reserved0: 0,
            tick,
            seq: self.seq,
            writer: self.name,
        };
        sample.send().map(drop).map_err(|e| failed(&e))
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
fn records_of(header: &ControlHeader, payload: &[u8]) -> Result<Vec<VehicleControlRecord>, String> {
    if header.magic != CONTROL_MAGIC {
        return Err(format!(
            "starts with {:#010x}, not with \"GCTL\"",
            header.magic
        ));
    }
    if header.schema_version != SCHEMA_VERSION {
        return Err(format!(
            "carries schema {}, this simulator reads {SCHEMA_VERSION}",
            header.schema_version
        ));
    }
    let record_bytes = size_of::<VehicleControlRecord>();
    if payload.len() > MAX_CONTROL_RECORDS * record_bytes {
        return Err(format!(
            "has {} bytes, at most {MAX_CONTROL_RECORDS} records of {record_bytes} are read",
            payload.len()
        ));
    }
    let records = payload.chunks_exact(record_bytes);
    if !records.remainder().is_empty() {
        return Err(format!(
            "has {} bytes, not a whole number of records of {record_bytes}",
            payload.len()
        ));
    }
    // Wherever the bytes begin: another writer's need not be aligned, nor those of no records.
    Ok(records.map(bytemuck::pod_read_unaligned).collect())
}

/// Writes lockstep acknowledgements.
#[derive(Debug)]
pub struct AckWriter {
    port: Publisher<Service, Wire<AckRecord>, ()>,
    wake: Notifier,
    _service: Acks,
}

impl AckWriter {
    pub(crate) fn open(node: &BusNode, name: &str) -> Result<AckWriter, BusError> {
        let service = ack_service(node)?;
        let full = service.name().as_str().to_string();
        let bad = |_| BusError::Name { topic: name.into() };
        let port_name = PortName::new(name).map_err(bad)?;
        let port = service
            .publisher_builder()
            .name(&port_name)
            .create()
            .map_err(|e| {
                writer_error(
                    &full,
                    qos::CONTROL.publishers,
                    segment_bytes(&qos::CONTROL, qos::USUAL_LOANS, size_of::<AckRecord>()),
                    e,
                )
            })?;
        Ok(AckWriter {
            port,
            wake: Notifier::open(node, CONTROL_WAKE)?,
            _service: service,
        })
    }

    /// Says that participant `participant` is done with `tick`, and wakes the daemon.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn send(&self, participant: u32, epoch: u64, tick: u64) -> Result<(), BusError> {
        let record = AckRecord {
            participant,
            reserved: 0,
            epoch,
            tick,
            reserved1: 0,
        };
        let failed = |e: &dyn std::fmt::Debug| other_error("write to", CONTROL_ACK, e);
        let loan = self.port.loan_uninit().map_err(|e| failed(&e))?;
        let sample = loan.write_payload(Wire(record));
        let payload = std::ptr::from_ref(sample.payload()).cast();
        backed(CONTROL_ACK, payload, size_of::<AckRecord>())?;
        sample.send().map_err(|e| failed(&e))?;
        self.wake.notify();
        Ok(())
    }
}

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

/// Reads lockstep acknowledgements.
#[derive(Debug)]
pub struct AckReader {
    port: Subscriber<Service, Wire<AckRecord>, ()>,
    origins: Origins,
    service: Acks,
}

impl AckReader {
    pub(crate) fn open(node: &BusNode) -> Result<AckReader, BusError> {
        let service = ack_service(node)?;
        let full = service.name().as_str().to_string();
        let port = service
            .subscriber_builder()
            .create()
            .map_err(|e| reader_error(&full, qos::CONTROL.readers, e))?;
        Ok(AckReader {
            port,
            origins: Origins::default(),
            service,
        })
    }

    /// Takes the acknowledgements that wait, at most 64 of each writer.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn drain(&mut self) -> Result<Vec<Ack>, BusError> {
        let AckReader {
            port,
            origins,
            service,
        } = self;
        let full = service.name().as_str();
        let mut acks = Vec::new();
        drain(
            &qos::CONTROL,
            usize::MAX,
            || {
                port.receive()
                    .map_err(|e| receive_error(full, qos::CONTROL.borrowed, e))
            },
            |sample| {
                let AckRecord {
                    participant,
                    epoch,
                    tick,
                    ..
                } = sample.payload().0;
                acks.push(Ack {
                    participant,
                    epoch,
                    tick,
                    origin: origins.of(sample.origin().value(), |see| list_writers(service, see)),
                });
                size_of::<AckRecord>()
            },
        )?;
        Ok(acks)
    }

    /// The processes whose writers are open; the names of their ports are those of the participants.
    /// Call [`crate::Bus::clean_dead_nodes`] first, so that killed ones are not among them.
    pub fn writers(&self) -> Vec<Origin> {
        let mut writers = Vec::new();
        list_writers(&self.service, &mut |_, node, port| {
            writers.push(Origin::new(pid_of(node), port));
        });
        writers.sort_by(|a, b| (&a.port, a.pid).cmp(&(&b.port, b.pid)));
        writers
    }
}

fn list_writers(service: &Acks, see: &mut dyn FnMut(u128, UniqueNodeId, &str)) {
    service.dynamic_config().list_publishers(|details| {
        see(
            details.publisher_id.value(),
            details.node_id,
            details.publisher_name.as_str(),
        );
        CallbackProgression::Continue
    });
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
        let fault = |header: &ControlHeader, n_bytes| records_of(header, &vec![0; n_bytes]).err();
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
