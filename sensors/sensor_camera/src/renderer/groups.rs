//! Views that are recorded together: all of a tick, unless their shadow maps do not fit into memory
//! at once.

use sensor_core::Scene;

use super::{Active, CameraRenderer, Quality, ShadowPlans};
use crate::lamps::LampLists;
use crate::shadow::{Eye, Shadows};
use crate::view::ViewJob;

/// Most memory of all shadow maps: 32 near ones of 4096 × 4096 for computed views, and as many of
/// what is further away.
pub(super) const MOST_SHADOW_BYTES: u64 = 3 << 30;

/// What each of both cascades has of it: a near map is two, without what moves and with it.
pub(super) const fn share(quality: Quality, most_bytes: u64) -> [u64; 2] {
    match quality {
        Quality::Low => [most_bytes, 0],
        Quality::High => [most_bytes / 3 * 2, most_bytes / 3],
    }
}

/// Those that look up shadow maps; numbers them in the views.
pub(super) fn eyes_of(active: &mut [Active], jobs: &[ViewJob<'_, '_>]) -> Vec<Eye> {
    let mut eyes = Vec::new();
    for active in active.iter_mut().filter(|active| active.set.is_lit()) {
        active.eye = Some(eyes.len());
        let focal_px = jobs[active.job_idx].view.spec.intrinsics.focal_px;
        eyes.push(Eye {
            world_from_camera: active.motion.world_from_camera,
            focal_px,
        });
    }
    eyes
}

impl CameraRenderer {
    /// Bounds the memory of shadow maps; 3 GiB unless it is called. Sunlit cameras that stand in so
    /// many places that their maps would need
    /// more are lit one group after the other, and maps are drawn anew in every tick: slower, and
    /// the same pictures. Each size of map keeps
    /// room for one, however little is given. While maps become more, those of before take memory
    /// until the tick is done.
    pub fn limit_shadow_bytes(&mut self, most_bytes: u64) {
        let [near, far] = share(self.quality, most_bytes);
        self.shadows.limit(near);
        self.far_shadows
            .iter_mut()
            .for_each(|shadows| shadows.limit(far));
    }

    /// Bytes of the textures that shadow maps lie in.
    pub fn shadow_bytes(&self) -> u64 {
        self.shadows.n_bytes() + self.far_shadows.as_ref().map_or(0, Shadows::n_bytes)
    }

    /// How many of these eyes, from the first one on, can have their maps at once.
    pub(super) fn n_fitting(&self, eyes: &[Eye]) -> usize {
        let n_near = self.shadows.n_fitting(eyes);
        self.far_shadows
            .as_ref()
            .map_or(n_near, |far| n_near.min(far.n_fitting(eyes)))
    }

    /// Records all views. Without plans for all of them it makes them group by group, and gives all
    /// groups but the last to the GPU: that is
    /// done with a group's maps before it draws those of the next.
    pub(super) fn record_groups(
        &mut self,
        scene: &Scene,
        mut active: &mut [Active],
        jobs: &[ViewJob<'_, '_>],
        (lamps, plans): (&LampLists, Option<ShadowPlans>),
        computes: bool,
    ) -> wgpu::CommandEncoder {
        let gpu = self.gpu.clone();
        let mut encoder = gpu.encoder("views");
        gpu.mark(&mut encoder, "begin");
        if let Some(plans) = plans {
            number_instances(active);
            self.record(scene, active, jobs, (lamps, &plans), computes, &mut encoder);
            return encoder;
        }
        loop {
            let n = self.n_of_group(active, jobs);
            let (group, rest) = std::mem::take(&mut active).split_at_mut(n);
            number_instances(group);
            let plans = self.plan_shadows(scene, group, jobs);
            self.record(scene, group, jobs, (lamps, &plans), computes, &mut encoder);
            if rest.is_empty() {
                return encoder;
            }
            let overwritten: Vec<_> = group
                .iter()
                .map(|active| active.targets.reads.clone())
                .collect();
            gpu.submit_overwriting(
                vec![std::mem::replace(&mut encoder, gpu.encoder("views")).finish()],
                &overwritten,
            );
            active = rest;
        }
    }

    /// How many of the views, from the first one on, can be lit at once; those that are not lit
    /// count, too.
    fn n_of_group(&self, active: &mut [Active], jobs: &[ViewJob<'_, '_>]) -> usize {
        let eyes = eyes_of(active, jobs);
        let n = self.n_fitting(&eyes);
        active
            .iter()
            .position(|active| active.eye == Some(n))
            .unwrap_or(active.len())
    }

    fn plan_shadows(
        &mut self,
        scene: &Scene,
        group: &mut [Active],
        jobs: &[ViewJob<'_, '_>],
    ) -> ShadowPlans {
        let eyes = eyes_of(group, jobs);
        let (Some(light), Some(assets)) = (&self.light, &self.assets) else {
            return ShadowPlans::default();
        };
        let plan = |shadows: &mut Shadows| {
            (!eyes.is_empty()).then(|| shadows.plan(assets, scene, light.sun_towards, &eyes))
        };
        ShadowPlans {
            near: plan(&mut self.shadows),
            far: self.far_shadows.as_mut().and_then(plan),
        }
    }
}

/// Where each view's instances begin in the list of all that are recorded together.
fn number_instances(active: &mut [Active]) {
    let mut first = 0;
    for active in active {
        active.drawn.first_instance = first;
        first += active.drawn.instances.len() as u32;
    }
}
