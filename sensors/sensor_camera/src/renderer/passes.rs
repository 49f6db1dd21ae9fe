//! Records the passes of all views: shadows first, then each step for all views in one compute
//! pass, so that a GPU works on them in parallel.

use sensor_gpu::{Gpu, Uploads};

use super::active::Active;
use super::tick::{TickDrawing, TickScene};
use crate::assets::GpuAssets;
use crate::bindings::{Bindings, Together};
use crate::debug::{DebugPass, DebugView, is_drawn};
use crate::geometry::{GeometryPass, SceneryLamps, ViewPass};
use crate::post::{PostJob, PostPass};
use crate::quality::Quality;
use crate::raster::{RasterJob, RasterPass, RasterPlan, Rasteriser, can_compute};
use crate::shade::{ShadeKey, ShadePass, Shading};
use crate::shadow::{Lit, ShadowLookup, ShadowMaps, ShadowPlans};
use crate::target::{Target, TargetLayer, TargetSet, Targets};
use crate::uniform::{MAX_TOGETHER, MapPlace, ViewData};
use crate::view::{View, ViewJob};
use crate::visible::{Drawn, StillAs};

/// The work of one view in the passes.
struct Work<'w> {
    view: ViewPass<'w>,
    /// Present if it is lit.
    shade: Option<ShadeKey>,
    /// Present if its colour is developed.
    post: Option<PostJob<'w>>,
}

/// Bind groups of the scene and of computed views.
struct Bound {
    scene: wgpu::BindGroup,
    views: wgpu::BindGroup,
}

/// Views that share every dispatch.
struct Run<'w> {
    works: &'w [Work<'w>],
    views: Together<'w>,
}

impl<'w> Run<'w> {
    /// Splits the views, in their order, into runs of at most [`MAX_TOGETHER`].
    fn all_of(
        works: &'w [Work<'w>],
        active: &'w [Active],
        jobs: &'w [ViewJob<'_, '_>],
    ) -> Vec<Run<'w>> {
        let is_alike = |a: &Work<'_>, b: &Work<'_>| {
            let is_plain = |work: &Work<'_>| work.post.as_ref().map(PostJob::is_plain);
            std::ptr::eq(a.view.targets, b.view.targets)
                && a.shade == b.shade
                && is_plain(a) == is_plain(b)
        };
        let run = |works: &'w [Work<'w>]| {
            let (first, targets) = (works[0].view.view_idx, works[0].view.targets);
            let kept = jobs[active[first].job_idx].view.kept;
            Run {
                works,
                views: Together {
                    targets,
                    kept,
                    first,
                    n: works.len(),
                },
            }
        };
        works
            .chunk_by(is_alike)
            .flat_map(|alike| alike.chunks(MAX_TOGETHER))
            .map(run)
            .collect()
    }
}

/// The passes that views go through.
#[derive(Debug)]
pub(super) struct Passes {
    bindings: Bindings,
    geometry: GeometryPass,
    /// Present if compute shaders rasterise.
    raster: Option<RasterPass>,
    shade: ShadePass,
    post: PostPass,
    debug: DebugPass,
}

impl Passes {
    pub fn new(gpu: &Gpu, quality: Quality, rasteriser: Rasteriser) -> Self {
        let computes = rasteriser == Rasteriser::Computed && can_compute(gpu);
        let shading = if quality == Quality::Low && !computes {
            Shading::Drawn
        } else {
            Shading::Computed
        };
        let bindings = Bindings::new(gpu);
        Passes {
            geometry: GeometryPass::new(gpu, &bindings, shading.surfaces()),
            shade: ShadePass::new(gpu, &bindings, quality, shading),
            post: PostPass::new(gpu, false),
            raster: computes.then(|| RasterPass::new(gpu, &bindings)),
            debug: DebugPass::new(gpu),
            bindings,
        }
    }

    /// Whether compute shaders rasterise these meshes.
    pub fn computes(&self, gpu: &Gpu, assets: &GpuAssets) -> bool {
        self.raster.is_some() && RasterPass::takes(gpu, assets)
    }

    /// How static instances of these meshes are wanted.
    pub fn still_as(&self, gpu: &Gpu, assets: &GpuAssets) -> StillAs {
        let raster = self.raster.as_ref().filter(|_| self.computes(gpu, assets));
        raster.map_or(StillAs::Instances, |raster| raster.still_as(assets))
    }

    /// Forgets what bind groups hold, so that meshes and shadow maps can go.
    pub fn forget(&self) {
        self.bindings.forget();
        self.raster.iter().for_each(RasterPass::forget);
    }

    pub fn shading(&self) -> Shading {
        self.shade.shading()
    }

    /// What shading reads of a view.
    pub fn shading_reads(&self, lamps: SceneryLamps) -> TargetSet {
        self.shade.reads(lamps)
    }

    /// Makes the pipelines that draw a set of targets, once.
    pub fn prepare_drawing(&mut self, gpu: &Gpu, set: TargetSet, lamps: SceneryLamps) {
        self.geometry.prepare(gpu, set, lamps);
    }

    /// Records all passes of views whose shadows are planned.
    pub fn record(
        &mut self,
        drawing: &TickDrawing<'_>,
        active: &[Active],
        jobs: &[ViewJob<'_, '_>],
        (maps, plans): (&mut ShadowMaps, &ShadowPlans),
        uploads: &mut Uploads,
        encoder: &mut wgpu::CommandEncoder,
    ) {
        let tick = &drawing.tick;
        let TickScene {
            gpu, scene, assets, ..
        } = *tick;
        let lit = gpu.time("record: light", || {
            let eyes = active.iter().map(|active| active.eye);
            maps.record(gpu, (&mut *uploads, &mut *encoder), assets, plans, eyes)
        });
        let mut views: Vec<ViewData> = active
            .iter()
            .zip(&lit)
            .map(|(active, lit)| view_data(jobs[active.job_idx].view, active, lit))
            .collect();
        let plan = gpu.time("record: upload", || {
            self.upload(drawing, active, &mut views, (&mut *uploads, &mut *encoder))
        });
        let works = gpu.time("record: works", || {
            self.works(tick, active, jobs, (&mut *uploads, &mut *encoder))
        });
        let bound = Bound {
            scene: self.bindings.bind_scene(gpu, tick.sky, &assets.switched),
            views: self.bindings.bind_views(gpu, maps.lookups()),
        };
        gpu.time("record: passes", || match &plan {
            Some(plan) => {
                let batches: Vec<&[Work<'_>]> = works
                    .chunk_by(|a, b| {
                        plan.batch_of(a.view.view_idx) == plan.batch_of(b.view.view_idx)
                    })
                    .collect();
                for (batch, works) in batches.into_iter().enumerate() {
                    let runs = Run::all_of(works, active, jobs);
                    self.rasterise(tick, &runs, plan, batch, &bound, encoder);
                    self.record_light(gpu, &runs, &lit, &bound, encoder);
                }
            }
            // TickDrawing goes view by view, so that each stays in the CPU's caches.
            None => {
                for work in works.chunks(1) {
                    let runs = Run::all_of(work, active, jobs);
                    self.draw_geometry(tick, &work[0], &lit, &bound, encoder);
                    self.record_light(gpu, &runs, &lit, &bound, encoder);
                }
            }
        });
        for active in active {
            let View { spec, is_face, .. } = &*jobs[active.job_idx].view;
            if active.set.contains(Target::Color) && !is_face && is_drawn(scene, spec) {
                let view = DebugView {
                    overlay: spec.shows_overlay.then_some(&scene.overlay),
                    lens: &jobs[active.job_idx].view.drawn,
                    world_from_camera: &active.motion.world_from_camera,
                    images: TargetLayer {
                        targets: &active.targets,
                        layer: active.layer,
                    },
                };
                self.debug.record(gpu, encoder, &scene.debug, &view);
            }
        }
    }

    /// Uploads what changes from tick to tick.
    fn upload(
        &mut self,
        drawing: &TickDrawing<'_>,
        active: &[Active],
        views: &mut [ViewData],
        (uploads, encoder): (&mut Uploads, &mut wgpu::CommandEncoder),
    ) -> Option<RasterPlan> {
        let TickScene {
            gpu,
            scene,
            assets,
            light,
            ..
        } = drawing.tick;
        let drawn: Vec<&Drawn> = active.iter().map(|active| &active.drawn).collect();
        let rasters = self.raster.as_mut().filter(|_| drawing.computes);
        let plan = rasters.map(|raster| {
            let jobs: Vec<RasterJob<'_>> = views
                .iter()
                .zip(active)
                .map(|(view, active)| RasterJob::new(view, &active.drawn, &active.motion))
                .collect();
            let n_of = |drawn: &&Drawn| drawn.instances.len() + drawn.still.len();
            let n_instances = drawn.iter().map(n_of).sum();
            let instances = self.bindings.room_for_instances(gpu, n_instances);
            let plan = raster.upload(gpu, uploads, encoder, assets, &jobs, instances);
            views
                .iter_mut()
                .zip(&plan.views)
                .for_each(|(view, lists)| lists.tell(view));
            plan
        });
        let light = light.data_at(scene.sim_time.as_secs());
        let to = (&mut *uploads, &mut *encoder);
        self.bindings.upload(gpu, to, &light, views, drawing.lamps);
        if !drawing.computes {
            let to = (uploads, encoder);
            self.geometry
                .upload(gpu, to, &mut self.bindings, views, &drawn);
        }
        plan
    }

    /// Finds the work of each view, and makes the pipelines for it.
    fn works<'w>(
        &mut self,
        tick: &TickScene<'_>,
        active: &'w [Active],
        jobs: &'w [ViewJob<'_, '_>],
        to: (&mut Uploads, &mut wgpu::CommandEncoder),
    ) -> Vec<Work<'w>> {
        let TickScene {
            gpu,
            quality,
            scene,
            assets,
            light,
            ..
        } = *tick;
        let (mut works, mut first_call) = (Vec::with_capacity(active.len()), 0);
        for (view_idx, active) in active.iter().enumerate() {
            let view = &*jobs[active.job_idx].view;
            let targets: &Targets = &active.targets;
            let developed = active.set.contains(Target::Radiance);
            let shade = active.set.is_lit().then(|| ShadeKey {
                color: active.set.contains(Target::Color) && !developed,
                radiance: developed,
                luminance: active.set.contains(Target::Luminance),
                lamps: active.lamps.n > 0 || light.dark_ratio > 0.0 || assets.meshes.is_switched(),
                fog: light.has_fog,
                wet: light.is_wet,
                switched: assets.meshes.is_switched(),
            });
            let previous = view
                .previous
                .as_ref()
                .map_or(scene.sim_time.0, |firing| firing.sim_time.0);
            // A picture is developed as one once its faces are together.
            let post = (active.set.is_lit() && developed && !view.is_face).then(|| PostJob {
                view_idx,
                optics: &view.spec.optics,
                lens: view.spec.intrinsics,
                targets,
                layer: active.layer,
                meter: view.meter.as_ref(),
                exposure: light.exposure,
                since_secs: scene.sim_time.0.saturating_sub(previous) as f32 * 1e-9,
                smooth_edges: quality == Quality::High,
                has_field: false,
            });
            if let Some(key) = shade {
                self.shade.prepare(gpu, key);
            }
            let pass = ViewPass {
                targets,
                set: active.set,
                drawn: &active.drawn,
                first_call,
                view_idx,
            };
            first_call += active.drawn.calls.len();
            works.push(Work {
                view: pass,
                shade,
                post,
            });
        }
        let developed: Vec<&PostJob<'_>> =
            works.iter().filter_map(|work| work.post.as_ref()).collect();
        self.post.upload(gpu, to, &developed, works.len());
        works
    }

    /// Bind group of a drawn view.
    fn bind_view(&self, gpu: &Gpu, lit: &Lit) -> wgpu::BindGroup {
        self.bindings
            .bind_view(gpu, [&lit.near.view, &lit.far.view])
    }

    fn draw_geometry(
        &self,
        tick: &TickScene<'_>,
        work: &Work<'_>,
        lit: &[Lit],
        bound: &Bound,
        encoder: &mut wgpu::CommandEncoder,
    ) {
        let view = self.bind_view(tick.gpu, &lit[work.view.view_idx]);
        self.geometry.record(
            tick.gpu,
            encoder,
            &self.bindings,
            tick.assets,
            [&bound.scene, &view],
            &work.view,
        );
        tick.gpu.mark(encoder, "geometry");
    }

    fn rasterise(
        &self,
        tick: &TickScene<'_>,
        runs: &[Run<'_>],
        plan: &RasterPlan,
        batch: usize,
        bound: &Bound,
        encoder: &mut wgpu::CommandEncoder,
    ) {
        let TickScene { gpu, assets, .. } = *tick;
        let raster = self.raster.as_ref().expect("only it makes plans");
        let instances = &self.bindings.instances;
        raster.record(gpu, encoder, assets, instances, plan, batch);
        gpu.mark(encoder, "raster");
        let lists = raster.bind_lists(gpu, assets);
        let mut pass = begin_computing(gpu, encoder, "resolve");
        for run in runs {
            raster.resolve(
                gpu,
                &mut pass,
                [&bound.scene, &bound.views, &lists],
                &run.views,
            );
        }
        drop(pass);
        gpu.mark(encoder, "resolve");
    }

    fn record_light(
        &self,
        gpu: &Gpu,
        runs: &[Run<'_>],
        lit: &[Lit],
        bound: &Bound,
        encoder: &mut wgpu::CommandEncoder,
    ) {
        let shaded = || {
            runs.iter()
                .filter_map(|run| Some((run, run.works[0].shade?)))
        };
        if shaded().next().is_none() {
            return;
        }
        if self.shade.is_drawn() {
            for (work, key) in
                shaded().flat_map(|(run, key)| run.works.iter().map(move |work| (work, key)))
            {
                let view = self.bind_view(gpu, &lit[work.view.view_idx]);
                self.shade
                    .draw(gpu, encoder, [&bound.scene, &view], &work.view, key);
            }
        } else {
            let mut pass = begin_computing(gpu, encoder, "shade");
            for (run, key) in shaded() {
                self.shade.compute(
                    gpu,
                    &mut pass,
                    [&bound.scene, &bound.views],
                    &run.views,
                    key,
                );
            }
        }
        gpu.mark(encoder, "shade");
        if runs
            .iter()
            .flat_map(|run| run.works)
            .all(|work| work.post.is_none())
        {
            return;
        }
        let mut pass = begin_computing(gpu, encoder, "post");
        for run in runs {
            match run.works[0].post.as_ref().map(PostJob::is_plain) {
                Some(true) => self.post.develop_plain(gpu, &mut pass, &run.views),
                _ => run
                    .works
                    .iter()
                    .filter_map(|work| work.post.as_ref())
                    .for_each(|job| self.post.develop(gpu, &mut pass, job)),
            }
        }
        drop(pass);
        gpu.mark(encoder, "post");
    }
}

fn begin_computing<'e>(
    gpu: &Gpu,
    encoder: &'e mut wgpu::CommandEncoder,
    label: &'static str,
) -> wgpu::ComputePass<'e> {
    gpu.counters().add_pass();
    encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
        label: Some(label),
        timestamp_writes: None,
    })
}

fn view_data(view: &View, active: &Active, lit: &Lit) -> ViewData {
    let place = |lookup: &ShadowLookup| MapPlace {
        tile: [lookup.tile[0], lookup.tile[1]],
        side: lookup.tile[2],
        layer: lookup.layer,
    };
    ViewData {
        shadow_from_camera: lit.near.shadow_from_camera,
        far_shadow_from_camera: lit.far.shadow_from_camera,
        has_shadows: lit.near.on as u32 as f32,
        shadow_texel_depth: lit.near.texel_depth,
        far_shadow_texel_depth: lit.far.texel_depth,
        first_lamp: active.lamps.first_lamp,
        first_lamp_tile: active.lamps.first_tile,
        layer: active.layer,
        wanted: active.set.0 as u32,
        near_map: place(&lit.near),
        far_map: place(&lit.far),
        n_blockers: active.drawn.blockers.n,
        blockers: active.drawn.blockers.boxes,
        ..active.motion.view_data(&view.drawn)
    }
}
