//! Topics of records: whoever reads them takes what waits and learns who sent each. A record is the
//! whole sample; it has no header.

use std::fmt::Debug;
use std::sync::Arc;

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use crate::contract::error::BusError;
use crate::contract::origin::Origin;
use crate::contract::qos::{MAX_NODES, Qos, USUAL_LOANS};
use crate::contract::wire::{OnBus, Wire};
use crate::memory::shortage::backed;
use crate::memory::sizes::segment_bytes;
use crate::place::event::Notifier;
use crate::place::iceoryx_error::{
    other_error, reader_error, receive_error, service_error, writer_error,
};
use crate::place::node::{BusNode, Service};
use crate::place::origins::{Origins, pid_of};
use crate::place::service::{check_schema, schema_attribute, settle};
use crate::ports::drain::drain;

/// A record with a topic of its own.
pub trait Record: OnBus {
    /// Name of the topic without the domain.
    const TOPIC: &'static str;
    /// Event that wakes its readers.
    const WAKE: &'static str;
    /// Capacity of the topic.
    const QOS: Qos;
    /// The record as its reader gets it.
    type Taken;

    /// The record with the process that sent it.
    fn taken(self, origin: Arc<Origin>) -> Self::Taken;
}

type Records<R> = PortFactory<Service, Wire<R>, ()>;

fn service<R: Record>(node: &BusNode) -> Result<Records<R>, BusError> {
    let (full, name) = node.service_name(R::TOPIC)?;
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
            .publish_subscribe::<Wire<R>>()
            .max_publishers(R::QOS.publishers)
            .max_subscribers(R::QOS.readers)
            .max_nodes(MAX_NODES)
            .subscriber_max_buffer_size(R::QOS.buffer)
            .subscriber_max_borrowed_samples(R::QOS.borrowed)
            .enable_safe_overflow(true)
            .open_or_create_with_attributes(&schema_attribute())
            .map_err(|e| service_error("open", &full, &e))
    })
}

/// Writes records, and wakes their readers.
#[derive(Debug)]
pub struct RecordWriter<R: Record> {
    port: Publisher<Service, Wire<R>, ()>,
    wake: Notifier,
    _service: Records<R>,
}

impl<R: Record> RecordWriter<R> {
    pub(crate) fn open(node: &BusNode, name: &str) -> Result<RecordWriter<R>, BusError> {
        let service = service::<R>(node)?;
        let port_name = PortName::new(name).map_err(|_| BusError::Name { topic: name.into() })?;
        let port = service
            .publisher_builder()
            .name(&port_name)
            .create()
            .map_err(|e| {
                let bytes = segment_bytes(&R::QOS, USUAL_LOANS, size_of::<R>());
                writer_error(service.name().as_str(), R::QOS.publishers, bytes, e)
            })?;
        Ok(RecordWriter {
            port,
            wake: Notifier::open(node, R::WAKE)?,
            _service: service,
        })
    }

    pub(crate) fn put(&self, record: R) -> Result<(), BusError> {
        let failed = |e: &dyn Debug| other_error("write to", R::TOPIC, e);
        let loan = self.port.loan_uninit().map_err(|e| failed(&e))?;
        let sample = loan.write_payload(Wire(record));
        let payload = std::ptr::from_ref(sample.payload()).cast();
        backed(R::TOPIC, payload, size_of::<R>())?;
        sample.send().map_err(|e| failed(&e))?;
        self.wake.notify();
        Ok(())
    }
}

/// Reads records.
#[derive(Debug)]
pub struct RecordReader<R: Record> {
    port: Subscriber<Service, Wire<R>, ()>,
    origins: Origins,
    service: Records<R>,
}

impl<R: Record> RecordReader<R> {
    pub(crate) fn open(node: &BusNode) -> Result<RecordReader<R>, BusError> {
        let service = service::<R>(node)?;
        let port = service
            .subscriber_builder()
            .create()
            .map_err(|e| reader_error(service.name().as_str(), R::QOS.readers, e))?;
        Ok(RecordReader {
            port,
            origins: Origins::default(),
            service,
        })
    }

    /// Takes the records that wait, of each writer at most as many as the topic keeps for it.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn drain(&mut self) -> Result<Vec<R::Taken>, BusError> {
        let RecordReader {
            port,
            origins,
            service,
        } = self;
        let full = service.name().as_str();
        let mut taken = Vec::new();
        drain(
            &R::QOS,
            usize::MAX,
            || {
                port.receive()
                    .map_err(|e| receive_error(full, R::QOS.borrowed, e))
            },
            |sample| {
                let id = sample.origin().value();
                let origin = origins.of(id, |see| list_writers(service, see));
                taken.push(sample.payload().0.taken(origin));
                size_of::<R>()
            },
        )?;
        Ok(taken)
    }

    /// The processes whose writers are open, by the names of their ports. Call
    /// [`crate::Bus::clean_dead_nodes`] first, so that killed ones are not among them.
    pub fn writers(&self) -> Vec<Origin> {
        let mut writers = Vec::new();
        list_writers(&self.service, &mut |_, node, port| {
            writers.push(Origin::new(pid_of(node), port));
        });
        writers.sort_by(|a, b| (&a.port, a.pid).cmp(&(&b.port, b.pid)));
        writers
    }
}

fn list_writers<R: Record>(service: &Records<R>, see: &mut dyn FnMut(u128, UniqueNodeId, &str)) {
    service.dynamic_config().list_publishers(|details| {
        see(
            details.publisher_id.value(),
            details.node_id,
            details.publisher_name.as_str(),
        );
        CallbackProgression::Continue
    });
}
