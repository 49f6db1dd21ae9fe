//! Pages of frame topics: reserved before the slots that lie in them are used.
//!
//! A segment has room for all the readers that its topic may have, most of which never come, so it
//! is sparse. iceoryx2's free list is last in, first out: the slots in use are always the first of
//! the segment, as many as the readers and the writer can hold at a time. The pages of those are
//! reserved for one reader when the segment is made, and for one more with each reader that joins:
//! by the reader itself, who is refused if there is no room, and by the writer, for readers that are
//! no program of Gantry.

use std::fs::File;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};

use schema_types::MonoTime;

use crate::contract::error::BusError;
use crate::contract::qos::Qos;
use crate::memory::segment::reserve;
use crate::memory::sizes::{segment_bytes, shared_memory_free};

/// How long a writer waits before it asks again for pages that it did not get, nanoseconds: asking
/// takes milliseconds, and frames go on meanwhile in the slots that there are.
const ASK_AGAIN_NANOS: u64 = 500_000_000;

/// What a writer has reserved of its segment.
#[derive(Debug)]
pub(crate) struct Reserved {
    file: File,
    /// Readers that the pages are enough for.
    n_readers: AtomicUsize,
    /// `CLOCK_MONOTONIC` before which nothing is asked for again.
    not_before_nanos: AtomicU64,
    /// Number of readers for which it was said that there is no room.
    n_refused: AtomicUsize,
}

/// Capacity and slots of a topic, from which follows how many bytes a number of readers needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Need {
    pub qos: Qos,
    pub max_loans: usize,
    pub max_payload_bytes: usize,
}

impl Need {
    /// Bytes from the beginning of the segment that `n_readers` and the writer use.
    pub fn bytes(&self, n_readers: usize) -> u64 {
        let qos = Qos {
            readers: n_readers.clamp(1, self.qos.readers.max(1)),
            ..self.qos
        };
        segment_bytes(&qos, self.max_loans, self.max_payload_bytes)
    }
}

impl Reserved {
    /// Reserves what the first reader needs.
    pub fn new(service: &str, file: File, need: &Need) -> Result<Reserved, BusError> {
        reserve_for(service, &file, need, 1)?;
        Ok(Reserved {
            file,
            n_readers: AtomicUsize::new(1),
            not_before_nanos: AtomicU64::new(0),
            n_refused: AtomicUsize::new(0),
        })
    }

    /// Reserves what so many readers need, unless it is reserved already. That there is no room is
    /// said once for a number of readers. `now` is asked only if something is to be reserved.
    pub fn fit(
        &self,
        service: &str,
        need: &Need,
        n_readers: usize,
        now: impl FnOnce() -> MonoTime,
    ) -> Result<(), BusError> {
        if n_readers <= self.n_readers.load(Relaxed) {
            return Ok(());
        }
        let now_nanos = now().0;
        if now_nanos < self.not_before_nanos.load(Relaxed) {
            return Ok(());
        }
        let made = reserve_for(service, &self.file, need, n_readers);
        match &made {
            Ok(()) => self.n_readers.store(n_readers, Relaxed),
            Err(_) => {
                let not_before = now_nanos.saturating_add(ASK_AGAIN_NANOS);
                self.not_before_nanos.store(not_before, Relaxed);
                if self.n_refused.swap(n_readers, Relaxed) == n_readers {
                    return Ok(());
                }
            }
        }
        made
    }
}

/// Reserves what so many readers need of a segment.
///
/// # Errors
/// [`BusError::Memory`] if there is no room.
pub(crate) fn reserve_for(
    service: &str,
    file: &File,
    need: &Need,
    n_readers: usize,
) -> Result<(), BusError> {
    let Ok(file_bytes) = file.metadata().map(|of| of.len()) else {
        return Ok(());
    };
    let n_bytes = need.bytes(n_readers).min(file_bytes);
    reserve(file, 0, n_bytes).map_err(|error| {
        tracing::debug!(service, n_readers, %error, "cannot reserve pages of a segment");
        BusError::Memory {
            service: service.into(),
            need_bytes: n_bytes,
            free_bytes: shared_memory_free().unwrap_or(0),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contract::qos::FRAME;

    #[test]
    fn each_reader_needs_its_slots_and_the_writer_its_own() {
        let need = Need {
            qos: FRAME,
            max_loans: 3,
            max_payload_bytes: 1_920_000,
        };
        // 1 reader × 5 + 3 = 8 slots of 1 920 384 bytes, and 65 536; with two readers 13 slots.
        assert_eq!(need.bytes(1), 8 * 1_920_384 + 65_536);
        assert_eq!(need.bytes(0), need.bytes(1));
        assert_eq!(need.bytes(2), 13 * 1_920_384 + 65_536);
        // Never more than the topic may have: 8 readers.
        assert_eq!(need.bytes(9), 43 * 1_920_384 + 65_536);
    }

    #[test]
    fn pages_that_are_reserved_belong_to_the_file() {
        use std::os::unix::fs::MetadataExt as _;
        let file = tempfile::tempfile_in("/dev/shm").unwrap();
        file.set_len(1 << 20).unwrap();
        let need = Need {
            qos: Qos {
                readers: 2,
                buffer: 1,
                borrowed: 1,
                ..FRAME
            },
            max_loans: 1,
            max_payload_bytes: 40_000,
        };
        let reserved = Reserved::new("d/x/y/rgb", file, &need).unwrap();
        let used = || reserved.file.metadata().unwrap().blocks() * 512;
        // 3 slots of 40 384 bytes, and 65 536: 46 pages of 4096; the file keeps its length.
        assert_eq!(used(), 46 * 4096);
        assert_eq!(reserved.file.metadata().unwrap().len(), 1 << 20);
        let now = || MonoTime(1);
        reserved.fit("d/x/y/rgb", &need, 2, now).unwrap();
        assert_eq!(used(), (5 * 40_384u64 + 65_536).next_multiple_of(4096));
    }
}
