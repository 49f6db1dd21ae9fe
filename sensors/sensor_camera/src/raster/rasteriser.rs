//! Which way triangles become pixels.

use sensor_gpu::Gpu;

/// How triangles become pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rasteriser {
    /// As the adapter draws them.
    Drawn,
    /// In compute shaders.
    Computed,
}

impl Rasteriser {
    /// Computed on GPUs with the needed features, drawn on software adapters and other GPUs.
    pub fn default_for(gpu: &Gpu) -> Self {
        if !gpu.is_software() && can_compute(gpu) {
            Rasteriser::Computed
        } else {
            Rasteriser::Drawn
        }
    }
}

/// Whether the adapter has what the compute shaders need.
pub(crate) fn can_compute(gpu: &Gpu) -> bool {
    let wanted = wgpu::Features::SHADER_INT64
        | wgpu::Features::SHADER_INT64_ATOMIC_MIN_MAX
        | wgpu::Features::TEXTURE_ADAPTER_SPECIFIC_FORMAT_FEATURES;
    gpu.device().features().contains(wanted)
}
