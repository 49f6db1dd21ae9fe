//! The reading end of a topic that another machine wants.

use bytemuck::bytes_of;
use consumer_kit::FollowedDocument;
use schema_bus::{Bus, BusError, FrameReader, ReaderCounts, ResultReader, SnapshotReader};
use schema_frames::FrameHeader;

use crate::announce::{Kind, Offer};

/// Samples in a row that are refused before other topics are looked at.
const MAX_REFUSED: usize = 64;

/// Where a topic's samples come from.
#[derive(Debug)]
pub enum Source {
    /// Nobody wants them.
    Closed,
    /// A sensor.
    Frames(FrameReader),
    /// A user's program.
    Results(ResultReader),
    /// The world.
    Snapshot(SnapshotReader, Gaps),
    /// A text of the world.
    Document(Box<FollowedDocument>),
}

/// Counts the ticks between two snapshots.
#[derive(Debug, Default)]
pub struct Gaps {
    epoch: u64,
    tick: u64,
    lost: u64,
}

/// One sample, copied out of shared memory.
#[derive(Debug)]
pub struct Taken {
    /// Its user header, and what stands behind it in the envelope.
    pub header: Vec<u8>,
    /// The header of a frame.
    pub frame: Option<FrameHeader>,
    /// Its payload; of a result its body.
    pub payload: Vec<u8>,
}

impl Source {
    /// Opens the topic; closed still if it is being made or removed.
    ///
    /// # Errors
    /// What waiting may not heal: no place left for another reader.
    pub fn open(bus: &Bus, offer: &Offer) -> Result<Source, BusError> {
        let name = offer.name.as_str();
        let opened = match offer.kind {
            Kind::Frames => bus.frame_reader(name).map(Source::Frames),
            Kind::Results => bus.result_reader(name).map(Source::Results),
            Kind::Snapshot => bus
                .snapshot_reader()
                .map(|reader| Source::Snapshot(reader, Gaps::default())),
            Kind::Document => Ok(Source::Document(Box::new(FollowedDocument::optional(name)))),
        };
        match opened {
            Err(BusError::NoSuchTopic { .. } | BusError::Service { .. }) => Ok(Source::Closed),
            other => other,
        }
    }

    /// Whether it is read.
    pub fn is_open(&self) -> bool {
        !matches!(self, Source::Closed)
    }

    /// Samples that this reader was too slow for, because the link was.
    pub fn lost(&self) -> u64 {
        let of = |counts: ReaderCounts| counts.lost;
        match self {
            Source::Frames(reader) => of(reader.counts()),
            Source::Results(reader) => of(reader.counts()),
            Source::Snapshot(_, gaps) => gaps.lost,
            Source::Document(_) | Source::Closed => 0,
        }
    }

    /// The next sample, if one waits. Samples that break the contract are passed over.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn take(&mut self, bus: &Bus) -> Result<Option<Taken>, BusError> {
        for _ in 0..MAX_REFUSED {
            match self.try_take(bus) {
                Err(
                    BusError::BadFrame { .. }
                    | BusError::BadResult { .. }
                    | BusError::BadSample { .. },
                ) => {}
                taken => return taken,
            }
        }
        Ok(None)
    }

    fn try_take(&mut self, bus: &Bus) -> Result<Option<Taken>, BusError> {
        Ok(match self {
            Source::Closed => None,
            Source::Frames(reader) => reader.next()?.map(|frame| Taken {
                header: bytes_of(frame.header()).to_vec(),
                frame: Some(*frame.header()),
                payload: frame.to_vec(),
            }),
            Source::Results(reader) => reader.next()?.map(|result| Taken {
                header: [
                    bytes_of(result.header()),
                    bytemuck::cast_slice(result.inputs()),
                ]
                .concat(),
                frame: None,
                payload: result.to_vec(),
            }),
            Source::Snapshot(reader, gaps) => reader.next()?.map(|snapshot| {
                let header = snapshot.header();
                gaps.note(header.epoch, header.tick);
                Taken {
                    header: bytes_of(header).to_vec(),
                    frame: None,
                    payload: bytemuck::cast_slice(snapshot.records()).to_vec(),
                }
            }),
            Source::Document(document) => document.changed(bus)?.map(|document| Taken {
                header: bytes_of(&document.header).to_vec(),
                frame: None,
                payload: document.text.clone().into_bytes(),
            }),
        })
    }
}

impl Gaps {
    fn note(&mut self, epoch: u64, tick: u64) {
        if epoch == self.epoch {
            self.lost += tick.saturating_sub(self.tick + 1);
        }
        (self.epoch, self.tick) = (epoch, tick);
    }
}
