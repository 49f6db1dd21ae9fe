//! Opening a device with `VK_EXT_external_memory_host`, which wgpu does not ask for, and with a
//! queue that copies.

use ash::vk;
use wgpu::hal::api::Vulkan;

use crate::error::GpuError;
use crate::queue::{CopyPath, Family, MAX_QUEUES, family_for};

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

/// All queues have the same priority.
static PRIORITIES: [f32; MAX_QUEUES] = [1.0; MAX_QUEUES];

/// An open device.
pub(crate) struct Opened {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub caps: Option<ImportCaps>,
    /// Family of the second queue, if there is one.
    pub copying: Option<Family>,
    /// Whether memory of the device can be exported.
    pub can_export: bool,
}

/// Opens `adapter` with the import extension and a queue for copies, if it has them.
///
/// Errors are [`GpuError::Open`] with the driver's message.
pub(crate) fn open_device(adapter: &wgpu::Adapter, copies: CopyPath) -> Result<Opened, GpuError> {
    let refused = |reason: &dyn std::fmt::Display| GpuError::Open {
        name: adapter.get_info().name,
        reason: reason.to_string(),
    };
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
    let hal_adapter = unsafe { adapter.as_hal::<Vulkan>() }
        .ok_or_else(|| refused(&"the adapter is not a Vulkan adapter"))?;
    let has_import = hal_adapter
        .physical_device_capabilities()
        .supports_extension(ash::ext::external_memory_host::NAME);
    let mut host_properties = vk::PhysicalDeviceExternalMemoryHostPropertiesEXT::default();
    let mut properties = vk::PhysicalDeviceProperties2::default();
    if has_import {
        properties = properties.push_next(&mut host_properties);
    }
    // SAFETY: instance and physical device belong together and live; wgpu requires Vulkan 1.1 where
    // this call is core, and the chained struct is only there if its extension is.
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
    .map_err(|error| refused(&error))?;
    let can_export = can_export(&hal_adapter);
    drop(hal_adapter);
    // SAFETY: `open` was made from this adapter with the same features and limits as in
    // `descriptor`.
    let (device, queue) = unsafe { adapter.create_device_from_hal::<Vulkan>(open, &descriptor) }
        .map_err(|error| refused(&error))?;
    let caps = has_import.then_some(ImportCaps {
        alignment_bytes: host_properties.min_imported_host_pointer_alignment.max(1),
    });
    Ok(Opened {
        device,
        queue,
        caps,
        copying,
        can_export,
    })
}

/// How memory of the device is exported.
pub(crate) const FD: vk::ExternalMemoryHandleTypeFlags =
    vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD;

/// What exported buffers are used for.
pub(crate) fn exported_usage() -> vk::BufferUsageFlags {
    vk::BufferUsageFlags::TRANSFER_DST
        | vk::BufferUsageFlags::TRANSFER_SRC
        | vk::BufferUsageFlags::STORAGE_BUFFER
}

/// Whether a driver can export buffers of the device's own memory.
fn can_export(hal: &wgpu::hal::vulkan::Adapter) -> bool {
    let has_extension = hal
        .physical_device_capabilities()
        .supports_extension(ash::khr::external_memory_fd::NAME);
    if !has_extension {
        return false;
    }
    let info = vk::PhysicalDeviceExternalBufferInfo::default()
        .usage(exported_usage())
        .handle_type(FD);
    let mut properties = vk::ExternalBufferProperties::default();
    // SAFETY: instance and physical device belong together and live; wgpu requires Vulkan 1.1 where
    // this call is core.
    unsafe {
        hal.shared_instance()
            .raw_instance()
            .get_physical_device_external_buffer_properties(
                hal.raw_physical_device(),
                &info,
                &mut properties,
            );
    }
    let features = properties
        .external_memory_properties
        .external_memory_features;
    features.contains(vk::ExternalMemoryFeatureFlags::EXPORTABLE)
}
