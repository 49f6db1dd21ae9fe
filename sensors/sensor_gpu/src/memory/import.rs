//! Importing host memory into the device, by Vulkan calls that wgpu does not have.

use ash::vk;
use wgpu::hal::api::Vulkan;

use crate::device::Gpu;
use crate::queue::CopyQueue;

/// Why memory cannot be imported.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ImportError {
    /// The caller asked for a staged target.
    #[error("asked for")]
    AskedFor,
    /// Importing is not possible with this device.
    #[error("importing is switched off, or the driver lacks VK_EXT_external_memory_host")]
    Unsupported,
    /// Address or length is not aligned, or the length is 0.
    #[error(
        "segment of {len} bytes at {base:#x} is not aligned to the driver's {alignment_bytes} bytes"
    )]
    Misaligned {
        /// Length of the segment.
        len: u64,
        /// Its address.
        base: usize,
        /// Alignment that the driver asks for.
        alignment_bytes: u64,
    },
    /// Longer than a buffer can be.
    #[error("segment of {len} bytes exceeds the adapter's largest buffer of {max_bytes} bytes")]
    TooLong {
        /// Length of the segment.
        len: u64,
        /// Limit of the adapter.
        max_bytes: u64,
    },
    /// The device is not a Vulkan device.
    #[error("the device is not a Vulkan device")]
    NotVulkan,
    /// The driver returned an error.
    #[error("the driver refused: {0}")]
    Refused(vk::Result),
}

/// Wraps host memory as a GPU buffer that can be copied to and bound to shaders.
///
/// # Safety
/// `base..base + len` stays mapped and writable until the returned buffer is dropped and the device
/// has been polled.
pub(crate) unsafe fn import_host_memory(
    gpu: &Gpu,
    base: *mut u8,
    len: usize,
) -> Result<wgpu::Buffer, ImportError> {
    let caps = gpu.import_caps().ok_or(ImportError::Unsupported)?;
    let len = len as u64;
    if !(base as u64).is_multiple_of(caps.alignment_bytes)
        || !len.is_multiple_of(caps.alignment_bytes)
        || len == 0
    {
        return Err(ImportError::Misaligned {
            len,
            base: base as usize,
            alignment_bytes: caps.alignment_bytes,
        });
    }
    if len > gpu.max_buffer_bytes() {
        return Err(ImportError::TooLong {
            len,
            max_bytes: gpu.max_buffer_bytes(),
        });
    }
    // SAFETY: the hal device is only used for the calls below and lives as long as this guard.
    let device = unsafe { gpu.device().as_hal::<Vulkan>() }.ok_or(ImportError::NotVulkan)?;
    // SAFETY: the caller keeps the memory mapped; alignment and size were checked above.
    let hal_buffer = unsafe {
        create_imported_buffer(
            &device,
            gpu.copy_queue().map_or(&[], CopyQueue::families),
            base,
            len,
        )
    }
    .map_err(ImportError::Refused)?;
    drop(device);
    let descriptor = wgpu::BufferDescriptor {
        label: Some("imported shared memory"),
        size: len,
        usage: wgpu::BufferUsages::COPY_DST
            | wgpu::BufferUsages::COPY_SRC
            | wgpu::BufferUsages::STORAGE,
        mapped_at_creation: false,
    };
    // SAFETY: made from this device with this size; the Vulkan usage flags include those of the
    // descriptor. The contents are whatever the host wrote, so they count as initialised.
    Ok(unsafe {
        gpu.device()
            .create_buffer_from_hal::<Vulkan>(hal_buffer, &descriptor)
    })
}

/// A buffer over host memory for queues of these families; none means those of the family that
/// draws.
///
/// # Safety
/// As [`import_host_memory`], with alignment and size checked; the families are the device's.
unsafe fn create_imported_buffer(
    device: &wgpu::hal::vulkan::Device,
    families: &[u32],
    base: *mut u8,
    len: u64,
) -> Result<wgpu::hal::vulkan::Buffer, vk::Result> {
    const HOST: vk::ExternalMemoryHandleTypeFlags =
        vk::ExternalMemoryHandleTypeFlags::HOST_ALLOCATION_EXT;
    let raw = device.raw_device();
    let instance = device.shared_instance().raw_instance();
    let extension = ash::ext::external_memory_host::Device::new(instance, raw);
    let mut pointer_properties = vk::MemoryHostPointerPropertiesEXT::default();
    // SAFETY: the extension is enabled (`import_caps` is some), the pointer is valid by the
    // caller's promise.
    unsafe {
        (extension.fp().get_memory_host_pointer_properties_ext)(
            raw.handle(),
            HOST,
            base.cast_const().cast(),
            &mut pointer_properties,
        )
    }
    .result()?;
    let mut external = vk::ExternalMemoryBufferCreateInfo::default().handle_types(HOST);
    let usage = vk::BufferUsageFlags::TRANSFER_DST
        | vk::BufferUsageFlags::TRANSFER_SRC
        | vk::BufferUsageFlags::STORAGE_BUFFER;
    let sharing = if families.is_empty() {
        vk::SharingMode::EXCLUSIVE
    } else {
        vk::SharingMode::CONCURRENT
    };
    let info = vk::BufferCreateInfo::default()
        .size(len)
        .usage(usage)
        .sharing_mode(sharing)
        .queue_family_indices(families);
    let info = info.push_next(&mut external);
    // SAFETY: a well-formed create info; the buffer is destroyed below on failure, by wgpu-hal on
    // success.
    let buffer = unsafe { raw.create_buffer(&info, None) }?;
    // SAFETY: the buffer was just made from this device.
    let requirements = unsafe { raw.get_buffer_memory_requirements(buffer) };
    // SAFETY: instance and physical device belong together.
    let memory =
        unsafe { instance.get_physical_device_memory_properties(device.raw_physical_device()) };
    let bits = requirements.memory_type_bits & pointer_properties.memory_type_bits;
    let coherent = |i: &u32| {
        bits & (1 << i) != 0
            && memory.memory_types[*i as usize]
                .property_flags
                .contains(vk::MemoryPropertyFlags::HOST_COHERENT)
    };
    // Only coherent memory: readers in other processes cannot invalidate caches for us.
    let allocated = (0..memory.memory_type_count)
        .find(coherent)
        .ok_or(vk::Result::ERROR_FORMAT_NOT_SUPPORTED)
        .and_then(|memory_type| {
            let mut import = vk::ImportMemoryHostPointerInfoEXT::default()
                .handle_type(HOST)
                .host_pointer(base.cast());
            let info = vk::MemoryAllocateInfo::default()
                .allocation_size(len)
                .memory_type_index(memory_type)
                .push_next(&mut import);
            // SAFETY: size and pointer are aligned, the memory type is among those allowed for this
            // pointer and buffer.
            unsafe { raw.allocate_memory(&info, None) }
        });
    let memory = match allocated {
        Ok(memory) => memory,
        Err(error) => {
            // SAFETY: the buffer is ours and was never used.
            unsafe { raw.destroy_buffer(buffer, None) };
            return Err(error);
        }
    };
    // SAFETY: fresh buffer, fresh memory of sufficient size, offset 0.
    if let Err(error) = unsafe { raw.bind_buffer_memory(buffer, memory, 0) } {
        // SAFETY: both are ours and were never used.
        unsafe {
            raw.destroy_buffer(buffer, None);
            raw.free_memory(memory, None);
        }
        return Err(error);
    }
    // SAFETY: buffer and memory were made from this device, belong to nobody else, and are bound at
    // 0.
    Ok(unsafe { wgpu::hal::vulkan::Buffer::from_raw_managed(buffer, memory, 0, len) })
}
