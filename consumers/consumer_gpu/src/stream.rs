//! A stream of one's own on a device: copies that begin once others' work is done.

use std::sync::Arc;

use cudarc::driver::sys;

use crate::cuda::{Cuda, Event, check};
use crate::error::GpuError;

/// A queue of work for a device, beside all others.
#[derive(Debug)]
pub struct Stream {
    cuda: Arc<Cuda>,
    stream: sys::CUstream,
}

// SAFETY: streams may be used by any thread.
unsafe impl Send for Stream {}
// SAFETY: as above.
unsafe impl Sync for Stream {}

impl Stream {
    /// Makes one.
    ///
    /// # Errors
    /// [`GpuError::Cuda`].
    pub fn new(cuda: &Arc<Cuda>) -> Result<Stream, GpuError> {
        cuda.with(|| {
            let mut stream = std::ptr::null_mut();
            let flags = sys::CUstream_flags::CU_STREAM_NON_BLOCKING as u32;
            // SAFETY: the context is current; the pointer is to this frame's own.
            check("cuStreamCreate", unsafe {
                sys::cuStreamCreate(&mut stream, flags)
            })?;
            Ok(Stream {
                cuda: cuda.clone(),
                stream,
            })
        })
    }

    /// Its address, by which other libraries queue work on it.
    pub fn address(&self) -> u64 {
        self.stream as u64
    }

    /// Lets what is queued from now on wait for a moment.
    ///
    /// # Errors
    /// [`GpuError::Cuda`].
    pub fn after(&self, event: &Event) -> Result<(), GpuError> {
        self.cuda.with(|| {
            // SAFETY: both live, and belong to this context.
            check("cuStreamWaitEvent", unsafe {
                sys::cuStreamWaitEvent(self.stream, event.event, 0)
            })
        })
    }

    /// Queues a copy within the device.
    ///
    /// # Errors
    /// [`GpuError::Cuda`].
    ///
    /// # Safety
    /// Both ranges are memory of the device until the copy is done, nobody writes to the first, and
    /// nobody uses the second.
    pub unsafe fn copy(&self, from: u64, to: u64, n_bytes: usize) -> Result<(), GpuError> {
        self.cuda.with(|| {
            // SAFETY: promised by the caller.
            check("cuMemcpyDtoDAsync", unsafe {
                sys::cuMemcpyDtoDAsync_v2(to, from, n_bytes, self.stream)
            })
        })
    }

    /// Copies bytes to the device, and waits.
    ///
    /// # Errors
    /// [`GpuError::Cuda`].
    ///
    /// # Safety
    /// The range is memory of the device, and nobody uses it.
    pub unsafe fn upload(&self, from: &[u8], to: u64) -> Result<(), GpuError> {
        self.cuda.with(|| {
            // SAFETY: promised by the caller; the bytes are there until the wait is over.
            unsafe {
                check(
                    "cuMemcpyHtoDAsync",
                    sys::cuMemcpyHtoDAsync_v2(to, from.as_ptr().cast(), from.len(), self.stream),
                )?;
                check("cuStreamSynchronize", sys::cuStreamSynchronize(self.stream))
            }
        })
    }

    /// Copies bytes from the device, and waits.
    ///
    /// # Errors
    /// [`GpuError::Cuda`].
    ///
    /// # Safety
    /// The range is memory of the device, and nobody writes to it.
    pub unsafe fn download(&self, from: u64, into: &mut [u8]) -> Result<(), GpuError> {
        self.cuda.with(|| {
            // SAFETY: promised by the caller; the bytes are this process's own, borrowed alone.
            unsafe {
                check(
                    "cuMemcpyDtoHAsync",
                    sys::cuMemcpyDtoHAsync_v2(
                        into.as_mut_ptr().cast(),
                        from,
                        into.len(),
                        self.stream,
                    ),
                )?;
                check("cuStreamSynchronize", sys::cuStreamSynchronize(self.stream))
            }
        })
    }

    /// Waits until all that was queued on it is done.
    ///
    /// # Errors
    /// [`GpuError::Cuda`].
    pub fn wait(&self) -> Result<(), GpuError> {
        self.cuda.with(|| {
            // SAFETY: it lives.
            check("cuStreamSynchronize", unsafe {
                sys::cuStreamSynchronize(self.stream)
            })
        })
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        let _ = self.cuda.with(|| {
            // SAFETY: made by `new`; work that is queued on it is finished by the driver.
            check("cuStreamDestroy", unsafe {
                sys::cuStreamDestroy_v2(self.stream)
            })
        });
    }
}
