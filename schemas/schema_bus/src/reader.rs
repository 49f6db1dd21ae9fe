//! Reading frames: each is checked, gaps are counted, and the bytes stay in place.

use std::ops::Deref;
use std::sync::Arc;

use schema_frames::{FrameError, FrameHeader, Modality};
use schema_types::MonoTime;

use crate::clock::mono_now;
use crate::error::BusError;
use crate::intake::{Admission, Intake, ReaderCounts, Received};
use crate::node::BusNode;
use crate::origin::Origin;
use crate::reserve::reserve_as_reader;
use crate::service::join;

/// The reading end of a frame topic. It survives its writer: when the writer comes back, frames
/// continue under a new epoch.
#[derive(Debug)]
pub struct FrameReader {
    intake: Intake<Frames>,
    repeats: Repeats,
}

/// Frames that came twice: one that a process sent and was killed before it said so is made once
/// more by another.
#[derive(Debug, Default)]
pub(crate) struct Repeats {
    /// Epoch, tick and number of the last frame.
    last: Option<(u64, u64, u64)>,
    n_repeated: u64,
}

impl Repeats {
    /// Whether a frame is the last one again. Takes note of it otherwise.
    pub fn note(&mut self, header: &FrameHeader) -> bool {
        let FrameHeader {
            epoch, tick, seq, ..
        } = *header;
        let is_numbered = seq > 0 && tick > 0;
        let repeats = is_numbered && self.last == Some((epoch, tick, seq));
        self.n_repeated += u64::from(repeats);
        self.last = Some((epoch, tick, seq));
        repeats
    }

    /// The last frame is none that is repeated.
    pub fn forget_last(&mut self) {
        self.last = None;
    }

    /// Counts without the frames that were passed over.
    pub fn left_out_of(&self, counts: ReaderCounts) -> ReaderCounts {
        ReaderCounts {
            taken: counts.taken - self.n_repeated,
            ..counts
        }
    }
}

/// How frames are checked.
#[derive(Debug)]
struct Frames {
    topic: Arc<str>,
}

impl Admission for Frames {
    type Header = FrameHeader;
    type Item = Frame;
    type Fault = FrameError;

    fn admit(&self, sample: Received<FrameHeader>) -> Result<(Frame, u64, u64), FrameError> {
        // The header is copied before it is checked, because another process could change it
        // between check and use.
        let header = sample.user_header().0;
        let frame = Frame {
            modality: header.check(sample.payload().len())?,
            topic: self.topic.clone(),
            taken: mono_now(),
            used: header.payload_bytes as usize,
            header,
            sample,
        };
        Ok((frame, header.epoch, header.seq))
    }

    fn refuse(service: String, writer: Option<Arc<Origin>>, source: FrameError) -> BusError {
        BusError::BadFrame {
            service,
            writer,
            source,
        }
    }
}

impl FrameReader {
    pub(crate) fn open(node: &BusNode, topic: &str) -> Result<FrameReader, BusError> {
        let frames = Frames {
            topic: topic.into(),
        };
        let intake = Intake::open(join::<FrameHeader>(node, topic)?, frames)?;
        reserve_as_reader(node, intake.service())?;
        Ok(FrameReader {
            intake,
            repeats: Repeats::default(),
        })
    }

    /// Name without the domain.
    pub fn topic(&self) -> &str {
        &self.intake.admission.topic
    }

    /// Takes the oldest frame that waits, if any.
    ///
    /// # Errors
    /// [`BusError::BadFrame`] for a frame that breaks the contract, which is dropped, so the next
    /// call continues after it; [`BusError::BorrowLimit`].
    #[expect(
        clippy::should_implement_trait,
        reason = "an iterator would end at the first gap; this is polled"
    )]
    pub fn next(&mut self) -> Result<Option<Frame>, BusError> {
        while let Some(frame) = self.intake.next()? {
            if !self.repeats.note(&frame.header) {
                return Ok(Some(frame));
            }
        }
        Ok(None)
    }

    /// Takes the newest frame that waits, if any; older ones are dropped and counted as skipped.
    ///
    /// # Errors
    /// As [`FrameReader::next`].
    pub fn latest(&mut self) -> Result<Option<Frame>, BusError> {
        let newest = self.intake.latest()?;
        Ok(newest.filter(|frame| !self.repeats.note(&frame.header)))
    }

    /// Counters since this reader was opened.
    pub fn counts(&self) -> ReaderCounts {
        self.repeats.left_out_of(self.intake.counts())
    }

    /// Epoch of the newest frame.
    pub fn epoch(&self) -> Option<u64> {
        self.intake.epoch()
    }

    /// Whether a writer has the topic open. A killed writer counts until its remains are removed,
    /// see [`crate::Bus::clean_dead_nodes`].
    pub fn has_writer(&self) -> bool {
        self.intake.has_writer()
    }
}

/// A frame in shared memory, which dereferences to the bytes of its payload. A reader may hold
/// three at a time (of small topics four), so drop it soon.
#[derive(Debug)]
pub struct Frame {
    sample: Received<FrameHeader>,
    header: FrameHeader,
    topic: Arc<str>,
    taken: MonoTime,
    modality: Modality,
    used: usize,
}

impl Frame {
    /// The header, checked.
    pub fn header(&self) -> &FrameHeader {
        &self.header
    }

    /// Its topic without the domain.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// When this reader took it.
    pub fn taken(&self) -> MonoTime {
        self.taken
    }

    /// The modality of the payload.
    pub fn modality(&self) -> Modality {
        self.modality
    }

    /// The payload in use as elements, e.g. `frame.elements::<DvsEvent>()` or `::<f32>()` for
    /// depth. `None` if `T`'s size does not divide it.
    pub fn elements<T: bytemuck::Pod>(&self) -> Option<&[T]> {
        bytemuck::try_cast_slice(self).ok()
    }

    /// Number of the port that wrote it: another one may be another process.
    pub fn writer(&self) -> u128 {
        self.sample.origin().value()
    }

    /// Row `y` of an image without its padding; `None` beyond the last row.
    pub fn row(&self, y: u32) -> Option<&[u8]> {
        let header = &self.header;
        let start = y as usize * header.row_stride as usize;
        (y < header.height)
            .then(|| &self[start..start + header.width as usize * header.element_bytes as usize])
    }
}

impl Deref for Frame {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        &self.sample.payload()[..self.used]
    }
}
