//! Draws every view of a tick in one submission, unless their shadow maps exceed their memory
//! limit.

mod active;
mod admit;
mod assign_targets;
mod bend;
mod check;
mod compose;
mod find;
mod gpu_events;
mod groups;
mod modality;
mod outputs;
mod passes;
mod tick;

use std::sync::Arc;

use nalgebra::Isometry3;
use schema_frames::Modality;
use schema_types::space::sensor_from_camera;
use sensor_core::{InstancePoses, Scene, SceneAssets};
use sensor_gpu::{CopyBatch, Gpu, GpuError, Uploads};

use active::Active;
pub use admit::HeldImages;
pub use check::RenderError;
use compose::{Composer, FacesOf, TickFaces};
use gpu_events::GpuEvents;
use groups::Recorder;
use modality::targets_of;
use passes::Passes;
use tick::{TickDrawing, TickScene};

use crate::assets::GpuAssets;
use crate::camera_motion::{CameraMotion, Firing};
use crate::debug::is_drawn;
use crate::geometry::SceneryLamps;
use crate::lamps::{LampLists, LampRange};
use crate::lens::LensPass;
use crate::light::{Light, upload_sky};
use crate::post;
use crate::quality::Quality;
use crate::raster::Rasteriser;
use crate::shade::Shading;
use crate::shadow::{MapLayout, ShadowMaps};
use crate::target::{Target, TargetLayer, TargetPool, TargetSet};
use crate::view::{Submission, View, ViewJob, ViewSpec, leaders};
use crate::visible::Drawn;

/// Renders views. One per daemon.
#[derive(Debug)]
pub struct CameraRenderer {
    gpu: Gpu,
    quality: Quality,
    assets: Option<GpuAssets>,
    light: Option<Light>,
    /// The sky of `light`.
    sky: Option<wgpu::TextureView>,
    passes: Passes,
    lens: LensPass,
    composer: Composer,
    shadows: ShadowMaps,
    uploads: Uploads,
    pool: TargetPool,
    events: GpuEvents,
    /// Reused allocations of earlier submissions.
    spare_drawn: Vec<Drawn>,
    /// Most bytes of images of all views; `None` leaves it to the driver.
    most_target_bytes: Option<u64>,
}

impl CameraRenderer {
    /// A renderer without a scene.
    pub fn new(gpu: &Gpu, quality: Quality) -> Self {
        Self::with_rasteriser(gpu, quality, Rasteriser::default_for(gpu))
    }

    /// The same with a chosen rasteriser; an adapter that lacks the features for computing draws
    /// anyway.
    pub fn with_rasteriser(gpu: &Gpu, quality: Quality, rasteriser: Rasteriser) -> Self {
        let passes = Passes::new(gpu, quality, rasteriser);
        let layout = map_layout(&passes);
        CameraRenderer {
            gpu: gpu.clone(),
            quality,
            assets: None,
            light: None,
            sky: None,
            passes,
            lens: LensPass::default(),
            composer: Composer::default(),
            shadows: ShadowMaps::new(gpu, quality, layout),
            uploads: Uploads::new(gpu),
            pool: TargetPool::default(),
            events: GpuEvents::new(gpu),
            spare_drawn: Vec::new(),
            most_target_bytes: None,
        }
    }

    /// Limits the memory of the images of all views together, which
    /// [`CameraRenderer::admit`] compares with; by default the driver says what fits.
    pub fn limit_target_bytes(&mut self, most_bytes: u64) {
        self.most_target_bytes = Some(most_bytes);
    }

    /// Bytes that the images of a view take on the GPU if it makes these modalities.
    pub fn target_bytes(&self, view: &View, modalities: &[Modality]) -> u64 {
        let n_sets = if self.gpu.copies_beside() { 2 } else { 1 };
        let set = self.targets_for(view, modalities);
        let faces = view.faces.iter();
        let of_faces = faces.map(|face| admit::target_bytes(face, set, n_sets));
        admit::target_bytes(view, set, n_sets) + of_faces.sum::<u64>()
    }

    /// Whether the images of a view fit the GPU, beside those of other views that take `used_bytes`.
    /// They are made for that, and take their memory until the answer is dropped.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`] if they do not fit, [`GpuError::Lost`].
    pub fn admit(
        &self,
        view: &View,
        modalities: &[Modality],
        used_bytes: u64,
    ) -> Result<HeldImages, GpuError> {
        let needed_bytes = self.target_bytes(view, modalities);
        if let Some(most_bytes) = self.most_target_bytes
            && used_bytes.saturating_add(needed_bytes) > most_bytes
        {
            let mebibytes = |n: u64| n.div_ceil(1 << 20);
            return Err(GpuError::OutOfMemory {
                name: self.gpu.name().to_owned(),
                what: format!(
                    "{}, which need {} MiB: cameras have {} MiB in all, and others use {} MiB",
                    admit::what([view.drawn.width_px, view.drawn.height_px]),
                    mebibytes(needed_bytes),
                    mebibytes(most_bytes),
                    mebibytes(used_bytes),
                ),
            });
        }
        let set = self.targets_for(view, modalities);
        let surfaces = self.passes.shading().surfaces();
        let mut held = admit::try_targets(&self.gpu, view, set, surfaces)?;
        for face in &view.faces {
            held.add(admit::try_targets(&self.gpu, face, set, surfaces)?);
        }
        Ok(held)
    }

    /// Forgets what a tick or a map that found no memory left behind. The next tick makes it anew.
    pub fn recover(&mut self) {
        self.passes.forget();
        self.assets = None;
        self.pool = TargetPool::default();
        self.light = None;
        self.uploads = Uploads::new(&self.gpu);
        self.shadows = ShadowMaps::new(&self.gpu, self.quality, map_layout(&self.passes));
    }

    /// All targets that a view needs for these modalities.
    fn targets_for(&self, view: &View, modalities: &[Modality]) -> TargetSet {
        let asked = modalities.iter().map(|modality| targets_of(*modality));
        let asked = asked.fold(TargetSet::default(), TargetSet::union);
        self.completed(asked, &view.spec, SceneryLamps::AsBuilt)
    }

    /// The targets that are read to make those of `set`, too.
    fn completed(&self, mut set: TargetSet, spec: &ViewSpec, lamps: SceneryLamps) -> TargetSet {
        if set.contains(Target::Color)
            && (self.quality == Quality::High || !spec.optics.is_neutral())
        {
            set = set.union(Target::Radiance.bit());
        }
        if set.contains(Target::Radiance) {
            set = set.union(post::reads(&spec.optics));
        }
        if set.is_lit() {
            set = set.union(self.passes.shading_reads(lamps));
        }
        set
    }

    /// Chooses whether event cameras work on the GPU or on the CPU; by default they use the GPU
    /// unless the adapter is software. Returns `false` if the GPU lacks the features.
    pub fn set_events_on_gpu(&mut self, on: bool) -> bool {
        self.events.set_on_gpu(&self.gpu, on)
    }

    /// Limits the memory of shadow maps; the default is 3 GiB. If the maps of all sunlit cameras
    /// need more, cameras are lit one group after the other, and maps are drawn again in every
    /// tick: that is slower, but the pictures are the same. Each size of map has room for at least
    /// one. While textures grow, the old ones take memory until the tick is done.
    pub fn limit_shadow_bytes(&mut self, most_bytes: u64) {
        self.passes.forget();
        self.shadows.limit(most_bytes);
    }

    /// Bytes of the textures that shadow maps lie in.
    pub fn shadow_bytes(&self) -> u64 {
        self.shadows.n_bytes()
    }

    /// Uploads an episode's meshes and returns the number of bytes. [`CameraRenderer::render`] does
    /// it by itself when the scene's assets change. If only other objects of the same scenery are
    /// shown, only the changes are uploaded.
    pub fn load(&mut self, assets: &Arc<SceneAssets>) -> u64 {
        if let Some(n_bytes) = self
            .assets
            .as_mut()
            .and_then(|loaded| loaded.take_over(&self.gpu, assets))
        {
            self.gpu.submit([]);
            self.shadows.redraw();
            return n_bytes;
        }
        // The old meshes are dropped first, so that memory need not hold two towns.
        self.passes.forget();
        self.assets = None;
        let uploaded = GpuAssets::upload(&self.gpu, assets);
        let n_bytes = uploaded.n_bytes();
        self.assets = Some(uploaded);
        // wgpu uploads with the next submission and frees dropped buffers with the one after, but
        // without readers there are none.
        self.gpu.submit([]);
        self.gpu.wait_idle();
        self.shadows.clear();
        n_bytes
    }

    /// Draws the outputs of all `jobs` and remembers every job's firing. This is one submission,
    /// unless shadow maps exceed their memory limit ([`CameraRenderer::limit_shadow_bytes`]), and
    /// none without readers.
    ///
    /// # Errors
    /// A job asks for a modality that cameras do not make, asks for one twice, or a place is too
    /// small. Then nothing was drawn or remembered.
    pub fn render<'a>(
        &mut self,
        scene: &Scene,
        mut jobs: Vec<ViewJob<'_, 'a>>,
    ) -> Result<Submission<'a>, RenderError> {
        for job in &jobs {
            check::check(job)?;
        }
        match &mut self.assets {
            Some(loaded) if Arc::ptr_eq(&loaded.meshes.scene_assets, &scene.assets) => {}
            Some(loaded) if loaded.meshes.shows_the_same(&scene.assets) => {
                loaded.switch_lamps(&self.gpu, &scene.assets)
            }
            _ => drop(self.load(&scene.assets)),
        }
        for job in &mut jobs {
            outputs::begin_firing(&self.gpu, job, scene);
        }
        let n_jobs = jobs.len();
        let mut faces = TickFaces::take(&mut jobs);
        let mut jobs_of_all = Vec::with_capacity(n_jobs);
        jobs_of_all.extend(jobs.iter_mut().map(ViewJob::reborrow));
        let faces_of = faces.add_to(&mut jobs_of_all);
        let submission = self.draw(scene, &mut jobs_of_all, &faces_of);
        let poses = Arc::new(InstancePoses::of(scene));
        for job in jobs_of_all {
            let world_from_camera = world_from_camera(&job.world_from_sensor);
            job.view.previous = Some(Firing {
                world_from_camera,
                sim_time: scene.sim_time,
                episode: scene.assets.episode,
                poses: poses.clone(),
            });
        }
        faces.give_back(&mut jobs);
        Ok(submission)
    }

    /// `faces` are those of the first jobs; the jobs behind them are faces.
    fn draw<'a>(
        &mut self,
        scene: &Scene,
        jobs: &mut [ViewJob<'_, 'a>],
        faces: &[FacesOf],
    ) -> Submission<'a> {
        let gpu = self.gpu.clone();
        let leaders = gpu.time("merge", || leaders(jobs));
        let mut active = self.activate(scene, jobs, &leaders, faces);
        if active.is_empty() {
            return Submission::new(None, faces.iter().map(|_| Vec::new()).collect());
        }
        gpu.time("find", || self.make_light(scene));
        let tick = TickScene {
            gpu: &gpu,
            quality: self.quality,
            scene,
            assets: self.assets.as_ref().expect("render() loaded the assets"),
            light: self.light.as_ref().expect("it was just made"),
            sky: self.sky.as_ref().expect("it was just made"),
        };
        let computes = self.passes.computes(&gpu, tick.assets);
        // Compute shaders take hidden triangles in less time than the processor needs to find them.
        let culling = (
            self.passes.still_as(&gpu, tick.assets),
            gpu.is_software() && !computes,
        );
        let plans = gpu.time("find", || {
            find::find(&tick, culling, &mut self.shadows, jobs, &mut active)
        });
        let mut lamps = LampLists::default();
        for active in active.iter_mut().filter(|active| active.set.is_lit()) {
            active.lamps = lamps.add_view(&active.lamps_in_view, &jobs[active.job_idx].view.drawn);
        }
        gpu.time("targets", || {
            if computes {
                assign_targets::assign_computed(&gpu, &mut self.pool, jobs, &mut active);
                return;
            }
            for active in &active {
                self.passes.prepare_drawing(
                    &gpu,
                    active.set,
                    SceneryLamps::of(&tick.assets.meshes),
                );
            }
            let surfaces = self.passes.shading().surfaces();
            assign_targets::assign_drawn(&gpu, surfaces, jobs, &mut active);
        });
        let drawing = TickDrawing {
            tick,
            lamps: &lamps,
            computes,
        };
        let mut encoder = gpu.time("record", || {
            let recorder = Recorder {
                passes: &mut self.passes,
                maps: &mut self.shadows,
                uploads: &mut self.uploads,
            };
            recorder.record(plans, &drawing, &mut active, jobs)
        });
        let mut batch = CopyBatch::new();
        let mut images = vec![None; jobs.len()];
        active
            .iter()
            .for_each(|active| batch.overwrites(&active.targets.reads));
        for active in &active {
            let view = &mut *jobs[active.job_idx].view;
            let bent = bend::bend(&gpu, &mut self.lens, view, active, &mut encoder);
            if let Some(bent) = &bent {
                batch.overwrites(&bent.reads);
            }
            images[active.job_idx] = Some(match bent {
                Some(bent) => (bent, 0),
                None => (active.targets.clone(), active.layer),
            });
        }
        let composer = &mut self.composer;
        for (job_idx, picture) in
            composer.compose(&tick, &mut self.uploads, jobs, faces, &active, &mut encoder)
        {
            batch.overwrites(&picture.reads);
            images[job_idx] = Some((picture, 0));
        }
        self.spare_drawn = active.into_iter().map(|active| active.drawn).collect();
        let plans = jobs
            .iter_mut()
            .take(faces.len())
            .zip(&leaders)
            .map(|(job, leader)| match &images[*leader] {
                Some((targets, layer)) => {
                    let images = TargetLayer {
                        targets,
                        layer: *layer,
                    };
                    let list = self.events.record(&gpu, job, images, scene, &mut encoder);
                    outputs::plan_outputs(job, images, scene, &mut batch, list)
                }
                None => Vec::new(),
            });
        let plans = plans.collect();
        self.uploads.close(&encoder);
        Submission::new(
            Some(gpu.time("copies and submit", || batch.submit(&gpu, encoder))),
            plans,
        )
    }

    /// Which jobs have something to draw, and what.
    fn activate(
        &mut self,
        scene: &Scene,
        jobs: &mut [ViewJob<'_, '_>],
        leaders: &[usize],
        faces: &[FacesOf],
    ) -> Vec<Active> {
        let lamps = match scene.assets.switched.is_empty() {
            true => SceneryLamps::AsBuilt,
            false => SceneryLamps::Switched,
        };
        let mut active = Vec::new();
        let mut asked = vec![TargetSet::default(); jobs.len()];
        for (job, leader) in jobs.iter().zip(leaders) {
            asked[*leader] = job.outputs.iter().fold(asked[*leader], |set, output| {
                set.union(targets_of(output.modality))
            });
        }
        for (job_idx, FacesOf { first, n }) in faces.iter().enumerate().filter(|it| it.1.n > 0) {
            let set = self.completed(asked[job_idx], &jobs[job_idx].view.spec, lamps);
            asked[*first..first + n].fill(set);
            asked[job_idx] = TargetSet::default();
        }
        for (job_idx, (job, asked)) in jobs.iter_mut().zip(asked).enumerate() {
            let mut set = self.completed(asked, &job.view.spec, lamps);
            if set.contains(Target::Color) && !job.view.is_face && is_drawn(scene, &job.view.spec) {
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

    /// Makes the light of the weather, if it is another one.
    fn make_light(&mut self, scene: &Scene) {
        if self
            .light
            .as_ref()
            .is_none_or(|light| !light.is_of(&scene.weather))
        {
            let (light, sky) = Light::new(self.quality, &scene.weather);
            self.light = Some(light);
            self.sky = Some(upload_sky(&self.gpu, sky));
        }
    }
}

/// How shadow maps lie in their textures.
fn map_layout(passes: &Passes) -> MapLayout {
    match passes.shading() {
        Shading::Drawn => MapLayout::BySize,
        Shading::Computed => MapLayout::Together,
    }
}

fn world_from_camera(world_from_sensor: &Isometry3<f64>) -> Isometry3<f64> {
    world_from_sensor * sensor_from_camera()
}
