//! Finding the adapter to open.

use crate::error::GpuError;

/// A GPU that could be opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterInfo {
    /// Name, e.g. `llvmpipe (LLVM 15.0.6, 256 bits)`.
    pub name: String,
    /// Driver and its version.
    pub driver: String,
    /// Whether the CPU does the work.
    pub is_software: bool,
    /// Whether the driver has the import extension, without which every frame costs a CPU copy.
    pub can_import: bool,
}

pub fn enumerate() -> Vec<wgpu::Adapter> {
    let descriptor = wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        // Validating indirect draw calls costs a pass on the GPU, and only trusted code writes
        // them.
        flags: wgpu::InstanceFlags::default() - wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    };
    pollster::block_on(wgpu::Instance::new(descriptor).enumerate_adapters(wgpu::Backends::VULKAN))
}

pub fn choose(
    adapters: Vec<wgpu::Adapter>,
    asked: Option<&str>,
) -> Result<wgpu::Adapter, GpuError> {
    let found: Vec<String> = adapters
        .iter()
        .map(|adapter| adapter.get_info().name)
        .collect();
    if adapters.is_empty() {
        return Err(GpuError::NoAdapter);
    }
    let named = |adapter: &wgpu::Adapter| {
        asked.is_none_or(|part| {
            adapter
                .get_info()
                .name
                .to_lowercase()
                .contains(&part.to_lowercase())
        })
    };
    adapters
        .into_iter()
        .filter(named)
        .min_by_key(|adapter| match adapter.get_info().device_type {
            wgpu::DeviceType::DiscreteGpu => 0,
            wgpu::DeviceType::IntegratedGpu => 1,
            wgpu::DeviceType::VirtualGpu => 2,
            wgpu::DeviceType::Other => 3,
            wgpu::DeviceType::Cpu => 4,
        })
        .ok_or_else(|| GpuError::UnknownAdapter {
            asked: asked.unwrap_or_default().to_owned(),
            found,
        })
}
