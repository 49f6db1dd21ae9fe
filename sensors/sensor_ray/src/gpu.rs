//! Lidars on the GPU: the hierarchies that the CPU walks, walked by a compute shader, many lidars to a submission.
//!
//! Hits are made exact in `f64` there too, noise and drop-off come from the same integers, and points are packed in the same order, so that
//! frames agree with the CPU's to a rounding of the last step (`exp`, the normal deviate).

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use schema_types::noise::Noise;
use schema_types::{ActorId, ObjectId};
use sensor_gpu::{CopyBatch, Gpu, GpuError, InFlight, Place};
use sensor_spec::LidarSpec;

use crate::lidar::{Lidar, SensorPath, column_poses};
use crate::points::keep_limit;
use crate::scene::RayScene;
use world::World;

pub(crate) mod pack;
mod world;

/// Rays whose returns are counted together, as in the shader.
const CHUNK_RAYS: u32 = 1024;
/// Entries of the shader's stack: one for each level of the deepest mesh and two for each level of the hierarchy over instances.
const STACK_ENTRIES: u32 = 32;
/// Rays of a workgroup.
const BLOCK_RAYS: u32 = 64;

/// One lidar's frame to be made.
#[derive(Debug)]
pub struct ScanJob<'l, 'p> {
    /// The lidar, its head turned.
    pub lidar: &'l mut Lidar,
    /// Where it was.
    pub path: SensorPath,
    /// Key (seed, sensor, tick).
    pub noise: Noise,
    /// Rays pass through the parts of this actor.
    pub ignored: Option<ActorId>,
    /// Where the points go: room for a point per ray.
    pub place: Place<'p>,
}

/// What became of a scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScanOutcome {
    /// Points at the front of the place; bytes behind them mean nothing.
    pub n_points: u32,
    /// Copies by the CPU: 0 into imported memory, else 1.
    pub cpu_copies: u32,
}

/// Scans on their way.
#[derive(Debug)]
#[must_use = "the points are there only after wait()"]
pub struct Scans<'p> {
    copies: Option<InFlight<'p>>,
    /// Which copy is a job's; `None` for a job without rays.
    of_jobs: Vec<Option<usize>>,
}

impl Scans<'_> {
    /// Waits until the points are where they belong; one outcome per job, in order.
    ///
    /// # Errors
    /// The device was lost.
    pub fn wait(self) -> Result<Vec<ScanOutcome>, GpuError> {
        let Some(copies) = self.copies else { return Ok(Vec::new()) };
        let outcomes = copies.wait_awake()?;
        let totals = outcomes.last().and_then(|outcome| outcome.mapped.as_ref()).expect("the last copy is that of the totals");
        let totals: Vec<u32> = bytemuck::pod_collect_to_vec(totals.row(0));
        let scan = |(copy, n_points): (&Option<usize>, &u32)| ScanOutcome {
            n_points: *n_points,
            cpu_copies: copy.map_or(0, |copy| outcomes[copy].cpu_copies),
        };
        Ok(self.of_jobs.iter().zip(&totals).map(scan).collect())
    }
}

/// A lidar as the shader reads it.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct LidarWords {
    shape: [u32; 4],
    place: [u32; 4],
    what: [u32; 4],
    noise: [u32; 4],
    range: [f32; 4],
    loss: [f32; 4],
}

/// A buffer that grows.
struct Growing {
    label: &'static str,
    usage: wgpu::BufferUsages,
    buffer: wgpu::Buffer,
}

impl Growing {
    fn new(gpu: &Gpu, label: &'static str, usage: wgpu::BufferUsages) -> Self {
        Growing { label, usage, buffer: gpu.buffer(label, 256, usage) }
    }

    /// Makes room for `n_bytes` and says whether the buffer is another one.
    fn fit(&mut self, gpu: &Gpu, n_bytes: u64) -> bool {
        if self.buffer.size() >= n_bytes {
            return false;
        }
        self.buffer = gpu.buffer(self.label, n_bytes.next_power_of_two(), self.usage);
        true
    }
}

/// How the shader is built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuRayOptions {
    /// Width of a workgroup's block of 64 rays: a power of two up to 64.
    pub block_columns: u32,
}

impl Default for GpuRayOptions {
    fn default() -> Self {
        GpuRayOptions { block_columns: 16 }
    }
}

/// Casts lidars on a GPU. One submission at a time: wait for the scans before the next ones.
pub struct GpuRays {
    gpu: Gpu,
    layout: wgpu::BindGroupLayout,
    trace: wgpu::ComputePipeline,
    pack: wgpu::ComputePipeline,
    block_columns: u32,
    world: World,
    lidars: Growing,
    tables: Growing,
    points: Growing,
    kept: Growing,
    packed: Growing,
    totals: Growing,
    bindings: Option<wgpu::BindGroup>,
}

impl GpuRays {
    /// Whether an adapter can do it: its shaders count in `f64` and `u64`.
    pub fn is_supported(gpu: &Gpu) -> bool {
        gpu.has_wide_numbers()
    }

    /// Pipelines on a GPU that supports it.
    pub fn new(gpu: &Gpu, options: GpuRayOptions) -> Self {
        let block_columns = options.block_columns;
        assert!(Self::is_supported(gpu), "{} has no f64 or u64 in shaders", gpu.name());
        assert!(block_columns.is_power_of_two() && block_columns <= BLOCK_RAYS, "blocks {block_columns} columns wide");
        let (layout, trace, pack) = pipelines(gpu, options);
        use wgpu::BufferUsages as U;
        let buffer = |label, usage| Growing::new(gpu, label, usage | U::STORAGE);
        GpuRays {
            layout,
            trace,
            pack,
            block_columns,
            world: World::new(gpu),
            lidars: buffer("lidars", U::COPY_DST),
            tables: buffer("lidar beams", U::COPY_DST),
            points: buffer("lidar points", U::empty()),
            kept: buffer("lidar returns per chunk", U::COPY_DST),
            packed: buffer("packed lidar points", U::COPY_SRC),
            totals: buffer("lidar returns", U::COPY_SRC),
            bindings: None,
            gpu: gpu.clone(),
        }
    }

    /// Brings the GPU's world to the state of `scene`, which was loaded for the GPU. Call it after every [`RayScene::update`].
    ///
    /// False if a hierarchy is too deep for the shader's stack: then the GPU's world is not that of `scene`, and the CPU has to cast.
    #[must_use]
    pub fn update(&mut self, scene: &RayScene) -> bool {
        let Some(has_new_buffers) = self.world.update(&self.gpu, scene) else { return false };
        if has_new_buffers {
            self.bindings = None;
        }
        true
    }

    /// Casts all jobs with one submission.
    ///
    /// Panics if a place is too small for a point per ray.
    pub fn scan<'p>(&mut self, jobs: Vec<ScanJob<'_, 'p>>) -> Scans<'p> {
        let mut frame = Frame::default();
        let mut places = Vec::with_capacity(jobs.len());
        for job in jobs {
            places.push(frame.add(job));
        }
        let n_lidars = frame.lidars.len();
        if n_lidars == 0 {
            return Scans { copies: None, of_jobs: Vec::new() };
        }
        self.upload(&frame);
        let mut encoder = self.gpu.encoder("lidars");
        encoder.clear_buffer(&self.kept.buffer, 0, None);
        let bindings = self.bindings.get_or_insert_with(|| {
            let world = &self.world;
            let scratch = [&self.lidars, &self.tables, &self.points, &self.kept, &self.packed, &self.totals].map(|b| &b.buffer);
            let buffers = [&world.nodes, &world.triangles, &world.instances].into_iter().chain(scratch);
            let entries: Vec<_> = buffers
                .enumerate()
                .map(|(i, buffer)| wgpu::BindGroupEntry { binding: i as u32, resource: buffer.as_entire_binding() })
                .collect();
            self.gpu.device().create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout: &self.layout, entries: &entries })
        });
        let blocks =
            |lidar: &LidarWords| lidar.shape[0].div_ceil(BLOCK_RAYS / self.block_columns) * lidar.shape[1].div_ceil(self.block_columns);
        let n_blocks = frame.lidars.iter().map(blocks).max().unwrap_or(0);
        let n_chunks = frame.lidars.iter().map(|lidar| lidar.noise[2]).max().unwrap_or(0);
        self.gpu.mark(&mut encoder, "begin");
        for (label, pipeline, n_groups) in [("lidar trace", &self.trace, n_blocks), ("lidar pack", &self.pack, n_chunks)] {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_bind_group(0, &*bindings, &[]);
            pass.set_pipeline(pipeline);
            pass.dispatch_workgroups(n_groups, n_lidars as u32, 1);
            drop(pass);
            self.gpu.counters().add_pass();
            self.gpu.mark(&mut encoder, label);
        }
        let mut batch = CopyBatch::new();
        let mut of_jobs = Vec::with_capacity(n_lidars);
        for (lidar, place) in frame.lidars.iter().zip(places) {
            let n_bytes = 4 * (lidar.noise[3] * lidar.shape[0] * lidar.shape[1]) as usize;
            of_jobs.push((n_bytes > 0).then(|| batch.buffer(&self.packed.buffer, 4 * lidar.place[2] as u64, n_bytes, place)));
        }
        batch.map_buffer(&self.totals.buffer, 0, 4 * n_lidars);
        Scans { copies: Some(batch.submit(&self.gpu, encoder)), of_jobs }
    }

    fn upload(&mut self, frame: &Frame) {
        let (lidars, tables): (&[u8], &[u8]) = (bytemuck::cast_slice(&frame.lidars), bytemuck::cast_slice(&frame.tables));
        let points_bytes = 4 * frame.n_words as u64;
        let mut is_new = self.lidars.fit(&self.gpu, lidars.len() as u64);
        is_new |= self.tables.fit(&self.gpu, tables.len() as u64);
        is_new |= self.points.fit(&self.gpu, points_bytes);
        is_new |= self.packed.fit(&self.gpu, points_bytes);
        is_new |= self.kept.fit(&self.gpu, 4 * frame.n_chunks as u64);
        is_new |= self.totals.fit(&self.gpu, 4 * frame.lidars.len() as u64);
        if is_new {
            self.bindings = None;
        }
        self.gpu.queue().write_buffer(&self.lidars.buffer, 0, lidars);
        self.gpu.queue().write_buffer(&self.tables.buffer, 0, tables);
    }
}

fn pipelines(gpu: &Gpu, options: GpuRayOptions) -> (wgpu::BindGroupLayout, wgpu::ComputePipeline, wgpu::ComputePipeline) {
    let entry = |binding: u32| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Storage { read_only: binding < 5 },
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    };
    let entries: Vec<_> = (0..9).map(entry).collect();
    let layout = gpu.device().create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("lidars"), entries: &entries });
    let of_pipeline = gpu.device().create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("lidars"),
        bind_group_layouts: &[Some(&layout)],
        immediate_size: 0,
    });
    // SAFETY: nodes, triangles and instances are numbered by `pack` and `world`, which fill the buffers; rays, chunks and words by `Frame`,
    // after which the buffers are sized; a walk visits a node once, its stack holds what [`GpuRays::update`] lets through, and all other
    // loops count bits or lanes.
    #[expect(unsafe_code, reason = "checks of indices and loops cost a part of the rays per second; the block carries its proof")]
    let shader = unsafe { gpu.shader_unchecked("lidars", include_str!("gpu/lidar.wgsl")) };
    let pipeline = |entry_point: &str, constants: &[(&str, f64)]| {
        gpu.device().create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry_point),
            layout: Some(&of_pipeline),
            module: &shader,
            entry_point: Some(entry_point),
            compilation_options: wgpu::PipelineCompilationOptions { constants, zero_initialize_workgroup_memory: false },
            cache: None,
        })
    };
    let trace = pipeline("trace", &[("block_columns", options.block_columns as f64)]);
    let pack = pipeline("pack", &[]);
    (layout, trace, pack)
}

/// What is uploaded for one submission.
#[derive(Default)]
struct Frame {
    lidars: Vec<LidarWords>,
    tables: Vec<[f32; 4]>,
    n_words: u32,
    n_chunks: u32,
}

impl Frame {
    /// Adds a job and returns where its points go.
    fn add<'p>(&mut self, job: ScanJob<'_, 'p>) -> Place<'p> {
        let ScanJob { lidar, path, noise, ignored, place } = job;
        let spec = lidar.spec().clone();
        let beams = lidar.aim();
        let (n_channels, n_columns) = (beams.elevations.len() as u32, beams.azimuths.len() as u32);
        let first_elevation = self.tables.len() as u32;
        self.tables.extend(beams.elevations.iter().map(pair_of_pairs));
        let first_azimuth = self.tables.len() as u32;
        self.tables.extend(beams.azimuths.iter().map(pair_of_pairs));
        let poses = column_poses(&spec, &path, n_columns as usize);
        let first_pose = self.tables.len() as u32;
        for pose in &poses {
            self.tables.extend(rows(&pose.world_from_sensor, &pose.origin_m.coords));
        }
        let (n_rays, point_words) = (n_channels * n_columns, if spec.semantic { 6 } else { 4 });
        let n_chunks = n_rays.div_ceil(CHUNK_RAYS).max(1);
        let ignored = ignored.map_or(0, |actor| ObjectId::from(actor).0);
        let misfires = misfires(&spec);
        let key = noise.key();
        let [range_high, range_low] = pair(spec.range_m);
        self.lidars.push(LidarWords {
            shape: [n_channels, n_columns, first_elevation, first_azimuth],
            place: [first_pose, poses.len() as u32, self.n_words, self.n_chunks],
            what: [spec.semantic as u32, ignored, misfires as u32, (misfires >> 32) as u32],
            noise: [key as u32, (key >> 32) as u32, n_chunks, point_words],
            range: [range_high, range_low, spec.attenuation_per_m as f32, spec.noise_range_stddev_m as f32],
            loss: [keep_limit(&spec) as f32, spec.dropoff_intensity_limit as f32, spec.dropoff_zero_intensity_ratio as f32, 0.0],
        });
        self.n_words += n_rays * point_words;
        self.n_chunks += n_chunks;
        place
    }
}

/// Numerator over 2⁵³ below which a uniform number loses a ray: `k/2⁵³ < ratio` exactly if `k` is below it.
fn misfires(spec: &LidarSpec) -> u64 {
    if spec.semantic { 0 } else { (spec.dropoff_general_ratio * (1u64 << 53) as f64).ceil() as u64 }
}

/// A number as the sum of two `f32`.
fn pair(x: f64) -> [f32; 2] {
    let high = x as f32;
    [high, (x - high as f64) as f32]
}

fn pair_of_pairs((cos, sin): &(f64, f64)) -> [f32; 4] {
    let ([a, b], [c, d]) = (pair(*cos), pair(*sin));
    [a, b, c, d]
}

/// Rows of a turn with a shift in w: high parts, then low parts.
fn rows(turn: &Matrix3<f64>, shift: &Vector3<f64>) -> [[f32; 4]; 6] {
    let mut rows = [[0.0; 4]; 6];
    for i in 0..3 {
        for (j, x) in [turn[(i, 0)], turn[(i, 1)], turn[(i, 2)], shift[i]].into_iter().enumerate() {
            [rows[i][j], rows[i + 3][j]] = pair(x);
        }
    }
    rows
}

/// The same of a pose.
fn rows_of(pose: &Isometry3<f64>) -> [[f32; 4]; 6] {
    rows(pose.rotation.to_rotation_matrix().matrix(), &pose.translation.vector)
}

/// The pose that shifts a point to the origin.
fn shift_from(origin_m: &Point3<f64>) -> Isometry3<f64> {
    Isometry3::translation(-origin_m.x, -origin_m.y, -origin_m.z)
}
