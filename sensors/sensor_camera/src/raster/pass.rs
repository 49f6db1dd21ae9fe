//! Pipelines and buffers of the computed rasteriser.

use sensor_gpu::{Gpu, Uploads};

use super::chunks::ChunkPass;
use super::lists::{self, Lists};
use super::plan::{CHUNK, RasterBatch, RasterDraw, RasterJob, RasterPlan, RasterView, ViewLists};
use super::stills::StillPass;
use crate::assets::GpuAssets;
use crate::binding_layout::{grow, storage, uniform_at_offset, written_layers, written_storage};
use crate::bindings::{Bindings, Together};
use crate::camera_motion::NEAR_M;
use crate::kept_groups::KeptGroups;
use crate::target::Target;
use crate::visible::StillAs;

/// Text of the rasterising shader.
pub(crate) fn raster_wgsl() -> String {
    include_str!("../shader/raster.wgsl").to_owned()
}

/// Text of the resolving shader.
pub(crate) fn resolve_wgsl() -> String {
    [
        include_str!("../shader/scene.wgsl"),
        include_str!("../shader/bound.wgsl"),
        include_str!("../shader/view_computed.wgsl"),
        include_str!("../shader/instance_storage.wgsl"),
        include_str!("../shader/surface_wide.wgsl"),
        include_str!("../shader/surface.wgsl"),
        include_str!("../shader/resolve.wgsl"),
        include_str!("../shader/resolve_compute.wgsl"),
    ]
    .concat()
}

/// Text of the shader whose functions `sensor_shade` has for processors, for one view.
pub(crate) fn resolve_lanes_wgsl() -> String {
    [
        include_str!("../shader/scene.wgsl"),
        include_str!("../shader/bound.wgsl"),
        include_str!("../shader/view_drawn.wgsl"),
        include_str!("../shader/instance_storage.wgsl"),
        include_str!("../shader/surface_wide.wgsl"),
        include_str!("../shader/surface.wgsl"),
        include_str!("../shader/resolve.wgsl"),
    ]
    .concat()
}

/// Limit of workgroups across a dispatch.
const MAX_ACROSS: u32 = 32_768;
/// Room for tiles in the queue; when it is full, one workgroup fills a whole triangle.
const MAX_TILES: u32 = 1 << 20;
/// Limit of the pixels of a batch: they are rasterised, then resolved, before the next batch.
const MAX_PIXELS: u64 = 1 << 26;
const SEEN_BYTES: u64 = 8;
const ITEM_BYTES: u64 = 16;
const QUEUE_HEAD_BYTES: u64 = 16;
const BATCH_STRIDE_BYTES: u64 = 256;

/// Pipelines and lists.
#[derive(Debug)]
pub(crate) struct RasterPass {
    layout: wgpu::BindGroupLayout,
    arguments_layout: wgpu::BindGroupLayout,
    small: wgpu::ComputePipeline,
    arguments_of: wgpu::ComputePipeline,
    tiles: wgpu::ComputePipeline,
    lists_layout: wgpu::BindGroupLayout,
    images_layout: wgpu::BindGroupLayout,
    resolve: wgpu::ComputePipeline,
    chunking: ChunkPass,
    /// Present where shaders have `f64`.
    stills: Option<StillPass>,
    views: wgpu::Buffer,
    /// Numbers of static instances that views see.
    numbers: wgpu::Buffer,
    draws: wgpu::Buffer,
    chunks: wgpu::Buffer,
    seen: wgpu::Buffer,
    queue: wgpu::Buffer,
    arguments: wgpu::Buffer,
    batches: wgpu::Buffer,
    kept: [KeptGroups; 3],
}

impl RasterPass {
    pub fn new(gpu: &Gpu, bindings: &Bindings) -> Self {
        let device = gpu.device();
        let compute = |mut entry: wgpu::BindGroupLayoutEntry| {
            entry.visibility = wgpu::ShaderStages::COMPUTE;
            entry
        };
        let mut entries: Vec<_> = (0..6).map(storage).collect();
        entries.extend([
            written_storage(6),
            written_storage(7),
            uniform_at_offset(8, size_of::<RasterBatch>() as u64),
        ]);
        let entries: Vec<_> = entries.into_iter().map(compute).collect();
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("raster"),
            entries: &entries,
        });
        let descriptor = wgpu::BindGroupLayoutDescriptor {
            label: Some("raster arguments"),
            entries: &[compute(written_storage(0))],
        };
        let arguments_layout = device.create_bind_group_layout(&descriptor);
        let layout_of = |layouts: &[Option<&wgpu::BindGroupLayout>]| {
            let descriptor = wgpu::PipelineLayoutDescriptor {
                label: Some("raster"),
                bind_group_layouts: layouts,
                immediate_size: 0,
            };
            device.create_pipeline_layout(&descriptor)
        };
        let (lists_only, with_arguments) = (
            layout_of(&[Some(&layout)]),
            layout_of(&[Some(&layout), Some(&arguments_layout)]),
        );
        let shader = gpu.shader("raster", &raster_wgsl());
        let pipeline = |entry_point, layout| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry_point),
                layout: Some(layout),
                module: &shader,
                entry_point: Some(entry_point),
                compilation_options: Default::default(),
                cache: None,
            })
        };
        let lists: Vec<_> = (0..4).map(|binding| compute(storage(binding))).collect();
        let lists_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("seen"),
            entries: &lists,
        });
        let images: Vec<_> = (0..)
            .zip(Target::DRAWN)
            .map(|(binding, target)| written_layers(binding, target.format()))
            .collect();
        let images_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("resolved images"),
            entries: &images,
        });
        let resolve_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("resolve"),
            bind_group_layouts: &[
                Some(&bindings.scene_layout),
                Some(&bindings.views_layout),
                Some(&lists_layout),
                Some(&images_layout),
            ],
            immediate_size: 0,
        });
        let resolve = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("resolve"),
            layout: Some(&resolve_layout),
            module: &gpu.shader("resolve", &resolve_wgsl()),
            entry_point: Some("cs_resolve"),
            compilation_options: Default::default(),
            cache: None,
        });
        let list = |label, n_bytes| {
            gpu.buffer(
                label,
                n_bytes,
                wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            )
        };
        RasterPass {
            small: pipeline("cs_small", &lists_only),
            arguments_of: pipeline("cs_arguments", &with_arguments),
            tiles: pipeline("cs_tiles", &lists_only),
            layout,
            arguments_layout,
            lists_layout,
            images_layout,
            resolve,
            chunking: ChunkPass::new(gpu),
            stills: StillPass::new(gpu),
            numbers: list("numbers of stills", 4),
            views: list("raster views", size_of::<RasterView>() as u64),
            draws: list("raster draws", size_of::<RasterDraw>() as u64),
            chunks: list("raster chunks", 8),
            seen: list("seen", SEEN_BYTES),
            queue: list(
                "raster queue",
                QUEUE_HEAD_BYTES + ITEM_BYTES * MAX_TILES as u64,
            ),
            arguments: gpu.buffer(
                "raster arguments",
                12,
                wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::INDIRECT,
            ),
            batches: gpu.buffer(
                "raster batches",
                BATCH_STRIDE_BYTES,
                wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            ),
            kept: std::array::from_fn(|_| KeptGroups::up_to(1)),
        }
    }

    /// Forgets what it bound, meshes above all, so that they can go.
    pub fn forget(&self) {
        self.kept.iter().for_each(KeptGroups::clear);
        self.stills.iter().for_each(StillPass::forget);
    }

    /// Whether an episode's meshes fit into lists that shaders can read.
    pub fn takes(gpu: &Gpu, assets: &GpuAssets) -> bool {
        let limit = gpu.device().limits().max_storage_buffer_binding_size;
        assets.vertices.size() <= limit && assets.indices.size() <= limit
    }

    /// How it wants static instances of these meshes.
    pub fn still_as(&self, assets: &GpuAssets) -> StillAs {
        match (&self.stills, &assets.stills) {
            (Some(_), Some(_)) => StillAs::Numbers,
            _ => StillAs::Instances,
        }
    }

    /// Uploads the lists of all views, and records how they become longer ones.
    pub fn upload(
        &mut self,
        gpu: &Gpu,
        uploads: &mut Uploads,
        encoder: &mut wgpu::CommandEncoder,
        assets: &GpuAssets,
        jobs: &[RasterJob<'_>],
        instances: &wgpu::Buffer,
    ) -> RasterPlan {
        let limit = gpu.device().limits().max_storage_buffer_binding_size / SEEN_BYTES;
        let max_pixels = limit.min(MAX_PIXELS);
        let mut plan = RasterPlan::default();
        let mut views = Vec::with_capacity(jobs.len());
        let (mut n_draws, mut n_chunks) = (0, 0);
        for job in jobs {
            let n_pixels = job.size_px[0] as u64 * job.size_px[1] as u64;
            if plan
                .n_pixels
                .last()
                .is_none_or(|before| before + n_pixels > max_pixels)
            {
                plan.batches.push(RasterBatch {
                    first_chunk: n_chunks,
                    n_chunks: 0,
                    n_across: 0,
                    max_tiles: MAX_TILES,
                });
                plan.n_pixels.push(0);
            }
            let batch = plan.batches.len() - 1;
            let first_pixel = plan.n_pixels[batch] as u32;
            plan.n_pixels[batch] += n_pixels;
            views.push(RasterView {
                lens_px: job.lens_px,
                size_px: job.size_px,
                first_pixel,
                near_m: NEAR_M as f32,
            });
            let n_calls = job.drawn.calls.len() as u32;
            plan.views.push(ViewLists {
                batch,
                first_draw: n_draws,
                n_draws: n_calls,
                first_chunk: n_chunks,
                first_pixel,
            });
            n_draws += n_calls;
            n_chunks += lists::n_chunks(job.drawn);
            plan.batches[batch].n_chunks = n_chunks - plan.batches[batch].first_chunk;
            gpu.counters()
                .add_draws(n_calls as u64, job.drawn.n_triangles as u64);
        }
        grow(
            gpu,
            &mut self.chunks,
            size_of::<[u32; 2]>() as u64 * n_chunks as u64,
        );
        let lists = Lists {
            instances,
            numbers: &mut self.numbers,
            draws: &mut self.draws,
        };
        lists::write(gpu, uploads, encoder, lists, jobs, &plan.views);
        self.write(gpu, uploads, encoder, &mut plan, &views);
        self.expand(gpu, (uploads, encoder), assets, jobs, instances);
        plan
    }

    /// Makes the instances that stand still and the chunks of draw calls, both at once.
    fn expand(
        &mut self,
        gpu: &Gpu,
        (uploads, encoder): (&mut Uploads, &mut wgpu::CommandEncoder),
        assets: &GpuAssets,
        jobs: &[RasterJob<'_>],
        instances: &wgpu::Buffer,
    ) {
        let n_draws: usize = jobs.iter().map(|job| job.drawn.calls.len()).sum();
        if n_draws == 0 {
            return;
        }
        let still = self.stills.as_mut().zip(assets.stills.as_ref());
        let still = still.and_then(|(pass, stills)| {
            let groups = pass.upload(gpu, (&mut *uploads, &mut *encoder), jobs)?;
            Some((pass, stills, groups))
        });
        let groups = self
            .chunking
            .upload((uploads, &mut *encoder), n_draws as u32);
        gpu.counters().add_pass();
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("lists"),
            timestamp_writes: None,
        });
        if let Some((still, stills, groups)) = still {
            let lists = [stills, &self.numbers, instances];
            still.dispatch(gpu, &mut pass, lists, groups);
        }
        let lists = [&self.draws, &self.chunks];
        self.chunking.dispatch(gpu, &mut pass, lists, groups);
    }

    fn write(
        &mut self,
        gpu: &Gpu,
        uploads: &mut Uploads,
        encoder: &mut wgpu::CommandEncoder,
        plan: &mut RasterPlan,
        views: &[RasterView],
    ) {
        let mut most_chunks = 0;
        grow(
            gpu,
            &mut self.batches,
            BATCH_STRIDE_BYTES * plan.batches.len() as u64,
        );
        for (i, batch) in plan.batches.iter_mut().enumerate() {
            batch.n_across = batch
                .n_chunks
                .div_ceil(batch.n_chunks.div_ceil(MAX_ACROSS).max(1));
            most_chunks = most_chunks.max(batch.n_chunks);
            let offset = i as u64 * BATCH_STRIDE_BYTES;
            uploads.write(encoder, &self.batches, offset, bytemuck::bytes_of(batch));
        }
        grow(gpu, &mut self.views, size_of_val(views) as u64);
        uploads.write(encoder, &self.views, 0, bytemuck::cast_slice(views));
        let most_pixels = plan.n_pixels.iter().copied().max().unwrap_or(0);
        if self.seen.size() < SEEN_BYTES * most_pixels {
            self.seen = gpu.buffer("seen", SEEN_BYTES * most_pixels, self.seen.usage());
        }
        // Every triangle may need an entry after those of the tiles.
        let items = MAX_TILES as u64 + CHUNK as u64 * most_chunks as u64;
        grow(gpu, &mut self.queue, QUEUE_HEAD_BYTES + ITEM_BYTES * items);
    }

    /// Records the rasterising of one batch; the list holds what its views see until the next batch
    /// is recorded.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        assets: &GpuAssets,
        instances: &wgpu::Buffer,
        plan: &RasterPlan,
        batch_idx: usize,
    ) {
        let batch = &plan.batches[batch_idx];
        encoder.clear_buffer(&self.seen, 0, Some(SEEN_BYTES * plan.n_pixels[batch_idx]));
        if batch.n_chunks == 0 {
            return;
        }
        encoder.clear_buffer(&self.queue, 0, Some(QUEUE_HEAD_BYTES));
        let size = std::num::NonZeroU64::new(size_of::<RasterBatch>() as u64);
        let lists = [
            &self.views,
            instances,
            &self.draws,
            &self.chunks,
            &assets.vertices,
            &assets.indices,
            &self.seen,
            &self.queue,
        ];
        let mut entries: Vec<_> = (0..)
            .zip(lists)
            .map(|(binding, buffer)| whole(binding, buffer))
            .collect();
        let resource = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &self.batches,
            offset: 0,
            size,
        });
        entries.push(wgpu::BindGroupEntry {
            binding: 8,
            resource,
        });
        let [kept, kept_arguments, _] = &self.kept;
        let group = kept.bind(gpu, "raster", &self.layout, &entries);
        let arguments = kept_arguments.bind_whole(
            gpu,
            "raster arguments",
            &self.arguments_layout,
            &[&self.arguments],
        );
        let offset = [(batch_idx as u64 * BATCH_STRIDE_BYTES) as u32];
        let mut run = |pipeline: &wgpu::ComputePipeline,
                       arguments: Option<&wgpu::BindGroup>,
                       groups: Option<[u32; 2]>| {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("raster"),
                timestamp_writes: None,
            });
            gpu.counters().add_pass();
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group, &offset);
            if let Some(arguments) = arguments {
                pass.set_bind_group(1, arguments, &[]);
            }
            match groups {
                Some([across, down]) => pass.dispatch_workgroups(across, down, 1),
                None => pass.dispatch_workgroups_indirect(&self.arguments, 0),
            }
        };
        run(
            &self.small,
            None,
            Some([batch.n_across, batch.n_chunks.div_ceil(batch.n_across)]),
        );
        run(&self.arguments_of, Some(&arguments), Some([1, 1]));
        run(&self.tiles, None, None);
    }

    /// Bind group of what resolving reads of all views.
    pub fn bind_lists(&self, gpu: &Gpu, assets: &GpuAssets) -> wgpu::BindGroup {
        let lists = [&self.draws, &assets.vertices, &assets.indices, &self.seen];
        let [.., kept] = &self.kept;
        kept.bind_whole(gpu, "seen", &self.lists_layout, &lists)
    }

    /// Records the writing of targets from what views see.
    pub fn resolve(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::ComputePass<'_>,
        [scene, bound, lists]: [&wgpu::BindGroup; 3],
        views: &Together<'_>,
    ) {
        let (targets, set) = (views.targets, views.kept);
        let images = (0..)
            .zip(Target::DRAWN)
            .map(|(binding, target)| (binding, targets.get_or_nowhere(target, set)));
        let entries: Vec<_> = images
            .map(|(binding, view)| wgpu::BindGroupEntry {
                binding,
                resource: wgpu::BindingResource::TextureView(view),
            })
            .collect();
        let kept = &targets.groups;
        let images = kept.bind(gpu, "resolved images", &self.images_layout, &entries);
        let [width, height] = targets.size_px(set);
        pass.set_pipeline(&self.resolve);
        pass.set_bind_group(0, scene, &[]);
        pass.set_bind_group(1, bound, &[Bindings::offset_of(views.first)]);
        pass.set_bind_group(2, lists, &[]);
        pass.set_bind_group(3, &images, &[]);
        pass.dispatch_workgroups(width.div_ceil(16), height.div_ceil(8), views.n as u32);
    }
}

fn whole(binding: u32, buffer: &wgpu::Buffer) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry {
        binding,
        resource: buffer.as_entire_binding(),
    }
}
