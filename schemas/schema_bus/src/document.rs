//! Documents: texts that change rarely. A late reader receives the newest one.

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections as _;
use iceoryx2::prelude::*;

use schema_frames::document::DOCUMENT_MAGIC;
use schema_frames::{DocumentHeader, SCHEMA_VERSION};

use crate::error::BusError;
use crate::event::Notifier;
use crate::iceoryx_error::{other_error, writer_error};
use crate::intake::{receive, subscribe};
use crate::memory::segment_bytes;
use crate::names::CONTROL_WAKE;
use crate::node::{BusNode, Service};
use crate::origins::Origins;
use crate::qos;
use crate::service::{Slices, join, make};
use crate::shortage::backed;
use crate::wire::Wire;

/// Bytes of a slot before the segment grows for the first time.
const FIRST_SLOT_BYTES: usize = 16 << 10;

/// Writes a document.
#[derive(Debug)]
pub struct DocumentPublisher {
    port: Publisher<Service, [u8], Wire<DocumentHeader>>,
    service: Slices<DocumentHeader>,
    revision: u64,
}

impl DocumentPublisher {
    pub(crate) fn open(node: &BusNode, name: &str) -> Result<DocumentPublisher, BusError> {
        Self::of(Self::service(node, name)?)
    }

    /// The service that [`DocumentPublisher::of`] writes to, which readers can join from here on.
    pub(crate) fn service(node: &BusNode, name: &str) -> Result<Slices<DocumentHeader>, BusError> {
        make::<DocumentHeader>(node, name, &qos::DOCUMENT)
    }

    pub(crate) fn of(service: Slices<DocumentHeader>) -> Result<DocumentPublisher, BusError> {
        let full = service.name().as_str().to_string();
        let port = service
            .publisher_builder()
            .initial_max_slice_len(FIRST_SLOT_BYTES)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .create()
            .map_err(|e| {
                writer_error(
                    &full,
                    qos::DOCUMENT.publishers,
                    segment_bytes(&qos::DOCUMENT, qos::USUAL_LOANS, FIRST_SLOT_BYTES),
                    e,
                )
            })?;
        Ok(DocumentPublisher {
            port,
            service,
            revision: 0,
        })
    }

    /// Sends a new text that holds from the end of `tick` on. Returns its revision, counted from 1.
    ///
    /// # Errors
    /// [`BusError::Memory`] if `/dev/shm` has no room for it, [`BusError::Service`]. Nothing is sent
    /// and no revision is used up then.
    pub fn send(&mut self, text: &str, epoch: u64, tick: u64) -> Result<u64, BusError> {
        self.send_revision(text, epoch, tick, self.revision + 1)
    }

    /// As [`DocumentPublisher::send`], under a revision that the caller counts: of a document that is
    /// sent again as it was.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn send_revision(
        &mut self,
        text: &str,
        epoch: u64,
        tick: u64,
        revision: u64,
    ) -> Result<u64, BusError> {
        let name = self.service.name().as_str();
        let failed = |e: &dyn std::fmt::Debug| other_error("write to", name, e);
        let loan = self
            .port
            .loan_slice_uninit(text.len())
            .map_err(|e| failed(&e))?;
        let mut sample = loan.write_from_slice(text.as_bytes());
        backed(name, sample.payload().as_ptr(), text.len())?;
        sample.user_header_mut().0 = DocumentHeader {
            magic: DOCUMENT_MAGIC,
            schema_version: SCHEMA_VERSION,
            epoch,
            revision,
            payload_bytes: text.len() as u64,
            tick,
            ..bytemuck::Zeroable::zeroed()
        };
        sample.send().map_err(|e| failed(&e))?;
        self.revision = revision;
        Ok(revision)
    }

    /// Sends `value` as JSON, like [`DocumentPublisher::send`].
    ///
    /// # Errors
    /// [`BusError::Service`], also for a value that JSON cannot hold.
    pub fn send_json<T: serde::Serialize>(
        &mut self,
        value: &T,
        epoch: u64,
        tick: u64,
    ) -> Result<u64, BusError> {
        let text = serde_json::to_string(value).map_err(|e| BusError::Service {
            action: "write JSON to",
            service: self.service.name().as_str().into(),
            cause: e.to_string(),
        })?;
        self.send(&text, epoch, tick)
    }

    /// Sends the newest text to readers that joined since the last call. iceoryx2 delivers it only
    /// in calls of the writer, so a daemon calls this once per turn of its loop, also while it
    /// waits for a cue (a new reader notifies `control/wake`). It costs little if nobody joined.
    pub fn greet(&self) {
        if let Err(e) = self.port.update_connections() {
            tracing::warn!(service = self.service.name().as_str(), cause = ?e, "cannot greet a new reader");
        }
    }

    /// Revision of the last text sent; 0 before the first.
    pub fn revision(&self) -> u64 {
        self.revision
    }
}

/// Reads a document.
#[derive(Debug)]
pub struct DocumentReader {
    port: Subscriber<Service, [u8], Wire<DocumentHeader>>,
    origins: Origins,
    service: Slices<DocumentHeader>,
}

/// A document's text.
#[derive(Clone, Debug, PartialEq)]
pub struct Document {
    /// Revision, epoch, tick.
    pub header: DocumentHeader,
    /// The text: JSON, or OpenDRIVE.
    pub text: String,
}

impl DocumentReader {
    pub(crate) fn open(node: &BusNode, name: &str) -> Result<DocumentReader, BusError> {
        let service = join::<DocumentHeader>(node, name)?;
        let port = subscribe(&service)?;
        Notifier::open(node, CONTROL_WAKE)?.notify();
        Ok(DocumentReader {
            port,
            origins: Origins::default(),
            service,
        })
    }

    /// Takes the newest text, if one was sent since the last call.
    ///
    /// # Errors
    /// [`BusError::BadSample`] for a text that breaks the contract.
    pub fn latest(&mut self) -> Result<Option<Document>, BusError> {
        let mut newest = None;
        // Bounded, so that a process that floods the document cannot hold its readers here.
        for _ in 0..qos::MAX_PASSED_OVER {
            match receive(&self.service, &self.port)? {
                Some(sample) => newest = Some(sample),
                None => break,
            }
        }
        let Some(sample) = newest else {
            return Ok(None);
        };
        let header = sample.user_header().0;
        let writer = sample.origin().value();
        let mut bad = |fault: String| BusError::BadSample {
            service: self.service.name().as_str().into(),
            writer: Some(self.origins.of_writer(writer, &self.service)),
            fault,
        };
        if header.magic != DOCUMENT_MAGIC {
            return Err(bad(format!(
                "starts with {:#010x}, not with \"GDOC\"",
                header.magic
            )));
        }
        if header.schema_version != SCHEMA_VERSION {
            return Err(bad(format!(
                "carries schema {}, this reader understands {SCHEMA_VERSION}",
                header.schema_version
            )));
        }
        let bytes = usize::try_from(header.payload_bytes)
            .ok()
            .and_then(|n| sample.payload().get(..n));
        let bytes = bytes.ok_or_else(|| {
            bad(format!(
                "claims {} bytes and has {}",
                header.payload_bytes,
                sample.payload().len()
            ))
        })?;
        let text = std::str::from_utf8(bytes).map_err(|e| bad(format!("is not UTF-8 ({e})")))?;
        Ok(Some(Document {
            header,
            text: text.to_string(),
        }))
    }
}

impl Document {
    /// Parses the text as JSON, e.g. `document.json::<WorldInfo>()`.
    ///
    /// # Errors
    /// [`BusError::BadSample`] with serde's message.
    pub fn json<T: serde::de::DeserializeOwned>(&self) -> Result<T, BusError> {
        serde_json::from_str(&self.text).map_err(|e| BusError::BadSample {
            service: std::any::type_name::<T>().into(),
            writer: None,
            fault: format!("is not the JSON expected ({e})"),
        })
    }
}
