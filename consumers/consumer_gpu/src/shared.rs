//! Memory of a device that processes share: made here for others, or imported from another.

use std::os::fd::{AsRawFd as _, FromRawFd as _, OwnedFd};
use std::sync::Arc;

use cudarc::driver::sys;

use crate::cuda::{Cuda, check};
use crate::error::GpuError;

/// CUDA's number of descriptors as shareable handles.
const DESCRIPTOR: sys::CUmemAllocationHandleType =
    sys::CUmemAllocationHandleType::CU_MEM_HANDLE_TYPE_POSIX_FILE_DESCRIPTOR;

/// A range of device addresses with memory behind it. It stays until this is dropped and the device
/// has done what this process gave it until then.
#[derive(Debug)]
pub struct SharedRange {
    cuda: Arc<Cuda>,
    /// Address of its first byte on the device.
    pub address: u64,
    n_bytes: usize,
}

/// What is free on a device, and all that it has, bytes.
#[derive(Clone, Copy, Debug)]
pub struct Room {
    /// Free bytes.
    pub free_bytes: u64,
    /// All bytes.
    pub all_bytes: u64,
}

fn location(cuda: &Cuda) -> sys::CUmemLocation {
    sys::CUmemLocation {
        type_: sys::CUmemLocationType::CU_MEM_LOCATION_TYPE_DEVICE,
        id: cuda.ordinal,
    }
}

fn properties(cuda: &Cuda) -> sys::CUmemAllocationProp {
    sys::CUmemAllocationProp {
        type_: sys::CUmemAllocationType::CU_MEM_ALLOCATION_TYPE_PINNED,
        requestedHandleTypes: DESCRIPTOR,
        location: location(cuda),
        win32HandleMetaData: std::ptr::null_mut(),
        allocFlags: sys::CUmemAllocationProp_st__bindgen_ty_1 {
            compressionType: 0,
            gpuDirectRDMACapable: 0,
            usage: 0,
            reserved: [0; 4],
        },
    }
}

/// Free memory of a device.
///
/// # Errors
/// [`GpuError::Cuda`].
pub fn room(cuda: &Cuda) -> Result<Room, GpuError> {
    cuda.with(|| {
        let (mut free, mut all) = (0, 0);
        // SAFETY: the context is current; the pointers are to this frame's own.
        check("cuMemGetInfo", unsafe {
            sys::cuMemGetInfo_v2(&mut free, &mut all)
        })?;
        Ok(Room {
            free_bytes: free as u64,
            all_bytes: all as u64,
        })
    })
}

/// `n_bytes` as a device gives them: whole pages of its own.
///
/// # Errors
/// [`GpuError::Cuda`].
pub fn rounded(cuda: &Cuda, n_bytes: usize) -> Result<usize, GpuError> {
    cuda.with(|| {
        let (mut page, wanted) = (0, properties(cuda));
        let least = sys::CUmemAllocationGranularity_flags::CU_MEM_ALLOC_GRANULARITY_MINIMUM;
        // SAFETY: the pointers are to this frame's own.
        check("cuMemGetAllocationGranularity", unsafe {
            sys::cuMemGetAllocationGranularity(&mut page, &wanted, least)
        })?;
        let whole = n_bytes.max(1).checked_next_multiple_of(page.max(1));
        // More than any device has.
        Ok(whole.unwrap_or(usize::MAX))
    })
}

/// Makes memory of `n_bytes`, a number of [`rounded`], and a descriptor by which other processes
/// import it.
///
/// # Errors
/// [`GpuError::Cuda`].
pub fn make(cuda: &Arc<Cuda>, n_bytes: usize) -> Result<(SharedRange, OwnedFd), GpuError> {
    cuda.with(|| {
        let (mut handle, wanted) = (0, properties(cuda));
        // SAFETY: the pointers are to this frame's own.
        check("cuMemCreate", unsafe {
            sys::cuMemCreate(&mut handle, n_bytes, &wanted, 0)
        })?;
        let mut descriptor: i32 = -1;
        // SAFETY: the handle was just made; for descriptors the call writes an `int`.
        let exported = check("cuMemExportToShareableHandle", unsafe {
            sys::cuMemExportToShareableHandle((&raw mut descriptor).cast(), handle, DESCRIPTOR, 0)
        });
        let exported = exported.map(|()| {
            // SAFETY: the driver has just made it for this process.
            let made = unsafe { OwnedFd::from_raw_fd(descriptor) };
            // Programs that this one starts do not inherit a clone.
            made.try_clone().unwrap_or(made)
        });
        let mapped = map(cuda, handle, n_bytes, Use::Write);
        release(handle);
        Ok((mapped?, exported?))
    })
}

/// Imports memory of `n_bytes` that another process has made.
///
/// # Errors
/// [`GpuError::Cuda`].
pub fn import(
    cuda: &Arc<Cuda>,
    descriptor: &OwnedFd,
    n_bytes: usize,
) -> Result<SharedRange, GpuError> {
    cuda.with(|| {
        let mut handle = 0;
        let number = descriptor.as_raw_fd() as usize;
        // SAFETY: for descriptors the call wants the number itself in the place of a pointer. The
        // descriptor stays the caller's.
        check("cuMemImportFromShareableHandle", unsafe {
            sys::cuMemImportFromShareableHandle(
                &mut handle,
                std::ptr::without_provenance_mut(number),
                DESCRIPTOR,
            )
        })?;
        let mapped = map(cuda, handle, n_bytes, Use::Read);
        release(handle);
        mapped
    })
}

/// What a process does with memory.
#[derive(Clone, Copy, PartialEq)]
enum Use {
    Read,
    Write,
}

/// Gives the handle back: memory stays while it is mapped somewhere.
fn release(handle: sys::CUmemGenericAllocationHandle) {
    // SAFETY: made or imported by the caller, who does not use it again.
    let _ = unsafe { sys::cuMemRelease(handle) };
}

/// Maps memory that is wholly `n_bytes` long; the driver refuses a longer range.
fn map(
    cuda: &Arc<Cuda>,
    handle: sys::CUmemGenericAllocationHandle,
    n_bytes: usize,
    for_: Use,
) -> Result<SharedRange, GpuError> {
    let mut address = 0;
    // SAFETY: the pointer is to this frame's own.
    check("cuMemAddressReserve", unsafe {
        sys::cuMemAddressReserve(&mut address, n_bytes, 0, 0, 0)
    })?;
    // SAFETY: the range was just reserved, and nothing is mapped there.
    let mapped = check("cuMemMap", unsafe {
        sys::cuMemMap(address, n_bytes, 0, handle, 0)
    });
    if let Err(error) = mapped {
        // SAFETY: reserved above, and used by nobody.
        unsafe { sys::cuMemAddressFree(address, n_bytes) };
        return Err(error);
    }
    let range = SharedRange {
        cuda: cuda.clone(),
        address,
        n_bytes,
    };
    let allow = |flags| {
        let access = sys::CUmemAccessDesc {
            location: location(cuda),
            flags,
        };
        // SAFETY: the range was just mapped; one description is given.
        check("cuMemSetAccess", unsafe {
            sys::cuMemSetAccess(address, n_bytes, &access, 1)
        })
    };
    // Devices that cannot protect their memory from writing allow it.
    if for_ == Use::Write || allow(sys::CUmemAccess_flags::CU_MEM_ACCESS_FLAGS_PROT_READ).is_err() {
        allow(sys::CUmemAccess_flags::CU_MEM_ACCESS_FLAGS_PROT_READWRITE)?;
    }
    Ok(range)
}

impl Drop for SharedRange {
    fn drop(&mut self) {
        // Work that was queued may still use the addresses.
        let waited = self.cuda.wait_for_all();
        let freed = waited.and_then(|()| {
            self.cuda.with(|| {
                // SAFETY: mapped and reserved by `map` with this length; who had addresses in it
                // held this, and the device is done with them.
                unsafe {
                    check("cuMemUnmap", sys::cuMemUnmap(self.address, self.n_bytes))?;
                    check(
                        "cuMemAddressFree",
                        sys::cuMemAddressFree(self.address, self.n_bytes),
                    )
                }
            })
        });
        // At the end of a process CUDA may be gone before this is.
        if let Err(error) = freed {
            tracing::debug!(%error, "shared memory was left to the driver");
        }
    }
}
