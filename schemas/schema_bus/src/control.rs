//! `control/vehicles` and `control/ack`: records that are sent in bulk every tick.

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use schema_frames::control::{CONTROL_MAGIC, ControlHeader};
use schema_frames::{AckRecord, SCHEMA_VERSION, VehicleControlRecord};

use crate::error::BusError;
use crate::event::Notifier;
use crate::iceoryx_error::{other_error, reader_error, service_error, writer_error};
use crate::memory::segment_bytes;
use crate::names::{CONTROL_ACK, CONTROL_VEHICLES, CONTROL_WAKE};
use crate::node::{BusNode, Service};
use crate::qos;
use crate::reader::{receive, subscribe};
use crate::service::{Slices, check_schema, make, schema_attribute, settle};
use crate::wire::Wire;

/// Records of a slot before the segment grows for the first time.
const FIRST_SLOT_RECORDS: usize = 64;

fn ack_service(node: &BusNode) -> Result<Acks, BusError> {
    let (full, name) = node.service_name(CONTROL_ACK)?;
    settle(|| {
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
}

/// Reads vehicle controls.
#[derive(Debug)]
pub struct ControlReader {
    port: Subscriber<Service, [u8], Wire<ControlHeader>>,
    service: Slices<ControlHeader>,
}

impl ControlReader {
    pub(crate) fn open(node: &BusNode) -> Result<ControlReader, BusError> {
        let service = make::<ControlHeader>(node, CONTROL_VEHICLES, &qos::CONTROL)?;
        let port = subscribe(&service)?;
        Ok(ControlReader { port, service })
    }

    /// Takes all samples that wait, sorted by (writer, seq), so that applying them in order lets
    /// the last one count. Samples that break the contract are dropped with a warning.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn drain(&mut self) -> Result<Vec<ControlBatch>, BusError> {
        let mut batches = Vec::new();
        while let Some(sample) = receive(&self.service, &self.port)? {
            let header = sample.user_header().0;
            let records = bytemuck::try_cast_slice::<u8, VehicleControlRecord>(sample.payload());
            match records {
                Ok(records)
                    if header.magic == CONTROL_MAGIC && header.schema_version == SCHEMA_VERSION =>
                {
                    batches.push(ControlBatch {
                        writer: name_text(&header.writer),
                        seq: header.seq,
                        tick: header.tick,
                        records: records.to_vec(),
                    })
                }
                _ => tracing::warn!(
                    writer = name_text(&header.writer),
                    "dropped a sample that is not a list of vehicle controls"
                ),
            }
        }
        batches.sort_by(|a, b| (&a.writer, a.seq).cmp(&(&b.writer, b.seq)));
        Ok(batches)
    }

    /// Number of writers now.
    pub fn n_writers(&self) -> usize {
        self.service.dynamic_config().number_of_publishers()
    }
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
        self.port
            .send_copy(Wire(record))
            .map_err(|e| other_error("write to", CONTROL_ACK, &e))?;
        self.wake.notify();
        Ok(())
    }
}

/// Reads lockstep acknowledgements.
#[derive(Debug)]
pub struct AckReader {
    port: Subscriber<Service, Wire<AckRecord>, ()>,
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
        Ok(AckReader { port, service })
    }

    /// Takes all acknowledgements that wait.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn drain(&mut self) -> Result<Vec<AckRecord>, BusError> {
        let failed = |e: &dyn std::fmt::Debug| other_error("read", CONTROL_ACK, e);
        let mut records = Vec::new();
        while let Some(sample) = self.port.receive().map_err(|e| failed(&e))? {
            records.push(sample.payload().0);
        }
        Ok(records)
    }

    /// Names of the participants whose writers are open, sorted. Call
    /// [`crate::Bus::clean_dead_nodes`] first, so that killed ones are not among them.
    pub fn writers(&self) -> Vec<String> {
        let mut names = Vec::new();
        self.service.dynamic_config().list_publishers(|details| {
            names.push(details.publisher_name.as_str().to_string());
            CallbackProgression::Continue
        });
        names.sort();
        names
    }
}
