//! Reading results: each is checked, gaps are counted, and the bytes stay in place.

use std::ops::Deref;
use std::sync::Arc;

use schema_frames::{
    Body, InputRecord, Keypoint, KeypointSet, MaskRecord, ResultError, ResultHeader, ResultRecord,
    ResultType,
};
use schema_types::MonoTime;

use crate::clock::mono_now;
use crate::error::BusError;
use crate::intake::{Admission, Intake, ReaderCounts, Received};
use crate::node::BusNode;
use crate::origin::Origin;
use crate::result_service::ResultService;

/// The reading end of a topic of results. It survives its writer: when the writer comes back,
/// results continue under a new `writer_epoch`.
#[derive(Debug)]
pub struct ResultReader {
    intake: Intake<Results>,
}

/// How results are checked.
#[derive(Debug)]
struct Results {
    topic: Arc<str>,
    /// The type that the topic declares.
    kind: ResultType,
}

impl Admission for Results {
    type Header = ResultHeader;
    type Item = ResultSample;
    type Fault = ResultError;

    fn admit(
        &self,
        sample: Received<ResultHeader>,
    ) -> Result<(ResultSample, u64, u64), ResultError> {
        // The header is copied before it is checked, because another process could change it
        // between check and use.
        let header = sample.user_header().0;
        let found = header.check(sample.payload().len())?;
        if found != self.kind {
            return Err(ResultError::OtherType {
                found: found.name(),
                declared: self.kind.name(),
            });
        }
        let result = ResultSample {
            kind: self.kind,
            topic: self.topic.clone(),
            taken: mono_now(),
            header,
            sample,
        };
        Ok((result, header.writer_epoch, header.seq))
    }

    fn refuse(service: String, writer: Option<Arc<Origin>>, source: ResultError) -> BusError {
        BusError::BadResult {
            service,
            writer,
            source,
        }
    }
}

impl ResultReader {
    pub(crate) fn open(node: &BusNode, topic: &str) -> Result<ResultReader, BusError> {
        let service = ResultService::join(node, topic)?;
        let results = Results {
            topic: topic.into(),
            kind: service.kind(),
        };
        Ok(ResultReader {
            intake: Intake::open(service.slices, results)?,
        })
    }

    /// Name without the domain.
    pub fn topic(&self) -> &str {
        &self.intake.admission.topic
    }

    /// The type that the topic declares.
    pub fn kind(&self) -> ResultType {
        self.intake.admission.kind
    }

    /// Takes the oldest result that waits, if any.
    ///
    /// # Errors
    /// [`BusError::BadResult`] for a result that breaks the contract, which is dropped, so the next
    /// call continues after it; [`BusError::BorrowLimit`].
    #[expect(
        clippy::should_implement_trait,
        reason = "an iterator would end at the first gap; this is polled"
    )]
    pub fn next(&mut self) -> Result<Option<ResultSample>, BusError> {
        self.intake.next()
    }

    /// Takes the newest result that waits, if any; older ones are dropped and counted as skipped.
    ///
    /// # Errors
    /// As [`ResultReader::next`].
    pub fn latest(&mut self) -> Result<Option<ResultSample>, BusError> {
        self.intake.latest()
    }

    /// Counters since this reader was opened.
    pub fn counts(&self) -> ReaderCounts {
        self.intake.counts()
    }

    /// `writer_epoch` of the newest result.
    pub fn writer_epoch(&self) -> Option<u64> {
        self.intake.epoch()
    }

    /// Whether a writer has the topic open. A killed writer counts until its remains are removed,
    /// see [`crate::Bus::clean_dead_nodes`].
    pub fn has_writer(&self) -> bool {
        self.intake.has_writer()
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
