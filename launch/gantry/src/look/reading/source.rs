//! Any topic as a stream of samples, whatever it carries.

use std::time::Duration;

use anyhow::Context as _;
use launch_cli::wrong_usage;
use schema_bus::{
    Ack, AckReader, AnyReader, AnySample, Bus, BusError, ControlBatch, ControlReader, Document,
    DocumentReader, Frame, FrameReader, Listener, ResultReader, ResultSample, Snapshot,
    SnapshotReader,
};
use schema_frames::SCHEMA_VERSION;

use crate::look::census::{Census, Kind};

/// Longest sleep between two looks, so that a missing wake-up costs no more than this.
const NAP: Duration = Duration::from_millis(1);

/// One sample.
pub enum Sample {
    Frame(Frame),
    Result(ResultSample),
    Snapshot(Snapshot),
    Document(Document),
    Controls(ControlBatch),
    Ack(Ack),
    /// Of a program that does not use our headers.
    Other(AnySample),
}

/// What all kinds of samples have.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Stamp {
    /// Whose numbers these are, where several writers share a topic.
    pub writer: String,
    /// Random number of the writer's start; another one means that it began to count anew.
    pub epoch: u64,
    /// Number of the sample, if its header has one; a gap is a loss.
    pub seq: Option<u64>,
    /// `CLOCK_MONOTONIC` just before it was sent, if the header has it.
    pub published_mono_nanos: Option<u64>,
    /// Bytes of the payload.
    pub bytes: u64,
    /// Of a result: each input's topic, and the time from its publishing to the result's.
    pub answers: Vec<(String, u64)>,
    /// Of a result: time from the publishing of the oldest sensor frame behind it.
    pub since_sensor_nanos: Option<u64>,
}

impl Sample {
    pub fn stamp(&self) -> Stamp {
        match self {
            Sample::Frame(frame) => {
                let header = frame.header();
                Stamp {
                    epoch: header.epoch,
                    seq: Some(header.seq),
                    published_mono_nanos: Some(header.published_mono_nanos),
                    bytes: header.payload_bytes,
                    ..Stamp::default()
                }
            }
            Sample::Result(result) => stamp_of_result(result),
            // Every tick has one snapshot, so the tick serves as a number.
            Sample::Snapshot(snapshot) => {
                let header = snapshot.header();
                Stamp {
                    epoch: header.epoch,
                    seq: Some(header.tick),
                    published_mono_nanos: Some(header.published_mono_nanos),
                    bytes: size_of_val(snapshot.records()) as u64,
                    ..Stamp::default()
                }
            }
            Sample::Document(document) => Stamp {
                epoch: document.header.epoch,
                seq: Some(document.header.revision),
                bytes: document.header.payload_bytes,
                ..Stamp::default()
            },
            Sample::Controls(batch) => Stamp {
                // A name may come back as another process, which counts from 1 again.
                writer: format!("{} {}", batch.writer, batch.origin.pid.unwrap_or(0)),
                seq: Some(batch.seq),
                bytes: size_of_val(&batch.records[..]) as u64,
                ..Stamp::default()
            },
            Sample::Ack(_) => Stamp {
                bytes: size_of::<schema_frames::AckRecord>() as u64,
                ..Stamp::default()
            },
            Sample::Other(sample) => Stamp {
                bytes: sample.payload().len() as u64,
                ..Stamp::default()
            },
        }
    }
}

fn stamp_of_result(result: &ResultSample) -> Stamp {
    let header = result.header();
    let published = header.published_mono_nanos;
    let since = |nanos: u64| published.saturating_sub(nanos);
    let answers = result
        .inputs()
        .iter()
        .filter(|input| input.published_mono_nanos != 0);
    Stamp {
        writer: String::new(),
        epoch: header.writer_epoch,
        seq: Some(header.seq),
        published_mono_nanos: Some(published),
        bytes: header.body_bytes,
        answers: answers
            .map(|input| (input.topic(), since(input.published_mono_nanos)))
            .collect(),
        since_sensor_nanos: (header.origin_mono_nanos != 0)
            .then(|| since(header.origin_mono_nanos)),
    }
}

enum Reader {
    Frames(FrameReader),
    Results(ResultReader),
    Snapshots(SnapshotReader),
    Documents(DocumentReader),
    Controls(ControlReader, std::vec::IntoIter<ControlBatch>),
    Acks(AckReader, std::vec::IntoIter<Ack>),
    Other(AnyReader),
}

/// An open topic of any kind.
pub struct Source {
    reader: Reader,
    wake: Option<Listener>,
    n_refused: u64,
}

impl Source {
    /// Opens `topic` (without the domain).
    pub fn open(bus: &Bus, topic: &str) -> anyhow::Result<Self> {
        let census = Census::take(bus)?;
        let known = census.topic(topic);
        if let Some(other) = known.map(|known| &known.service)
            && !other.schema.is_empty()
            && other.schema != SCHEMA_VERSION.to_string()
        {
            return Err(BusError::SchemaSkew {
                service: format!("{}/{topic}", bus.domain()),
                theirs: other.schema.clone(),
                advice: "rebuild the consumer",
            }
            .into());
        }
        // A topic that is not there is opened as one of frames, whose error names those there are.
        let reader = match known.map_or(Kind::Frames, |known| known.kind) {
            Kind::Frames => Reader::Frames(bus.frame_reader(topic)?),
            Kind::Results => Reader::Results(bus.result_reader(topic)?),
            Kind::Snapshot => Reader::Snapshots(bus.snapshot_reader()?),
            Kind::Document => Reader::Documents(bus.document_reader(topic)?),
            Kind::Controls => Reader::Controls(bus.control_reader()?, Vec::new().into_iter()),
            Kind::Acks => Reader::Acks(bus.ack_reader()?, Vec::new().into_iter()),
            Kind::Other => Reader::Other(bus.any_reader(topic)?),
            Kind::Requests => {
                return Err(wrong_usage(format!(
                    "{topic:?} carries requests and their answers, which only the two ends of a request see; `gantry topic info {topic}` names them"
                )));
            }
        };
        // Without the wake-up, the short sleeps alone keep a measurement going.
        let wake = matches!(reader, Reader::Frames(_) | Reader::Results(_))
            .then(|| bus.listener(topic).ok())
            .flatten();
        Ok(Source {
            reader,
            wake,
            n_refused: 0,
        })
    }

    /// The oldest sample that has not been read, if any. Samples that break the contract are passed
    /// over: the first is an error, so that one sentence names the fault, further ones are counted.
    pub fn next(&mut self) -> anyhow::Result<Option<Sample>> {
        let sample = match &mut self.reader {
            Reader::Frames(reader) => reader.next().map(|frame| frame.map(Sample::Frame)),
            Reader::Results(reader) => reader.next().map(|result| result.map(Sample::Result)),
            Reader::Snapshots(reader) => reader.next().map(|snap| snap.map(Sample::Snapshot)),
            Reader::Documents(reader) => reader.latest().map(|text| text.map(Sample::Document)),
            Reader::Controls(reader, waiting) => {
                if waiting.len() == 0 {
                    *waiting = reader.drain()?.into_iter();
                }
                Ok(waiting.next().map(Sample::Controls))
            }
            Reader::Acks(reader, waiting) => {
                if waiting.len() == 0 {
                    *waiting = reader.drain()?.into_iter();
                }
                Ok(waiting.next().map(Sample::Ack))
            }
            Reader::Other(reader) => reader.next().map(|sample| sample.map(Sample::Other)),
        };
        match sample {
            Err(
                fault @ (BusError::BadFrame { .. }
                | BusError::BadResult { .. }
                | BusError::BadSample { .. }),
            ) => {
                self.n_refused += 1;
                if self.n_refused == 1 {
                    eprintln!(
                        "warning: {fault}; it was passed over, further ones are only counted"
                    );
                }
                Ok(None)
            }
            other => Ok(other?),
        }
    }

    /// Samples that broke the contract.
    pub fn n_refused(&self) -> u64 {
        self.n_refused
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
