//! What the drawing of all views of a tick needs.

use sensor_core::Scene;
use sensor_gpu::Gpu;

use crate::assets::GpuAssets;
use crate::lamps::LampLists;
use crate::light::Light;
use crate::quality::Quality;

/// What all views of a tick share.
#[derive(Clone, Copy)]
pub(super) struct TickScene<'t> {
    pub gpu: &'t Gpu,
    pub quality: Quality,
    pub scene: &'t Scene,
    pub assets: &'t GpuAssets,
    pub light: &'t Light,
    pub sky: &'t wgpu::TextureView,
}

/// How the views of a tick become pixels.
#[derive(Clone, Copy)]
pub(super) struct TickDrawing<'t> {
    pub tick: TickScene<'t>,
    pub lamps: &'t LampLists,
    /// Whether compute shaders rasterise.
    pub computes: bool,
}
