//! Where the bytes of a frame go.

use std::sync::Arc;

use crate::memory::ShmTarget;

/// Where bytes go.
#[derive(Debug)]
pub enum Place<'a> {
    /// A range of a target; the caller has exclusive use of it (see [`ShmTarget::import`]).
    Shm {
        /// The segment.
        target: Arc<ShmTarget>,
        /// Where the payload begins, bytes from the segment's base; a multiple of 4 and of the
        /// element size.
        offset_bytes: usize,
        /// Length of the payload's memory.
        capacity_bytes: usize,
    },
    /// Ordinary memory.
    Memory(&'a mut [u8]),
}

impl Place<'_> {
    /// Size of the memory, bytes.
    pub fn capacity_bytes(&self) -> usize {
        match self {
            Place::Shm { capacity_bytes, .. } => *capacity_bytes,
            Place::Memory(memory) => memory.len(),
        }
    }

    /// Copies by the CPU if a texture or buffer is copied there: 0 imported, 1 otherwise.
    pub fn cpu_copies(&self) -> u32 {
        match self {
            Place::Shm { target, .. } => target.cpu_copies(),
            Place::Memory(_) => 1,
        }
    }

    /// The memory itself, for outputs that the CPU makes in place.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        match self {
            // SAFETY: the constructors of `ShmTarget` make the caller promise that the range of a
            // place is nobody else's; `&mut self` keeps the slice single.
            Place::Shm {
                target,
                offset_bytes,
                capacity_bytes,
            } => unsafe { target.range_mut(*offset_bytes, *capacity_bytes) },
            Place::Memory(memory) => memory,
        }
    }
}
