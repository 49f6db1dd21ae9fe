//! Draws every view of a tick in one submission.

use std::sync::{Arc, Mutex};

use nalgebra::Isometry3;
use rayon::prelude::*;
use schema_frames::Modality;
use schema_types::space::sensor_from_camera;
use sensor_core::{Scene, SceneAssets};
use sensor_gpu::{CopyBatch, Gpu};
use sensor_spec::{ExposureMode, Intrinsics};

use crate::assets::GpuAssets;
use crate::debug::DebugPass;
use crate::draw::{self, CameraMotion, Drawn, NEAR_M};
use crate::dvs::EventCamera;
use crate::lamps::{LampLists, LampRange};
use crate::light::Light;
use crate::merge;
use crate::pass::{GeometryPass, ViewPass};
use crate::post::{self, PostJob, PostPass};
use crate::raster::{RasterJob, RasterPass, Rasteriser, can_compute};
use crate::shade::{ShadeKey, ShadePass};
use crate::shadow::{Cascade, ShadowLookup, Shadows};
use crate::submission::{DvsMaps, Plan, Submission};
use crate::targets::{Target, TargetSet, Targets};
use crate::uniform::ViewData;
use crate::view::{Firing, InstancePoses, Output, View, ViewJob, ViewSpec};

/// How much work colour gets. Everything else is the same in both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// For software adapters.
    Low,
    /// For GPUs.
    High,
}

impl Quality {
    /// `Low` on software adapters, else `High`.
    pub fn default_for(gpu: &Gpu) -> Self {
        if gpu.is_software() { Quality::Low } else { Quality::High }
    }
}

/// Why nothing was drawn.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RenderError {
    /// Not made by a camera.
    #[error("a camera was asked for {:?}, which another kind of sensor makes", modality.name())]
    NotACamera {
        /// What was asked for.
        modality: Modality,
    },
    /// Asked twice.
    #[error("{:?} was asked twice of one view in one tick", modality.name())]
    Twice {
        /// What was asked for.
        modality: Modality,
    },
    /// No room.
    #[error("{:?} needs {needed} bytes, but its place has {room}", modality.name())]
    TooSmall {
        /// What was asked for.
        modality: Modality,
        /// Bytes of a frame.
        needed: usize,
        /// Bytes there.
        room: usize,
    },
}

/// Renders views. One per daemon.
#[derive(Debug)]
pub struct CameraRenderer {
    gpu: Gpu,
    quality: Quality,
    assets: Option<GpuAssets>,
    light: Option<Light>,
    pass: GeometryPass,
    /// Instead of drawing.
    raster: Option<RasterPass>,
    shade: ShadePass,
    post: PostPass,
    shadows: Shadows,
    /// High quality only.
    far_shadows: Option<Shadows>,
    debug: DebugPass,
}

/// A job with something to draw.
struct Active {
    job_idx: usize,
    set: TargetSet,
    motion: CameraMotion,
    drawn: Drawn,
}

impl CameraRenderer {
    /// A renderer without a scene.
    pub fn new(gpu: &Gpu, quality: Quality) -> Self {
        Self::with_rasteriser(gpu, quality, Rasteriser::default_for(gpu))
    }

    /// The same, with a rasteriser of one's choice; an adapter that cannot compute draws all the same.
    pub fn with_rasteriser(gpu: &Gpu, quality: Quality, rasteriser: Rasteriser) -> Self {
        let pass = GeometryPass::new(gpu);
        let computes = rasteriser == Rasteriser::Computed && can_compute(gpu);
        CameraRenderer {
            gpu: gpu.clone(),
            quality,
            assets: None,
            light: None,
            shade: ShadePass::new(gpu, &pass, quality, quality == Quality::Low && !computes),
            post: PostPass::new(gpu),
            raster: computes.then(|| RasterPass::new(gpu, &pass)),
            pass,
            shadows: Shadows::new(gpu, Cascade::near(quality)),
            far_shadows: (quality == Quality::High).then(|| Shadows::new(gpu, Cascade::far())),
            debug: DebugPass::new(gpu),
        }
    }

    /// Uploads an episode's meshes; [`CameraRenderer::render`] does it by itself when the scene's assets are others than before.
    pub fn load(&mut self, assets: &Arc<SceneAssets>) {
        // The old meshes first: two towns need not fit beside each other.
        self.assets = None;
        self.assets = Some(GpuAssets::upload(&self.gpu, assets));
        // An upload waits for the next submission, and what was dropped for the one after; a world that nobody looks at has none.
        self.gpu.queue().submit([]);
        self.gpu.wait_idle();
        self.shadows.clear();
        if let Some(far) = &mut self.far_shadows {
            far.clear();
        }
    }

    /// Draws what is read of all `jobs` and remembers every job's firing. One submission; none at all if nobody reads.
    ///
    /// # Errors
    /// A job asks for what a camera does not make, asks twice, or its place is too small; nothing was drawn or remembered then.
    pub fn render<'a>(&mut self, scene: &Scene, mut jobs: Vec<ViewJob<'_, 'a>>) -> Result<Submission<'a>, RenderError> {
        for job in &jobs {
            check(job)?;
        }
        match &mut self.assets {
            Some(loaded) if Arc::ptr_eq(&loaded.scene_assets, &scene.assets) => {}
            Some(loaded) if loaded.shows_the_same(&scene.assets) => loaded.switch_lamps(&self.gpu, &scene.assets),
            _ => self.load(&scene.assets),
        }
        for job in &mut jobs {
            begin_firing(&self.gpu, job, scene);
        }
        let submission = self.draw(scene, &mut jobs);
        let poses = Arc::new(InstancePoses::of(scene));
        for job in jobs {
            let world_from_camera = world_from_camera(&job.world_from_sensor);
            job.view.previous =
                Some(Firing { world_from_camera, sim_time: scene.sim_time, episode: scene.assets.episode, poses: poses.clone() });
        }
        Ok(submission)
    }

    fn draw<'a>(&mut self, scene: &Scene, jobs: &mut [ViewJob<'_, 'a>]) -> Submission<'a> {
        let assets = self.assets.as_ref().expect("render() loaded the assets");
        let computes = self.raster.is_some() && RasterPass::takes(&self.gpu, assets);
        let mut active = Vec::new();
        let leaders = merge::leaders(jobs);
        for job_idx in (0..jobs.len()).filter(|idx| leaders[*idx] == *idx) {
            let members = jobs.iter().zip(&leaders).filter(|(_, leader)| **leader == job_idx);
            let asked =
                members.flat_map(|(job, _)| &job.outputs).fold(TargetSet::default(), |set, output| set.union(targets_of(output.modality)));
            let job = &mut jobs[job_idx];
            let mut set = asked;
            if set.contains(Target::Color) && (self.quality == Quality::High || !job.view.spec.optics.is_neutral()) {
                set = set.union(Target::Radiance.bit());
            }
            if set.is_lit() {
                set = SHADED.into_iter().fold(set, |set, target| set.union(target.bit()));
            }
            if set == TargetSet::default() {
                continue;
            }
            let lens = job.view.spec.intrinsics;
            job.view.targets.ensure(&self.gpu, [lens.width_px, lens.height_px], set, self.raster.is_some());
            if !computes {
                self.pass.prepare(&self.gpu, set);
            }
            let motion = CameraMotion::new(world_from_camera(&job.world_from_sensor), job.view.previous.as_ref());
            active.push(Active { job_idx, set, motion, drawn: Drawn::default() });
        }
        if active.is_empty() {
            return Submission { in_flight: None, plans: jobs.iter().map(|_| Vec::new()).collect() };
        }
        self.gpu.time("visible", || find_visible(scene, assets, jobs, &mut active));
        let mut encoder = self.gpu.encoder("views");
        self.gpu.mark(&mut encoder, "begin");
        let gpu = self.gpu.clone();
        gpu.time("record", || self.record(scene, &active, jobs, computes, &mut encoder));
        let mut batch = CopyBatch::new();
        let plans = (0..jobs.len())
            .map(|idx| {
                let targets = jobs[leaders[idx]].view.targets.clone();
                plan_outputs(&mut jobs[idx], &targets, scene, &mut batch)
            })
            .collect();
        Submission { in_flight: Some(batch.submit(&self.gpu, encoder)), plans }
    }

    fn record(&mut self, scene: &Scene, active: &[Active], jobs: &[ViewJob<'_, '_>], computes: bool, encoder: &mut wgpu::CommandEncoder) {
        let assets = self.assets.as_ref().expect("render() loaded the assets");
        if self.light.as_ref().is_none_or(|light| !light.is_of(&scene.weather)) {
            self.light = Some(Light::new(&self.gpu, self.quality, &scene.weather));
        }
        let light = self.light.as_ref().expect("just made");
        let eyes: Vec<Isometry3<f64>> =
            active.iter().filter(|active| active.set.is_lit() && light.has_shadows).map(|active| active.motion.world_from_camera).collect();
        let cast = |shadows: &mut Shadows, encoder: &mut wgpu::CommandEncoder| {
            if eyes.is_empty() { Vec::new() } else { shadows.record(&self.gpu, encoder, assets, scene, light.sun_towards, &eyes) }
        };
        let near = self.gpu.time("record: shadows", || cast(&mut self.shadows, encoder));
        let far = self.far_shadows.as_mut().map_or(Vec::new(), |far| cast(far, encoder));
        self.gpu.mark(encoder, "shadows");
        let (mut near, mut far) = (near.into_iter(), far.into_iter());
        let none = self.shadows.none();
        let mut lamps = LampLists::new(self.quality);
        let lit: Vec<Lit> = active
            .iter()
            .map(|active| {
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
            })
            .collect();
        let mut views: Vec<ViewData> =
            active.iter().zip(&lit).map(|(active, lit)| view_data(jobs[active.job_idx].view, active, lit)).collect();
        let raster = self.raster.as_mut().filter(|_| computes);
        let drawn: Vec<&Drawn> = active.iter().map(|active| &active.drawn).collect();
        let plan = self.gpu.time("record: upload", || {
            let plan = raster.map(|raster| {
                let jobs: Vec<RasterJob<'_>> = views.iter().zip(&drawn).map(|(view, drawn)| RasterJob::new(view, drawn)).collect();
                let plan = raster.upload(&self.gpu, &jobs);
                views.iter_mut().zip(&plan.places).for_each(|(view, place)| view.raster[..3].copy_from_slice(&place.words()));
                plan
            });
            self.pass.upload(&self.gpu, &light.data_at(scene.sim_time.as_secs()), &views, &drawn, &lamps, computes);
            plan
        });
        let raster = self.raster.as_ref().zip(plan.as_ref());
        let scene_group = self.pass.bind_scene(&self.gpu, &light.sky, &assets.switched);
        let (mut first_call, mut batch) = (0, None);
        for (view_idx, (active, lit)) in active.iter().zip(&lit).enumerate() {
            let targets = &jobs[active.job_idx].view.targets;
            let view =
                ViewPass { targets, set: active.set, drawn: &active.drawn, first_call, view_idx, shadows: [&lit.near.view, &lit.far.view] };
            let bound = self.pass.bind_view(&self.gpu, view.shadows);
            match raster {
                Some((raster, plan)) => {
                    let own = plan.places[view_idx].batch;
                    if batch != Some(own) {
                        raster.record(&self.gpu, encoder, assets, &self.pass.instances, plan, own);
                        self.gpu.mark(encoder, "raster");
                        batch = Some(own);
                    }
                    raster.resolve(&self.gpu, encoder, assets, [&scene_group, &bound], &view);
                    self.gpu.mark(encoder, "resolve");
                }
                None => {
                    self.pass.record(&self.gpu, encoder, assets, [&scene_group, &bound], &view);
                    self.gpu.mark(encoder, "geometry");
                }
            }
            first_call += active.drawn.calls.len();
            if active.set.is_lit() {
                let developed = active.set.contains(Target::Radiance);
                let key = ShadeKey {
                    color: active.set.contains(Target::Color) && !developed,
                    radiance: developed,
                    luminance: active.set.contains(Target::Luminance),
                    lamps: lit.lamps.n > 0 || light.dark_ratio > 0.0 || assets.is_switched(),
                    fog: light.has_fog,
                    wet: light.is_wet,
                    switched: assets.is_switched(),
                };
                self.shade.prepare(&self.gpu, key);
                self.shade.record(&self.gpu, encoder, &scene_group, &bound, &view, key);
                self.gpu.mark(encoder, "shade");
                if developed {
                    let view = &*jobs[active.job_idx].view;
                    let previous = view.previous.as_ref().map_or(scene.sim_time.0, |firing| firing.sim_time.0);
                    let job = PostJob {
                        optics: &view.spec.optics,
                        targets,
                        meter: view.meter.as_ref(),
                        exposure: light.exposure,
                        since_secs: scene.sim_time.0.saturating_sub(previous) as f32 * 1e-9,
                        smooth_edges: self.quality == Quality::High,
                    };
                    self.post.record(&self.gpu, encoder, &job);
                    self.gpu.mark(encoder, "post");
                }
            }
            if active.set.contains(Target::Color) && !scene.debug.is_empty() {
                let lens = jobs[active.job_idx].view.spec.intrinsics;
                self.debug.record(&self.gpu, encoder, &scene.debug, &lens, &active.motion.world_from_camera, targets);
            }
        }
    }
}

/// What each view sees, found side by side.
fn find_visible(scene: &Scene, assets: &GpuAssets, jobs: &[ViewJob<'_, '_>], active: &mut [Active]) {
    let seen: Vec<(Intrinsics, Option<&Firing>)> =
        active.iter().map(|active| &*jobs[active.job_idx].view).map(|view| (view.spec.intrinsics, view.previous.as_ref())).collect();
    let find = |(active, (lens, previous)): (&mut Active, (Intrinsics, Option<&Firing>))| {
        active.drawn = draw::visible(scene, assets, &lens, &active.motion, previous);
    };
    active.par_iter_mut().zip(seen).for_each(find);
    let mut first_instance = 0;
    for active in active {
        active.drawn.first_instance = first_instance;
        first_instance += active.drawn.instances.len() as u32;
    }
}

/// Light of one view.
struct Lit {
    near: ShadowLookup,
    far: ShadowLookup,
    lamps: LampRange,
}

fn world_from_camera(world_from_sensor: &Isometry3<f64>) -> Isometry3<f64> {
    world_from_sensor * sensor_from_camera()
}

/// What the shading pass reads.
const SHADED: [Target; 3] = [Target::Surface, Target::Depth, Target::Instance];

/// Targets that a modality is made from.
fn targets_of(modality: Modality) -> TargetSet {
    match modality {
        Modality::Rgb => Target::Color.bit(),
        Modality::Depth => Target::Depth.bit(),
        Modality::Semantic => Target::Class.bit(),
        Modality::Instance => Target::Instance.bit(),
        Modality::Flow => Target::Flow.bit(),
        Modality::Normals => Target::Normals.bit(),
        Modality::Dvs => [Target::Luminance, Target::Flow, Target::Depth, Target::Instance, Target::Class]
            .into_iter()
            .fold(TargetSet::default(), |set, target| set.union(target.bit())),
        _ => TargetSet::default(),
    }
}

/// The target that is the modality's image.
fn image_of(modality: Modality) -> Option<Target> {
    match modality {
        Modality::Rgb => Some(Target::Color),
        Modality::Depth => Some(Target::Depth),
        Modality::Semantic => Some(Target::Class),
        Modality::Instance => Some(Target::Instance),
        Modality::Flow => Some(Target::Flow),
        Modality::Normals => Some(Target::Normals),
        _ => None,
    }
}

fn check(job: &ViewJob<'_, '_>) -> Result<(), RenderError> {
    for (i, Output { modality, place }) in job.outputs.iter().enumerate() {
        let modality = *modality;
        if targets_of(modality) == TargetSet::default() {
            return Err(RenderError::NotACamera { modality });
        }
        if job.outputs[..i].iter().any(|other| other.modality == modality) {
            return Err(RenderError::Twice { modality });
        }
        let (needed, room) = (job.view.payload_bytes(modality), place.capacity_bytes());
        if modality != Modality::Dvs && room < needed {
            return Err(RenderError::TooSmall { modality, needed, room });
        }
    }
    Ok(())
}

/// Drops what does not outlive an episode or the last reader.
fn begin_firing(gpu: &Gpu, job: &mut ViewJob<'_, '_>, scene: &Scene) {
    let view: &mut View = job.view;
    if view.previous.as_ref().is_some_and(|firing| firing.episode != scene.assets.episode) {
        view.reset();
    }
    if !job.outputs.iter().any(|output| output.modality == Modality::Dvs) {
        view.dvs = None;
    }
    let has_meter = view.spec.optics.exposure.mode == ExposureMode::Histogram && view.spec.optics.postprocess;
    if has_meter && job.outputs.iter().any(|output| output.modality == Modality::Rgb) {
        view.meter_begins = view.meter.is_none();
        view.meter.get_or_insert_with(|| post::meter(gpu));
    } else {
        view.meter = None;
        view.meter_begins = false;
    }
}

/// Records the copies of a job and says what to do with them after the fence.
fn plan_outputs<'a>(job: &mut ViewJob<'_, 'a>, targets: &Targets, scene: &Scene, batch: &mut CopyBatch<'a>) -> Vec<Plan<'a>> {
    let view: &mut View = job.view;
    let window_nanos = view.previous.as_ref().map_or(0, |firing| scene.sim_time.0.saturating_sub(firing.sim_time.0));
    let mut plans = Vec::with_capacity(job.outputs.len());
    for Output { modality, place } in job.outputs.drain(..) {
        let texture = |target: Target| &targets.get(target).texture;
        match image_of(modality) {
            Some(target) => {
                let is_flow = modality == Modality::Flow;
                let first = is_flow && view.previous.is_none() || modality == Modality::Rgb && view.meter_begins;
                let copy = batch.texture(texture(target), target.element_bytes(), place);
                plans.push(Plan::Copied { modality, copy, first, window_nanos: if is_flow { window_nanos } else { 0 } });
            }
            None => {
                let mut map = |target: Target| batch.map_texture(texture(target), target.element_bytes());
                let maps = DvsMaps {
                    luminance: map(Target::Luminance),
                    flow: map(Target::Flow),
                    depth: map(Target::Depth),
                    instance: map(Target::Instance),
                    class: map(Target::Class),
                };
                let state = view.dvs.get_or_insert_with(|| Arc::new(Mutex::new(event_camera(&view.spec)))).clone();
                plans.push(Plan::Events { place, maps, state, window_nanos });
            }
        }
    }
    plans
}

fn event_camera(spec: &ViewSpec) -> EventCamera {
    let size_px = [spec.intrinsics.width_px, spec.intrinsics.height_px];
    EventCamera::new(spec.dvs.clone(), size_px, spec.seed, spec.sensor_id as u64)
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
