//! The way of faces to the picture of a camera with a calibrated lens.

use std::sync::Arc;

use nalgebra::Isometry3;
use sensor_gpu::{Gpu, Uploads};

use super::active::Active;
use super::outputs::window_nanos;
use super::tick::TickScene;
use crate::faces::{FacePass, FaceTable};
use crate::post::{PostJob, PostPass};
use crate::quality::Quality;
use crate::target::{Surfaces, Target, TargetLayer, TargetSet, Targets};
use crate::view::{View, ViewJob};

/// The faces of all jobs of a tick, taken out of their views while these are drawn.
pub(super) struct TickFaces(Vec<Vec<View>>);

/// Which jobs are those of a job's faces.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FacesOf {
    /// The first of them.
    pub first: usize,
    /// How many there are; none of a camera without a lens.
    pub n: usize,
}

impl TickFaces {
    pub fn take(jobs: &mut [ViewJob<'_, '_>]) -> TickFaces {
        let taken = jobs
            .iter_mut()
            .map(|job| std::mem::take(&mut job.view.faces));
        TickFaces(taken.collect())
    }

    /// Adds a job for each face behind all others, and says which are whose.
    pub fn add_to<'v>(&'v mut self, jobs: &mut Vec<ViewJob<'v, '_>>) -> Vec<FacesOf> {
        let mut all = Vec::with_capacity(self.0.len());
        for (job_idx, faces) in self.0.iter_mut().enumerate() {
            let (first, n) = (jobs.len(), faces.len());
            all.push(FacesOf { first, n });
            for (number, face) in faces.iter_mut().enumerate() {
                let job = &jobs[job_idx];
                let Some(plan) = &job.view.plan else { continue };
                let world_from_sensor: Isometry3<f64> = plan.pose(number, &job.world_from_sensor);
                face.hidden.clone_from(&job.view.hidden);
                jobs.push(ViewJob {
                    view: face,
                    world_from_sensor,
                    outputs: Vec::new(),
                });
            }
        }
        all
    }

    pub fn give_back(self, jobs: &mut [ViewJob<'_, '_>]) {
        for (job, faces) in jobs.iter_mut().zip(self.0) {
            job.view.faces = faces;
        }
    }
}

/// Makes pictures of faces.
#[derive(Debug, Default)]
pub(super) struct Composer {
    faces: FacePass,
    /// Develops pictures; made for the first one.
    post: Option<PostPass>,
}

/// A picture in the making.
struct Picture {
    job_idx: usize,
    targets: Arc<Targets>,
}

impl Composer {
    /// Composes the pictures of all jobs whose faces were drawn, develops those whose colour is made
    /// of radiance, and returns them with their jobs.
    pub fn compose(
        &mut self,
        tick: &TickScene<'_>,
        uploads: &mut Uploads,
        jobs: &mut [ViewJob<'_, '_>],
        faces: &[FacesOf],
        active: &[Active],
        encoder: &mut wgpu::CommandEncoder,
    ) -> Vec<(usize, Arc<Targets>)> {
        let gpu = tick.gpu;
        let mut plain = Vec::new();
        let mut developed = Vec::new();
        for (job_idx, FacesOf { first, n }) in faces.iter().enumerate() {
            let own = *first..first + n;
            let mut drawn: Vec<&Active> = active
                .iter()
                .filter(|active| own.contains(&active.job_idx))
                .collect();
            if drawn.is_empty() || drawn.len() < *n {
                continue;
            }
            drawn.sort_by_key(|active| active.job_idx);
            let set = drawn[0].set;
            let is_developed = set.contains(Target::Radiance);
            let layers: Vec<TargetLayer<'_>> = drawn
                .iter()
                .map(|active| TargetLayer {
                    targets: &active.targets,
                    layer: active.layer,
                })
                .collect();
            let view = &mut *jobs[job_idx].view;
            let targets = picture_targets(gpu, view, is_developed);
            let Some(plan) = &view.plan else { continue };
            let table = view
                .face_table
                .get_or_insert_with(|| FaceTable::upload(gpu, plan));
            let target = match is_developed {
                true => Target::Radiance,
                false => Target::Color,
            };
            self.faces
                .record(gpu, encoder, (plan, table), &layers, &targets, target);
            match is_developed {
                true => developed.push(Picture { job_idx, targets }),
                false => plain.push((job_idx, targets)),
            }
        }
        self.develop(tick, uploads, jobs, &developed, encoder);
        let developed = developed.into_iter().map(|it| (it.job_idx, it.targets));
        plain.into_iter().chain(developed).collect()
    }

    /// From radiance to colour, each picture as one.
    fn develop(
        &mut self,
        tick: &TickScene<'_>,
        uploads: &mut Uploads,
        jobs: &[ViewJob<'_, '_>],
        pictures: &[Picture],
        encoder: &mut wgpu::CommandEncoder,
    ) {
        if pictures.is_empty() {
            return;
        }
        let TickScene {
            gpu,
            quality,
            scene,
            light,
            ..
        } = *tick;
        let post = self.post.get_or_insert_with(|| PostPass::new(gpu, true));
        let work: Vec<PostJob<'_>> = pictures
            .iter()
            .enumerate()
            .map(|(view_idx, picture)| {
                let view = &*jobs[picture.job_idx].view;
                PostJob {
                    view_idx,
                    optics: &view.spec.optics,
                    lens: view.spec.intrinsics,
                    targets: &picture.targets,
                    layer: 0,
                    meter: view.meter.as_ref(),
                    exposure: light.exposure,
                    since_secs: window_nanos(view, scene) as f32 * 1e-9,
                    smooth_edges: quality == Quality::High,
                    has_field: true,
                }
            })
            .collect();
        let jobs: Vec<&PostJob<'_>> = work.iter().collect();
        post.upload(gpu, (uploads, encoder), &jobs, work.len());
        gpu.counters().add_pass();
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("post of pictures"),
            timestamp_writes: None,
        });
        work.iter()
            .for_each(|job| post.develop(gpu, &mut pass, job));
        drop(pass);
        gpu.mark(encoder, "post");
    }
}

/// The targets of a picture, which the copies of the firing before may still read.
fn picture_targets(gpu: &Gpu, view: &mut View, is_developed: bool) -> Arc<Targets> {
    let size_px = [
        view.spec.intrinsics.width_px,
        view.spec.intrinsics.height_px,
    ];
    if gpu.copies_beside() {
        view.bent.swap(0, 1);
    }
    let mut set = Target::Color.bit();
    if is_developed {
        set = set.union(Target::Radiance.bit());
    }
    view.kept = view.kept.union(set);
    let kept = TargetSet(view.kept.0 & (Target::Color.bit().0 | Target::Radiance.bit().0));
    let [targets, twin] = &mut view.bent;
    Arc::make_mut(targets).ensure(gpu, size_px, kept, Surfaces::Slim, twin);
    view.bent[0].clone()
}
