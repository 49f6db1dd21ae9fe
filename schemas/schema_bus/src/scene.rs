//! `control/scene` and `control/rendered`: scenes for render workers, and their answers.

use std::sync::Arc;

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections as _;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use schema_frames::scene::SCENE_MAGIC;
use schema_frames::{RenderedRecord, SCHEMA_VERSION, SceneHeader};

use crate::clock::mono_now;
use crate::drain::drain;
use crate::error::BusError;
use crate::event::Notifier;
use crate::iceoryx_error::{other_error, reader_error, receive_error, service_error, writer_error};
use crate::intake::{receive, subscribe};
use crate::memory::segment_bytes;
use crate::names::{CONTROL_RENDERED, CONTROL_SCENE, CONTROL_WAKE};
use crate::node::{BusNode, Service};
use crate::origin::Origin;
use crate::origins::{Origins, pid_of};
use crate::qos;
use crate::service::{Slices, check_schema, make, schema_attribute, settle};
use crate::shortage::backed;
use crate::wire::Wire;

/// Bytes of a slot before the segment grows for the first time.
const FIRST_SLOT_BYTES: usize = 64 << 10;

/// Writes scenes.
#[derive(Debug)]
pub struct ScenePublisher {
    port: Publisher<Service, [u8], Wire<SceneHeader>>,
    wake: Notifier,
    service: Slices<SceneHeader>,
}

impl ScenePublisher {
    pub(crate) fn open(node: &BusNode) -> Result<ScenePublisher, BusError> {
        let service = make::<SceneHeader>(node, CONTROL_SCENE, &qos::SCENE)?;
        let full = service.name().as_str().to_string();
        let port = service
            .publisher_builder()
            .initial_max_slice_len(FIRST_SLOT_BYTES)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .create()
            .map_err(|e| {
                let bytes = segment_bytes(&qos::SCENE, qos::USUAL_LOANS, FIRST_SLOT_BYTES);
                writer_error(&full, qos::SCENE.publishers, bytes, e)
            })?;
        Ok(ScenePublisher {
            port,
            wake: Notifier::open(node, CONTROL_SCENE)?,
            service,
        })
    }

    /// Sends a message whose payload is `parts` one after the other, and wakes the workers. The
    /// header's magic, version, size and time of publishing are set here.
    ///
    /// # Errors
    /// [`BusError::Memory`] if `/dev/shm` has no room for it, [`BusError::Service`].
    pub fn send(&self, mut header: SceneHeader, parts: &[&[u8]]) -> Result<(), BusError> {
        header.magic = SCENE_MAGIC;
        header.schema_version = SCHEMA_VERSION;
        header.header_bytes = size_of::<SceneHeader>() as u16;
        let name = self.service.name().as_str();
        let failed = |e: &dyn std::fmt::Debug| other_error("write to", name, e);
        // One long piece is copied once; several are few bytes but for the last.
        let bytes = parts.concat();
        let loan = self
            .port
            .loan_slice_uninit(bytes.len())
            .map_err(|e| failed(&e))?;
        let mut sample = loan.write_from_slice(&bytes);
        backed(name, sample.payload().as_ptr(), bytes.len())?;
        header.published_mono_nanos = mono_now().0;
        sample.user_header_mut().0 = header;
        sample.send().map_err(|e| failed(&e))?;
        self.wake.notify_listeners();
        Ok(())
    }

    /// Connects workers that joined since the last call.
    pub fn greet(&self) {
        if let Err(e) = self.port.update_connections() {
            tracing::warn!(service = self.service.name().as_str(), cause = ?e, "cannot greet a new reader");
        }
    }
}

/// Reads scenes.
#[derive(Debug)]
pub struct SceneReader {
    port: Subscriber<Service, [u8], Wire<SceneHeader>>,
    origins: Origins,
    service: Slices<SceneHeader>,
}

/// A scene in shared memory. A worker may hold ten at a time.
#[derive(Debug)]
pub struct SceneMessage {
    sample: Sample<Service, [u8], Wire<SceneHeader>>,
}

impl SceneMessage {
    /// The header; magic, version and size are checked, nothing else.
    pub fn header(&self) -> &SceneHeader {
        &self.sample.user_header().0
    }

    /// The payload.
    pub fn payload(&self) -> &[u8] {
        self.sample.payload()
    }
}

impl SceneReader {
    pub(crate) fn open(node: &BusNode) -> Result<SceneReader, BusError> {
        let service = make::<SceneHeader>(node, CONTROL_SCENE, &qos::SCENE)?;
        let port = subscribe(&service)?;
        Ok(SceneReader {
            port,
            origins: Origins::default(),
            service,
        })
    }

    /// Takes the oldest message that waits, if any.
    ///
    /// # Errors
    /// [`BusError::BadSample`] for one that breaks the contract; the next call continues after it.
    #[expect(
        clippy::should_implement_trait,
        reason = "polled, like `FrameReader::next`"
    )]
    pub fn next(&mut self) -> Result<Option<SceneMessage>, BusError> {
        let Some(sample) = receive(&self.service, &self.port)? else {
            return Ok(None);
        };
        let header = &sample.user_header().0;
        let fault = if header.magic != SCENE_MAGIC {
            format!("starts with {:#010x}, not with \"GSCN\"", header.magic)
        } else if header.schema_version != SCHEMA_VERSION {
            format!(
                "carries schema {}, this worker understands {SCHEMA_VERSION}",
                header.schema_version
            )
        } else {
            return Ok(Some(SceneMessage { sample }));
        };
        let writer = sample.origin().value();
        Err(BusError::BadSample {
            service: self.service.name().as_str().into(),
            writer: Some(self.origins.of_writer(writer, &self.service)),
            fault,
        })
    }

    /// The process that writes scenes; `None` if nobody does. Call
    /// [`crate::Bus::clean_dead_nodes`] first, so that it is no killed one.
    pub fn writer(&self) -> Option<Origin> {
        let mut writer = None;
        self.service.dynamic_config().list_publishers(|details| {
            writer = Some(Origin::new(pid_of(details.node_id), ""));
            CallbackProgression::Continue
        });
        writer
    }
}

type Answers = PortFactory<Service, Wire<RenderedRecord>, ()>;

fn answers(node: &BusNode) -> Result<Answers, BusError> {
    let (full, name) = node.service_name(CONTROL_RENDERED)?;
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
            .publish_subscribe::<Wire<RenderedRecord>>()
            .max_publishers(qos::RENDERED.publishers)
            .max_subscribers(qos::RENDERED.readers)
            .max_nodes(qos::MAX_NODES)
            .subscriber_max_buffer_size(qos::RENDERED.buffer)
            .subscriber_max_borrowed_samples(qos::RENDERED.borrowed)
            .enable_safe_overflow(true)
            .open_or_create_with_attributes(&schema_attribute())
            .map_err(|e| service_error("open", &full, &e))
    })
}

/// Writes a worker's answers.
#[derive(Debug)]
pub struct RenderedWriter {
    port: Publisher<Service, Wire<RenderedRecord>, ()>,
    wake: Notifier,
    _service: Answers,
}

impl RenderedWriter {
    pub(crate) fn open(node: &BusNode, name: &str) -> Result<RenderedWriter, BusError> {
        let service = answers(node)?;
        let full = service.name().as_str().to_string();
        let port_name = PortName::new(name).map_err(|_| BusError::Name { topic: name.into() })?;
        let port = service
            .publisher_builder()
            .name(&port_name)
            .create()
            .map_err(|e| {
                let n_bytes = size_of::<RenderedRecord>();
                let bytes = segment_bytes(&qos::RENDERED, qos::USUAL_LOANS, n_bytes);
                writer_error(&full, qos::RENDERED.publishers, bytes, e)
            })?;
        Ok(RenderedWriter {
            port,
            wake: Notifier::open(node, CONTROL_WAKE)?,
            _service: service,
        })
    }

    /// Answers, and wakes the simulator.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn send(&self, record: RenderedRecord) -> Result<(), BusError> {
        let failed = |e: &dyn std::fmt::Debug| other_error("write to", CONTROL_RENDERED, e);
        let loan = self.port.loan_uninit().map_err(|e| failed(&e))?;
        let sample = loan.write_payload(Wire(record));
        let payload = std::ptr::from_ref(sample.payload()).cast();
        backed(CONTROL_RENDERED, payload, size_of::<RenderedRecord>())?;
        sample.send().map_err(|e| failed(&e))?;
        self.wake.notify();
        Ok(())
    }
}

/// An answer, with the process that sent it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rendered {
    /// The answer.
    pub record: RenderedRecord,
    /// Who sent it; the name of its port is the worker's.
    pub origin: Arc<Origin>,
}

/// Reads workers' answers.
#[derive(Debug)]
pub struct RenderedReader {
    port: Subscriber<Service, Wire<RenderedRecord>, ()>,
    origins: Origins,
    service: Answers,
}

impl RenderedReader {
    pub(crate) fn open(node: &BusNode) -> Result<RenderedReader, BusError> {
        let service = answers(node)?;
        let full = service.name().as_str().to_string();
        let port = service
            .subscriber_builder()
            .create()
            .map_err(|e| reader_error(&full, qos::RENDERED.readers, e))?;
        Ok(RenderedReader {
            port,
            origins: Origins::default(),
            service,
        })
    }

    /// Takes the answers that wait, a bounded number of each worker.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn drain(&mut self) -> Result<Vec<Rendered>, BusError> {
        let RenderedReader {
            port,
            origins,
            service,
        } = self;
        let full = service.name().as_str();
        let mut taken = Vec::new();
        drain(
            &qos::RENDERED,
            usize::MAX,
            || {
                port.receive()
                    .map_err(|e| receive_error(full, qos::RENDERED.borrowed, e))
            },
            |sample| {
                taken.push(Rendered {
                    record: sample.payload().0,
                    origin: origins.of(sample.origin().value(), |see| list_writers(service, see)),
                });
                size_of::<RenderedRecord>()
            },
        )?;
        Ok(taken)
    }

    /// The workers whose ports are open, those of killed processes among them until they are cleaned
    /// up.
    pub fn writers(&self) -> Vec<Origin> {
        let mut writers = Vec::new();
        list_writers(&self.service, &mut |_, node, port| {
            writers.push(Origin::new(pid_of(node), port));
        });
        writers
    }
}

fn list_writers(service: &Answers, see: &mut dyn FnMut(u128, UniqueNodeId, &str)) {
    service.dynamic_config().list_publishers(|details| {
        see(
            details.publisher_id.value(),
            details.node_id,
            details.publisher_name.as_str(),
        );
        CallbackProgression::Continue
    });
}
