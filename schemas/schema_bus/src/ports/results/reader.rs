//! Reading results: each is checked, gaps are counted, and the bytes stay in place.

use std::ops::Deref;
use std::sync::Arc;

use schema_frames::{
    Body, InputRecord, Keypoint, KeypointSet, MaskRecord, ResultError, ResultHeader, ResultRecord,
    ResultType,
};
use schema_types::MonoTime;

use crate::contract::error::BusError;
use crate::contract::origin::Origin;
use crate::place::node::BusNode;
use crate::ports::reader::{Moment, Reader, Received, SampleKind};
use crate::ports::results::service::ResultService;
use crate::time::clock::mono_now;

/// Results in shared memory.
#[derive(Debug)]
pub struct Results {
    /// The type that the topic declares.
    kind: ResultType,
}

/// The reading end of a topic of results.
pub type ResultReader = Reader<Results>;

impl SampleKind for Results {
    type Header = ResultHeader;
    type Sample = ResultSample;
    type Fault = ResultError;

    fn admit(
        &self,
        sample: Received<ResultHeader>,
        topic: &Arc<str>,
    ) -> Result<ResultSample, ResultError> {
        // The header is copied before it is checked, because another process could change it
        // between check and use.
        let header = sample.user_header().0;
        expect_kind(header.check(sample.payload().len())?, self.kind)?;
        Ok(ResultSample {
            kind: self.kind,
            topic: topic.clone(),
            taken: mono_now(),
            header,
            sample,
        })
    }

    fn moment(result: &ResultSample) -> Moment {
        moment_of(&result.header)
    }

    fn refuse(service: String, writer: Option<Arc<Origin>>, source: ResultError) -> BusError {
        bad_result(service, writer, source)
    }
}

/// Fails if a result is of another type than its topic declares.
pub(crate) fn expect_kind(found: ResultType, declared: ResultType) -> Result<(), ResultError> {
    match found == declared {
        true => Ok(()),
        false => Err(ResultError::OtherType {
            found: found.name(),
            declared: declared.name(),
        }),
    }
}

/// Where a result stands among those of its topic.
pub(crate) fn moment_of(header: &ResultHeader) -> Moment {
    Moment {
        epoch: header.writer_epoch,
        tick: header.tick,
        seq: header.seq,
    }
}

/// The error for a result that breaks a rule.
pub(crate) fn bad_result(
    service: String,
    writer: Option<Arc<Origin>>,
    source: ResultError,
) -> BusError {
    BusError::BadResult {
        service,
        writer,
        source,
    }
}

impl Reader<Results> {
    pub(crate) fn open(node: &BusNode, topic: &str) -> Result<ResultReader, BusError> {
        let service = ResultService::join(node, topic)?;
        let kind = service.kind();
        Reader::of(service.slices, topic, Results { kind })
    }

    /// The type that the topic declares.
    pub fn kind(&self) -> ResultType {
        self.kind.kind
    }
}

/// A result in shared memory, which dereferences to the bytes of its body. A reader may hold as
/// many as the topic allows (usually 3 or 4), so drop it soon.
#[derive(Debug)]
pub struct ResultSample {
    sample: Received<ResultHeader>,
    header: ResultHeader,
    kind: ResultType,
    topic: Arc<str>,
    taken: MonoTime,
}

impl ResultSample {
    /// The header, checked.
    pub fn header(&self) -> &ResultHeader {
        &self.header
    }

    /// Type of the result.
    pub fn kind(&self) -> ResultType {
        self.kind
    }

    /// Its topic without the domain.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// When this reader took it.
    pub fn taken(&self) -> MonoTime {
        self.taken
    }

    /// The frames and results that it answers.
    pub fn inputs(&self) -> &[InputRecord] {
        let start = self.header.inputs_offset() as usize;
        let end = self.header.payload_bytes as usize;
        bytemuck::try_cast_slice(&self.sample.payload()[start..end]).unwrap_or_default()
    }

    /// The records of the body, e.g. `result.records::<Box2d>()`. `None` if results of this type
    /// have other records.
    pub fn records<T: ResultRecord>(&self) -> Option<&[T]> {
        let bytes = self.header.n_items as usize * size_of::<T>();
        (T::TYPE == self.kind).then(|| bytemuck::try_cast_slice(self.get(..bytes)?).ok())?
    }

    /// The body as elements of one size: pixels, a tensor's elements, points. `None` if `T`'s size
    /// does not divide it.
    pub fn elements<T: bytemuck::Pod>(&self) -> Option<&[T]> {
        bytemuck::try_cast_slice(self).ok()
    }

    /// Row `y` of an image without its padding; `None` beyond the last row, or if it is no image.
    pub fn row(&self, y: u32) -> Option<&[u8]> {
        let header = &self.header;
        let start = y as usize * header.row_stride as usize;
        (self.kind.body() == Body::Pixels && y < header.height)
            .then(|| &self[start..start + header.width as usize * header.element_bytes as usize])
    }

    /// The text of `text` and `json`; `None` for other types and what is not UTF-8.
    pub fn text(&self) -> Option<&str> {
        let is_text = matches!(self.kind, ResultType::Text | ResultType::Json);
        is_text.then(|| std::str::from_utf8(self).ok())?
    }

    /// The runs of a mask; `None` if it names runs that are not there.
    pub fn runs_of(&self, mask: &MaskRecord) -> Option<&[u32]> {
        part(self.tail()?, mask.first_run, mask.n_runs)
    }

    /// The key points of a set; `None` if it names points that are not there.
    pub fn points_of(&self, set: &KeypointSet) -> Option<&[Keypoint]> {
        part(self.tail()?, set.first_point, set.n_points)
    }

    /// What lies behind the records.
    fn tail<T: bytemuck::Pod>(&self) -> Option<&[T]> {
        let records = self.header.n_items as usize * self.header.element_bytes as usize;
        match self.kind.body() {
            Body::RecordsAndTail(_, bytes) if bytes == size_of::<T>() => {
                bytemuck::try_cast_slice(self.get(records..)?).ok()
            }
            _ => None,
        }
    }
}

fn part<T>(all: &[T], first: u32, n: u32) -> Option<&[T]> {
    let first = first as usize;
    all.get(first..first.checked_add(n as usize)?)
}

impl Deref for ResultSample {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        &self.sample.payload()[..self.header.body_bytes as usize]
    }
}
