//! Memory of readers that frames are copied to: imported into the GPU, or reached through staging.

use std::sync::Arc;

use super::import::{ImportError, import_host_memory};
use crate::device::Gpu;

/// One shared-memory segment (or any host memory) that frames go to.
///
/// Dropping it waits until the device no longer uses the memory; unmap it only afterwards.
#[derive(Debug)]
pub struct ShmTarget {
    base: *mut u8,
    len: usize,
    imported: Option<(wgpu::Buffer, Gpu)>,
    staged: Option<ImportError>,
}

// SAFETY: `base` is only written through, in ranges that the renderer holds alone (contract of the
// constructors); no method gives out a reference to the memory.
unsafe impl Send for ShmTarget {}
// SAFETY: as above; the wgpu buffer is `Sync` itself.
unsafe impl Sync for ShmTarget {}

impl ShmTarget {
    /// Imports a whole data segment, once. If that fails, the target is staged and
    /// [`ShmTarget::staged_reason`] states why.
    ///
    /// # Safety
    /// - `base..base + len` stays mapped and writable until the target, with all its clones in
    ///   places, is dropped.
    /// - While a submission that copies to a range of it is in flight (until `InFlight::wait`
    ///   returned), nobody else in this process reads, writes or holds a reference to that range.
    pub unsafe fn import(gpu: &Gpu, base: *mut u8, len: usize) -> ShmTarget {
        // SAFETY: the caller promises what the callee asks.
        match unsafe { import_host_memory(gpu, base, len) } {
            Ok(buffer) => ShmTarget {
                base,
                len,
                imported: Some((buffer, gpu.clone())),
                staged: None,
            },
            Err(reason) => {
                tracing::warn!(
                    %reason,
                    len,
                    "shared memory is not imported; frames cost one CPU copy"
                );
                ShmTarget {
                    base,
                    len,
                    imported: None,
                    staged: Some(reason),
                }
            }
        }
    }

    /// A target that is always reached through staging and one CPU copy.
    ///
    /// # Safety
    /// As [`ShmTarget::import`].
    pub unsafe fn staged(base: *mut u8, len: usize) -> ShmTarget {
        ShmTarget {
            base,
            len,
            imported: None,
            staged: Some(ImportError::AskedFor),
        }
    }

    /// Copies per frame by the CPU on the way there: 0 imported, 1 staged.
    pub fn cpu_copies(&self) -> u32 {
        self.imported.is_none() as u32
    }

    /// Why the target is not imported; `None` if it is.
    pub fn staged_reason(&self) -> Option<&ImportError> {
        self.staged.as_ref()
    }

    /// Length of the memory, bytes.
    pub fn n_bytes(&self) -> usize {
        self.len
    }

    /// First address of the memory, to compute offsets of loans from.
    pub fn base_address(&self) -> usize {
        self.base as usize
    }

    /// The memory as a buffer that shaders read and write; `None` if it is staged, or longer than
    /// what a shader can be given.
    pub fn storage(&self) -> Option<&wgpu::Buffer> {
        let (buffer, gpu) = self.imported.as_ref()?;
        (buffer.size() <= gpu.device().limits().max_storage_buffer_binding_size).then_some(buffer)
    }

    pub(crate) fn imported(&self) -> Option<&wgpu::Buffer> {
        self.imported.as_ref().map(|(buffer, _)| buffer)
    }

    /// The range as a writable slice.
    ///
    /// # Safety
    /// Nobody else accesses the range while the slice lives.
    #[expect(
        clippy::mut_from_ref,
        reason = "the range belongs to whoever renders, by the constructors' contract"
    )]
    pub(crate) unsafe fn range_mut(&self, offset_bytes: usize, n_bytes: usize) -> &mut [u8] {
        assert!(
            offset_bytes
                .checked_add(n_bytes)
                .is_some_and(|end| end <= self.len),
            "range {offset_bytes}+{n_bytes} exceeds {} bytes",
            self.len
        );
        // SAFETY: in bounds (assert), mapped and writable (constructor), exclusive (caller); bytes
        // have no invalid values.
        unsafe { std::slice::from_raw_parts_mut(self.base.add(offset_bytes), n_bytes) }
    }
}

/// A target that shaders write to, for [`crate::Gpu::submit_direct`]. Nobody can make a
/// [`crate::Place`] from it, so the memory cannot be reached through it by safe code.
#[derive(Clone, Debug)]
pub struct DirectTarget(Arc<ShmTarget>);

impl From<Arc<ShmTarget>> for DirectTarget {
    fn from(target: Arc<ShmTarget>) -> DirectTarget {
        DirectTarget(target)
    }
}

impl DirectTarget {
    pub(crate) fn imported(&self) -> Option<&wgpu::Buffer> {
        self.0.imported()
    }
}

impl Drop for ShmTarget {
    fn drop(&mut self) {
        if let Some((buffer, gpu)) = self.imported.take() {
            drop(buffer);
            // wgpu frees a buffer when it is next polled. A lost device no longer uses it anyway.
            if let Err(error) = gpu.device().poll(wgpu::PollType::wait_indefinitely()) {
                tracing::warn!(%error, "the device did not confirm that it let go of shared memory");
            }
        }
    }
}
