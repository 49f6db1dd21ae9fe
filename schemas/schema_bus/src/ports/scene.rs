//! `control/scene` and `control/rendered`: scenes for render workers, and their answers.

use std::sync::Arc;

use schema_frames::scene::SCENE_MAGIC;
use schema_frames::{RenderedRecord, SCHEMA_VERSION, SceneHeader};

use crate::contract::error::BusError;
use crate::contract::names::{CONTROL_RENDERED, CONTROL_SCENE, CONTROL_WAKE};
use crate::contract::origin::Origin;
use crate::contract::qos::{self, Qos};
use crate::place::event::Notifier;
use crate::place::node::BusNode;
use crate::place::service::make;
use crate::ports::reader::{Moment, Reader, Received, SampleFault, SampleKind, Stamp, bad_sample};
use crate::ports::records::{Record, RecordReader, RecordWriter};
use crate::ports::writer::Writer;
use crate::time::clock::mono_now;

/// Bytes of a slot before the segment grows for the first time.
const FIRST_SLOT_BYTES: usize = 64 << 10;

/// Writes scenes.
#[derive(Debug)]
pub struct ScenePublisher {
    writer: Writer<SceneHeader>,
    wake: Notifier,
}

impl ScenePublisher {
    pub(crate) fn open(node: &BusNode) -> Result<ScenePublisher, BusError> {
        let service = make::<SceneHeader>(node, CONTROL_SCENE, &qos::SCENE)?;
        Ok(ScenePublisher {
            writer: Writer::copying(service, FIRST_SLOT_BYTES)?,
            wake: Notifier::open(node, CONTROL_SCENE)?,
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
        let name = self.writer.full_name();
        // One long piece is copied once; several are few bytes but for the last.
        let mut loan = self.writer.copy(name, &parts.concat())?;
        header.published_mono_nanos = mono_now().0;
        *loan.header_mut() = header;
        loan.send("write to", name)?;
        self.wake.notify_listeners();
        Ok(())
    }

    /// Connects workers that joined since the last call.
    pub fn greet(&self) {
        self.writer.greet(self.writer.full_name());
    }
}

/// Scenes for render workers.
#[derive(Debug)]
pub struct Scenes;

/// Reads scenes.
pub type SceneReader = Reader<Scenes>;

/// A scene in shared memory. A worker may hold ten at a time.
#[derive(Debug)]
pub struct SceneMessage {
    sample: Received<SceneHeader>,
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

impl SampleKind for Scenes {
    type Header = SceneHeader;
    type Sample = SceneMessage;
    type Fault = SampleFault;

    fn admit(
        &self,
        sample: Received<SceneHeader>,
        _: &Arc<str>,
    ) -> Result<SceneMessage, SampleFault> {
        let header = &sample.user_header().0;
        let stamp = Stamp {
            magic: header.magic,
            schema_version: header.schema_version,
        };
        stamp.check(SCENE_MAGIC, "this worker understands")?;
        Ok(SceneMessage { sample })
    }

    fn moment(scene: &SceneMessage) -> Moment {
        let header = scene.header();
        Moment {
            epoch: header.epoch,
            tick: header.tick,
            seq: header.number,
        }
    }

    fn refuse(service: String, writer: Option<Arc<Origin>>, fault: SampleFault) -> BusError {
        bad_sample(service, writer, &fault)
    }
}

impl Reader<Scenes> {
    pub(crate) fn open(node: &BusNode) -> Result<SceneReader, BusError> {
        let service = make::<SceneHeader>(node, CONTROL_SCENE, &qos::SCENE)?;
        Reader::of(service, CONTROL_SCENE, Scenes)
    }
}

/// Writes a worker's answers.
pub type RenderedWriter = RecordWriter<RenderedRecord>;
/// Reads workers' answers.
pub type RenderedReader = RecordReader<RenderedRecord>;

/// An answer, with the process that sent it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rendered {
    /// The answer.
    pub record: RenderedRecord,
    /// Who sent it; the name of its port is the worker's.
    pub origin: Arc<Origin>,
}

impl Record for RenderedRecord {
    const TOPIC: &'static str = CONTROL_RENDERED;
    const WAKE: &'static str = CONTROL_WAKE;
    const QOS: Qos = qos::RENDERED;
    type Taken = Rendered;

    fn taken(self, origin: Arc<Origin>) -> Rendered {
        Rendered {
            record: self,
            origin,
        }
    }
}

impl RecordWriter<RenderedRecord> {
    /// Answers, and wakes the simulator.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn send(&self, record: RenderedRecord) -> Result<(), BusError> {
        self.put(record)
    }
}
