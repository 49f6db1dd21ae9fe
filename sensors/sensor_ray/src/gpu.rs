//! Lidars on the GPU: a compute shader walks the same hierarchies as the CPU, for many lidars in
//! one submission.
//!
//! The shader also computes exact distances in `f64`, takes noise and drop-off from the same
//! integers, and packs points in the same order as the CPU. Its frames therefore agree with the
//! CPU's up to the rounding of the last step (`exp`, the normal deviate). Where readers' memory is
//! imported, the shader writes packed points straight into it; elsewhere they are packed in the
//! GPU's memory and copied.

use std::ops::Range;
use std::sync::Arc;

use sensor_gpu::{CopyBatch, DirectTarget, Gpu, HostMemory, Place, ShmTarget};

use crate::ray_scene::RayScene;
use gpu_scene::GpuScene;
use memory::{Growing, Memory};
use pipelines::{Pipelines, bind};
use scans::Way;
use shader::{BLOCK_RAYS, Dispatch, MAX_OUTPUTS};
use submission::{LidarWords, Submission};

mod gpu_scene;
mod memory;
mod pairs;
mod pipelines;
mod scans;
mod shader;
mod submission;

pub use gpu_scene::TooLarge;
pub use scans::{ScanOutcome, Scans};
pub use submission::ScanJob;

/// How the shader is built and used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuRayOptions {
    /// Width of a workgroup's block of 64 rays: a power of two up to 64.
    pub block_columns: u32,
    /// Rays after which a new group of lidars begins; a group is traced while the one before it is
    /// packed.
    pub group_rays: u32,
    /// Whether the shader writes straight into imported memory where it can.
    pub writes_directly: bool,
}

impl Default for GpuRayOptions {
    fn default() -> Self {
        GpuRayOptions {
            block_columns: 16,
            group_rays: 1 << 20,
            writes_directly: true,
        }
    }
}

/// Casts lidars on a GPU, one submission at a time: wait for its scans before the next one.
pub struct GpuRays {
    gpu: Gpu,
    options: GpuRayOptions,
    pipelines: Pipelines,
    gpu_scene: GpuScene,
    memory: Memory,
    /// Bind group of the scene and scratch memory; `None` after one of their buffers was replaced.
    bindings: Option<wgpu::BindGroup>,
}

/// Lidars that are traced by one dispatch and packed by the next, and the targets of their points;
/// no targets if the points are to be copied.
struct Group {
    lidars: Range<usize>,
    targets: Vec<Arc<ShmTarget>>,
}

impl GpuRays {
    /// What a GPU lacks for lidars, in a sentence; `None` if it lacks nothing.
    pub fn missing(gpu: &Gpu) -> Option<String> {
        pipelines::missing(gpu)
    }

    /// Builds the pipelines. Panics on a GPU for which [`GpuRays::missing`] names something.
    pub fn new(gpu: &Gpu, options: GpuRayOptions) -> Self {
        let block_columns = options.block_columns;
        if let Some(missing) = Self::missing(gpu) {
            panic!("{missing}");
        }
        assert!(
            block_columns.is_power_of_two() && block_columns <= BLOCK_RAYS,
            "blocks {block_columns} columns wide"
        );
        GpuRays {
            options,
            pipelines: Pipelines::new(gpu, block_columns),
            gpu_scene: GpuScene::new(gpu),
            memory: Memory::new(gpu),
            bindings: None,
            gpu: gpu.clone(),
        }
    }

    /// Uploads what changed in `scene`, which must have been loaded for the GPU. Call it after
    /// every [`RayScene::update`], [`RayScene::update_for_gpu`] or [`RayScene::hide`].
    ///
    /// # Errors
    /// If something of it is too large for the GPU. The GPU does not hold `scene` then, so the CPU
    /// has to cast.
    pub fn update(&mut self, scene: &RayScene) -> Result<(), TooLarge> {
        let updated = self.gpu_scene.update(&self.gpu, scene);
        // Buffers may have been replaced before an error was found.
        if updated != Ok(false) {
            self.bindings = None;
        }
        updated.map(drop)
    }

    /// Casts all jobs with one submission.
    ///
    /// Panics if a place is too small for a point per ray.
    pub fn scan<'p>(&mut self, jobs: Vec<ScanJob<'_, 'p>>) -> Scans<'p> {
        let mut submission = Submission::default();
        let mut places = Vec::with_capacity(jobs.len());
        for job in jobs {
            let (ages_nanos, swept_root) = self.gpu_scene.motion();
            places.push(submission.add(job, ages_nanos, swept_root));
        }
        if submission.lidars.is_empty() {
            return Scans(Way::None);
        }
        let writes_directly = self.options.writes_directly
            && places.iter().all(is_reachable)
            && self.memory.fit_host(&self.gpu, &submission);
        let groups = groups(
            &mut submission,
            &places,
            self.options.group_rays,
            writes_directly,
        );
        let mut encoder = self.gpu.encoder("lidars");
        if self
            .memory
            .upload(&self.gpu, &mut encoder, &mut submission, !writes_directly)
        {
            self.bindings = None;
        }
        self.gpu.mark(&mut encoder, "begin");
        let host = self.memory.host().filter(|_| writes_directly).cloned();
        self.record(&mut encoder, &submission, &groups, host.as_deref());
        if let Some(host) = host {
            let targets = groups
                .into_iter()
                .flat_map(|group| group.targets)
                .map(DirectTarget::from)
                .chain([host.target()])
                .collect();
            let flight = self.gpu.submit_direct(encoder, targets);
            return Scans(Way::Direct {
                flight,
                totals: host,
                n_jobs: places.len(),
            });
        }
        let mut batch = CopyBatch::new();
        let mut of_jobs = Vec::with_capacity(places.len());
        for (lidar, place) in submission.lidars.iter().zip(places) {
            let (begin, n_bytes) = (4 * lidar.first_word() as u64, lidar.n_bytes());
            of_jobs.push(
                (n_bytes > 0)
                    .then(|| batch.buffer(&self.memory.packed.buffer, begin, n_bytes, place)),
            );
        }
        batch.map_buffer(&self.memory.totals.buffer, 0, 4 * submission.lidars.len());
        let _uploaded = self.memory.host().cloned();
        Scans(Way::Copied {
            copies: batch.submit(&self.gpu, encoder),
            of_jobs,
            _uploaded,
        })
    }

    /// Records one dispatch per group: it traces the group and packs the one before it.
    fn record(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        submission: &Submission,
        groups: &[Group],
        host: Option<&HostMemory>,
    ) {
        let bindings = self.bindings.get_or_insert_with(|| {
            let (gpu_scene, memory) = (&self.gpu_scene, &self.memory);
            let scratch = [&memory.lidars, &memory.tables, &memory.points, &memory.kept]
                .map(|growing: &Growing| &growing.buffer);
            let buffers = [&gpu_scene.nodes, &gpu_scene.triangles, &gpu_scene.instances]
                .into_iter()
                .chain(scratch);
            bind(&self.gpu, &self.pipelines.scene, buffers)
        });
        let bindings = bindings.clone();
        for step in 0..=groups.len() {
            let (traced, packed) = (
                groups.get(step),
                step.checked_sub(1).map(|before| &groups[before]),
            );
            let (of_traced, of_packed) = (lidars_of(traced), lidars_of(packed));
            let dispatch = Dispatch {
                first_traced: of_traced.start as u32,
                n_traced: of_traced.len() as u32,
                first_packed: of_packed.start as u32,
                n_packed: of_packed.len() as u32,
                n_blocks: submission.lidars[of_traced]
                    .iter()
                    .map(|lidar| self.n_blocks(lidar))
                    .max()
                    .unwrap_or(0)
                    .max(1),
                n_chunks: submission.lidars[of_packed]
                    .iter()
                    .map(LidarWords::n_chunks)
                    .max()
                    .unwrap_or(0)
                    .max(1),
            };
            let outputs = self.bind_outputs(packed.or(traced), host);
            let (pipeline, label) = self.pipelines.of(&dispatch);
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &bindings, &[]);
            pass.set_bind_group(1, &outputs, &[]);
            pass.set_immediates(0, bytemuck::bytes_of(&dispatch));
            let [x, y, z] = dispatch.size();
            pass.dispatch_workgroups(x, y, z);
            drop(pass);
            self.gpu.counters().add_pass();
            self.gpu.mark(encoder, label);
        }
    }

    fn n_blocks(&self, lidar: &LidarWords) -> u32 {
        let columns = self.options.block_columns;
        lidar.n_channels().div_ceil(BLOCK_RAYS / columns) * lidar.n_columns().div_ceil(columns)
    }

    /// Binds where a group's points and their numbers go.
    fn bind_outputs(&self, group: Option<&Group>, host: Option<&HostMemory>) -> wgpu::BindGroup {
        let memory = &self.memory;
        let (totals, scratch) = match host {
            Some(host) => (host.buffer(), &memory.unused),
            None => (&memory.totals.buffer, &memory.packed.buffer),
        };
        let targets = group.map_or(&[][..], |group| &group.targets);
        let targets = targets.iter().map(|target| {
            target
                .storage()
                .expect("only reachable targets are written to")
        });
        let outputs = targets
            .chain(std::iter::once(scratch))
            .chain(std::iter::repeat(&memory.unused))
            .take(MAX_OUTPUTS);
        bind(
            &self.gpu,
            &self.pipelines.outputs,
            std::iter::once(totals).chain(outputs),
        )
    }
}

fn lidars_of(group: Option<&Group>) -> Range<usize> {
    group.map_or(0..0, |group| group.lidars.clone())
}

/// Whether a shader can write to a place.
fn is_reachable(place: &Place<'_>) -> bool {
    matches!(place, Place::Shm(place) if place.target().storage().is_some())
}

/// Splits lidars into groups of `group_rays` or a little more, and sets where each lidar's points
/// go.
fn groups(
    submission: &mut Submission,
    places: &[Place<'_>],
    group_rays: u32,
    writes_directly: bool,
) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    let mut n_rays = 0;
    for (i, (lidar, place)) in submission.lidars.iter_mut().zip(places).enumerate() {
        let target = match place {
            Place::Shm(place) if writes_directly => {
                let n_bytes = lidar.n_bytes();
                assert!(
                    n_bytes <= place.capacity_bytes(),
                    "{n_bytes} bytes do not fit {} bytes",
                    place.capacity_bytes()
                );
                Some((place.target(), place.offset_bytes() / 4))
            }
            _ => None,
        };
        let is_full = groups.last().is_none_or(|group| {
            let is_new = target.is_some_and(|(target, _)| {
                !group.targets.iter().any(|known| Arc::ptr_eq(known, target))
            });
            n_rays >= group_rays || is_new && group.targets.len() == MAX_OUTPUTS
        });
        if is_full {
            groups.push(Group {
                lidars: i..i,
                targets: Vec::new(),
            });
            n_rays = 0;
        }
        let group = groups.last_mut().expect("there is one by now");
        n_rays += lidar.n_rays();
        group.lidars.end = i + 1;
        let (output, first_word) = match target {
            Some((target, first_word)) => {
                let known = group
                    .targets
                    .iter()
                    .position(|known| Arc::ptr_eq(known, target));
                let output = known.unwrap_or_else(|| {
                    group.targets.push(target.clone());
                    group.targets.len() - 1
                });
                (output as u32, first_word as u32)
            }
            None => (0, lidar.first_word()),
        };
        lidar.send_to(output, first_word);
    }
    groups
}
