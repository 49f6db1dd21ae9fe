//! The file as a row of things to publish, each with the tick that it belongs to.

use std::collections::BTreeMap;
use std::sync::Arc;

use schema_frames::document::DocumentHeader;
use schema_frames::{ActorRecord, FrameHeader, InputRecord, ResultHeader, SnapshotHeader};
use schema_recording::read::{
    Damage, Mark, Payload, PayloadError, Place, RecordingFile, Samples, TopicKind, What,
};

use crate::foreign::Converter;
use crate::options::Options;
use crate::plan::Plan;

/// Chunks that are unpacked at a time while one is read, at most.
const MAX_UNPACKED: usize = 4;

/// One thing to publish.
#[derive(Debug)]
pub struct Fed<'a> {
    /// Where it is in the file.
    pub place: Place,
    /// Simulated time under which it is filed.
    pub sim_nanos: u64,
    pub what: FedWhat<'a>,
}

/// What it is. Topics of frames and results are numbers in the [`Plan`].
#[derive(Debug)]
pub enum FedWhat<'a> {
    Snapshot(SnapshotHeader, &'a [ActorRecord]),
    Document(&'a Arc<str>, DocumentHeader, &'a str),
    Frame(usize, FrameHeader, Bytes<'a>),
    Result(usize, ResultHeader, Payload<'a>, &'a [InputRecord]),
}

/// The bytes of a frame.
#[derive(Debug)]
#[expect(
    clippy::large_enum_variant,
    reason = "one lives at a time, and a box for each would be slower"
)]
pub enum Bytes<'a> {
    /// In the file.
    Recorded(Payload<'a>),
    /// Made of a message of another program.
    Made(&'a [u8]),
}

impl Bytes<'_> {
    /// Writes all bytes into `out`, which has as many.
    pub fn read_into(self, out: &mut [u8]) -> Result<(), PayloadError> {
        match self {
            Bytes::Recorded(mut payload) => payload.read_into(out),
            Bytes::Made(bytes) => {
                out.copy_from_slice(bytes);
                Ok(())
            }
        }
    }
}

/// Reads the file.
#[derive(Debug)]
pub struct Feed {
    samples: Samples,
    frames: BTreeMap<Arc<str>, usize>,
    results: BTreeMap<Arc<str>, usize>,
    converter: Option<Converter>,
}

/// A place between two things, to come back to.
#[derive(Clone, Debug)]
pub struct FeedMark {
    mark: Mark,
    ticks: Option<(u64, u64)>,
}

impl FeedMark {
    /// Whether `place` comes after it.
    pub fn is_before(&self, place: Place) -> bool {
        self.mark.place() <= place
    }
}

impl Feed {
    /// The part of a file that is asked for.
    pub fn new(file: &RecordingFile, plan: &Plan, options: &Options) -> Feed {
        let frames: BTreeMap<Arc<str>, usize> = numbered(plan.frames.iter().map(|of| &of.source));
        let results = numbered(plan.results.iter().map(|of| &of.source));
        let start_nanos = file.span().map_or(0, |(first, _)| first);
        let foreign = plan.frames.iter().enumerate().filter_map(|(idx, planned)| {
            Some((planned.source.clone(), (idx, planned.conversion?)))
        });
        let converter = plan
            .is_foreign
            .then(|| Converter::new(file, foreign, start_nanos));
        let shift = converter.as_ref().map_or(0, Converter::start_nanos);
        let from = options.from_nanos.unwrap_or(0).saturating_add(shift);
        let to = options
            .to_nanos
            .map_or(u64::MAX, |to| to.saturating_add(shift));
        let samples = file.samples_of((from, to), |topic| match topic.kind {
            TopicKind::Frame => frames.contains_key(&topic.name),
            TopicKind::Result => results.contains_key(&topic.name),
            TopicKind::Foreign => plan.is_foreign,
            TopicKind::Snapshot | TopicKind::Document => true,
            TopicKind::Journal | TopicKind::Derived => false,
        });
        let n_cores = std::thread::available_parallelism().map_or(1, |n| n.get());
        let samples = samples.read_ahead((n_cores / 2).min(MAX_UNPACKED));
        Feed {
            samples,
            frames,
            results,
            converter,
        }
    }

    /// The place before what comes next.
    pub fn mark(&self) -> FeedMark {
        FeedMark {
            mark: self.samples.mark(),
            ticks: self.converter.as_ref().map(Converter::ticks),
        }
    }

    /// Goes on at a place.
    ///
    /// # Errors
    /// If the disk cannot be read.
    pub fn back_to(&mut self, mark: &FeedMark) -> anyhow::Result<()> {
        if let (Some(converter), Some(ticks)) = (&mut self.converter, mark.ticks) {
            converter.set_ticks(ticks);
        }
        self.samples.back_to(&mark.mark)
    }

    /// Goes to a simulated time.
    pub fn skip_to(&mut self, sim_nanos: u64) {
        let mut nanos = sim_nanos;
        if let Some(converter) = &mut self.converter {
            converter.set_ticks((0, 0));
            nanos = nanos.saturating_add(converter.start_nanos());
        }
        self.samples.skip_to(nanos);
    }

    /// What could not be read so far.
    pub fn damage(&self) -> &Damage {
        self.samples.damage()
    }

    /// Whether the file is another program's, so that ticks have no snapshots.
    pub fn is_foreign(&self) -> bool {
        self.converter.is_some()
    }

    /// The next thing; the outer `None` at the end, the inner for what is not published.
    ///
    /// # Errors
    /// If the disk cannot be read.
    pub fn next(&mut self) -> anyhow::Result<Option<Option<Fed<'_>>>> {
        let Some(sample) = self.samples.next()? else {
            return Ok(None);
        };
        let place = sample.place;
        let mut sim_nanos = sample.log_nanos;
        let what =
            match sample.what {
                What::Snapshot { header, records } => Some(FedWhat::Snapshot(header, records)),
                What::Document {
                    topic,
                    header,
                    text,
                } => Some(FedWhat::Document(topic, header, text)),
                What::Frame {
                    topic,
                    header,
                    payload,
                } => self
                    .frames
                    .get(topic)
                    .map(|idx| FedWhat::Frame(*idx, header, Bytes::Recorded(payload))),
                What::Result {
                    topic,
                    header,
                    body,
                    inputs,
                } => self
                    .results
                    .get(topic)
                    .map(|idx| FedWhat::Result(*idx, header, body, inputs)),
                What::Foreign { topic, bytes, .. } => match &mut self.converter {
                    Some(converter) => converter.convert(topic, bytes, sample.log_nanos).map(
                        |(idx, header, bytes)| {
                            sim_nanos = header.sim_nanos;
                            FedWhat::Frame(idx, header, Bytes::Made(bytes))
                        },
                    ),
                    None => None,
                },
                What::Journal { .. } => None,
            };
        Ok(Some(what.map(|what| Fed {
            place,
            sim_nanos,
            what,
        })))
    }
}

fn numbered<'a>(names: impl Iterator<Item = &'a Arc<str>>) -> BTreeMap<Arc<str>, usize> {
    names
        .enumerate()
        .map(|(idx, name)| (name.clone(), idx))
        .collect()
}
