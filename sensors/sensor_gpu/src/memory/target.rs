//! Memory of readers that frames are copied to: imported into the GPU, or reached through staging.

use std::sync::Arc;

use super::import::{ImportError, import_host_memory};
use crate::device::Gpu;

/// One shared-memory segment (or any host memory) that frames go to, with what keeps it mapped.
///
/// When the last clone is dropped, the device lets go of the memory, whoever still holds a clone of
/// its buffer or a binding of it; then what keeps the memory is dropped, and never before. If the
/// device hangs, so that it may write at any time, the memory is kept until the process ends.
pub struct ShmTarget {
    base: *mut u8,
    len: usize,
    imported: Option<(wgpu::Buffer, Gpu)>,
    staged: Option<ImportError>,
    /// Whether it is memory of the device, which this process has not mapped.
    is_exported: bool,
    /// `None` after `drop` has left it to the end of the process.
    keeper: Option<Box<dyn Send + Sync>>,
}

impl std::fmt::Debug for ShmTarget {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ShmTarget")
            .field("len", &self.len)
            .field("staged", &self.staged)
            .finish_non_exhaustive()
    }
}

// SAFETY: `base` is only used in ranges of places, each of which belongs to one holder (contract of
// `place`); the keeper is `Send` and `Sync`, and so is the buffer.
unsafe impl Send for ShmTarget {}
// SAFETY: as above.
unsafe impl Sync for ShmTarget {}

impl ShmTarget {
    /// Imports a whole data segment, once. If that fails, the target is staged and
    /// [`ShmTarget::staged_reason`] states why. `keeper` is dropped after the device has let go of
    /// the memory.
    ///
    /// # Safety
    /// `base..base + len` stays mapped and writable as long as `keeper` lives. Who reads and writes
    /// which range is promised for every [`ShmTarget::place`].
    pub unsafe fn import(
        gpu: &Gpu,
        base: *mut u8,
        len: usize,
        keeper: impl Send + Sync + 'static,
    ) -> ShmTarget {
        let keeper: Option<Box<dyn Send + Sync>> = Some(Box::new(keeper));
        // SAFETY: the caller promises what the callee asks.
        match unsafe { import_host_memory(gpu, base, len) } {
            Ok(buffer) => ShmTarget {
                base,
                len,
                imported: Some((buffer, gpu.clone())),
                staged: None,
                is_exported: false,
                keeper,
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
                    is_exported: false,
                    keeper,
                }
            }
        }
    }

    /// A target that is always reached through staging and one CPU copy.
    ///
    /// # Safety
    /// As [`ShmTarget::import`].
    pub unsafe fn staged(
        base: *mut u8,
        len: usize,
        keeper: impl Send + Sync + 'static,
    ) -> ShmTarget {
        ShmTarget {
            base,
            len,
            imported: None,
            staged: Some(ImportError::AskedFor),
            is_exported: false,
            keeper: Some(Box::new(keeper)),
        }
    }

    /// Memory of the device behind this buffer, which is not mapped.
    pub(super) fn on_device(gpu: &Gpu, buffer: wgpu::Buffer, len: usize) -> ShmTarget {
        ShmTarget {
            base: std::ptr::null_mut(),
            len,
            imported: Some((buffer, gpu.clone())),
            staged: None,
            is_exported: true,
            keeper: None,
        }
    }

    /// Whether it is memory of the device that other processes import ([`ShmTarget::export`]).
    pub fn is_exported(&self) -> bool {
        self.is_exported
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
    /// what a shader can be given. A clone of it is of no use after the target is dropped: wgpu
    /// refuses submissions that use it.
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
        assert!(
            !self.is_exported,
            "memory of the device cannot be reached by the processor"
        );
        // SAFETY: in bounds (first assert), mapped and writable (constructor), exclusive (caller); bytes
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
        let Some((buffer, gpu)) = self.imported.take() else {
            return;
        };
        // Frees it although there may be clones and bindings, once it is polled and nothing that was
        // submitted uses it. A lost device no longer uses it anyway.
        buffer.destroy();
        drop(buffer);
        if let Err(error) = gpu.wait_for(None) {
            tracing::debug!(%error, "the device did not confirm that it let go of shared memory");
        }
        if gpu.is_hung() {
            std::mem::forget(self.keeper.take());
        }
    }
}
