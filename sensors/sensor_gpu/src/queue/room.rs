//! The limit on textures with dedicated memory.

use std::sync::atomic::AtomicU32;

/// How many textures may have dedicated memory, and how many have.
#[derive(Debug)]
pub(crate) struct Room {
    pub adapter: wgpu::Adapter,
    pub most: u32,
    pub n: AtomicU32,
}

impl Room {
    /// A quarter of what the driver allows: wgpu, imports and the driver's other users need some
    /// too.
    pub fn of(hal: &wgpu::hal::vulkan::Device, adapter: &wgpu::Adapter) -> Room {
        let instance = hal.shared_instance().raw_instance();
        // SAFETY: instance and physical device belong together and live.
        let limits =
            unsafe { instance.get_physical_device_properties(hal.raw_physical_device()) }.limits;
        Room {
            adapter: adapter.clone(),
            most: limits.max_memory_allocation_count / 4,
            n: AtomicU32::new(0),
        }
    }
}
