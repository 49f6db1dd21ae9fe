//! Reading frames: each is checked, gaps are counted, and the bytes stay in place.

use std::ops::Deref;
use std::sync::Arc;

use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;

use schema_frames::{FrameHeader, Modality};
use schema_types::MonoTime;

use crate::clock::mono_now;
use crate::error::BusError;
use crate::iceoryx_error::{other_error, reader_error, receive_error};
use crate::node::{BusNode, Service};
use crate::origins::Origins;
use crate::qos;
use crate::service::{Slices, join};
use crate::wire::{OnBus, Wire};

/// Opens the reading port of a service.
pub(crate) fn subscribe<H: OnBus>(
    service: &Slices<H>,
) -> Result<Subscriber<Service, [u8], Wire<H>>, BusError> {
    service.subscriber_builder().create().map_err(|e| {
        let limit = service.static_config().max_subscribers();
        reader_error(service.name().as_str(), limit, e)
    })
}

/// A received sample: bytes behind a header `H`.
pub(crate) type Received<H> = Sample<Service, [u8], Wire<H>>;

/// Takes one sample, if any waits.
pub(crate) fn receive<H: OnBus>(
    service: &Slices<H>,
    port: &Subscriber<Service, [u8], Wire<H>>,
) -> Result<Option<Received<H>>, BusError> {
    port.receive().map_err(|e| {
        let limit = service.static_config().subscriber_max_borrowed_samples();
        receive_error(service.name().as_str(), limit, e)
    })
}

/// What a reader has received and missed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReaderCounts {
    /// Frames that were returned.
    pub taken: u64,
    /// Frames that [`FrameReader::latest`] passed over.
    pub skipped: u64,
    /// Frames that never arrived: gaps in `seq`.
    pub lost: u64,
    /// Frames that broke the contract.
    pub refused: u64,
    /// Number of times that frames came under a new epoch: the writer had restarted.
    pub restarts: u64,
}

/// The reading end of a frame topic. It survives its writer: when the writer comes back, frames
/// continue under a new epoch.
#[derive(Debug)]
pub struct FrameReader {
    port: Subscriber<Service, [u8], Wire<FrameHeader>>,
    service: Slices<FrameHeader>,
    origins: Origins,
    topic: Arc<str>,
    /// Epoch and `seq` of the newest frame.
    place: Option<(u64, u64)>,
    counts: ReaderCounts,
}

impl FrameReader {
    pub(crate) fn open(node: &BusNode, topic: &str) -> Result<FrameReader, BusError> {
        let service = join::<FrameHeader>(node, topic)?;
        let port = subscribe(&service)?;
        Ok(FrameReader {
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
        let frame = self.pull()?;
        self.counts.taken += frame.is_some() as u64;
        Ok(frame)
    }

    /// Takes the newest frame that waits, if any; older ones are dropped and counted as skipped.
    ///
    /// # Errors
    /// As [`FrameReader::next`].
    pub fn latest(&mut self) -> Result<Option<Frame>, BusError> {
        let mut newest = None;
        // Bounded, so that a process that floods the topic cannot hold its readers here.
        for _ in 0..qos::MAX_PASSED_OVER {
            if !self.waiting()? {
                break;
            }
            // The older frame is given back first, so that a caller that may hold only one more can
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

    /// Epoch of the newest frame.
    pub fn epoch(&self) -> Option<u64> {
        self.place.map(|(epoch, _)| epoch)
    }

    /// Whether a writer has the topic open. A killed writer counts until its remains are removed,
    /// see [`crate::Bus::clean_dead_nodes`].
    pub fn has_writer(&self) -> bool {
        self.service.dynamic_config().number_of_publishers() > 0
    }

    fn waiting(&self) -> Result<bool, BusError> {
        let failed = |e| other_error("read", self.service.name().as_str(), &e);
        self.port.has_samples().map_err(failed)
    }

    fn pull(&mut self) -> Result<Option<Frame>, BusError> {
        let Some(sample) = receive(&self.service, &self.port)? else {
            return Ok(None);
        };
        // The header is copied before it is checked, because another process could change it
        // between check and use.
        let header = sample.user_header().0;
        match header.check(sample.payload().len()) {
            Ok(modality) => {
                self.count_gap(&header);
                Ok(Some(Frame {
                    topic: self.topic.clone(),
                    taken: mono_now(),
                    modality,
                    used: header.payload_bytes as usize,
                    header,
                    sample,
                }))
            }
            Err(source) => {
                self.counts.refused += 1;
                Err(BusError::BadFrame {
                    service: self.service.name().as_str().into(),
                    writer: Some(
                        self.origins
                            .of_writer(sample.origin().value(), &self.service),
                    ),
                    source,
                })
            }
        }
    }

    fn count_gap(&mut self, header: &FrameHeader) {
        match self.place {
            Some((epoch, seq)) if epoch == header.epoch => {
                let gap = header.seq.saturating_sub(seq.saturating_add(1));
                self.counts.lost = self.counts.lost.saturating_add(gap);
            }
            Some(_) => self.counts.restarts += 1,
            None => {}
        }
        self.place = Some((header.epoch, header.seq));
    }
}

/// A frame in shared memory, which dereferences to the bytes of its payload. A reader may hold
/// three at a time (of small topics four), so drop it soon.
#[derive(Debug)]
pub struct Frame {
    sample: Sample<Service, [u8], Wire<FrameHeader>>,
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
