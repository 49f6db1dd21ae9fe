//! Reading frames: each is checked, gaps are counted, and the bytes stay in place.

use std::ops::Deref;
use std::sync::Arc;

use schema_frames::{FrameError, FrameHeader, Modality};
use schema_types::MonoTime;

use crate::contract::error::BusError;
use crate::contract::origin::Origin;
use crate::place::node::BusNode;
use crate::place::service::join;
use crate::ports::frames::pages::reserve_as_reader;
use crate::ports::reader::{Moment, Reader, Received, SampleKind};
use crate::time::clock::mono_now;

/// Frames in shared memory.
#[derive(Debug)]
pub struct Frames;

/// The reading end of a frame topic.
pub type FrameReader = Reader<Frames>;

impl SampleKind for Frames {
    type Header = FrameHeader;
    type Sample = Frame;
    type Fault = FrameError;

    const COMES_TWICE: bool = true;

    fn admit(&self, sample: Received<FrameHeader>, topic: &Arc<str>) -> Result<Frame, FrameError> {
        // The header is copied before it is checked, because another process could change it
        // between check and use.
        let header = sample.user_header().0;
        Ok(Frame {
            modality: header.check(sample.payload().len())?,
            topic: topic.clone(),
            taken: mono_now(),
            used: header.payload_bytes as usize,
            header,
            sample,
        })
    }

    fn moment(frame: &Frame) -> Moment {
        moment_of(&frame.header)
    }

    fn refuse(service: String, writer: Option<Arc<Origin>>, source: FrameError) -> BusError {
        bad_frame(service, writer, source)
    }
}

/// Where a frame stands among those of its topic.
pub(crate) fn moment_of(header: &FrameHeader) -> Moment {
    Moment {
        epoch: header.epoch,
        tick: header.tick,
        seq: header.seq,
    }
}

/// The error for a frame that breaks a rule.
pub(crate) fn bad_frame(
    service: String,
    writer: Option<Arc<Origin>>,
    source: FrameError,
) -> BusError {
    BusError::BadFrame {
        service,
        writer,
        source,
    }
}

impl Reader<Frames> {
    pub(crate) fn open(node: &BusNode, topic: &str) -> Result<FrameReader, BusError> {
        let reader = Reader::of(join::<FrameHeader>(node, topic)?, topic, Frames)?;
        reserve_as_reader(node, reader.service())?;
        Ok(reader)
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
