//! Writing frames: a service without memory, a publisher with a segment, and loans that are filled
//! in place.

use std::fs::File;
use std::sync::{Arc, OnceLock};

use iceoryx2::prelude::*;

use schema_frames::{FrameHeader, GPU_PLACE_BYTES, GpuPlace, Modality};

use crate::contract::error::{BusError, LoanError};
use crate::contract::names::modality_of;
use crate::memory::reserve::{Need, Reserved};
use crate::memory::segment::{Segment, file_of, mapping_of, prefault};
use crate::memory::shortage::guarded;
use crate::memory::sizes::{FrameTopic, require_shared_memory, shared_memory_free};
use crate::place::iceoryx_error::with_shortage;
use crate::place::node::BusNode;
use crate::place::service::{Slices, make};
use crate::ports::frames::reader::bad_frame;
use crate::ports::writer::{Loan, Port, Slots, Writer, make_port};
use crate::time::clock::mono_now;

/// A frame topic that readers can find and that has no memory yet.
#[derive(Debug)]
pub struct FrameService {
    service: Slices<FrameHeader>,
    about: About,
}

/// What a frame topic is.
#[derive(Debug)]
struct About {
    topic: Arc<str>,
    modality: Modality,
    spec: FrameTopic,
}

impl About {
    fn need(&self) -> Need {
        Need {
            qos: self.spec.qos(self.modality),
            max_loans: self.spec.max_loans(),
            max_payload_bytes: self.spec.max_payload_bytes,
        }
    }
}

impl FrameService {
    pub(crate) fn make(
        node: &BusNode,
        topic: &str,
        spec: FrameTopic,
    ) -> Result<FrameService, BusError> {
        let modality = modality_of(topic).ok_or_else(|| BusError::Name {
            topic: topic.into(),
        })?;
        let service = make::<FrameHeader>(node, topic, &spec.qos(modality))?;
        Ok(FrameService {
            service,
            about: About {
                topic: topic.into(),
                modality,
                spec,
            },
        })
    }

    /// Name without the domain.
    pub fn topic(&self) -> &str {
        &self.about.topic
    }

    /// Number of readers now.
    pub fn n_readers(&self) -> usize {
        self.service.dynamic_config().number_of_subscribers()
    }

    /// Modality, from the topic's name.
    pub fn modality(&self) -> Modality {
        self.about.modality
    }

    /// Size of the segment that a publisher makes, bytes.
    pub fn segment_bytes(&self) -> u64 {
        self.about.spec.segment_bytes(self.about.modality)
    }

    /// Makes a publisher with its segment. After the publisher is dropped, the service lives as
    /// long as a reader has it open.
    ///
    /// # Errors
    /// [`BusError::Memory`] if less is free in `/dev/shm` than the segment can use,
    /// [`BusError::TooManyWriters`].
    pub fn publisher(self) -> Result<FramePublisher, BusError> {
        self.publisher_with(AllocationStrategy::Static)
    }

    /// As [`FrameService::publisher`], for frames whose longest payload is not known beforehand: a
    /// longer loan adds a segment whose slots have twice the length or more. Such a publisher has no
    /// one [`FramePublisher::segment`].
    ///
    /// # Errors
    /// As [`FrameService::publisher`], for the first segment.
    pub fn growing_publisher(self) -> Result<FramePublisher, BusError> {
        self.publisher_with(AllocationStrategy::PowerOfTwo)
    }

    fn publisher_with(self, grow: AllocationStrategy) -> Result<FramePublisher, BusError> {
        let full = self.service.name().as_str().to_string();
        let need_bytes = self.segment_bytes();
        require_shared_memory(&full, need_bytes)?;
        let FrameService { service, about } = self;
        let slots = Slots {
            payload_bytes: about.spec.max_payload_bytes.max(1),
            max_loans: about.spec.max_loans(),
            need_bytes,
            grow,
        };
        let (port, reserved) = guarded(&full, need_bytes, || {
            let port = make_port(&service, &slots, None)?;
            let reserved = match grow {
                AllocationStrategy::Static => reserve(&full, &port, &about.need())?,
                _ => None,
            };
            Ok((port, reserved))
        })?;
        Ok(FramePublisher {
            writer: Writer::of(service, port, &slots),
            about,
            reserved,
            segment: OnceLock::new(),
        })
    }
}

/// Reserves the pages that a first reader needs; `None` if the segment's file is not found.
fn reserve(
    full: &str,
    port: &Port<FrameHeader>,
    need: &Need,
) -> Result<Option<Reserved>, BusError> {
    let Ok(mut loan) = port.loan_slice_uninit(1) else {
        return Ok(None);
    };
    let path = file_of(loan.payload_mut().as_ptr().cast());
    let file = path.and_then(|path| File::options().read(true).write(true).open(path).ok());
    file.map(|file| Reserved::new(full, file, need)).transpose()
}

/// A frame topic with its memory.
#[derive(Debug)]
pub struct FramePublisher {
    writer: Writer<FrameHeader>,
    about: About,
    /// Pages that are the segment's; `None` if it grows.
    reserved: Option<Reserved>,
    segment: OnceLock<Segment>,
}

impl FramePublisher {
    /// Name without the domain.
    pub fn topic(&self) -> &str {
        &self.about.topic
    }

    /// Number of readers now. If it is 0, the sensor need not be rendered.
    pub fn n_readers(&self) -> usize {
        self.writer.n_readers()
    }

    /// Modality, from the topic's name.
    pub fn modality(&self) -> Modality {
        self.about.modality
    }

    /// Longest payload of a loan, bytes; of a growing publisher that of its first segment.
    pub fn max_payload_bytes(&self) -> usize {
        self.about.spec.max_payload_bytes
    }

    /// Number of loans that may exist at a time.
    pub fn max_loans(&self) -> usize {
        self.writer.max_loans()
    }

    /// The whole data segment, for importing it into a GPU. It never moves and lives as long as
    /// this publisher; drop the import first.
    ///
    /// # Errors
    /// [`BusError::Segment`] if the mapping is not found, for example because every slot is loaned.
    pub fn segment(&self) -> Result<Segment, BusError> {
        if let Some(segment) = self.segment.get() {
            return Ok(*segment);
        }
        let missing = |cause: String| BusError::Segment {
            service: self.topic().to_string(),
            cause: with_shortage(cause),
        };
        let loan = self
            .writer
            .loan(self.topic(), 1, 1)
            .map_err(|error| missing(error.to_string()))?;
        let segment = mapping_of(loan.address()).map_err(|error| missing(error.to_string()))?;
        Ok(*self.segment.get_or_init(|| segment))
    }

    /// Faults in the pages of the slots that the first reader and the writer will use, so that no
    /// frame pays for that. iceoryx2's free list is last in, first out, so these slots stay the ones
    /// in use.
    ///
    /// # Errors
    /// As [`FramePublisher::segment`], and [`BusError::Memory`] if `/dev/shm` is full.
    pub fn touch(&self) -> Result<(), BusError> {
        let one_reader = FrameTopic {
            max_readers: 1,
            ..self.about.spec
        };
        let need_bytes = one_reader.segment_bytes(self.modality());
        prefault(self.segment()?, need_bytes as usize).map_err(|error| {
            tracing::debug!(topic = self.topic(), %error, "cannot touch the segment");
            BusError::Memory {
                service: self.topic().into(),
                need_bytes,
                free_bytes: shared_memory_free().unwrap_or(0),
            }
        })
    }

    /// Loans a slot for a payload of `len` bytes, with a header for this topic's modality. A loan
    /// that is dropped unsent goes back.
    ///
    /// For a list whose length is known only when it is filled, loan its greatest length and set
    /// `header.payload_bytes` to the bytes in use.
    ///
    /// # Errors
    /// [`LoanError::NoFreeSlot`] if all loans are in use, [`LoanError::TooLong`] beyond
    /// [`FramePublisher::max_payload_bytes`].
    pub fn loan(&self, len: usize) -> Result<FrameLoan, LoanError> {
        if let Some(reserved) = &self.reserved
            && let Err(error) =
                reserved.fit(self.topic(), &self.about.need(), self.n_readers(), mono_now)
        {
            // Frames go on in the slots that there are; one that has no page is not sent.
            tracing::warn!(topic = self.topic(), %error, "a reader joined for which there is no room; frames may be lost");
        }
        let mut loan = self
            .writer
            .loan(self.topic(), len, self.max_payload_bytes())?;
        *loan.header_mut() = FrameHeader::new(self.modality());
        Ok(FrameLoan {
            loan,
            segment: self.segment.get().copied(),
            topic: self.about.topic.clone(),
        })
    }
}

/// A slot of shared memory that is borrowed for writing. Send it, or drop it to give it back.
pub struct FrameLoan {
    loan: Loan<FrameHeader>,
    segment: Option<Segment>,
    topic: Arc<str>,
}

impl std::fmt::Debug for FrameLoan {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FrameLoan")
            .field("len", &self.len())
            .field("header", self.header())
            .finish_non_exhaustive()
    }
}

impl FrameLoan {
    /// The header as it is so far.
    pub fn header(&self) -> &FrameHeader {
        self.loan.header()
    }

    /// The header, to be filled in before sending.
    pub fn header_mut(&mut self) -> &mut FrameHeader {
        self.loan.header_mut()
    }

    /// Length of the loan's payload, bytes.
    pub fn len(&self) -> usize {
        self.loan.len()
    }

    /// Whether the loan has no bytes.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Address of the payload's first byte, 64-aligned, for a device that writes there. No
    /// reference to the payload may exist while the device writes.
    pub fn payload_ptr(&mut self) -> *mut u8 {
        self.loan.address_mut()
    }

    /// Offset of the payload from the segment's first byte, bytes; `None` before the first call of
    /// [`FramePublisher::segment`].
    pub fn offset_in_segment(&self) -> Option<usize> {
        let payload = self.loan.address() as usize;
        self.segment.map(|segment| payload - segment.base as usize)
    }

    /// The payload, to be filled in place. It holds the bytes of an earlier frame.
    pub fn payload_mut(&mut self) -> &mut [u8] {
        self.loan.payload_mut()
    }

    /// Makes it a frame whose payload is at `place` on a GPU, with this header.
    ///
    /// Panics if the loan is too short for the place.
    pub fn put_on_gpu(&mut self, header: &FrameHeader, place: &GpuPlace) {
        self.payload_mut()[..GPU_PLACE_BYTES].copy_from_slice(bytemuck::bytes_of(place));
        *self.header_mut() = FrameHeader {
            payload_place: FrameHeader::ON_GPU,
            ..*header
        };
    }

    /// Sets `published_mono_nanos` and sends the frame to all readers. Returns the number of
    /// readers that received it.
    ///
    /// Bytes after `header.payload_bytes` stay what the slot held. Wake the readers afterwards
    /// through the rig's event.
    ///
    /// # Errors
    /// [`BusError::BadFrame`] if the header contradicts the loan, [`BusError::Memory`] if `/dev/shm`
    /// had no page for the slot, [`BusError::Service`] if iceoryx2 fails.
    pub fn send(mut self) -> Result<usize, BusError> {
        let topic = self.topic.clone();
        let checked = match self.header().payload_place {
            FrameHeader::ON_GPU => GpuPlace::read(self.header(), self.loan.payload()).map(drop),
            _ => self.header().check(self.len()).map(drop),
        };
        checked.map_err(|source| bad_frame(topic.to_string(), None, source))?;
        self.loan.check_pages(&topic)?;
        self.header_mut().published_mono_nanos = mono_now().0;
        self.loan.send("send", &topic)
    }
}

/// A loan that a device writes to. Nobody reaches its payload until it is taken back; dropped, it
/// goes back to its publisher, so it must outlive what the device does.
#[derive(Debug)]
pub struct DeviceLoan(FrameLoan);

impl FrameLoan {
    /// Hands the payload to a device.
    pub fn lend(self) -> DeviceLoan {
        DeviceLoan(self)
    }
}

impl DeviceLoan {
    /// As [`FrameLoan::offset_in_segment`].
    pub fn offset_in_segment(&self) -> Option<usize> {
        self.0.offset_in_segment()
    }

    /// The loan, to be sent.
    ///
    /// # Safety
    /// The device has finished writing to it, and will not write to it again.
    pub unsafe fn take_back(self) -> FrameLoan {
        self.0
    }
}
