//! Another device of the same adapter, which imports memory by its descriptor as another process does.

#![expect(
    unsafe_code,
    reason = "memory of other processes is imported by raw Vulkan calls; each block carries its proof"
)]

use std::os::fd::{IntoRawFd as _, OwnedFd};

use ash::vk;
use sensor_gpu::{Gpu, GpuOptions};
use wgpu::hal::api::Vulkan;

const FD: vk::ExternalMemoryHandleTypeFlags = vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD;

/// The bytes of memory that another device exported, read by a device that knows its descriptor alone.
///
/// # Panics
/// If the driver refuses any of it.
pub fn bytes_by_descriptor(descriptor: OwnedFd, memory_bytes: u64, n_bytes: u64) -> Vec<u8> {
    let other = Gpu::open(&GpuOptions::default()).unwrap_or_else(|error| panic!("{error}"));
    // SAFETY: the guard only lends the device for the calls below.
    let device = unsafe { other.device().as_hal::<Vulkan>() }.expect("a Vulkan device");
    let raw = device.raw_device();
    let mut external = vk::ExternalMemoryBufferCreateInfo::default().handle_types(FD);
    let info = vk::BufferCreateInfo::default()
        .size(n_bytes)
        .usage(
            vk::BufferUsageFlags::TRANSFER_SRC
                | vk::BufferUsageFlags::TRANSFER_DST
                | vk::BufferUsageFlags::STORAGE_BUFFER,
        )
        .push_next(&mut external);
    // SAFETY: a well-formed create info of an extension that every `Gpu` that exports has.
    let buffer = unsafe { raw.create_buffer(&info, None) }.expect("a buffer");
    // SAFETY: the buffer was just made from this device.
    let needs = unsafe { raw.get_buffer_memory_requirements(buffer) };
    assert_eq!(needs.size, memory_bytes, "one driver, one buffer");
    let instance = device.shared_instance().raw_instance();
    // SAFETY: instance and physical device belong together.
    let known =
        unsafe { instance.get_physical_device_memory_properties(device.raw_physical_device()) };
    let memory_type = (0..known.memory_type_count)
        .find(|i| {
            let flags = known.memory_types[*i as usize].property_flags;
            needs.memory_type_bits & (1 << i) != 0
                && flags.contains(vk::MemoryPropertyFlags::DEVICE_LOCAL)
        })
        .expect("the type that it was exported from");
    let mut dedicated = vk::MemoryDedicatedAllocateInfo::default().buffer(buffer);
    // An import takes the descriptor over.
    let mut imported = vk::ImportMemoryFdInfoKHR::default()
        .handle_type(FD)
        .fd(descriptor.into_raw_fd());
    let info = vk::MemoryAllocateInfo::default()
        .allocation_size(memory_bytes)
        .memory_type_index(memory_type)
        .push_next(&mut imported)
        .push_next(&mut dedicated);
    // SAFETY: size and type are those that the memory was exported with; the buffer is of this device
    // and bound once; wgpu-hal owns both from the last line on.
    let managed = unsafe {
        let memory = raw.allocate_memory(&info, None).expect("the import");
        raw.bind_buffer_memory(buffer, memory, 0).expect("bound");
        wgpu::hal::vulkan::Buffer::from_raw_managed(buffer, memory, 0, n_bytes)
    };
    drop(device);
    let description = wgpu::BufferDescriptor {
        label: Some("imported memory"),
        size: n_bytes,
        usage: wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    };
    // SAFETY: made from this device with this size and usage; the memory was written by its exporter.
    let shown = unsafe {
        other
            .device()
            .create_buffer_from_hal::<Vulkan>(managed, &description)
    };
    let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
    let read = other.buffer_with("read", &vec![0xff_u8; n_bytes as usize], usage);
    let mut encoder = other.encoder("read imported memory");
    encoder.copy_buffer_to_buffer(&shown, 0, &read, 0, n_bytes);
    other.queue().submit([encoder.finish()]);
    read.map_async(wgpu::MapMode::Read, .., |outcome| {
        outcome.expect("it can be mapped");
    });
    other.wait_idle();
    read.get_mapped_range(..).expect("it is mapped").to_vec()
}
