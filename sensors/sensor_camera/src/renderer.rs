//! Draws every view of a tick in one submission, unless their shadow maps do not fit their memory.

mod events;
mod groups;
mod recording;

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
use crate::draw::{self, CameraMotion, Drawn};
use crate::dvs::EventCamera;
use crate::dvs::gpu::{EventList, EventPass};
use crate::lamps::{self, LampInView, LampLists, LampRange};
use crate::light::Light;
use crate::merge;
use crate::pass::GeometryPass;
use crate::pool::{PoolKey, TargetPool};
use crate::post::{self, PostPass};
use crate::raster::{RasterPass, Rasteriser, can_compute};
use crate::shade::ShadePass;
use crate::shadow::{Cascade, ShadowPlan, Shadows};
use crate::submission::{DvsMaps, Plan, Submission};
use crate::targets::{Target, TargetSet, Targets};
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
        if gpu.is_software() {
            Quality::Low
        } else {
            Quality::High
        }
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
    pool: TargetPool,
    /// Whether the GPU follows events where it can, and what does it once somebody looked through
    /// an event camera.
    events_on_gpu: bool,
    events: Option<EventPass>,
    /// Memory of earlier submissions.
    spare_drawn: Vec<Drawn>,
}

/// A job with something to draw.
struct Active {
    job_idx: usize,
    set: TargetSet,
    motion: CameraMotion,
    drawn: Drawn,
    /// Number of its lookup in shadow maps, if it has any.
    eye: Option<usize>,
    lamps_in_view: Vec<LampInView>,
    lamps: LampRange,
    targets: Arc<Targets>,
    /// Its layer there.
    layer: u32,
}

/// What is new in shadow maps.
#[derive(Debug, Default)]
struct ShadowPlans {
    near: Option<ShadowPlan>,
    far: Option<ShadowPlan>,
}

impl CameraRenderer {
    /// A renderer without a scene.
    pub fn new(gpu: &Gpu, quality: Quality) -> Self {
        Self::with_rasteriser(gpu, quality, Rasteriser::default_for(gpu))
    }

    /// The same, with a rasteriser of one's choice; an adapter that cannot compute draws all the
    /// same.
    pub fn with_rasteriser(gpu: &Gpu, quality: Quality, rasteriser: Rasteriser) -> Self {
        let computes = rasteriser == Rasteriser::Computed && can_compute(gpu);
        let slim = quality == Quality::Low && !computes;
        let pass = GeometryPass::new(gpu, slim);
        let shade = ShadePass::new(gpu, &pass, quality, slim);
        let [near_bytes, far_bytes] = groups::share(quality, groups::MOST_SHADOW_BYTES);
        let shadows =
            |cascade, most_bytes| Shadows::new(gpu, cascade, !shade.is_drawn(), most_bytes);
        CameraRenderer {
            gpu: gpu.clone(),
            quality,
            assets: None,
            light: None,
            post: PostPass::new(gpu),
            raster: computes.then(|| RasterPass::new(gpu, &pass)),
            pass,
            shadows: shadows(Cascade::near(quality), near_bytes),
            far_shadows: (quality == Quality::High).then(|| shadows(Cascade::far(), far_bytes)),
            shade,
            debug: DebugPass::new(gpu),
            pool: TargetPool::default(),
            events_on_gpu: !gpu.is_software() && EventPass::is_supported(gpu),
            events: None,
            spare_drawn: Vec::new(),
        }
    }

    /// Uploads an episode's meshes; [`CameraRenderer::render`] does it by itself when the scene's
    /// assets are others than before. Where only
    /// other objects of the same scenery are shown, what changed is uploaded. Gives the number of
    /// bytes.
    pub fn load(&mut self, assets: &Arc<SceneAssets>) -> u64 {
        if let Some(n_bytes) = self
            .assets
            .as_mut()
            .and_then(|loaded| loaded.take_over(&self.gpu, assets))
        {
            self.gpu.submit([]);
            self.shadows.redraw();
            self.far_shadows.iter_mut().for_each(Shadows::redraw);
            return n_bytes;
        }
        // The old meshes first: two towns need not fit beside each other.
        self.assets = None;
        let uploaded = GpuAssets::upload(&self.gpu, assets);
        let n_bytes = uploaded.n_bytes();
        self.assets = Some(uploaded);
        // An upload waits for the next submission, and what was dropped for the one after; a world
        // that nobody looks at has none.
        self.gpu.submit([]);
        self.gpu.wait_idle();
        self.shadows.clear();
        if let Some(far) = &mut self.far_shadows {
            far.clear();
        }
        n_bytes
    }

    /// Draws what is read of all `jobs` and remembers every job's firing. One submission, unless
    /// their shadow maps do not fit their memory
    /// ([`CameraRenderer::limit_shadow_bytes`]); none at all if nobody reads.
    ///
    /// # Errors
    /// A job asks for what a camera does not make, asks twice, or its place is too small; nothing
    /// was drawn or remembered then.
    pub fn render<'a>(
        &mut self,
        scene: &Scene,
        mut jobs: Vec<ViewJob<'_, 'a>>,
    ) -> Result<Submission<'a>, RenderError> {
        for job in &jobs {
            check(job)?;
        }
        match &mut self.assets {
            Some(loaded) if Arc::ptr_eq(&loaded.scene_assets, &scene.assets) => {}
            Some(loaded) if loaded.shows_the_same(&scene.assets) => {
                loaded.switch_lamps(&self.gpu, &scene.assets)
            }
            _ => drop(self.load(&scene.assets)),
        }
        for job in &mut jobs {
            begin_firing(&self.gpu, job, scene);
        }
        let submission = self.draw(scene, &mut jobs);
        let poses = Arc::new(InstancePoses::of(scene));
        for job in jobs {
            let world_from_camera = world_from_camera(&job.world_from_sensor);
            job.view.previous = Some(Firing {
                world_from_camera,
                sim_time: scene.sim_time,
                episode: scene.assets.episode,
                poses: poses.clone(),
            });
        }
        Ok(submission)
    }

    fn draw<'a>(&mut self, scene: &Scene, jobs: &mut [ViewJob<'_, 'a>]) -> Submission<'a> {
        let gpu = self.gpu.clone();
        let leaders = gpu.time("merge", || merge::leaders(jobs));
        let mut active = self.activate(scene, jobs, &leaders);
        if active.is_empty() {
            return Submission {
                in_flight: None,
                plans: jobs.iter().map(|_| Vec::new()).collect(),
            };
        }
        let assets = self.assets.as_ref().expect("render() loaded the assets");
        let computes = self.raster.is_some() && RasterPass::takes(&gpu, assets);
        let shadows = gpu.time("find", || self.find(scene, jobs, &mut active));
        let mut lamps = LampLists::default();
        for active in active.iter_mut().filter(|active| active.set.is_lit()) {
            active.lamps = lamps.add_view(
                &active.lamps_in_view,
                &jobs[active.job_idx].view.spec.intrinsics,
            );
        }
        gpu.time("targets", || self.take_targets(jobs, &mut active, computes));
        let mut encoder = gpu.time("record", || {
            self.record_groups(scene, &mut active, jobs, (&lamps, shadows), computes)
        });
        let mut batch = CopyBatch::new();
        let mut images = vec![None; jobs.len()];
        active
            .iter()
            .for_each(|active| batch.overwrites(&active.targets.reads));
        active.iter().for_each(|active| {
            images[active.job_idx] = Some((active.targets.clone(), active.layer))
        });
        self.spare_drawn = active.into_iter().map(|active| active.drawn).collect();
        let plans = jobs
            .iter_mut()
            .zip(&leaders)
            .map(|(job, leader)| match &images[*leader] {
                Some((targets, layer)) => {
                    let list = self.record_events(job, (targets, *layer), scene, &mut encoder);
                    plan_outputs(job, (targets, *layer), scene, &mut batch, list)
                }
                None => Vec::new(),
            });
        let plans = plans.collect();
        Submission {
            in_flight: Some(gpu.time("copies and submit", || batch.submit(&gpu, encoder))),
            plans,
        }
    }

    /// Who has something to draw, and what.
    fn activate(
        &mut self,
        scene: &Scene,
        jobs: &mut [ViewJob<'_, '_>],
        leaders: &[usize],
    ) -> Vec<Active> {
        let is_switched = !scene.assets.switched.is_empty();
        let mut active = Vec::new();
        let mut asked = vec![TargetSet::default(); jobs.len()];
        for (job, leader) in jobs.iter().zip(leaders) {
            asked[*leader] = job.outputs.iter().fold(asked[*leader], |set, output| {
                set.union(targets_of(output.modality))
            });
        }
        for (job_idx, (job, mut set)) in jobs.iter_mut().zip(asked).enumerate() {
            if set.contains(Target::Color)
                && (self.quality == Quality::High || !job.view.spec.optics.is_neutral())
            {
                set = set.union(Target::Radiance.bit());
            }
            if set.is_lit() {
                set = set.union(self.shade.reads(is_switched));
            }
            if set.contains(Target::Color) && !scene.debug.is_empty() {
                set = set.union(Target::Depth.bit());
            }
            if set == TargetSet::default() {
                continue;
            }
            job.view.kept = job.view.kept.union(set);
            let motion = CameraMotion::new(
                world_from_camera(&job.world_from_sensor),
                job.view.previous.as_ref(),
            );
            let drawn = self.spare_drawn.pop().unwrap_or_default();
            active.push(Active {
                job_idx,
                set,
                motion,
                drawn,
                eye: None,
                lamps_in_view: Vec::new(),
                lamps: LampRange::default(),
                targets: Arc::default(),
                layer: 0,
            });
        }
        active
    }

    /// Makes the weather's light, and finds what each view sees, which lamps reach into it, and
    /// what is new in its shadow maps, if all of
    /// them fit into memory: side by side.
    fn find(
        &mut self,
        scene: &Scene,
        jobs: &[ViewJob<'_, '_>],
        active: &mut [Active],
    ) -> Option<ShadowPlans> {
        if self
            .light
            .as_ref()
            .is_none_or(|light| !light.is_of(&scene.weather))
        {
            self.light = Some(Light::new(&self.gpu, self.quality, &scene.weather));
        }
        let (Some(light), Some(assets)) = (&self.light, &self.assets) else {
            return Some(ShadowPlans::default());
        };
        let eyes = if light.has_shadows {
            groups::eyes_of(active, jobs)
        } else {
            Vec::new()
        };
        let fits = self.n_fitting(&eyes) == eyes.len();
        let shining = lamps::shining(scene, assets, light.exposure, light.dark_ratio);
        let quality = self.quality;
        let seen: Vec<(Intrinsics, Option<&Firing>)> = active
            .iter()
            .map(|active| &*jobs[active.job_idx].view)
            .map(|view| (view.spec.intrinsics, view.previous.as_ref()))
            .collect();
        let find = |(active, (lens, previous)): (&mut Active, (Intrinsics, Option<&Firing>))| {
            draw::visible(
                scene,
                assets,
                &lens,
                &active.motion,
                previous,
                &mut active.drawn,
            );
            if active.set.is_lit() {
                active.lamps_in_view = lamps::reaching(&shining, quality, &lens, &active.motion);
            }
        };
        let plan = |shadows: &mut Shadows| {
            (fits && !eyes.is_empty())
                .then(|| shadows.plan(assets, scene, light.sun_towards, &eyes))
        };
        let (near, far) = (&mut self.shadows, &mut self.far_shadows);
        // One view is done before other threads wake up.
        if active.len() == 1 {
            active.iter_mut().zip(seen).for_each(find);
            return Some(ShadowPlans {
                near: plan(near),
                far: far.as_mut().and_then(plan),
            });
        }
        let views = || active.par_iter_mut().zip(seen).for_each(find);
        let plans = || rayon::join(|| plan(near), || far.as_mut().and_then(plan));
        let ((), (near, far)) = rayon::join(views, plans);
        fits.then_some(ShadowPlans { near, far })
    }

    /// Gives every view its targets. Views that compute shaders do alike come to stand one after
    /// the other, and share textures.
    fn take_targets(
        &mut self,
        jobs: &mut [ViewJob<'_, '_>],
        active: &mut [Active],
        computes: bool,
    ) {
        if !computes {
            let is_switched = self.assets.as_ref().is_some_and(GpuAssets::is_switched);
            for active in active {
                self.pass.prepare(&self.gpu, active.set, is_switched);
                let view = &mut *jobs[active.job_idx].view;
                let Intrinsics {
                    width_px,
                    height_px,
                    ..
                } = view.spec.intrinsics;
                if self.gpu.copies_beside() {
                    view.targets.swap(0, 1);
                }
                let [targets, twin] = &mut view.targets;
                Arc::make_mut(targets).ensure(
                    &self.gpu,
                    [width_px, height_px],
                    view.kept,
                    self.shade.is_drawn(),
                    twin,
                );
                view.turns = None;
                active.targets = view.targets[0].clone();
            }
            return;
        }
        let key = |active: &Active| {
            let view = &jobs[active.job_idx].view;
            (
                (
                    [
                        view.spec.intrinsics.width_px,
                        view.spec.intrinsics.height_px,
                    ],
                    view.kept,
                ),
                active.set,
                active.lamps.n > 0,
            )
        };
        active.sort_by_key(key);
        let mut turns_of = Vec::with_capacity(active.len());
        for alike in active.chunk_by_mut(|a, b| key(a).0 == key(b).0) {
            let (size_px, set) = key(&alike[0]).0;
            let most = TargetPool::max_layers(&self.gpu, size_px);
            for (part, alike) in (0..).zip(alike.chunks_mut(most as usize)) {
                let turns = self.pool.take(
                    &self.gpu,
                    PoolKey { size_px, set, part },
                    alike.len() as u32,
                );
                let targets = turns.next();
                for (layer, active) in (0..).zip(alike) {
                    (active.targets, active.layer) = (targets.clone(), layer);
                    turns_of.push(turns.clone());
                }
            }
        }
        for (active, turns) in active.iter().zip(turns_of) {
            let view = &mut *jobs[active.job_idx].view;
            if view.turns.replace(turns).is_none() {
                view.targets = Default::default();
            }
        }
    }
}

/// Time since the view's previous firing.
fn window_nanos(view: &View, scene: &Scene) -> u64 {
    view.previous.as_ref().map_or(0, |firing| {
        scene.sim_time.0.saturating_sub(firing.sim_time.0)
    })
}

fn world_from_camera(world_from_sensor: &Isometry3<f64>) -> Isometry3<f64> {
    world_from_sensor * sensor_from_camera()
}

/// Targets that a modality is made from.
fn targets_of(modality: Modality) -> TargetSet {
    match modality {
        Modality::Rgb => Target::Color.bit(),
        Modality::Depth => Target::Depth.bit(),
        Modality::Semantic => Target::Class.bit(),
        Modality::Instance => Target::Instance.bit(),
        Modality::Flow => Target::Flow.bit(),
        Modality::Normals => Target::Normals.bit(),
        Modality::Dvs => [
            Target::Luminance,
            Target::Flow,
            Target::Depth,
            Target::Instance,
            Target::Class,
        ]
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
        if job.outputs[..i]
            .iter()
            .any(|other| other.modality == modality)
        {
            return Err(RenderError::Twice { modality });
        }
        let (needed, room) = (job.view.payload_bytes(modality), place.capacity_bytes());
        if modality != Modality::Dvs && room < needed {
            return Err(RenderError::TooSmall {
                modality,
                needed,
                room,
            });
        }
    }
    Ok(())
}

/// Drops what does not outlive an episode or the last reader.
fn begin_firing(gpu: &Gpu, job: &mut ViewJob<'_, '_>, scene: &Scene) {
    let view: &mut View = job.view;
    if view
        .previous
        .as_ref()
        .is_some_and(|firing| firing.episode != scene.assets.episode)
    {
        view.reset();
    }
    if !job
        .outputs
        .iter()
        .any(|output| output.modality == Modality::Dvs)
    {
        view.dvs = None;
        view.gpu_events = None;
    }
    let has_meter =
        view.spec.optics.exposure.mode == ExposureMode::Histogram && view.spec.optics.postprocess;
    if has_meter
        && job
            .outputs
            .iter()
            .any(|output| output.modality == Modality::Rgb)
    {
        view.meter_begins = view.meter.is_none();
        view.meter.get_or_insert_with(|| post::meter(gpu));
    } else {
        view.meter = None;
        view.meter_begins = false;
    }
}

/// Records the copies of a job and says what to do with them after the fence.
fn plan_outputs<'a>(
    job: &mut ViewJob<'_, 'a>,
    (targets, layer): (&Targets, u32),
    scene: &Scene,
    batch: &mut CopyBatch<'a>,
    mut list: Option<EventList>,
) -> Vec<Plan<'a>> {
    let view: &mut View = job.view;
    let window_nanos = window_nanos(view, scene);
    let mut plans = Vec::with_capacity(job.outputs.len());
    for Output { modality, place } in job.outputs.drain(..) {
        let texture = |target: Target| &targets.get(target).texture;
        match image_of(modality) {
            Some(target) => {
                let is_flow = modality == Modality::Flow;
                let first = is_flow && view.previous.is_none()
                    || modality == Modality::Rgb && view.meter_begins;
                let (image, n_bytes) = (targets.get(target), target.element_bytes());
                let copy = match image.is_shared {
                    true => {
                        batch.shared_layer(&image.texture, layer, n_bytes, place, &targets.reads)
                    }
                    false => batch.texture_layer(&image.texture, layer, n_bytes, place),
                };
                plans.push(Plan::Copied {
                    modality,
                    copy,
                    first,
                    window_nanos: if is_flow { window_nanos } else { 0 },
                });
            }
            None => {
                if let Some(list) = list.take() {
                    plans.push(Plan::EventList {
                        place,
                        list,
                        window_nanos,
                    });
                    continue;
                }
                let mut map = |target: Target| {
                    batch.map_texture(texture(target), layer, target.element_bytes())
                };
                let maps = DvsMaps {
                    luminance: map(Target::Luminance),
                    flow: map(Target::Flow),
                    depth: map(Target::Depth),
                    instance: map(Target::Instance),
                    class: map(Target::Class),
                };
                let state = view
                    .dvs
                    .get_or_insert_with(|| Arc::new(Mutex::new(event_camera(&view.spec))))
                    .clone();
                plans.push(Plan::Events {
                    place,
                    maps,
                    state,
                    window_nanos,
                });
            }
        }
    }
    plans
}

fn event_camera(spec: &ViewSpec) -> EventCamera {
    let size_px = [spec.intrinsics.width_px, spec.intrinsics.height_px];
    EventCamera::new(spec.dvs.clone(), size_px, spec.seed, spec.sensor_id as u64)
}
