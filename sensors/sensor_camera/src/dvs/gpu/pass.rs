//! The passes of an event camera on the GPU.

use sensor_gpu::{Gpu, HostMemory, prefix_sum_wgsl};

use super::camera::GpuEventCamera;
use super::job::{EventJob, JOB_BYTES};
use super::list::EventList;
use crate::binding_layout::{storage, texture, uniform_at_offset, written_storage};
use crate::target::{Target, TargetLayer};

/// Text of the shader.
pub(crate) fn events_wgsl() -> String {
    prefix_sum_wgsl(256) + include_str!("../../shader/events.wgsl")
}

/// Pipelines.
pub(crate) struct EventPass {
    common: wgpu::BindGroupLayout,
    written: wgpu::BindGroupLayout,
    read: wgpu::BindGroupLayout,
    levels: wgpu::ComputePipeline,
    begin: wgpu::ComputePipeline,
    scatter: wgpu::ComputePipeline,
    before: wgpu::ComputePipeline,
    follow: wgpu::ComputePipeline,
    place: wgpu::ComputePipeline,
}

impl std::fmt::Debug for EventPass {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("EventPass")
    }
}

impl EventPass {
    /// Whether an adapter has the needed features.
    pub fn is_supported(gpu: &Gpu) -> bool {
        let wanted = wgpu::Features::SHADER_INT64 | wgpu::Features::SHADER_INT64_ATOMIC_MIN_MAX;
        let has_room = gpu.device().limits().max_storage_buffers_per_shader_stage >= 14;
        gpu.device().features().contains(wanted) && has_room && gpu.can_write_directly()
    }

    pub fn new(gpu: &Gpu) -> Self {
        let image = |binding, is_float| {
            let kind = if is_float {
                wgpu::TextureSampleType::Float { filterable: false }
            } else {
                wgpu::TextureSampleType::Uint
            };
            texture(binding, kind)
        };
        let images = [
            image(1, true),
            image(2, true),
            image(3, true),
            image(4, false),
            image(5, false),
        ];
        let mut common = vec![uniform_at_offset(0, size_of::<EventJob>() as u64)];
        common.extend(images);
        common.extend((6..18).map(written_storage));
        let common = layout(gpu, common);
        let written = layout(gpu, vec![written_storage(0), written_storage(1)]);
        let read = layout(gpu, vec![storage(0), storage(1)]);
        let shader = gpu.shader("events", &events_wgsl());
        let pipeline = |entry_point: &str, second: Option<&wgpu::BindGroupLayout>| {
            let layouts: Vec<Option<&wgpu::BindGroupLayout>> = [Some(&common), second]
                .into_iter()
                .filter(Option::is_some)
                .collect();
            let descriptor = wgpu::PipelineLayoutDescriptor {
                label: Some("events"),
                bind_group_layouts: &layouts,
                immediate_size: 0,
            };
            gpu.device()
                .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(entry_point),
                    layout: Some(&gpu.device().create_pipeline_layout(&descriptor)),
                    module: &shader,
                    entry_point: Some(entry_point),
                    compilation_options: wgpu::PipelineCompilationOptions {
                        constants: &[],
                        zero_initialize_workgroup_memory: false,
                    },
                    cache: None,
                })
        };
        EventPass {
            levels: pipeline("cs_levels", None),
            begin: pipeline("cs_begin", None),
            scatter: pipeline("cs_scatter", Some(&written)),
            before: pipeline("cs_before", Some(&read)),
            follow: pipeline("cs_follow", Some(&read)),
            place: pipeline("cs_place", None),
            common,
            written,
            read,
        }
    }

    /// Records the window that ends with these images, a layer of targets. Returns where its events
    /// will be.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        state: &mut GpuEventCamera,
        images: TargetLayer<'_>,
        window_nanos: u64,
    ) -> Option<EventList> {
        let memory = state.take_list(gpu)?;
        let job = state.next_window(window_nanos);
        let mut jobs = [0; 2 * JOB_BYTES as usize];
        for (place, writes) in jobs.chunks_exact_mut(JOB_BYTES as usize).zip([0, 1]) {
            place[..size_of::<EventJob>()]
                .copy_from_slice(bytemuck::bytes_of(&EventJob { writes, ..job }));
        }
        gpu.queue().write_buffer(&state.job, 0, &jobs);
        let common = self.bind(gpu, state, images, &memory);
        let written = bind_tables(gpu, &self.written, state);
        let read = bind_tables(gpu, &self.read, state);
        for buffer in [&state.source, &state.passing, &state.slices] {
            encoder.clear_buffer(buffer, 0, None);
        }
        let tiles = [job.n_tiles[0], job.n_tiles[1]];
        let mut run_as = |job_bytes: u64,
                          pipeline: &wgpu::ComputePipeline,
                          second: Option<&wgpu::BindGroup>,
                          [x, y]: [u32; 2]| {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("events"),
                timestamp_writes: None,
            });
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &common, &[job_bytes as u32]);
            if let Some(second) = second {
                pass.set_bind_group(1, second, &[]);
            }
            pass.dispatch_workgroups(x, y, 1);
            gpu.counters().add_pass();
        };
        let (counts, writes) = (0, JOB_BYTES);
        let mut run = |pipeline: &wgpu::ComputePipeline,
                       second: Option<&wgpu::BindGroup>,
                       size: [u32; 2]| run_as(counts, pipeline, second, size);
        run(&self.levels, None, tiles);
        let first = !std::mem::replace(&mut state.has_begun, true) || window_nanos == 0;
        if first {
            gpu.queue()
                .write_buffer(&state.references, 0, bytemuck::cast_slice(&state.leaked));
            run(&self.begin, None, tiles);
        } else {
            if job.moves != 0 {
                run(&self.scatter, Some(&written), tiles);
                run(&self.before, Some(&read), tiles);
            }
            // The same pipeline counts and writes: two pipelines could be compiled to round
            // differently, so that an event is written that was not counted.
            run(&self.follow, Some(&read), tiles);
            run(&self.place, None, [1, 1]);
            run_as(writes, &self.follow, Some(&read), tiles);
        }
        memory.make_visible(encoder);
        gpu.mark(encoder, "events");
        let (capacity, max_events) = (job.capacity as usize, state.max_events);
        Some(EventList {
            memory: Some(memory),
            first,
            capacity,
            max_events,
            window_nanos,
            lists: state.lists.clone(),
        })
    }

    fn bind(
        &self,
        gpu: &Gpu,
        state: &GpuEventCamera,
        images: TargetLayer<'_>,
        list: &HostMemory,
    ) -> wgpu::BindGroup {
        let (before, now) = (1 - state.now, state.now);
        let buffers = [
            &state.levels,
            &state.flow[before],
            &state.flow[now],
            &state.motion_before,
            &state.range_now,
            &state.range_before,
            &state.jump,
            &state.references,
            &state.silent_nanos,
            &state.mismatch,
            &state.slices,
            list.buffer(),
        ];
        let job = wgpu::BufferBinding {
            buffer: &state.job,
            offset: 0,
            size: std::num::NonZeroU64::new(size_of::<EventJob>() as u64),
        };
        let mut entries = vec![wgpu::BindGroupEntry {
            binding: 0,
            resource: wgpu::BindingResource::Buffer(job),
        }];
        let views = [
            Target::Luminance,
            Target::Flow,
            Target::Depth,
            Target::Instance,
            Target::Class,
        ]
        .map(|target| images.view(target));
        let resources = views
            .iter()
            .map(wgpu::BindingResource::TextureView)
            .chain(buffers.map(|buffer| buffer.as_entire_binding()));
        entries.extend(
            resources
                .enumerate()
                .map(|(i, resource)| wgpu::BindGroupEntry {
                    binding: 1 + i as u32,
                    resource,
                }),
        );
        gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("events"),
            layout: &self.common,
            entries: &entries,
        })
    }
}

/// Bind group of the tables that one pass writes by atomics and later passes read.
fn bind_tables(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    state: &GpuEventCamera,
) -> wgpu::BindGroup {
    let entry = |binding: u32, buffer| wgpu::BindGroupEntry {
        binding,
        resource: wgpu::Buffer::as_entire_binding(buffer),
    };
    let entries = [entry(0, &state.source), entry(1, &state.passing)];
    gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("event tables"),
        layout,
        entries: &entries,
    })
}

fn layout(gpu: &Gpu, mut entries: Vec<wgpu::BindGroupLayoutEntry>) -> wgpu::BindGroupLayout {
    entries
        .iter_mut()
        .for_each(|entry| entry.visibility = wgpu::ShaderStages::COMPUTE);
    gpu.device()
        .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("events"),
            entries: &entries,
        })
}
