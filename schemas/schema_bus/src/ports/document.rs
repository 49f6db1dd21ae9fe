//! Documents: texts that change rarely. A late reader receives the newest one.

use std::sync::Arc;

use schema_frames::document::DOCUMENT_MAGIC;
use schema_frames::{DocumentHeader, SCHEMA_VERSION};

use crate::contract::error::BusError;
use crate::contract::names::CONTROL_WAKE;
use crate::contract::origin::Origin;
use crate::contract::qos;
use crate::place::event::Notifier;
use crate::place::node::BusNode;
use crate::place::service::{Slices, join, make};
use crate::ports::reader::{Moment, Reader, Received, SampleFault, SampleKind, Stamp, bad_sample};
use crate::ports::writer::Writer;

/// Bytes of a slot before the segment grows for the first time.
const FIRST_SLOT_BYTES: usize = 16 << 10;

/// Writes a document.
#[derive(Debug)]
pub struct DocumentPublisher {
    writer: Writer<DocumentHeader>,
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
        Ok(DocumentPublisher {
            writer: Writer::copying(service, FIRST_SLOT_BYTES)?,
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
        let name = self.writer.full_name();
        let mut loan = self.writer.copy(name, text.as_bytes())?;
        *loan.header_mut() = DocumentHeader {
            magic: DOCUMENT_MAGIC,
            schema_version: SCHEMA_VERSION,
            epoch,
            revision,
            payload_bytes: text.len() as u64,
            tick,
            ..bytemuck::Zeroable::zeroed()
        };
        loan.send("write to", name)?;
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
            service: self.writer.full_name().into(),
            cause: e.to_string(),
        })?;
        self.send(&text, epoch, tick)
    }

    /// Sends the newest text to readers that joined since the last call. iceoryx2 delivers it only
    /// in calls of the writer, so a daemon calls this once per turn of its loop, also while it
    /// waits for a cue (a new reader notifies `control/wake`). It costs little if nobody joined.
    pub fn greet(&self) {
        self.writer.greet(self.writer.full_name());
    }

    /// Revision of the last text sent; 0 before the first.
    pub fn revision(&self) -> u64 {
        self.revision
    }
}

/// Documents, whose texts are read only when they are the newest.
#[derive(Debug)]
struct Documents;

impl SampleKind for Documents {
    type Header = DocumentHeader;
    type Sample = Received<DocumentHeader>;
    type Fault = SampleFault;

    fn admit(
        &self,
        sample: Received<DocumentHeader>,
        _: &Arc<str>,
    ) -> Result<Received<DocumentHeader>, SampleFault> {
        Ok(sample)
    }

    fn moment(sample: &Received<DocumentHeader>) -> Moment {
        let header = &sample.user_header().0;
        Moment {
            epoch: header.epoch,
            tick: header.tick,
            seq: header.revision,
        }
    }

    fn refuse(service: String, writer: Option<Arc<Origin>>, fault: SampleFault) -> BusError {
        bad_sample(service, writer, &fault)
    }
}

/// Reads a document.
#[derive(Debug)]
pub struct DocumentReader(Reader<Documents>);

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
        let reader = Reader::of(join::<DocumentHeader>(node, name)?, name, Documents)?;
        Notifier::open(node, CONTROL_WAKE)?.notify();
        Ok(DocumentReader(reader))
    }

    /// Takes the newest text, if one was sent since the last call.
    ///
    /// # Errors
    /// [`BusError::BadSample`] for a text that breaks the contract.
    pub fn latest(&mut self) -> Result<Option<Document>, BusError> {
        let Some(sample) = self.0.latest()? else {
            return Ok(None);
        };
        match text_of(&sample) {
            Ok(document) => Ok(Some(document)),
            Err(fault) => Err(self.0.refusal(sample.origin().value(), fault)),
        }
    }
}

/// The text of a sample.
///
/// # Errors
/// The broken rule as a predicate.
fn text_of(sample: &Received<DocumentHeader>) -> Result<Document, SampleFault> {
    let header = sample.user_header().0;
    let stamp = Stamp {
        magic: header.magic,
        schema_version: header.schema_version,
    };
    stamp.check(DOCUMENT_MAGIC, "this reader understands")?;
    let bytes = usize::try_from(header.payload_bytes)
        .ok()
        .and_then(|n| sample.payload().get(..n));
    let bytes = bytes.ok_or(SampleFault::Length {
        claimed: header.payload_bytes,
        found: sample.payload().len(),
    })?;
    let text = std::str::from_utf8(bytes)?;
    Ok(Document {
        header,
        text: text.to_string(),
    })
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
