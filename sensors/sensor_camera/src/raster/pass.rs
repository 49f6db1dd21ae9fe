//! Pipelines and buffers of the computed rasteriser.

use sensor_gpu::Gpu;

use super::lists::{self, Lists};
use super::plan::{CHUNK, RasterBatch, RasterDraw, RasterJob, RasterPlan, RasterView, ViewLists};
use crate::assets::GpuAssets;
use crate::binding_layout::{grow, storage, uniform_at_offset, written_layers, written_storage};
use crate::bindings::{Bindings, Together};
use crate::camera_motion::NEAR_M;
use crate::target::Target;

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
    views: wgpu::Buffer,
    draws: wgpu::Buffer,
    chunks: wgpu::Buffer,
    seen: wgpu::Buffer,
    queue: wgpu::Buffer,
    arguments: wgpu::Buffer,
    batches: wgpu::Buffer,
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
        }
    }

    /// Whether an episode's meshes fit into lists that shaders can read.
    pub fn takes(gpu: &Gpu, assets: &GpuAssets) -> bool {
        let limit = gpu.device().limits().max_storage_buffer_binding_size;
        assets.vertices.size() <= limit && assets.indices.size() <= limit
    }

    /// Uploads the lists of all views.
    pub fn upload(
        &mut self,
        gpu: &Gpu,
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
            &mut self.draws,
            size_of::<RasterDraw>() as u64 * n_draws as u64,
        );
        grow(
            gpu,
            &mut self.chunks,
            size_of::<[u32; 2]>() as u64 * n_chunks as u64,
        );
        lists::write(
            gpu,
            &Lists {
                instances,
                draws: &self.draws,
                chunks: &self.chunks,
            },
            jobs,
            &plan.views,
        );
        self.write(gpu, &mut plan, &views);
        plan
    }

    fn write(&mut self, gpu: &Gpu, plan: &mut RasterPlan, views: &[RasterView]) {
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
            gpu.queue().write_buffer(
                &self.batches,
                i as u64 * BATCH_STRIDE_BYTES,
                bytemuck::bytes_of(batch),
            );
        }
        grow(gpu, &mut self.views, size_of_val(views) as u64);
        gpu.queue()
            .write_buffer(&self.views, 0, bytemuck::cast_slice(views));
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
        let group = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("raster"),
            layout: &self.layout,
            entries: &entries,
        });
        let arguments = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("raster arguments"),
            layout: &self.arguments_layout,
            entries: &[whole(0, &self.arguments)],
        });
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
        let entries: Vec<_> = (0..)
            .zip(lists)
            .map(|(binding, buffer)| whole(binding, buffer))
            .collect();
        gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("seen"),
            layout: &self.lists_layout,
            entries: &entries,
        })
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
        let images = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("resolved images"),
            layout: &self.images_layout,
            entries: &entries,
        });
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
