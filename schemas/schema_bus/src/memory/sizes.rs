//! How much shared memory topics need, and whether `/dev/shm` has it.
//!
//! Every sum of shared memory in the workspace is made here, so that the launcher, the daemon and
//! the publisher itself agree on what fits.

use schema_frames::result::MAX_INPUTS;
use schema_frames::{About, FrameHeader, GPU_PLACE_BYTES, Modality, ResultHeader, ResultType};

use crate::contract::error::BusError;
use crate::contract::qos::{
    FRAMES_IN_FLIGHT, GPU_FRAME, Qos, RUN_TIME_FRAME_READERS, RUN_TIME_TOPIC_BYTES, SPARE_LOANS,
    USUAL_LOANS,
};

/// iceoryx2's own header before our user header, and the rounding of both, bytes per slot
/// (measured: the payload begins at 384).
const SLOT_OVERHEAD_BYTES: u64 = 384;
/// What the header of a result is longer than that of a frame, bytes.
const RESULT_HEADER_SURPLUS_BYTES: usize = size_of::<ResultHeader>() - size_of::<FrameHeader>();
/// Slots begin at multiples of this, bytes.
const SLOT_ALIGN_BYTES: u64 = 64;
/// iceoryx2's bookkeeping of one segment, bytes; an upper bound.
const SEGMENT_OVERHEAD_BYTES: u64 = 1 << 16;

/// What a domain uses besides frames: the touched slots of snapshots, documents and controls, and
/// iceoryx2's own bookkeeping, bytes. Their segments are larger, but sparse, and no GPU pins them.
pub const OTHER_BYTES: u64 = 24 << 20;

/// Size of a frame topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameTopic {
    /// Longest payload, bytes.
    pub max_payload_bytes: usize,
    /// Frames that the writer works on at a time, 1 or more.
    pub frames_in_flight: usize,
    /// Readers at a time; [`FrameTopic::new`] takes the number of the modality's [`Qos`], as for
    /// the next two.
    pub max_readers: usize,
    /// Frames that wait for a reader.
    pub buffer: usize,
    /// Frames that a reader may hold at a time.
    pub borrowed: usize,
}

impl FrameTopic {
    /// A topic with the usual number of readers for its modality and of frames in flight.
    pub fn new(modality: Modality, max_payload_bytes: usize) -> Self {
        let usual = Qos::of(modality);
        FrameTopic {
            max_payload_bytes,
            frames_in_flight: FRAMES_IN_FLIGHT,
            max_readers: usual.readers,
            buffer: usual.buffer,
            borrowed: usual.borrowed,
        }
    }

    /// A topic of a sensor that is spawned at run time. There may be many of these, so a large one
    /// has fewer readers.
    ///
    /// The number of readers depends on modality and payload alone, so that a service that readers
    /// kept alive fits the daemon that comes back.
    pub fn of_run_time_sensor(modality: Modality, max_payload_bytes: usize) -> Self {
        let mut topic = FrameTopic::new(modality, max_payload_bytes);
        for max_readers in RUN_TIME_FRAME_READERS {
            topic.max_readers = max_readers;
            if topic.segment_bytes(modality) <= RUN_TIME_TOPIC_BYTES {
                break;
            }
        }
        topic
    }

    /// The service of a topic's frames on a GPU, whose samples hold no payload but a place. Slots of
    /// a GPU are committed memory, so it has few readers.
    pub fn on_gpu(frames_in_flight: usize) -> Self {
        FrameTopic {
            max_payload_bytes: GPU_PLACE_BYTES,
            frames_in_flight,
            max_readers: GPU_FRAME.readers,
            buffer: GPU_FRAME.buffer,
            borrowed: GPU_FRAME.borrowed,
        }
    }

    /// Slots of the topic.
    pub fn n_slots(&self) -> usize {
        self.max_readers * (self.buffer + self.borrowed) + self.max_loans()
    }

    /// Samples that the writer may have loaned at a time.
    pub fn max_loans(&self) -> usize {
        self.frames_in_flight + SPARE_LOANS
    }

    /// Shared memory of the topic once it has a reader, bytes. The segment is sparse until it is
    /// used, but a GPU that imports it may pin all of it.
    pub fn segment_bytes(&self, modality: Modality) -> u64 {
        segment_bytes(
            &self.qos(modality),
            self.max_loans(),
            self.max_payload_bytes,
        )
    }

    /// The capacity of the topic's service.
    pub(crate) fn qos(&self, modality: Modality) -> Qos {
        Qos {
            readers: self.max_readers,
            buffer: self.buffer,
            borrowed: self.borrowed,
            ..Qos::of(modality)
        }
    }
}

/// What a topic of results is made with. Who finds the topic there joins it with the capacities
/// that it has.
#[derive(Clone, Debug, PartialEq)]
pub struct ResultTopic {
    /// Type of its results.
    pub kind: ResultType,
    /// Bytes of a body that the first slots hold; a longer one makes the slots grow.
    pub body_bytes: usize,
    /// Results that the writer may fill at a time.
    pub max_loans: usize,
    /// Readers' places, samples that wait for a reader and that it may hold.
    pub qos: Qos,
    /// What the type leaves open.
    pub about: About,
}

impl ResultTopic {
    /// A topic with the usual capacities of its type, for bodies of 4 KiB until a longer one comes.
    pub fn new(kind: ResultType) -> Self {
        ResultTopic {
            kind,
            body_bytes: 4096,
            max_loans: USUAL_LOANS,
            qos: Qos::of_results(kind),
            about: About::default(),
        }
    }

    /// Shared memory of the topic once it is in use, bytes. The segment is sparse until then.
    pub fn segment_bytes(&self) -> u64 {
        result_segment_bytes(&self.qos, self.max_loans, loan_bytes(self.body_bytes))
    }
}

/// Bytes of a loan for a body of `body_bytes`: the inputs lie behind it.
pub(crate) fn loan_bytes(body_bytes: usize) -> usize {
    ResultHeader::payload_for(body_bytes as u64, MAX_INPUTS) as usize
}

/// Shared memory of a writer's segment of results whose loans have `loan_bytes`, bytes.
pub(crate) fn result_segment_bytes(qos: &Qos, max_loans: usize, loan_bytes: usize) -> u64 {
    segment_bytes(qos, max_loans, loan_bytes + RESULT_HEADER_SURPLUS_BYTES)
}

/// Shared memory of one writer's segment, bytes.
pub(crate) fn segment_bytes(qos: &Qos, max_loans: usize, max_payload_bytes: usize) -> u64 {
    let slot_bytes =
        (max_payload_bytes as u64 + SLOT_OVERHEAD_BYTES).next_multiple_of(SLOT_ALIGN_BYTES);
    qos.slots(max_loans) as u64 * slot_bytes + SEGMENT_OVERHEAD_BYTES
}

/// Shared memory that a domain with these frame segments needs in all, bytes.
pub fn shared_memory_needed(segments: impl IntoIterator<Item = u64>) -> u64 {
    segments.into_iter().sum::<u64>() + OTHER_BYTES
}

/// Free bytes in `/dev/shm`; `None` if it cannot be asked.
pub fn shared_memory_free() -> Option<u64> {
    let stat = nix::sys::statvfs::statvfs("/dev/shm").ok()?;
    Some(stat.blocks_available() as u64 * stat.fragment_size() as u64)
}

/// `/dev/shm` has too little.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{need} MiB of shared memory are needed, but /dev/shm has {free} MiB free", need = .need_bytes.div_ceil(1 << 20), free = .free_bytes.unwrap_or(0).div_ceil(1 << 20))]
pub struct MemoryShortage {
    /// Bytes that are needed.
    pub need_bytes: u64,
    /// Bytes that are free; `None` if `/dev/shm` cannot be looked at, for example because nothing
    /// is mounted there.
    pub free_bytes: Option<u64>,
}

/// Whether `need_bytes` fit into what is free in `/dev/shm` once `released_bytes` are given back.
///
/// # Errors
/// [`MemoryShortage`], also if `/dev/shm` cannot be looked at: no frame could live there.
pub fn check_shared_memory(need_bytes: u64, released_bytes: u64) -> Result<(), MemoryShortage> {
    fits(need_bytes, released_bytes, shared_memory_free())
}

/// As [`check_shared_memory`], about the segment of a service.
///
/// # Errors
/// [`BusError::Memory`].
pub(crate) fn require_shared_memory(service: &str, need_bytes: u64) -> Result<(), BusError> {
    check_shared_memory(need_bytes, 0).map_err(|short| BusError::Memory {
        service: service.to_owned(),
        need_bytes,
        free_bytes: short.free_bytes.unwrap_or(0),
    })
}

fn fits(
    need_bytes: u64,
    released_bytes: u64,
    free_bytes: Option<u64>,
) -> Result<(), MemoryShortage> {
    let free_bytes = free_bytes.map(|free| free.saturating_add(released_bytes));
    match free_bytes {
        Some(free) if need_bytes <= free => Ok(()),
        _ => Err(MemoryShortage {
            need_bytes,
            free_bytes,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_have_the_sizes_computed_by_hand() {
        // 8 readers × (2 + 3) + 0 + (2 + 1) = 43 slots of 1 920 000 + 384 bytes, and 65 536.
        let rgb = FrameTopic::new(Modality::Rgb, 800 * 600 * 4);
        assert_eq!(rgb.segment_bytes(Modality::Rgb), 82_642_048);
        // Two more frames in flight are two more slots.
        let more = FrameTopic {
            frames_in_flight: 4,
            ..rgb
        };
        assert_eq!(more.segment_bytes(Modality::Rgb), 86_482_816);
        // 2 readers × (5 + 1) + 3 = 15 slots.
        let other = FrameTopic {
            max_readers: 2,
            buffer: 5,
            borrowed: 1,
            ..rgb
        };
        assert_eq!(
            other.segment_bytes(Modality::Rgb),
            15 * 1_920_384 + (1 << 16)
        );
        // 16 readers × (16 + 4) + 0 + 3 = 323 slots of 72 + 384, rounded up to 512 bytes.
        let imu = FrameTopic::new(Modality::Imu, 72);
        assert_eq!(imu.segment_bytes(Modality::Imu), 230_912);
        // Both, and 24 MiB for everything that is not a frame.
        let segments = [
            rgb.segment_bytes(Modality::Rgb),
            imu.segment_bytes(Modality::Imu),
        ];
        assert_eq!(shared_memory_needed(segments), 108_038_784);
    }

    #[test]
    fn a_large_topic_of_a_run_time_sensor_has_fewer_readers() {
        let readers = |bytes| FrameTopic::of_run_time_sensor(Modality::Rgb, bytes).max_readers;
        // 16 readers are 83 slots: 64 MiB are 67 108 864 bytes, less 65 536, so slots of at most
        // 807 744 bytes, of which 384 are not payload.
        assert_eq!((readers(807_360), readers(807_361)), (16, 8));
        assert_eq!(readers(640 * 480 * 4), 8);
        // 8 readers are 43 slots of at most 1 559 104 bytes.
        assert_eq!((readers(1_558_720), readers(1_558_721)), (8, 4));
        // 4 readers × 5 + 3 = 23 slots of 8 294 784 bytes.
        let full_hd = FrameTopic::of_run_time_sensor(Modality::Rgb, 1920 * 1080 * 4);
        assert_eq!(full_hd.segment_bytes(Modality::Rgb), 190_845_568);
    }

    #[test]
    fn what_is_released_counts_as_free_and_an_unknown_size_as_too_little() {
        assert_eq!(fits(100, 0, Some(100)), Ok(()));
        assert_eq!(fits(100, 40, Some(60)), Ok(()));
        let short = fits(100, 39, Some(60)).unwrap_err();
        assert_eq!(short.free_bytes, Some(99));
        assert_eq!(fits(1, 0, None).unwrap_err().free_bytes, None);
    }
}
