//! Memory on the device that other processes can import, by Vulkan calls that wgpu does not have.

use std::os::fd::{FromRawFd as _, OwnedFd};

use ash::vk;
use wgpu::hal::api::Vulkan;

use super::target::ShmTarget;
use crate::device::{FD, Gpu, exported_usage};
use crate::queue::CopyQueue;

/// Why memory cannot be exported.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ExportError {
    /// The driver has no such extension.
    #[error("the driver lacks VK_KHR_external_memory_fd")]
    Unsupported,
    /// Longer than a buffer can be.
    #[error("{n_bytes} bytes exceed the adapter's largest buffer of {max_bytes} bytes")]
    TooLong {
        /// What was asked for.
        n_bytes: u64,
        /// Limit of the adapter.
        max_bytes: u64,
    },
    /// The device has no memory for it.
    #[error("the GPU has no {mib} MiB of memory left for it", mib = n_bytes.div_ceil(1 << 20))]
    OutOfMemory {
        /// What was asked for.
        n_bytes: u64,
    },
    /// The driver returned an error.
    #[error("the driver refused: {0}")]
    Refused(vk::Result),
}

/// Memory on the device that other processes can import.
#[derive(Debug)]
pub struct ExportedMemory {
    /// As a target of copies and shaders.
    pub target: ShmTarget,
    /// What other processes import it by.
    pub descriptor: OwnedFd,
    /// Length that they must import it with, bytes; not less than what was asked for.
    pub memory_bytes: u64,
}

impl Gpu {
    /// Memory of the device that is free, bytes: as its driver says, or else all that it has.
    pub fn free_memory_bytes(&self) -> u64 {
        // SAFETY: the guard only lends the device for the calls below.
        let Some(hal) = (unsafe { self.device().as_hal::<Vulkan>() }) else {
            return 0;
        };
        let (instance, physical) = (
            hal.shared_instance().raw_instance(),
            hal.raw_physical_device(),
        );
        // SAFETY: instance and physical device belong together and live.
        let has_budget = unsafe { instance.enumerate_device_extension_properties(physical) }
            .unwrap_or_default()
            .iter()
            .any(|known| known.extension_name_as_c_str() == Ok(ash::ext::memory_budget::NAME));
        let mut budget = vk::PhysicalDeviceMemoryBudgetPropertiesEXT::default();
        let mut memory = vk::PhysicalDeviceMemoryProperties2::default();
        if has_budget {
            memory = memory.push_next(&mut budget);
        }
        // SAFETY: as above; the chained struct is only there if its extension is.
        unsafe { instance.get_physical_device_memory_properties2(physical, &mut memory) };
        let memory = memory.memory_properties;
        let heaps = memory.memory_heaps[..memory.memory_heap_count as usize].iter();
        let local = heaps
            .enumerate()
            .filter(|(_, heap)| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
        let free = local.map(|(i, heap)| match has_budget {
            true => budget.heap_budget[i].saturating_sub(budget.heap_usage[i]),
            false => heap.size,
        });
        free.max().unwrap_or(0)
    }
}

impl ShmTarget {
    /// Zeroed memory on the device that other processes can import. Nothing of this process reaches
    /// its bytes but copies and shaders.
    ///
    /// # Errors
    /// [`ExportError`].
    pub fn export(gpu: &Gpu, n_bytes: u64) -> Result<ExportedMemory, ExportError> {
        if !gpu.can_export() {
            return Err(ExportError::Unsupported);
        }
        let n_bytes = n_bytes.max(1).next_multiple_of(1 << 16);
        let max_bytes = gpu.max_buffer_bytes();
        if n_bytes > max_bytes {
            return Err(ExportError::TooLong { n_bytes, max_bytes });
        }
        // SAFETY: the guard only lends the device for the calls below.
        let device = unsafe { gpu.device().as_hal::<Vulkan>() }.ok_or(ExportError::Unsupported)?;
        let families = gpu.copy_queue().map_or(&[][..], CopyQueue::families);
        let made = create(&device, families, n_bytes).map_err(|error| match error {
            vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
                ExportError::OutOfMemory { n_bytes }
            }
            error => ExportError::Refused(error),
        })?;
        drop(device);
        let (hal_buffer, descriptor, memory_bytes) = made;
        let description = wgpu::BufferDescriptor {
            label: Some("exported memory"),
            size: n_bytes,
            usage: wgpu::BufferUsages::COPY_DST
                | wgpu::BufferUsages::COPY_SRC
                | wgpu::BufferUsages::STORAGE,
            mapped_at_creation: false,
        };
        // SAFETY: made from this device with this size; the Vulkan usage flags include those of the
        // descriptor. The contents are cleared below, before anybody is given the memory.
        let buffer = unsafe {
            gpu.device()
                .create_buffer_from_hal::<Vulkan>(hal_buffer, &description)
        };
        let mut encoder = gpu.encoder("clear exported memory");
        encoder.clear_buffer(&buffer, 0, None);
        let cleared = gpu.submit([encoder.finish()]);
        if gpu.wait_for(Some(&cleared)).is_err() {
            return Err(ExportError::Refused(vk::Result::ERROR_DEVICE_LOST));
        }
        Ok(ExportedMemory {
            target: ShmTarget::on_device(gpu, buffer, n_bytes as usize),
            descriptor,
            memory_bytes,
        })
    }
}

/// A buffer in memory of its own for queues of these families (none: the family that draws), the
/// memory's descriptor, and the memory's length.
fn create(
    device: &wgpu::hal::vulkan::Device,
    families: &[u32],
    n_bytes: u64,
) -> Result<(wgpu::hal::vulkan::Buffer, OwnedFd, u64), vk::Result> {
    let raw = device.raw_device();
    let instance = device.shared_instance().raw_instance();
    let sharing = if families.is_empty() {
        vk::SharingMode::EXCLUSIVE
    } else {
        vk::SharingMode::CONCURRENT
    };
    let mut external = vk::ExternalMemoryBufferCreateInfo::default().handle_types(FD);
    let info = vk::BufferCreateInfo::default()
        .size(n_bytes)
        .usage(exported_usage())
        .sharing_mode(sharing)
        .queue_family_indices(families)
        .push_next(&mut external);
    // SAFETY: a well-formed create info of an extension that is there (`can_export`), for families
    // of this device; destroyed below on failure, by wgpu-hal on success.
    let buffer = unsafe { raw.create_buffer(&info, None) }?;
    // SAFETY: the buffer was just made from this device.
    let needs = unsafe { raw.get_buffer_memory_requirements(buffer) };
    // SAFETY: instance and physical device belong together.
    let known =
        unsafe { instance.get_physical_device_memory_properties(device.raw_physical_device()) };
    let is_local = |i: &u32| {
        let flags = known.memory_types[*i as usize].property_flags;
        needs.memory_type_bits & (1 << i) != 0
            && flags.contains(vk::MemoryPropertyFlags::DEVICE_LOCAL)
    };
    let allocated = (0..known.memory_type_count)
        .find(is_local)
        .ok_or(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY)
        .and_then(|memory_type| {
            let mut dedicated = vk::MemoryDedicatedAllocateInfo::default().buffer(buffer);
            let mut exported = vk::ExportMemoryAllocateInfo::default().handle_types(FD);
            let info = vk::MemoryAllocateInfo::default()
                .allocation_size(needs.size)
                .memory_type_index(memory_type)
                .push_next(&mut exported)
                .push_next(&mut dedicated);
            // SAFETY: size and type are what the buffer asks for, and the memory is for it alone.
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
    let extension = ash::khr::external_memory_fd::Device::new(instance, raw);
    let wanted = vk::MemoryGetFdInfoKHR::default()
        .memory(memory)
        .handle_type(FD);
    // SAFETY: fresh buffer, fresh memory of the size it asks for, offset 0; the memory was made to
    // be exported as what is asked for.
    let exported = unsafe {
        raw.bind_buffer_memory(buffer, memory, 0)
            .and_then(|()| extension.get_memory_fd(&wanted))
    };
    match exported {
        Ok(descriptor) => {
            // SAFETY: the driver has just made it for this process, which owns it from now on.
            let descriptor = unsafe { OwnedFd::from_raw_fd(descriptor) };
            // SAFETY: buffer and memory were made from this device, belong to nobody else, and are
            // bound at 0.
            let managed =
                unsafe { wgpu::hal::vulkan::Buffer::from_raw_managed(buffer, memory, 0, n_bytes) };
            Ok((managed, descriptor, needs.size))
        }
        Err(error) => {
            // SAFETY: both are ours and were never used.
            unsafe {
                raw.destroy_buffer(buffer, None);
                raw.free_memory(memory, None);
            }
            Err(error)
        }
    }
}
