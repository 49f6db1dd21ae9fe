//! Recording the passes of all views: shadows, then the same step of all views in one compute pass, so that a GPU works on them side by side.

use nalgebra::Isometry3;
use sensor_core::Scene;

use super::{Active, CameraRenderer, Quality};
use crate::draw::{self, Drawn, NEAR_M};
use crate::lamps::{LampLists, LampRange};
use crate::light::Light;
use crate::pass::ViewPass;
use crate::post::PostJob;
use crate::raster::{RasterJob, RasterPlan};
use crate::shade::ShadeKey;
use crate::shadow::{Eye, ShadowLookup, Shadows};
use crate::targets::{Target, Targets};
use crate::uniform::ViewData;
use crate::view::{View, ViewJob};

/// Light of one view.
struct Lit {
    near: ShadowLookup,
    far: ShadowLookup,
    lamps: LampRange,
}

/// A view on its way through the passes.
struct Work<'w> {
    view: ViewPass<'w>,
    bound: wgpu::BindGroup,
    /// If it is lit.
    shade: Option<ShadeKey>,
    /// If its picture is developed.
    post: Option<PostJob<'w>>,
}

impl CameraRenderer {
    pub(super) fn record(
        &mut self,
        scene: &Scene,
        active: &[Active],
        jobs: &[ViewJob<'_, '_>],
        computes: bool,
        encoder: &mut wgpu::CommandEncoder,
    ) {
        if self.light.as_ref().is_none_or(|light| !light.is_of(&scene.weather)) {
            self.light = Some(Light::new(&self.gpu, self.quality, &scene.weather));
        }
        let gpu = self.gpu.clone();
        let mut lamps = LampLists::new(self.quality);
        let lit = gpu.time("record: light", || self.light_up(scene, active, jobs, &mut lamps, encoder));
        let mut views: Vec<ViewData> =
            active.iter().zip(&lit).map(|(active, lit)| view_data(jobs[active.job_idx].view, active, lit)).collect();
        let plan = gpu.time("record: upload", || self.upload(scene, active, &mut views, &lamps, computes));
        let works = gpu.time("record: works", || self.works(scene, active, jobs, &lit));
        let scene_group = self.bind_scene();
        // Views of one batch go through each step together; what is drawn goes view by view and stays in the processor's caches.
        let batch_of = |i: usize| plan.as_ref().map_or(i, |plan| plan.places[i].batch);
        let mut begin = 0;
        while begin < works.len() {
            let end = (begin..works.len()).find(|i| batch_of(*i) != batch_of(begin)).unwrap_or(works.len());
            self.record_geometry(&works[begin..end], plan.as_ref().map(|plan| (plan, batch_of(begin))), &scene_group, encoder);
            self.record_light(&works[begin..end], &scene_group, encoder);
            begin = end;
        }
        for (work, active) in works.iter().zip(active) {
            if active.set.contains(Target::Color) && !scene.debug.is_empty() {
                let lens = jobs[active.job_idx].view.spec.intrinsics;
                self.debug.record(&self.gpu, encoder, &scene.debug, &lens, &active.motion.world_from_camera, work.view.targets);
            }
        }
    }

    /// Draws shadow maps and gathers lamps.
    fn light_up(
        &mut self,
        scene: &Scene,
        active: &[Active],
        jobs: &[ViewJob<'_, '_>],
        lamps: &mut LampLists,
        encoder: &mut wgpu::CommandEncoder,
    ) -> Vec<Lit> {
        let assets = self.assets.as_ref().expect("render() loaded the assets");
        let light = self.light.as_ref().expect("record() made the light");
        let eye = |active: &Active| Eye {
            world_from_camera: active.motion.world_from_camera,
            focal_px: jobs[active.job_idx].view.spec.intrinsics.focal_px,
        };
        let eyes: Vec<Eye> = active.iter().filter(|active| active.set.is_lit() && light.has_shadows).map(eye).collect();
        let cast = |shadows: &mut Shadows, encoder: &mut wgpu::CommandEncoder| {
            if eyes.is_empty() { Vec::new() } else { shadows.record(&self.gpu, encoder, assets, scene, light.sun_towards, &eyes) }
        };
        let near = cast(&mut self.shadows, encoder);
        let far = self.far_shadows.as_mut().map_or(Vec::new(), |far| cast(far, encoder));
        self.gpu.mark(encoder, "shadows");
        let (mut near, mut far) = (near.into_iter(), far.into_iter());
        let none = self.shadows.none();
        let lit = |active: &Active| {
            let has_shadows = active.set.is_lit() && light.has_shadows;
            let next = |lookups: &mut std::vec::IntoIter<ShadowLookup>| {
                Some(()).filter(|_| has_shadows).and_then(|_| lookups.next()).unwrap_or_else(|| none.clone())
            };
            let range = if active.set.is_lit() {
                let lens = jobs[active.job_idx].view.spec.intrinsics;
                lamps.add_view(scene, assets, &lens, &active.motion, light.exposure, light.dark_ratio)
            } else {
                LampRange::default()
            };
            Lit { near: next(&mut near), far: next(&mut far), lamps: range }
        };
        active.iter().map(lit).collect()
    }

    /// Uploads what changes from tick to tick.
    fn upload(
        &mut self,
        scene: &Scene,
        active: &[Active],
        views: &mut [ViewData],
        lamps: &LampLists,
        computes: bool,
    ) -> Option<RasterPlan> {
        let light = self.light.as_ref().expect("record() made the light");
        let drawn: Vec<&Drawn> = active.iter().map(|active| &active.drawn).collect();
        let plan = self.raster.as_mut().filter(|_| computes).map(|raster| {
            let jobs: Vec<RasterJob<'_>> = views.iter().zip(&drawn).map(|(view, drawn)| RasterJob::new(view, drawn)).collect();
            let plan = raster.upload(&self.gpu, &jobs);
            views.iter_mut().zip(&plan.places).for_each(|(view, place)| view.raster[..3].copy_from_slice(&place.words()));
            plan
        });
        self.pass.upload(&self.gpu, &light.data_at(scene.sim_time.as_secs()), views, &drawn, lamps, computes);
        plan
    }

    fn bind_scene(&self) -> wgpu::BindGroup {
        let assets = self.assets.as_ref().expect("render() loaded the assets");
        let light = self.light.as_ref().expect("record() made the light");
        self.pass.bind_scene(&self.gpu, &light.sky, &assets.switched)
    }

    /// Says what each view goes through, and makes the pipelines for it.
    fn works<'w>(&mut self, scene: &Scene, active: &'w [Active], jobs: &'w [ViewJob<'_, '_>], lit: &'w [Lit]) -> Vec<Work<'w>> {
        let assets = self.assets.as_ref().expect("render() loaded the assets");
        let light = self.light.as_ref().expect("record() made the light");
        let (mut works, mut first_call) = (Vec::with_capacity(active.len()), 0);
        for (view_idx, (active, lit)) in active.iter().zip(lit).enumerate() {
            let view = &*jobs[active.job_idx].view;
            let targets: &Targets = &view.targets;
            let developed = active.set.contains(Target::Radiance);
            let shade = active.set.is_lit().then(|| ShadeKey {
                color: active.set.contains(Target::Color) && !developed,
                radiance: developed,
                luminance: active.set.contains(Target::Luminance),
                lamps: lit.lamps.n > 0 || light.dark_ratio > 0.0 || assets.is_switched(),
                fog: light.has_fog,
                wet: light.is_wet,
                switched: assets.is_switched(),
            });
            let previous = view.previous.as_ref().map_or(scene.sim_time.0, |firing| firing.sim_time.0);
            let post = (active.set.is_lit() && developed).then(|| PostJob {
                view_idx,
                optics: &view.spec.optics,
                targets,
                meter: view.meter.as_ref(),
                exposure: light.exposure,
                since_secs: scene.sim_time.0.saturating_sub(previous) as f32 * 1e-9,
                smooth_edges: self.quality == Quality::High,
            });
            if let Some(key) = shade {
                self.shade.prepare(&self.gpu, key);
            }
            let shadows = [&lit.near.view, &lit.far.view];
            let bound = self.pass.bind_view(&self.gpu, shadows);
            let pass = ViewPass { targets, set: active.set, drawn: &active.drawn, first_call, view_idx };
            first_call += active.drawn.calls.len();
            works.push(Work { view: pass, bound, shade, post });
        }
        let developed: Vec<&PostJob<'_>> = works.iter().filter_map(|work| work.post.as_ref()).collect();
        self.post.upload(&self.gpu, &developed, works.len());
        works
    }

    fn record_geometry(
        &self,
        works: &[Work<'_>],
        computed: Option<(&RasterPlan, usize)>,
        scene_group: &wgpu::BindGroup,
        encoder: &mut wgpu::CommandEncoder,
    ) {
        let assets = self.assets.as_ref().expect("render() loaded the assets");
        let Some((raster, (plan, batch))) = self.raster.as_ref().zip(computed) else {
            for work in works {
                self.pass.record(&self.gpu, encoder, assets, [scene_group, &work.bound], &work.view);
                self.gpu.mark(encoder, "geometry");
            }
            return;
        };
        raster.record(&self.gpu, encoder, assets, &self.pass.instances, plan, batch);
        self.gpu.mark(encoder, "raster");
        let lists = raster.bind_lists(&self.gpu, assets);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("resolve"), timestamp_writes: None });
        for work in works {
            raster.resolve(&self.gpu, &mut pass, [scene_group, &work.bound, &lists], &work.view);
        }
        drop(pass);
        self.gpu.mark(encoder, "resolve");
    }

    fn record_light(&self, works: &[Work<'_>], scene_group: &wgpu::BindGroup, encoder: &mut wgpu::CommandEncoder) {
        let lit: Vec<(&Work<'_>, ShadeKey)> = works.iter().filter_map(|work| work.shade.map(|key| (work, key))).collect();
        if lit.is_empty() {
            return;
        }
        if self.shade.is_drawn() {
            for (work, key) in &lit {
                self.shade.draw(&self.gpu, encoder, [scene_group, &work.bound], &work.view, *key);
            }
        } else {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("shade"), timestamp_writes: None });
            for (work, key) in &lit {
                self.shade.compute(&self.gpu, &mut pass, [scene_group, &work.bound], &work.view, *key);
            }
        }
        self.gpu.mark(encoder, "shade");
        let developed: Vec<&PostJob<'_>> = works.iter().filter_map(|work| work.post.as_ref()).collect();
        if !developed.is_empty() {
            self.post.record(&self.gpu, encoder, &developed);
            self.gpu.mark(encoder, "post");
        }
    }
}

fn view_data(view: &View, active: &Active, lit: &Lit) -> ViewData {
    let motion = &active.motion;
    let lens = view.spec.intrinsics;
    let mut world_from_camera = draw::rows(&motion.world_from_camera);
    let eye = motion.world_from_camera.translation.vector;
    // Patterns repeat every 1024 m, so that they stay sharp far from the origin.
    world_from_camera[0][3] = eye.x.rem_euclid(1024.0) as f32;
    world_from_camera[1][3] = eye.y.rem_euclid(1024.0) as f32;
    let turn = motion.previous_camera_from_world.rotation * motion.world_from_camera.rotation;
    ViewData {
        lens_px: lens.as_array().map(|x| x as f32),
        frame: [lens.width_px as f32, lens.height_px as f32, NEAR_M as f32, f32::INFINITY],
        world_from_camera,
        previous_from_camera: draw::rows(&Isometry3::from_parts(Default::default(), turn)),
        shadow_from_camera: lit.near.shadow_from_camera,
        far_shadow_from_camera: lit.far.shadow_from_camera,
        options: [motion.moved() as u32 as f32, lit.near.on as u32 as f32, 0.0, lit.near.texel_depth],
        lamps: [lit.lamps.first_lamp, lit.lamps.first_tile, lit.far.texel_depth.to_bits(), 0],
        raster: [0, 0, 0, active.set.0 as u32],
    }
}
