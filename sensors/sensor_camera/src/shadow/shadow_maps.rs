//! The maps of both cascades: around the cameras, and further away.

use nalgebra::Vector3;
use sensor_core::Scene;
use sensor_gpu::{Gpu, Uploads};

use super::cascade::Cascade;
use super::cascade_maps::{CascadeMaps, Eye, MapLayout, ShadowLookup, ShadowPlan};
use crate::assets::{GpuAssets, Meshes};
use crate::quality::Quality;

/// Memory limit of all shadow maps: 32 near maps of 4096 × 4096 for computed views, and as many far
/// ones.
const MOST_SHADOW_BYTES: u64 = 3 << 30;

/// Shares of the near and the far cascade. A near map counts twice, because it exists without and
/// with moving casters.
const fn share(quality: Quality, most_bytes: u64) -> [u64; 2] {
    match quality {
        Quality::Low => [most_bytes, 0],
        Quality::High => [most_bytes / 3 * 2, most_bytes / 3],
    }
}

/// Shadow maps of both cascades.
#[derive(Debug)]
pub(crate) struct ShadowMaps {
    quality: Quality,
    near: CascadeMaps,
    /// High quality only.
    far: Option<CascadeMaps>,
}

/// What is to be drawn in shadow maps.
#[derive(Debug, Default)]
pub(crate) struct ShadowPlans {
    near: Option<ShadowPlan>,
    far: Option<ShadowPlan>,
}

/// Where one view looks up its shadows.
#[derive(Clone, Debug)]
pub(crate) struct Lit {
    pub near: ShadowLookup,
    pub far: ShadowLookup,
}

impl ShadowMaps {
    /// No maps yet; their textures get [`MOST_SHADOW_BYTES`] at most.
    pub fn new(gpu: &Gpu, quality: Quality, layout: MapLayout) -> Self {
        let [near_bytes, far_bytes] = share(quality, MOST_SHADOW_BYTES);
        let maps = |cascade, most_bytes| CascadeMaps::new(gpu, cascade, layout, most_bytes);
        ShadowMaps {
            quality,
            near: maps(Cascade::near(quality), near_bytes),
            far: (quality == Quality::High).then(|| maps(Cascade::far(), far_bytes)),
        }
    }

    fn cascades(&mut self) -> impl Iterator<Item = &mut CascadeMaps> {
        std::iter::once(&mut self.near).chain(&mut self.far)
    }

    /// Changes the memory limit of all textures, and drops them.
    pub fn limit(&mut self, most_bytes: u64) {
        let shares = share(self.quality, most_bytes);
        self.cascades()
            .zip(shares)
            .for_each(|(maps, bytes)| maps.limit(bytes));
    }

    /// Bytes of all textures.
    pub fn n_bytes(&self) -> u64 {
        self.near.n_bytes() + self.far.as_ref().map_or(0, CascadeMaps::n_bytes)
    }

    /// Forgets everything: another episode.
    pub fn clear(&mut self) {
        self.cascades().for_each(CascadeMaps::clear);
    }

    /// Marks the static maps as stale, because other objects are shown.
    pub fn redraw(&mut self) {
        self.cascades().for_each(CascadeMaps::redraw);
    }

    /// How many of these eyes, counted from the first, can have their maps at the same time.
    pub fn n_fitting(&self, eyes: &[Eye]) -> usize {
        let n_near = self.near.n_fitting(eyes);
        self.far
            .as_ref()
            .map_or(n_near, |far| n_near.min(far.n_fitting(eyes)))
    }

    /// Plans what to draw for these eyes, of which there are no more than [`ShadowMaps::n_fitting`]
    /// returns; nothing if there are none.
    pub fn plan(
        &mut self,
        assets: &Meshes,
        scene: &Scene,
        sun_towards: Vector3<f64>,
        eyes: &[Eye],
    ) -> ShadowPlans {
        let plan = |maps: &mut CascadeMaps| {
            (!eyes.is_empty()).then(|| maps.plan(assets, scene, sun_towards, eyes))
        };
        ShadowPlans {
            near: plan(&mut self.near),
            far: self.far.as_mut().and_then(plan),
        }
    }

    /// The same with the two cascades in parallel.
    pub fn plan_in_parallel(
        &mut self,
        assets: &Meshes,
        scene: &Scene,
        sun_towards: Vector3<f64>,
        eyes: &[Eye],
    ) -> ShadowPlans {
        let plan = |maps: &mut CascadeMaps| {
            (!eyes.is_empty()).then(|| maps.plan(assets, scene, sun_towards, eyes))
        };
        let (near, far) = (&mut self.near, &mut self.far);
        let (near, far) = rayon::join(|| plan(near), || far.as_mut().and_then(plan));
        ShadowPlans { near, far }
    }

    /// Draws what was planned. Returns one lookup for each of `eyes`, which are indices of eyes in
    /// the plans, or none.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        (uploads, encoder): (&mut Uploads, &mut wgpu::CommandEncoder),
        assets: &GpuAssets,
        plans: &ShadowPlans,
        eyes: impl Iterator<Item = Option<usize>>,
    ) -> Vec<Lit> {
        let mut cast = |maps: &mut CascadeMaps, plan: &Option<ShadowPlan>| {
            plan.as_ref().map_or(Vec::new(), |plan| {
                maps.record(gpu, (&mut *uploads, &mut *encoder), assets, plan)
            })
        };
        let near = cast(&mut self.near, &plans.near);
        let far = self
            .far
            .as_mut()
            .map_or(Vec::new(), |far| cast(far, &plans.far));
        gpu.mark(encoder, "shadows");
        let none = self.near.none();
        let lookup = |lookups: &[ShadowLookup], eye: Option<usize>| {
            eye.and_then(|eye| lookups.get(eye))
                .unwrap_or(&none)
                .clone()
        };
        eyes.map(|eye| Lit {
            near: lookup(&near, eye),
            far: lookup(&far, eye),
        })
        .collect()
    }

    /// Where compute shaders look up the maps that were last drawn, near and far.
    pub fn lookups(&self) -> [&wgpu::TextureView; 2] {
        let near = self.near.lookup();
        [near, self.far.as_ref().map_or(near, CascadeMaps::lookup)]
    }
}
