//! CUDA's driver: its devices, memory of other processes, events, and page-locked memory.

use std::os::fd::{AsRawFd as _, IntoRawFd as _};
use std::sync::{Arc, OnceLock};

use cudarc::driver::sys;
use parking_lot::Mutex;
use schema_bus::GpuMemory;

use crate::error::{GpuError, NoCuda};

/// First driver that records an event behind all work of a context.
const RECORDS_CONTEXTS: i32 = 12_050;

/// Events that are kept for the next moments.
const MAX_SPARE_EVENTS: usize = 16;

/// A device of CUDA, in the context that torch and others use too.
#[derive(Debug)]
pub struct Cuda {
    /// Its number.
    pub ordinal: i32,
    /// Its UUID.
    pub uuid: [u8; 16],
    context: sys::CUcontext,
    records_contexts: bool,
    spare_events: Mutex<Vec<EventHandle>>,
}

/// An event that is over, or that nobody waits for any more.
#[derive(Debug)]
struct EventHandle(sys::CUevent);

// SAFETY: events may be used by any thread.
unsafe impl Send for EventHandle {}

// SAFETY: CUDA's contexts may be used by any thread that makes them current, as `with` does.
unsafe impl Send for Cuda {}
// SAFETY: as above.
unsafe impl Sync for Cuda {}

/// A device before it is opened.
#[derive(Clone, Debug)]
pub struct Found {
    /// Its number.
    pub ordinal: i32,
    /// Its UUID.
    pub uuid: [u8; 16],
    /// Its name.
    pub name: String,
}

/// The result of a call as an error.
pub(crate) fn check(call: &'static str, result: sys::CUresult) -> Result<(), GpuError> {
    if result == sys::CUresult::CUDA_SUCCESS {
        return Ok(());
    }
    Err(GpuError::Cuda {
        call,
        code: format!("{result:?}"),
    })
}

/// Starts CUDA once; the result states why it cannot be used.
fn start() -> Result<(), GpuError> {
    static STARTED: OnceLock<Result<(), NoCuda>> = OnceLock::new();
    let started = STARTED.get_or_init(|| {
        // SAFETY: looks for the library only.
        if !unsafe { sys::is_culib_present() } {
            return Err(NoCuda::NotFound);
        }
        // SAFETY: the library is there; no other call comes before this one.
        match unsafe { sys::cuInit(0) } {
            sys::CUresult::CUDA_SUCCESS => Ok(()),
            error => Err(NoCuda::Refused(error)),
        }
    });
    started.map_err(GpuError::NoCuda)
}

/// All devices that this process may use.
///
/// # Errors
/// [`GpuError::NoCuda`].
pub fn devices() -> Result<Vec<Found>, GpuError> {
    start()?;
    let mut n = 0;
    // SAFETY: CUDA has started; the pointer is to a number of this frame.
    check("cuDeviceGetCount", unsafe { sys::cuDeviceGetCount(&mut n) })?;
    let mut found = Vec::new();
    for ordinal in 0..n {
        let (mut device, mut uuid) = (0, sys::CUuuid { bytes: [0; 16] });
        let mut name = [0 as std::ffi::c_char; 128];
        // SAFETY: the ordinal is below the number of devices; the pointers are to this frame's own.
        unsafe {
            check("cuDeviceGet", sys::cuDeviceGet(&mut device, ordinal))?;
            // Of a slice of a GPU this is the slice's own UUID.
            check(
                "cuDeviceGetUuid",
                sys::cuDeviceGetUuid_v2(&mut uuid, device),
            )?;
            check(
                "cuDeviceGetName",
                sys::cuDeviceGetName(name.as_mut_ptr(), 127, device),
            )?;
        }
        let name = name.iter().take_while(|c| **c != 0);
        found.push(Found {
            ordinal,
            uuid: uuid.bytes.map(|byte| byte as u8),
            name: String::from_utf8_lossy(&name.map(|c| *c as u8).collect::<Vec<_>>()).into_owned(),
        });
    }
    Ok(found)
}

/// Number of the device whose memory an address is in.
///
/// # Errors
/// [`GpuError::NoCuda`], [`GpuError::Cuda`] for other memory.
pub fn device_of(address: u64) -> Result<i32, GpuError> {
    start()?;
    let mut ordinal: i32 = -1;
    let what = sys::CUpointer_attribute::CU_POINTER_ATTRIBUTE_DEVICE_ORDINAL;
    // SAFETY: CUDA has started; for this attribute the call writes an `int`, and it refuses
    // addresses that are not its own.
    check("cuPointerGetAttribute", unsafe {
        sys::cuPointerGetAttribute((&raw mut ordinal).cast(), what, address)
    })?;
    Ok(ordinal)
}

impl Cuda {
    /// Opens a device.
    ///
    /// # Errors
    /// [`GpuError::NoCuda`], [`GpuError::Cuda`].
    pub fn open(ordinal: i32) -> Result<Arc<Cuda>, GpuError> {
        start()?;
        let (mut device, mut context, mut version) = (0, std::ptr::null_mut(), 0);
        let mut uuid = sys::CUuuid { bytes: [0; 16] };
        // SAFETY: CUDA has started; the pointers are to this frame's own. The primary context is
        // kept until the process ends, because tensors of others may outlive this value.
        unsafe {
            check("cuDeviceGet", sys::cuDeviceGet(&mut device, ordinal))?;
            check(
                "cuDeviceGetUuid",
                sys::cuDeviceGetUuid_v2(&mut uuid, device),
            )?;
            check(
                "cuDevicePrimaryCtxRetain",
                sys::cuDevicePrimaryCtxRetain(&mut context, device),
            )?;
            check("cuDriverGetVersion", sys::cuDriverGetVersion(&mut version))?;
        }
        Ok(Arc::new(Cuda {
            ordinal,
            uuid: uuid.bytes.map(|byte| byte as u8),
            context,
            records_contexts: version >= RECORDS_CONTEXTS,
            spare_events: Mutex::new(Vec::new()),
        }))
    }

    /// Calls `act` with the device's context as this thread's.
    pub(crate) fn with<T>(&self, act: impl FnOnce() -> Result<T, GpuError>) -> Result<T, GpuError> {
        // SAFETY: the context is retained.
        check("cuCtxPushCurrent", unsafe {
            sys::cuCtxPushCurrent_v2(self.context)
        })?;
        let done = act();
        let mut popped = std::ptr::null_mut();
        // SAFETY: pops what was pushed above.
        check("cuCtxPopCurrent", unsafe {
            sys::cuCtxPopCurrent_v2(&mut popped)
        })?;
        done
    }

    /// Whether a moment is behind the work of all streams, whoever made them.
    pub fn sees_all_streams(&self) -> bool {
        self.records_contexts
    }

    /// Imports Vulkan's memory of another process.
    ///
    /// # Errors
    /// [`GpuError::Cuda`].
    pub fn import(self: &Arc<Self>, memory: GpuMemory) -> Result<Imported, GpuError> {
        self.with(|| {
            let mut external = std::ptr::null_mut();
            let wanted = sys::CUDA_EXTERNAL_MEMORY_HANDLE_DESC {
                type_: sys::CUexternalMemoryHandleType::CU_EXTERNAL_MEMORY_HANDLE_TYPE_OPAQUE_FD,
                handle: sys::CUDA_EXTERNAL_MEMORY_HANDLE_DESC_st__bindgen_ty_1 {
                    fd: memory.descriptor.as_raw_fd(),
                },
                size: memory.n_bytes,
                flags: sys::CUDA_EXTERNAL_MEMORY_DEDICATED,
                reserved: [0; 16],
            };
            // SAFETY: a well-formed description of an open descriptor, with the length that its
            // writer named (`GpuFrame::check_memory`).
            check("cuImportExternalMemory", unsafe {
                sys::cuImportExternalMemory(&mut external, &wanted)
            })?;
            // After an import that succeeded the descriptor is the driver's.
            let _ = memory.descriptor.into_raw_fd();
            let range = sys::CUDA_EXTERNAL_MEMORY_BUFFER_DESC {
                offset: 0,
                size: memory.n_bytes,
                flags: 0,
                reserved: [0; 16],
            };
            let mut address = 0;
            // SAFETY: the whole of the memory that was just imported.
            let mapped = check("cuExternalMemoryGetMappedBuffer", unsafe {
                sys::cuExternalMemoryGetMappedBuffer(&mut address, external, &range)
            });
            if let Err(error) = mapped {
                // SAFETY: just imported, and nothing was mapped.
                unsafe { sys::cuDestroyExternalMemory(external) };
                return Err(error);
            }
            Ok(Imported {
                cuda: self.clone(),
                address,
                external,
            })
        })
    }

    /// A moment behind everything that the device's context has been given so far.
    ///
    /// # Errors
    /// [`GpuError::Cuda`].
    pub fn now(self: &Arc<Self>, stream: u64) -> Result<Event, GpuError> {
        self.with(|| {
            let event = self.event()?;
            // SAFETY: event and context belong together.
            if self.records_contexts
                && unsafe { sys::cuCtxRecordEvent(self.context, event.event) }
                    == sys::CUresult::CUDA_SUCCESS
            {
                return Ok(event);
            }
            // SAFETY: a stream of this context by its address, or 0 for the legacy one, which waits
            // for all streams that do not refuse that.
            check("cuEventRecord", unsafe {
                sys::cuEventRecord(event.event, stream as sys::CUstream)
            })?;
            Ok(event)
        })
    }

    fn event(self: &Arc<Self>) -> Result<Event, GpuError> {
        let spare = self.spare_events.lock().pop();
        let event = match spare {
            Some(EventHandle(event)) => event,
            None => {
                let mut event = std::ptr::null_mut();
                let flags = sys::CUevent_flags::CU_EVENT_DISABLE_TIMING as u32;
                // SAFETY: the context is current; the pointer is to this frame's own.
                check("cuEventCreate", unsafe {
                    sys::cuEventCreate(&mut event, flags)
                })?;
                event
            }
        };
        Ok(Event {
            cuda: self.clone(),
            event,
        })
    }

    /// Waits until the device has done all that this process gave it.
    ///
    /// # Errors
    /// [`GpuError::Cuda`].
    pub fn wait_for_all(self: &Arc<Self>) -> Result<(), GpuError> {
        if self.records_contexts {
            self.now(0)?.wait();
            return Ok(());
        }
        // SAFETY: the context is current.
        self.with(|| check("cuCtxSynchronize", unsafe { sys::cuCtxSynchronize() }))
    }

    /// Copies bytes of the device's memory to the processor, and waits.
    ///
    /// # Errors
    /// [`GpuError::Cuda`].
    ///
    /// # Safety
    /// The bytes from `address` on are memory of this device that nobody frees meanwhile.
    pub unsafe fn read(&self, address: u64, into: &mut [u8]) -> Result<(), GpuError> {
        self.with(|| {
            // SAFETY: promised by the caller, and `into` is this process's own.
            check("cuMemcpyDtoH", unsafe {
                sys::cuMemcpyDtoH_v2(into.as_mut_ptr().cast(), address, into.len())
            })
        })
    }

    /// Memory of the device and page-locked memory of the same length.
    ///
    /// # Errors
    /// [`GpuError::Cuda`].
    pub fn staged(self: &Arc<Self>, n_bytes: usize) -> Result<Staged, GpuError> {
        self.with(|| {
            let (mut host, mut address) = (std::ptr::null_mut(), 0);
            // SAFETY: the context is current; the pointers are to this frame's own.
            check("cuMemHostAlloc", unsafe {
                sys::cuMemHostAlloc(&mut host, n_bytes.max(1), 0)
            })?;
            // SAFETY: as above.
            let made = check("cuMemAlloc", unsafe {
                sys::cuMemAlloc_v2(&mut address, n_bytes.max(1))
            });
            if let Err(error) = made {
                // SAFETY: made above, and used by nobody.
                unsafe { sys::cuMemFreeHost(host) };
                return Err(error);
            }
            Ok(Staged {
                cuda: self.clone(),
                host: host.cast(),
                address,
                n_bytes,
            })
        })
    }
}

/// Memory of another process in this one's CUDA.
#[derive(Debug)]
pub struct Imported {
    cuda: Arc<Cuda>,
    /// Address of its first byte on the device.
    pub address: u64,
    external: sys::CUexternalMemory,
}

// SAFETY: addresses and handles of the device, which any thread may use through `Cuda::with`.
unsafe impl Send for Imported {}
// SAFETY: as above.
unsafe impl Sync for Imported {}

impl Drop for Imported {
    fn drop(&mut self) {
        let freed = self.cuda.with(|| {
            // SAFETY: mapped and imported by `import`; frames that lie in it hold it, so nobody
            // reads it any more.
            unsafe {
                check("cuMemFree", sys::cuMemFree_v2(self.address))?;
                check(
                    "cuDestroyExternalMemory",
                    sys::cuDestroyExternalMemory(self.external),
                )
            }
        });
        // At the end of a process CUDA may be gone before this is.
        if let Err(error) = freed {
            tracing::debug!(%error, "imported memory was left to the driver");
        }
    }
}

/// A moment in the work of a device.
#[derive(Debug)]
pub struct Event {
    cuda: Arc<Cuda>,
    pub(crate) event: sys::CUevent,
}

// SAFETY: events may be asked by any thread.
unsafe impl Send for Event {}
// SAFETY: as above.
unsafe impl Sync for Event {}

impl Event {
    /// Whether all work before it is done. A device that has failed does nothing any more.
    pub fn is_over(&self) -> bool {
        // SAFETY: the event lives as long as this value.
        let state = unsafe { sys::cuEventQuery(self.event) };
        state != sys::CUresult::CUDA_ERROR_NOT_READY
    }

    /// Waits until all work before it is done.
    pub fn wait(&self) {
        let waited = self.cuda.with(|| {
            // SAFETY: as above.
            check("cuEventSynchronize", unsafe {
                sys::cuEventSynchronize(self.event)
            })
        });
        if let Err(error) = waited {
            tracing::debug!(%error, "the device does nothing any more");
        }
    }
}

impl Drop for Event {
    fn drop(&mut self) {
        let mut spare = self.cuda.spare_events.lock();
        if spare.len() < MAX_SPARE_EVENTS {
            spare.push(EventHandle(self.event));
            return;
        }
        // SAFETY: made by `event`; destroying one that is still recorded is allowed.
        let _ = unsafe { sys::cuEventDestroy_v2(self.event) };
    }
}

/// Page-locked memory, and memory of the device to which it is uploaded.
#[derive(Debug)]
pub struct Staged {
    cuda: Arc<Cuda>,
    host: *mut u8,
    /// Address on the device.
    pub address: u64,
    /// Length of both, bytes.
    pub n_bytes: usize,
}

// SAFETY: the memory is the value's own.
unsafe impl Send for Staged {}
// SAFETY: as above.
unsafe impl Sync for Staged {}

impl Staged {
    /// Uploads `bytes`, and waits until they are on the device.
    ///
    /// Panics if there are more than it holds.
    ///
    /// # Errors
    /// [`GpuError::Cuda`].
    pub fn upload(&mut self, bytes: &[u8]) -> Result<(), GpuError> {
        assert!(bytes.len() <= self.n_bytes, "an upload does not fit");
        self.cuda.with(|| {
            // SAFETY: in bounds (assert), and both are this value's own, which is borrowed alone.
            unsafe {
                std::ptr::copy_nonoverlapping(bytes.as_ptr(), self.host, bytes.len());
                check(
                    "cuMemcpyHtoD",
                    sys::cuMemcpyHtoD_v2(self.address, self.host.cast(), bytes.len()),
                )
            }
        })
    }
}

impl Drop for Staged {
    fn drop(&mut self) {
        let _ = self.cuda.with(|| {
            // SAFETY: made by `staged`; who had work that reads it gave it back after that work.
            unsafe {
                sys::cuMemFree_v2(self.address);
                sys::cuMemFreeHost(self.host.cast());
            }
            Ok(())
        });
    }
}
