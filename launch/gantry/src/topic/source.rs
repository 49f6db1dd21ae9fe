//! Any topic as a stream of samples: frames, snapshots, documents, controls.

use std::time::Duration;

use anyhow::Context as _;
use schema_bus::names::{CONTROL_VEHICLES, WORLD_SNAPSHOT, rig_of, rig_tick};
use schema_bus::{
    Bus, BusError, ControlBatch, ControlReader, Document, DocumentReader, Frame, FrameReader,
    Listener, Snapshot, SnapshotReader, TopicKind,
};
use schema_frames::SCHEMA_VERSION;

/// Longest sleep between two looks, so that a missing wake-up costs no more than this.
const NAP: Duration = Duration::from_millis(1);

/// One sample.
pub enum Sample {
    Frame(Frame),
    Snapshot(Snapshot),
    Document(Document),
    Controls(ControlBatch),
}

/// What all kinds of samples have.
pub struct Stamp {
    /// Sequence number of the sample, if its header has one; a gap is a loss.
    pub seq: Option<u64>,
    /// `CLOCK_MONOTONIC` just before it was sent, if the header has it.
    pub published_mono_nanos: Option<u64>,
    pub bytes: u64,
}

impl Sample {
    pub fn stamp(&self) -> Stamp {
        let (seq, published_mono_nanos, bytes) = match self {
            Sample::Frame(frame) => {
                let header = frame.header();
                (
                    Some(header.seq),
                    Some(header.published_mono_nanos),
                    header.payload_bytes,
                )
            }
            // Every tick has one snapshot, so the tick serves as a sequence number.
            Sample::Snapshot(snapshot) => {
                let header = snapshot.header();
                (
                    Some(header.tick),
                    Some(header.published_mono_nanos),
                    size_of_val(snapshot.records()) as u64,
                )
            }
            Sample::Document(document) => (
                Some(document.header.revision),
                None,
                document.header.payload_bytes,
            ),
            // Several writers share this topic, and each has its own sequence numbers.
            Sample::Controls(batch) => (None, None, size_of_val(&batch.records[..]) as u64),
        };
        Stamp {
            seq,
            published_mono_nanos,
            bytes,
        }
    }
}

enum Reader {
    Frames(FrameReader),
    Snapshots(SnapshotReader),
    Documents(DocumentReader),
    Controls(ControlReader, std::vec::IntoIter<ControlBatch>),
}

/// An open topic of any kind.
pub struct Source {
    reader: Reader,
    wake: Option<Listener>,
}

impl Source {
    /// Opens `topic` (without the domain).
    pub fn open(bus: &Bus, topic: &str) -> anyhow::Result<Self> {
        let known = bus.topics()?.into_iter().find(|known| known.name == topic);
        if let Some(other) = known
            .as_ref()
            .filter(|known| !known.schema.is_empty() && known.schema != SCHEMA_VERSION.to_string())
        {
            let (service, theirs) = (format!("{}/{topic}", bus.domain()), other.schema.clone());
            return Err(BusError::SchemaSkew {
                service,
                theirs,
                advice: "rebuild the consumer",
            }
            .into());
        }
        let reader = match known.map_or(TopicKind::Frames, |known| known.kind) {
            TopicKind::Frames => Reader::Frames(bus.frame_reader(topic)?),
            TopicKind::Snapshot if topic == WORLD_SNAPSHOT => {
                Reader::Snapshots(bus.snapshot_reader()?)
            }
            TopicKind::Document => Reader::Documents(bus.document_reader(topic)?),
            TopicKind::Controls if topic == CONTROL_VEHICLES => {
                Reader::Controls(bus.control_reader()?, Vec::new().into_iter())
            }
            _ => anyhow::bail!(
                "topic {topic:?} carries no frames, snapshots, documents or controls; gantry cannot read it"
            ),
        };
        // Without the wake-up, the short sleeps alone keep the measurement going.
        let wake = matches!(reader, Reader::Frames(_))
            .then(|| bus.listener(&rig_tick(rig_of(topic))).ok())
            .flatten();
        Ok(Source { reader, wake })
    }

    /// The oldest sample that has not been read, if any.
    pub fn next(&mut self) -> anyhow::Result<Option<Sample>> {
        let sample = match &mut self.reader {
            Reader::Frames(reader) => reader.next()?.map(Sample::Frame),
            Reader::Snapshots(reader) => reader.next()?.map(Sample::Snapshot),
            Reader::Documents(reader) => reader.latest()?.map(Sample::Document),
            Reader::Controls(reader, waiting) => {
                if waiting.len() == 0 {
                    *waiting = reader.drain()?.into_iter();
                }
                waiting.next().map(Sample::Controls)
            }
        };
        Ok(sample)
    }

    /// Sleeps until a sample may have come, at most a millisecond.
    pub fn nap(&self) -> anyhow::Result<()> {
        match &self.wake {
            Some(listener) => listener
                .wait(NAP)
                .map(drop)
                .context("cannot wait for the next frame"),
            None => {
                std::thread::sleep(NAP);
                Ok(())
            }
        }
    }
}
