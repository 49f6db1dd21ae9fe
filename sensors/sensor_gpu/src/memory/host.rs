//! Memory of the process that shaders read and write in place.

use std::alloc::Layout;
use std::sync::Arc;

use wgpu::wgt;

use super::target::{DirectTarget, ShmTarget};
use crate::device::Gpu;

/// Page-aligned memory that the GPU has imported.
#[derive(Debug)]
pub struct HostMemory {
    target: Arc<ShmTarget>,
    base: *mut u8,
    n_bytes: usize,
}

/// What was allocated; the target keeps it.
struct Allocation {
    base: *mut u8,
    layout: Layout,
}

// SAFETY: nothing is done with the address but to free it.
unsafe impl Send for Allocation {}
// SAFETY: as above.
unsafe impl Sync for Allocation {}

impl Drop for Allocation {
    fn drop(&mut self) {
        // SAFETY: allocated with this layout, and nobody uses it: the target drops this last.
        unsafe { std::alloc::dealloc(self.base, self.layout) };
    }
}

// SAFETY: the memory belongs to the value; it is only read and written through methods whose
// callers keep accesses apart.
unsafe impl Send for HostMemory {}
// SAFETY: as above.
unsafe impl Sync for HostMemory {}

/// Imports need whole pages; 64 KiB is a multiple of the page size wherever Vulkan runs.
const ALIGN_BYTES: usize = 65_536;

impl HostMemory {
    /// Zeroed memory of at least `n_bytes`; `None` if shaders cannot reach memory of the process.
    pub fn new(gpu: &Gpu, n_bytes: usize) -> Option<HostMemory> {
        if !gpu.can_write_directly() {
            return None;
        }
        let layout =
            Layout::from_size_align(n_bytes.max(1).next_multiple_of(ALIGN_BYTES), ALIGN_BYTES)
                .ok()?;
        // SAFETY: the layout is not empty.
        let base = unsafe { std::alloc::alloc_zeroed(layout) };
        if base.is_null() {
            return None;
        }
        let allocation = Allocation { base, layout };
        // SAFETY: the memory is there until the allocation is dropped, and nobody has a reference to
        // it.
        let target = unsafe { ShmTarget::import(gpu, base, layout.size(), allocation) };
        target.storage()?;
        Some(HostMemory {
            target: Arc::new(target),
            base,
            n_bytes: layout.size(),
        })
    }

    /// As a target, to be named among those that a submission writes to.
    pub fn target(&self) -> DirectTarget {
        self.target.clone().into()
    }

    /// As a buffer for shaders and copies.
    pub fn buffer(&self) -> &wgpu::Buffer {
        self.target.storage().expect("checked when it was made")
    }

    /// Length, bytes.
    pub fn n_bytes(&self) -> usize {
        self.n_bytes
    }

    /// Makes what earlier commands wrote there visible to the host.
    pub fn make_visible(&self, encoder: &mut wgpu::CommandEncoder) {
        let visible = wgt::BufferTransition {
            buffer: self.buffer(),
            state: wgt::BufferUses::MAP_READ,
        };
        encoder.transition_resources(
            [visible].into_iter(),
            std::iter::empty::<wgt::TextureTransition<&wgpu::Texture>>(),
        );
    }

    /// The memory itself.
    ///
    /// # Safety
    /// While the slice lives, nobody calls [`HostMemory::write`], and no submission that writes to
    /// the memory is in flight.
    pub unsafe fn bytes(&self) -> &[u8] {
        // SAFETY: initialised, and written through `write` and by submissions only, which the
        // caller keeps apart from this.
        unsafe { std::slice::from_raw_parts(self.base, self.n_bytes) }
    }

    /// Copies bytes out.
    ///
    /// Panics if the range leaves the memory.
    ///
    /// # Safety
    /// No submission that writes to the range is in flight, and no other thread writes to it
    /// meanwhile.
    pub unsafe fn read(&self, offset_bytes: usize, into: &mut [u8]) {
        self.check_range(offset_bytes, into.len());
        // SAFETY: in bounds and initialised, `into` is other memory, because nobody ever has a
        // mutable reference to this, and nobody writes meanwhile (caller).
        unsafe {
            std::ptr::copy_nonoverlapping(
                self.base.add(offset_bytes),
                into.as_mut_ptr(),
                into.len(),
            )
        };
    }

    /// Copies bytes in.
    ///
    /// Panics if the range leaves the memory.
    ///
    /// # Safety
    /// No submission that reads or writes the range is in flight, no other thread reads or writes
    /// it meanwhile, and nobody holds what [`HostMemory::bytes`] gave.
    pub unsafe fn write(&self, offset_bytes: usize, from: &[u8]) {
        self.check_range(offset_bytes, from.len());
        // SAFETY: in bounds, `from` is other memory, because nobody holds a reference to this, and
        // nobody reads it meanwhile (caller).
        unsafe {
            std::ptr::copy_nonoverlapping(from.as_ptr(), self.base.add(offset_bytes), from.len())
        };
    }

    fn check_range(&self, offset_bytes: usize, n_bytes: usize) {
        let is_inside = offset_bytes
            .checked_add(n_bytes)
            .is_some_and(|end| end <= self.n_bytes());
        assert!(
            is_inside,
            "{n_bytes} bytes at {offset_bytes} of {}",
            self.n_bytes()
        );
    }
}
