//! Reading results: each is checked, gaps are counted, and the bytes stay in place.

use std::ops::Deref;
use std::sync::Arc;

use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::service::port_factory::PortFactory as _;

use schema_frames::{
    Body, InputRecord, Keypoint, KeypointSet, MaskRecord, ResultError, ResultHeader, ResultRecord,
    ResultType,
};
use schema_types::MonoTime;

use crate::clock::mono_now;
use crate::error::BusError;
use crate::iceoryx_error::other_error;
use crate::node::{BusNode, Service};
use crate::origins::Origins;
use crate::qos;
use crate::reader::{ReaderCounts, Received, receive, subscribe};
use crate::result_service::ResultService;
use crate::wire::Wire;

/// The reading end of a topic of results. It survives its writer: when the writer comes back,
/// results continue under a new `writer_epoch`.
#[derive(Debug)]
pub struct ResultReader {
    port: Subscriber<Service, [u8], Wire<ResultHeader>>,
    service: ResultService,
    origins: Origins,
    topic: Arc<str>,
    /// `writer_epoch` and `seq` of the newest result.
    place: Option<(u64, u64)>,
    counts: ReaderCounts,
}

impl ResultReader {
    pub(crate) fn open(node: &BusNode, topic: &str) -> Result<ResultReader, BusError> {
        let service = ResultService::join(node, topic)?;
        let port = subscribe(&service.slices)?;
        Ok(ResultReader {
            port,
            service,
            origins: Origins::default(),
            topic: topic.into(),
            place: None,
            counts: ReaderCounts::default(),
        })
    }

    /// Name without the domain.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// The type that the topic declares.
    pub fn kind(&self) -> ResultType {
        self.service.kind()
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
        let sample = self.pull()?;
        self.counts.taken += sample.is_some() as u64;
        Ok(sample)
    }

    /// Takes the newest result that waits, if any; older ones are dropped and counted as skipped.
    ///
    /// # Errors
    /// As [`ResultReader::next`].
    pub fn latest(&mut self) -> Result<Option<ResultSample>, BusError> {
        let mut newest = None;
        // Bounded, as in `FrameReader::latest`.
        for _ in 0..qos::MAX_PASSED_OVER {
            if !self.waiting()? {
                break;
            }
            // The older one is given back first, so that a caller that may hold only one more can
            // still drain.
            if newest.take().is_some() {
                self.counts.skipped += 1;
            }
            newest = self.pull()?;
            if newest.is_none() {
                break;
            }
        }
        self.counts.taken += newest.is_some() as u64;
        Ok(newest)
    }

    /// Counters since this reader was opened.
    pub fn counts(&self) -> ReaderCounts {
        self.counts
    }

    /// `writer_epoch` of the newest result.
    pub fn writer_epoch(&self) -> Option<u64> {
        self.place.map(|(epoch, _)| epoch)
    }

    /// Whether a writer has the topic open. A killed writer counts until its remains are removed,
    /// see [`crate::Bus::clean_dead_nodes`].
    pub fn has_writer(&self) -> bool {
        self.service.slices.dynamic_config().number_of_publishers() > 0
    }

    fn waiting(&self) -> Result<bool, BusError> {
        let failed = |e| other_error("read", &self.topic, &e);
        self.port.has_samples().map_err(failed)
    }

    fn pull(&mut self) -> Result<Option<ResultSample>, BusError> {
        let Some(sample) = receive(&self.service.slices, &self.port)? else {
            return Ok(None);
        };
        // The header is copied before it is checked, because another process could change it
        // between check and use.
        let header = sample.user_header().0;
        let declared = self.service.kind();
        let checked = match header.check(sample.payload().len()) {
            Ok(kind) if kind == declared => Ok(()),
            Ok(kind) => Err(ResultError::OtherType {
                found: kind.name(),
                declared: declared.name(),
            }),
            Err(fault) => Err(fault),
        };
        match checked {
            Ok(()) => {
                self.count_gap(&header);
                Ok(Some(ResultSample {
                    kind: declared,
                    topic: self.topic.clone(),
                    taken: mono_now(),
                    header,
                    sample,
                }))
            }
            Err(source) => {
                self.counts.refused += 1;
                Err(BusError::BadResult {
                    service: self.service.slices.name().as_str().into(),
                    writer: Some(
                        self.origins
                            .of_writer(sample.origin().value(), &self.service.slices),
                    ),
                    source,
                })
            }
        }
    }

    fn count_gap(&mut self, header: &ResultHeader) {
        match self.place {
            Some((epoch, seq)) if epoch == header.writer_epoch => {
                let gap = header.seq.saturating_sub(seq.saturating_add(1));
                self.counts.lost = self.counts.lost.saturating_add(gap);
            }
            Some(_) => self.counts.restarts += 1,
            None => {}
        }
        self.place = Some((header.writer_epoch, header.seq));
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
