//! Where the bytes of a frame go.

use std::sync::Arc;

use crate::memory::ShmTarget;

/// Where bytes go.
#[derive(Debug)]
pub enum Place<'a> {
    /// A range of a target, from [`ShmTarget::place`].
    Shm(ShmPlace),
    /// Ordinary memory.
    Memory(&'a mut [u8]),
}

/// A range of a target that belongs to whoever holds this value.
#[derive(Debug)]
pub struct ShmPlace {
    target: Arc<ShmTarget>,
    offset_bytes: usize,
    capacity_bytes: usize,
}

impl ShmTarget {
    /// A range of the target, for one frame: `offset_bytes` from its beginning, a multiple of 4 and
    /// of the element size, and `capacity_bytes` long.
    ///
    /// Panics if the range leaves the target, or the offset is no multiple of 4.
    ///
    /// # Safety
    /// Until the place is dropped, or the submission that it was given to has been waited for or
    /// dropped, nobody else reads or writes the range or holds a reference into it; in particular
    /// there is no other place that overlaps it.
    pub unsafe fn place(
        self: &Arc<Self>,
        offset_bytes: usize,
        capacity_bytes: usize,
    ) -> Place<'static> {
        assert!(
            offset_bytes.is_multiple_of(4),
            "offset {offset_bytes} is not a multiple of 4"
        );
        let is_inside = offset_bytes
            .checked_add(capacity_bytes)
            .is_some_and(|end| end <= self.n_bytes());
        assert!(is_inside, "the place leaves its segment");
        Place::Shm(ShmPlace {
            target: self.clone(),
            offset_bytes,
            capacity_bytes,
        })
    }
}

impl ShmPlace {
    /// The target.
    pub fn target(&self) -> &Arc<ShmTarget> {
        &self.target
    }

    /// Where it begins, bytes from the target's beginning.
    pub fn offset_bytes(&self) -> usize {
        self.offset_bytes
    }

    /// Its length, bytes.
    pub fn capacity_bytes(&self) -> usize {
        self.capacity_bytes
    }
}

impl Place<'_> {
    /// Size of the memory, bytes.
    pub fn capacity_bytes(&self) -> usize {
        match self {
            Place::Shm(place) => place.capacity_bytes,
            Place::Memory(memory) => memory.len(),
        }
    }

    /// Copies by the CPU if a texture or buffer is copied there: 0 imported, 1 otherwise.
    pub fn cpu_copies(&self) -> u32 {
        match self {
            Place::Shm(place) => place.target.cpu_copies(),
            Place::Memory(_) => 1,
        }
    }

    /// The memory itself, for outputs that the CPU makes in place.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        match self {
            // SAFETY: whoever made the place promised that its range is nobody else's; no submission
            // has it, because that would own the place; `&mut self` keeps the slice single.
            Place::Shm(place) => unsafe {
                place
                    .target
                    .range_mut(place.offset_bytes, place.capacity_bytes)
            },
            Place::Memory(memory) => memory,
        }
    }
}
