//! Recording the passes of all views: shadows, then the same step of all views in one compute pass,
//! so that a GPU works on them side by side.

use nalgebra::Isometry3;
use sensor_core::Scene;

use super::{Active, CameraRenderer, Quality, ShadowPlans};
use crate::draw::{self, Drawn, NEAR_M};
use crate::lamps::LampLists;
use crate::pass::{Together, ViewPass};
use crate::post::PostJob;
use crate::raster::{RasterJob, RasterPlan};
use crate::shade::ShadeKey;
use crate::shadow::{ShadowLookup, ShadowPlan, Shadows};
use crate::targets::{Target, Targets};
use crate::uniform::{MAX_TOGETHER, ViewData};
use crate::view::{View, ViewJob};

/// Light of one view.
struct Lit {
    near: ShadowLookup,
    far: ShadowLookup,
}

/// A view on its way through the passes.
struct Work<'w> {
    view: ViewPass<'w>,
    /// If it is lit.
    shade: Option<ShadeKey>,
    /// If its picture is developed.
    post: Option<PostJob<'w>>,
}

/// What views are bound to on their way: the scene, and the views that are computed.
struct Bound {
    scene: wgpu::BindGroup,
    views: wgpu::BindGroup,
}

/// Views that go through every step together.
struct Run<'w> {
    works: &'w [Work<'w>],
    views: Together<'w>,
}

impl<'w> Run<'w> {
    /// Runs of views in their order, of at most [`MAX_TOGETHER`].
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

impl CameraRenderer {
    pub(super) fn record(
        &mut self,
        scene: &Scene,
        active: &[Active],
        jobs: &[ViewJob<'_, '_>],
        (lamps, shadows): (&LampLists, &ShadowPlans),
        computes: bool,
        encoder: &mut wgpu::CommandEncoder,
    ) {
        let gpu = self.gpu.clone();
        let lit = gpu.time("record: light", || self.light_up(active, shadows, encoder));
        let mut views: Vec<ViewData> = active
            .iter()
            .zip(&lit)
            .map(|(active, lit)| view_data(jobs[active.job_idx].view, active, lit))
            .collect();
        let plan = gpu.time("record: upload", || {
            self.upload(scene, active, &mut views, lamps, computes)
        });
        let works = gpu.time("record: works", || self.works(scene, active, jobs));
        let bound = Bound {
            scene: self.bind_scene(),
            views: self.bind_views(),
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
                    self.rasterise(&runs, (plan, batch), &bound, encoder);
                    self.record_light(&runs, &lit, &bound, encoder);
                }
            }
            // What is drawn goes view by view and stays in the processor's caches.
            None => {
                for work in works.chunks(1) {
                    let runs = Run::all_of(work, active, jobs);
                    self.draw_geometry(&work[0], &lit, &bound, encoder);
                    self.record_light(&runs, &lit, &bound, encoder);
                }
            }
        });
        for active in active {
            if active.set.contains(Target::Color) && !scene.debug.is_empty() {
                let lens = jobs[active.job_idx].view.spec.intrinsics;
                let targets = (&*active.targets, active.layer);
                self.debug.record(
                    &self.gpu,
                    encoder,
                    &scene.debug,
                    &lens,
                    &active.motion.world_from_camera,
                    targets,
                );
            }
        }
    }

    /// Draws shadow maps.
    fn light_up(
        &mut self,
        active: &[Active],
        plans: &ShadowPlans,
        encoder: &mut wgpu::CommandEncoder,
    ) -> Vec<Lit> {
        let assets = self.assets.as_ref().expect("render() loaded the assets");
        let cast = |shadows: &mut Shadows,
                    plan: &Option<ShadowPlan>,
                    encoder: &mut wgpu::CommandEncoder| {
            plan.as_ref().map_or(Vec::new(), |plan| {
                shadows.record(&self.gpu, encoder, assets, plan)
            })
        };
        let near = cast(&mut self.shadows, &plans.near, encoder);
        let far = self
            .far_shadows
            .as_mut()
            .map_or(Vec::new(), |far| cast(far, &plans.far, encoder));
        self.gpu.mark(encoder, "shadows");
        let none = self.shadows.none();
        let lookup = |lookups: &[ShadowLookup], active: &Active| {
            active
                .eye
                .and_then(|eye| lookups.get(eye))
                .unwrap_or(&none)
                .clone()
        };
        active
            .iter()
            .map(|active| Lit {
                near: lookup(&near, active),
                far: lookup(&far, active),
            })
            .collect()
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
        let light = self.light.as_ref().expect("draw() made the light");
        let drawn: Vec<&Drawn> = active.iter().map(|active| &active.drawn).collect();
        let plan = self.raster.as_mut().filter(|_| computes).map(|raster| {
            let jobs: Vec<RasterJob<'_>> = views
                .iter()
                .zip(&drawn)
                .map(|(view, drawn)| RasterJob::new(view, drawn))
                .collect();
            let n_instances = drawn.iter().map(|drawn| drawn.instances.len()).sum();
            let plan = raster.upload(
                &self.gpu,
                &jobs,
                self.pass.room_for_instances(&self.gpu, n_instances),
            );
            views
                .iter_mut()
                .zip(&plan.places)
                .for_each(|(view, place)| view.raster[..3].copy_from_slice(&place.words()));
            plan
        });
        self.pass.upload(
            &self.gpu,
            &light.data_at(scene.sim_time.as_secs()),
            views,
            &drawn,
            lamps,
            computes,
        );
        plan
    }

    fn bind_scene(&self) -> wgpu::BindGroup {
        let assets = self.assets.as_ref().expect("render() loaded the assets");
        let light = self.light.as_ref().expect("draw() made the light");
        self.pass
            .bind_scene(&self.gpu, &light.sky, &assets.switched)
    }

    /// What computed views look up.
    fn bind_views(&self) -> wgpu::BindGroup {
        let near = self.shadows.lookup();
        self.pass.bind_views(
            &self.gpu,
            [
                near,
                self.far_shadows.as_ref().map_or(near, Shadows::lookup),
            ],
        )
    }

    /// Says what each view goes through, and makes the pipelines for it.
    fn works<'w>(
        &mut self,
        scene: &Scene,
        active: &'w [Active],
        jobs: &'w [ViewJob<'_, '_>],
    ) -> Vec<Work<'w>> {
        let assets = self.assets.as_ref().expect("render() loaded the assets");
        let light = self.light.as_ref().expect("draw() made the light");
        let (mut works, mut first_call) = (Vec::with_capacity(active.len()), 0);
        for (view_idx, active) in active.iter().enumerate() {
            let view = &*jobs[active.job_idx].view;
            let targets: &Targets = &active.targets;
            let developed = active.set.contains(Target::Radiance);
            let shade = active.set.is_lit().then(|| ShadeKey {
                color: active.set.contains(Target::Color) && !developed,
                radiance: developed,
                luminance: active.set.contains(Target::Luminance),
                lamps: active.lamps.n > 0 || light.dark_ratio > 0.0 || assets.is_switched(),
                fog: light.has_fog,
                wet: light.is_wet,
                switched: assets.is_switched(),
            });
            let previous = view
                .previous
                .as_ref()
                .map_or(scene.sim_time.0, |firing| firing.sim_time.0);
            let post = (active.set.is_lit() && developed).then(|| PostJob {
                view_idx,
                optics: &view.spec.optics,
                targets,
                layer: active.layer,
                meter: view.meter.as_ref(),
                exposure: light.exposure,
                since_secs: scene.sim_time.0.saturating_sub(previous) as f32 * 1e-9,
                smooth_edges: self.quality == Quality::High,
            });
            if let Some(key) = shade {
                self.shade.prepare(&self.gpu, key);
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
        self.post.upload(&self.gpu, &developed, works.len());
        works
    }

    /// What a drawn view looks up.
    fn bind_view(&self, lit: &Lit) -> wgpu::BindGroup {
        self.pass
            .bind_view(&self.gpu, [&lit.near.view, &lit.far.view])
    }

    fn draw_geometry(
        &self,
        work: &Work<'_>,
        lit: &[Lit],
        bound: &Bound,
        encoder: &mut wgpu::CommandEncoder,
    ) {
        let assets = self.assets.as_ref().expect("render() loaded the assets");
        let view = self.bind_view(&lit[work.view.view_idx]);
        self.pass.record(
            &self.gpu,
            encoder,
            assets,
            [&bound.scene, &view],
            &work.view,
        );
        self.gpu.mark(encoder, "geometry");
    }

    fn rasterise(
        &self,
        runs: &[Run<'_>],
        (plan, batch): (&RasterPlan, usize),
        bound: &Bound,
        encoder: &mut wgpu::CommandEncoder,
    ) {
        let assets = self.assets.as_ref().expect("render() loaded the assets");
        let raster = self.raster.as_ref().expect("only it makes plans");
        raster.record(
            &self.gpu,
            encoder,
            assets,
            &self.pass.instances,
            plan,
            batch,
        );
        self.gpu.mark(encoder, "raster");
        let lists = raster.bind_lists(&self.gpu, assets);
        let mut pass = self.begin_computing(encoder, "resolve");
        for run in runs {
            raster.resolve(
                &self.gpu,
                &mut pass,
                [&bound.scene, &bound.views, &lists],
                &run.views,
            );
        }
        drop(pass);
        self.gpu.mark(encoder, "resolve");
    }

    fn record_light(
        &self,
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
                let view = self.bind_view(&lit[work.view.view_idx]);
                self.shade
                    .draw(&self.gpu, encoder, [&bound.scene, &view], &work.view, key);
            }
        } else {
            let mut pass = self.begin_computing(encoder, "shade");
            for (run, key) in shaded() {
                self.shade.compute(
                    &self.gpu,
                    &mut pass,
                    [&bound.scene, &bound.views],
                    &run.views,
                    key,
                );
            }
        }
        self.gpu.mark(encoder, "shade");
        if runs
            .iter()
            .flat_map(|run| run.works)
            .all(|work| work.post.is_none())
        {
            return;
        }
        let mut pass = self.begin_computing(encoder, "post");
        for run in runs {
            match run.works[0].post.as_ref().map(PostJob::is_plain) {
                Some(true) => self.post.develop_plain(&self.gpu, &mut pass, &run.views),
                _ => run
                    .works
                    .iter()
                    .filter_map(|work| work.post.as_ref())
                    .for_each(|job| self.post.develop(&self.gpu, &mut pass, job)),
            }
        }
        drop(pass);
        self.gpu.mark(encoder, "post");
    }
}

impl CameraRenderer {
    fn begin_computing<'e>(
        &self,
        encoder: &'e mut wgpu::CommandEncoder,
        label: &'static str,
    ) -> wgpu::ComputePass<'e> {
        self.gpu.counters().add_pass();
        encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(label),
            timestamp_writes: None,
        })
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
        frame: [
            lens.width_px as f32,
            lens.height_px as f32,
            NEAR_M as f32,
            f32::INFINITY,
        ],
        world_from_camera,
        previous_from_camera: draw::rows(&Isometry3::from_parts(Default::default(), turn)),
        shadow_from_camera: lit.near.shadow_from_camera,
        far_shadow_from_camera: lit.far.shadow_from_camera,
        options: [
            motion.moved() as u32 as f32,
            lit.near.on as u32 as f32,
            0.0,
            lit.near.texel_depth,
        ],
        lamps: [
            active.lamps.first_lamp,
            active.lamps.first_tile,
            lit.far.texel_depth.to_bits(),
            0,
        ],
        raster: [0, 0, 0, active.set.0 as u32],
        layers: [active.layer, lit.near.layer, lit.far.layer, 0],
        tile: [lit.near.tile[0], lit.near.tile[1], lit.near.tile[2], 0.0],
        far_tile: [lit.far.tile[0], lit.far.tile[1], lit.far.tile[2], 0.0],
        rest: [[0; 4]; 12],
    }
}
