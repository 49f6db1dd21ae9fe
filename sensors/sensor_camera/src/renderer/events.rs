//! Event cameras beside the passes: which of them the GPU follows.

use schema_frames::Modality;
use sensor_core::Scene;

use super::{CameraRenderer, window_nanos};
use crate::dvs::gpu::{EventList, EventPass, GpuEventCamera};
use crate::targets::Targets;
use crate::view::{View, ViewJob};

impl CameraRenderer {
    /// Chooses whether event cameras work on the GPU, as they do by default where it is a real one,
    /// or on the processor; `false` if it cannot.
    pub fn set_events_on_gpu(&mut self, on: bool) -> bool {
        self.events_on_gpu = on && EventPass::is_supported(&self.gpu);
        self.events_on_gpu == on
    }

    /// Follows the events of a job on the GPU if somebody reads them and it can.
    pub(super) fn record_events(
        &mut self,
        job: &mut ViewJob<'_, '_>,
        images: (&Targets, u32),
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
            || !self.events_on_gpu
            || view.dvs.is_some()
            || !GpuEventCamera::takes(&view.spec.dvs, size_px)
        {
            return None;
        }
        let window_nanos = window_nanos(view, scene);
        let pass = self.events.get_or_insert_with(|| EventPass::new(&self.gpu));
        let new = || {
            GpuEventCamera::new(
                &self.gpu,
                &view.spec.dvs,
                size_px,
                view.spec.seed,
                view.spec.sensor_id as u64,
            )
        };
        let state = view.gpu_events.get_or_insert_with(new);
        pass.record(&self.gpu, encoder, state, images, window_nanos)
    }
}
