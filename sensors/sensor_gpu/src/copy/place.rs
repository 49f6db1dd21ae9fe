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

impl<'a> Place<'a> {
    /// Its first `n` parts of `part_bytes` each, one after the other; what is left over is nobody's.
    ///
    /// Panics if they do not fit, or `part_bytes` is no multiple of 4 although there are several.
    pub fn parts(self, n: usize, part_bytes: usize) -> Vec<Place<'a>> {
        let needed = part_bytes.checked_mul(n);
        assert!(
            needed.is_some_and(|needed| needed <= self.capacity_bytes()),
            "{n} parts of {part_bytes} bytes do not fit the {} bytes of a place",
            self.capacity_bytes()
        );
        assert!(
            n <= 1 || part_bytes.is_multiple_of(4),
            "parts of {part_bytes} bytes do not begin at multiples of 4"
        );
        match self {
            Place::Shm(whole) => (0..n)
                .map(|part| {
                    Place::Shm(ShmPlace {
                        target: whole.target.clone(),
                        offset_bytes: whole.offset_bytes + part * part_bytes,
                        capacity_bytes: part_bytes,
                    })
                })
                .collect(),
            Place::Memory(whole) if part_bytes > 0 => whole
                .chunks_exact_mut(part_bytes)
                .take(n)
                .map(Place::Memory)
                .collect(),
            Place::Memory(_) => (0..n).map(|_| Place::Memory(&mut [])).collect(),
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_place_lie_one_after_the_other_and_none_is_anothers() {
        let mut memory = [0u8; 30];
        let parts = Place::Memory(&mut memory).parts(3, 8);
        for (i, mut part) in parts.into_iter().enumerate() {
            assert_eq!(part.capacity_bytes(), 8);
            part.bytes_mut().fill(i as u8 + 1);
        }
        assert_eq!(memory[..24], [[1; 8], [2; 8], [3; 8]].concat());
        assert_eq!(memory[24..], [0; 6]);
        assert!(Place::Memory(&mut []).parts(0, 8).is_empty());
    }

    #[test]
    #[should_panic(expected = "do not fit")]
    fn parts_that_do_not_fit_are_refused() {
        let mut memory = [0u8; 30];
        Place::Memory(&mut memory).parts(4, 8);
    }
}
