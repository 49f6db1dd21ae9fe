//! Groups of views that are recorded together: all views of a tick, unless their shadow maps exceed
//! their memory limit.

use sensor_gpu::Uploads;

use super::active::{Active, eyes_of, number_instances};
use super::passes::Passes;
use super::tick::TickDrawing;
use crate::shadow::{ShadowMaps, ShadowPlans};
use crate::view::ViewJob;

/// What views are recorded with.
pub(super) struct Recorder<'r> {
    pub passes: &'r mut Passes,
    pub maps: &'r mut ShadowMaps,
    pub uploads: &'r mut Uploads,
}

impl Recorder<'_> {
    /// Records all views. Without plans for all of them it plans group by group and submits every
    /// group but the last, so that the GPU is done with a group's maps before it draws the next ones.
    /// Uploads of the encoder that is returned are not closed.
    pub fn record(
        self,
        plans: Option<ShadowPlans>,
        drawing: &TickDrawing<'_>,
        mut active: &mut [Active],
        jobs: &[ViewJob<'_, '_>],
    ) -> wgpu::CommandEncoder {
        let Recorder {
            passes,
            maps,
            uploads,
        } = self;
        let tick = &drawing.tick;
        let gpu = tick.gpu;
        let mut encoder = gpu.encoder("views");
        gpu.mark(&mut encoder, "begin");
        if let Some(plans) = plans {
            number_instances(active);
            passes.record(drawing, active, jobs, (maps, &plans), uploads, &mut encoder);
            return encoder;
        }
        loop {
            let n = n_of_group(maps, active, jobs);
            let (group, rest) = std::mem::take(&mut active).split_at_mut(n);
            number_instances(group);
            let eyes = eyes_of(group, jobs);
            let plans = maps.plan(
                &tick.assets.meshes,
                tick.scene,
                tick.light.sun_towards,
                &eyes,
            );
            passes.record(drawing, group, jobs, (maps, &plans), uploads, &mut encoder);
            if rest.is_empty() {
                return encoder;
            }
            let overwritten: Vec<_> = group
                .iter()
                .map(|active| active.targets.reads.clone())
                .collect();
            uploads.close(&encoder);
            gpu.submit_overwriting(
                vec![std::mem::replace(&mut encoder, gpu.encoder("views")).finish()],
                &overwritten,
            );
            active = rest;
        }
    }
}

/// How many of the views, counted from the first, can be lit together; unlit views count too.
fn n_of_group(maps: &ShadowMaps, active: &mut [Active], jobs: &[ViewJob<'_, '_>]) -> usize {
    let eyes = eyes_of(active, jobs);
    let n = maps.n_fitting(&eyes);
    active
        .iter()
        .position(|active| active.eye == Some(n))
        .unwrap_or(active.len())
}
