//! Vulkan calls behind wgpu's back: opening a device with `VK_EXT_external_memory_host`, and
//! importing host memory.

use ash::vk;
use wgpu::hal::api::Vulkan;

use crate::copy_queue::{CopyPath, CopyQueue, Family, MAX_QUEUES, family_for};
use crate::device::Gpu;

/// What the driver says about importing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ImportCaps {
    /// Base address and length of an import are multiples of this, bytes.
    pub alignment_bytes: u64,
}

/// Whether the driver of `adapter` has the import extension.
pub(crate) fn has_import(adapter: &wgpu::Adapter) -> bool {
    // SAFETY: the hal adapter is only read, and lives as long as this guard.
    let hal_adapter = unsafe { adapter.as_hal::<Vulkan>() };
    hal_adapter.is_some_and(|hal| {
        hal.physical_device_capabilities()
            .supports_extension(ash::ext::external_memory_host::NAME)
    })
}

/// No queue goes before another.
static PRIORITIES: [f32; MAX_QUEUES] = [1.0; MAX_QUEUES];

/// A device.
pub(crate) struct Opened {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub caps: Option<ImportCaps>,
    /// Family of the second queue, if there is one.
    pub copying: Option<Family>,
}

/// Opens `adapter` with the import extension and a queue for copies, if it has them.
///
/// Errors are the driver's words.
pub(crate) fn open_device(adapter: &wgpu::Adapter, copies: CopyPath) -> Result<Opened, String> {
    let wanted = wgpu::Features::FLOAT32_FILTERABLE
        | wgpu::Features::IMMEDIATES
        | wgpu::Features::INDIRECT_FIRST_INSTANCE
        | wgpu::Features::SHADER_F64
        | wgpu::Features::SHADER_INT64
        | wgpu::Features::SHADER_INT64_ATOMIC_MIN_MAX
        | wgpu::Features::TEXTURE_ADAPTER_SPECIFIC_FORMAT_FEATURES
        | wgpu::Features::TIMESTAMP_QUERY
        | wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS;
    let features = adapter.features() & wanted;
    let descriptor = wgpu::DeviceDescriptor {
        label: Some("gantry"),
        required_features: features,
        required_limits: adapter.limits(),
        ..Default::default()
    };
    // SAFETY: the hal adapter is only read, and lives as long as this guard.
    let hal_adapter =
        unsafe { adapter.as_hal::<Vulkan>() }.ok_or("the adapter is not a Vulkan adapter")?;
    let has_import = hal_adapter
        .physical_device_capabilities()
        .supports_extension(ash::ext::external_memory_host::NAME);
    let mut host_properties = vk::PhysicalDeviceExternalMemoryHostPropertiesEXT::default();
    let mut properties = vk::PhysicalDeviceProperties2::default();
    if has_import {
        properties = properties.push_next(&mut host_properties);
    }
    // SAFETY: instance and physical device belong together and live; wgpu requires Vulkan 1.1 where
    // this call is core,
    // and the chained struct is only there if its extension is.
    unsafe {
        hal_adapter
            .shared_instance()
            .raw_instance()
            .get_physical_device_properties2(hal_adapter.raw_physical_device(), &mut properties);
    }
    let copying = family_for(&hal_adapter, copies).filter(|_| has_import);
    let add = move |args: wgpu::hal::vulkan::CreateDeviceCallbackArgs<'_, '_, '_>| {
        if has_import {
            args.extensions.push(ash::ext::external_memory_host::NAME);
        }
        let known = |family: Family| {
            args.queue_create_infos
                .iter()
                .any(|info| info.queue_family_index == family.index)
        };
        if let Some(family) = copying.filter(|family| !known(*family)) {
            let info = vk::DeviceQueueCreateInfo::default()
                .queue_family_index(family.index)
                .queue_priorities(&PRIORITIES[..=family.queue as usize]);
            args.queue_create_infos.push(info);
        }
    };
    // SAFETY: the callback only adds an extension and a queue that the physical device reported.
    let open = unsafe {
        hal_adapter.open_with_callback(
            features,
            &descriptor.required_limits,
            &descriptor.memory_hints,
            Some(Box::new(add)),
        )
    }
    .map_err(|error| error.to_string())?;
    drop(hal_adapter);
    // SAFETY: `open` was made from this adapter with the same features and limits as in
    // `descriptor`.
    let (device, queue) = unsafe { adapter.create_device_from_hal::<Vulkan>(open, &descriptor) }
        .map_err(|error| error.to_string())?;
    let caps = has_import.then_some(ImportCaps {
        alignment_bytes: host_properties.min_imported_host_pointer_alignment.max(1),
    });
    Ok(Opened {
        device,
        queue,
        caps,
        copying,
    })
}

/// Wraps host memory as a GPU buffer that can be copied to and bound to shaders. Errors are
/// sentences that say why not.
///
/// # Safety
/// `base..base + len` stays mapped and writable until the returned buffer is dropped and the device
/// has been polled.
pub(crate) unsafe fn import_host_memory(
    gpu: &Gpu,
    base: *mut u8,
    len: usize,
) -> Result<wgpu::Buffer, String> {
    let caps = gpu
        .import_caps()
        .ok_or("importing is switched off, or the driver lacks VK_EXT_external_memory_host")?;
    let len = len as u64;
    if !(base as u64).is_multiple_of(caps.alignment_bytes)
        || !len.is_multiple_of(caps.alignment_bytes)
        || len == 0
    {
        return Err(format!(
            "segment of {len} bytes at {base:p} is not aligned to the driver's {} bytes",
            caps.alignment_bytes
        ));
    }
    if len > gpu.max_buffer_bytes() {
        return Err(format!(
            "segment of {len} bytes exceeds the adapter's largest buffer of {} bytes",
            gpu.max_buffer_bytes()
        ));
    }
    // SAFETY: the hal device is only used for the calls below and lives as long as this guard.
    let device =
        unsafe { gpu.device().as_hal::<Vulkan>() }.ok_or("the device is not a Vulkan device")?;
    // SAFETY: the caller keeps the memory mapped; alignment and size were checked above.
    let hal_buffer = unsafe {
        create_imported_buffer(
            &device,
            gpu.copy_queue().map_or(&[], CopyQueue::families),
            base,
            len,
        )
    }
    .map_err(|error| format!("the driver refused: {error}"))?;
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
    // descriptor. The contents are whatever
    // the host wrote, so they count as initialised.
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
