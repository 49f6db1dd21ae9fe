//! Event cameras on the GPU: which of them it follows.

use schema_frames::Modality;
use sensor_core::Scene;
use sensor_gpu::Gpu;

use super::outputs::window_nanos;
use crate::dvs::{EventList, EventPass, GpuEventCamera};
use crate::target::TargetLayer;
use crate::view::{View, ViewJob};

/// The event cameras that the GPU follows.
#[derive(Debug)]
pub(super) struct GpuEvents {
    /// Whether the GPU follows events of cameras that it supports.
    on_gpu: bool,
    /// Made when `dvs` is first read.
    pass: Option<EventPass>,
}

impl GpuEvents {
    /// On the GPU by default, unless the adapter is software or lacks the features.
    pub fn new(gpu: &Gpu) -> Self {
        GpuEvents {
            on_gpu: !gpu.is_software() && EventPass::is_supported(gpu),
            pass: None,
        }
    }

    /// Chooses where event cameras work; `false` if the GPU lacks the features.
    pub fn set_on_gpu(&mut self, gpu: &Gpu, on: bool) -> bool {
        self.on_gpu = on && EventPass::is_supported(gpu);
        self.on_gpu == on
    }

    /// Follows the events of a job on the GPU, if they are read and the GPU supports the camera.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        job: &mut ViewJob<'_, '_>,
        images: TargetLayer<'_>,
        scene: &Scene,
        encoder: &mut wgpu::CommandEncoder,
    ) -> Option<EventList> {
        let view: &mut View = job.view;
        let lens = view.spec.intrinsics;
        let size_px = [lens.width_px, lens.height_px];
        let is_read = job
            .outputs
            .iter()
            .any(|output| output.modality == Modality::Dvs);
        if !is_read
            || !self.on_gpu
            || view.dvs.is_some()
            || !GpuEventCamera::takes(&view.spec.dvs, size_px)
        {
            return None;
        }
        let window_nanos = window_nanos(view, scene);
        let pass = self.pass.get_or_insert_with(|| EventPass::new(gpu));
        let new = || {
            GpuEventCamera::new(
                gpu,
                &view.spec.dvs,
                size_px,
                view.spec.seed,
                view.spec.sensor_id as u64,
            )
        };
        let state = view.gpu_events.get_or_insert_with(new);
        pass.record(gpu, encoder, state, images, window_nanos)
    }
}
