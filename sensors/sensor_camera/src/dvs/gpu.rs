//! The event camera on the GPU, beside the pictures it looks at: `shader/events.wgsl` follows every
//! pixel and deals events out into slices
//! of time, right into the host's memory; the processor puts each slice in order.
//!
//! Chance that is drawn anew in every window (spread of thresholds, shot noise) stays with the
//! processor's [`super::EventCamera`].

use std::sync::{Arc, Mutex, PoisonError};

use bytemuck::{Pod, Zeroable};
use schema_frames::DvsEvent;
use sensor_gpu::{Gpu, HostMemory, prefix_sum_wgsl};
use sensor_spec::{DvsMode, DvsSpec};

use super::chance::Chance;
use super::sort::{Slices, Sorter};
use super::tiles::tiles_of;
use super::{EventsMade, chance_of};
use crate::pass::{entry, texture, uniform};
use crate::targets::{Target, Targets};

/// Text of the shader.
pub(crate) fn events_wgsl() -> String {
    prefix_sum_wgsl(256) + include_str!("../shader/events.wgsl")
}

/// Slices of time that the shader deals events out to.
const N_SLICES: usize = 1024;
/// Bytes of the list before its first event.
const HEAD_BYTES: usize = 4 * N_SLICES;
/// Longest list: cameras that may make more events in one frame are left to the processor.
const MAX_LIST_BYTES: usize = 256 << 20;

/// Mirror of `Job` in `shader/events.wgsl`, which says what is what.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct EventJob {
    /// Width and height.
    pub size_px: [u32; 2],
    /// Tiles across and down.
    pub n_tiles: [u32; 2],
    /// Up, down, what is added before the logarithm, longest step.
    pub thresholds: [f32; 4],
    /// Leak of the window.
    pub leak: f32,
    /// Length over that of the window before.
    pub ratio: f32,
    /// Length.
    pub nanos: u32,
    /// Refractory period.
    pub refractory_nanos: u32,
    /// Slices per time, times 2³².
    pub slices: [u32; 2],
    /// Events that the list takes.
    pub capacity: u32,
    /// What a level is.
    pub level: u32,
    /// Whether pictures are moved.
    pub moves: u32,
    /// Whether thresholds differ.
    pub differs: u32,
    /// Whether the run writes, or only counts.
    pub writes: u32,
    /// Which of two pictures is the end of the window.
    pub now: u32,
}

/// Distance of the job that counts from the one that writes: a multiple of what any device asks of
/// offsets.
const JOB_BYTES: u64 = 256;

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
    /// Whether an adapter can do it.
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
        let mut common = vec![uniform(0, size_of::<EventJob>() as u64, true)];
        common.extend(images);
        common.extend((6..18).map(|binding| storage(binding, false)));
        let common = layout(gpu, common);
        let written = layout(gpu, vec![storage(0, false), storage(1, false)]);
        let read = layout(gpu, vec![storage(0, true), storage(1, true)]);
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

    /// Records the window that ends with these images, a layer of targets, and says where its
    /// events will be.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        state: &mut GpuEventCamera,
        images: (&Targets, u32),
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
            // One pipeline counts and writes: two could be compiled to round apart, and an event be
            // written that was not counted.
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
        (targets, layer): (&Targets, u32),
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
        let images = [
            Target::Luminance,
            Target::Flow,
            Target::Depth,
            Target::Instance,
            Target::Class,
        ];
        let views = images.map(|target| targets.get(target).layer(layer));
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

/// What is written per pixel and tile by whoever comes first, and read once all are done.
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

fn storage(binding: u32, read_only: bool) -> wgpu::BindGroupLayoutEntry {
    let ty = wgpu::BufferBindingType::Storage { read_only };
    entry(
        binding,
        wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset: false,
            min_binding_size: None,
        },
    )
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

/// Lists that wait for their next frame.
type Lists = Arc<Mutex<Vec<HostMemory>>>;

/// What an event camera on the GPU remembers.
pub(crate) struct GpuEventCamera {
    spec: DvsSpec,
    size_px: [u32; 2],
    max_events: usize,
    capacity: usize,
    job: wgpu::Buffer,
    /// Two pictures in one buffer, by turns: the one that ends the window is number `now`.
    levels: wgpu::Buffer,
    /// The same in a buffer each.
    flow: [wgpu::Buffer; 2],
    now: usize,
    source: wgpu::Buffer,
    passing: wgpu::Buffer,
    motion_before: wgpu::Buffer,
    range_now: wgpu::Buffer,
    range_before: wgpu::Buffer,
    jump: wgpu::Buffer,
    references: wgpu::Buffer,
    /// How far each pixel has leaked when it begins: the shader adds the first picture.
    leaked: Vec<f32>,
    silent_nanos: wgpu::Buffer,
    mismatch: wgpu::Buffer,
    differs: bool,
    slices: wgpu::Buffer,
    lists: Lists,
    has_begun: bool,
    previous_window_nanos: u64,
}

impl GpuEventCamera {
    /// Whether the GPU can be such a camera.
    pub fn takes(spec: &DvsSpec, size_px: [u32; 2]) -> bool {
        let has_no_dice = spec.sigma_positive_threshold <= 0.0
            && spec.sigma_negative_threshold <= 0.0
            && spec.shot_noise_rate_hz <= 0.0;
        has_no_dice
            && HEAD_BYTES + size_of::<DvsEvent>() * capacity_of(spec, size_px) <= MAX_LIST_BYTES
    }

    pub fn new(gpu: &Gpu, spec: &DvsSpec, size_px: [u32; 2], seed: u64, sensor: u64) -> Self {
        let n_pixels = (size_px[0] * size_px[1]) as usize;
        let [across, down] = tiles_of(size_px.map(|side| side as usize));
        let chance: Chance = chance_of(spec, seed, sensor);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let per_pixel = |bytes: usize| gpu.buffer("events", (bytes * n_pixels) as u64, usage);
        let per_tile = |bytes: usize| gpu.buffer("events", (bytes * across * down) as u64, usage);
        let floats =
            |numbers: &[f32]| gpu.buffer_with("events", bytemuck::cast_slice(numbers), usage);
        let leaked = |pixel: usize| {
            if spec.leak_rate_hz > 0.0 {
                chance.phase(pixel) * spec.positive_threshold
            } else {
                0.0
            }
        };
        let mismatch = chance.mismatch(spec, n_pixels);
        GpuEventCamera {
            max_events: spec.max_events_of(size_px[0], size_px[1]) as usize,
            capacity: capacity_of(spec, size_px),
            job: gpu.buffer(
                "events",
                2 * JOB_BYTES,
                wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            ),
            levels: per_pixel(8),
            flow: [per_pixel(8), per_pixel(8)],
            now: 0,
            source: per_pixel(8),
            passing: per_tile(8),
            motion_before: per_pixel(8),
            range_now: per_tile(16),
            range_before: per_tile(16),
            jump: per_tile(8),
            references: per_pixel(4),
            leaked: (0..n_pixels).map(leaked).collect(),
            silent_nanos: per_pixel(4),
            differs: !mismatch.is_empty(),
            mismatch: if mismatch.is_empty() {
                floats(&[1.0])
            } else {
                floats(&mismatch)
            },
            slices: gpu.buffer("events", 64 + 8 * N_SLICES as u64, usage),
            lists: Lists::default(),
            has_begun: false,
            previous_window_nanos: 0,
            spec: spec.clone(),
            size_px,
        }
    }

    /// Memory for the events of one window.
    fn take_list(&self, gpu: &Gpu) -> Option<HostMemory> {
        let waiting = self
            .lists
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .pop();
        waiting.or_else(|| HostMemory::new(gpu, HEAD_BYTES + size_of::<DvsEvent>() * self.capacity))
    }

    fn next_window(&mut self, window_nanos: u64) -> EventJob {
        let spec = &self.spec;
        let ratio = if self.previous_window_nanos > 0 {
            window_nanos as f32 / self.previous_window_nanos as f32
        } else {
            0.0
        };
        self.previous_window_nanos = if self.has_begun { window_nanos } else { 0 };
        self.now = 1 - self.now;
        let slices = ((N_SLICES as u64) << 32) / (window_nanos + 1);
        let level = match (spec.mode, spec.use_log) {
            (DvsMode::Motion, true) => 0,
            (DvsMode::Motion, false) => 1,
            (DvsMode::TwoFrame, true) => 2,
            (DvsMode::TwoFrame, false) => 3,
        };
        EventJob {
            size_px: self.size_px,
            n_tiles: tiles_of(self.size_px.map(|side| side as usize)).map(|n| n as u32),
            thresholds: [
                spec.positive_threshold,
                spec.negative_threshold,
                spec.log_eps,
                spec.substep_px,
            ],
            leak: spec.leak_rate_hz * spec.positive_threshold * window_nanos as f32 * 1e-9,
            ratio,
            nanos: window_nanos.min(u32::MAX as u64) as u32,
            refractory_nanos: spec.refractory_nanos,
            slices: [slices as u32, (slices >> 32) as u32],
            capacity: self.capacity as u32,
            level,
            moves: (spec.mode == DvsMode::Motion) as u32,
            differs: self.differs as u32,
            writes: 0,
            now: self.now as u32,
        }
    }
}

/// Places for events: more than a frame takes, so that what is cut off is what comes last in all
/// but the worst case.
fn capacity_of(spec: &DvsSpec, [width, height]: [u32; 2]) -> usize {
    // A flicker of all pixels at one time is one slice.
    let max_events =
        (spec.max_events_of(width, height) as usize).max(width as usize * height as usize);
    max_events + max_events / 4 + 65_536
}

/// Where the events of a window will be once the GPU is done.
pub(crate) struct EventList {
    /// `None` after it went back.
    memory: Option<HostMemory>,
    first: bool,
    capacity: usize,
    max_events: usize,
    window_nanos: u64,
    lists: Lists,
}

impl std::fmt::Debug for EventList {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("EventList")
            .field("window_nanos", &self.window_nanos)
            .finish_non_exhaustive()
    }
}

impl EventList {
    /// Writes the events to the front of `out`, sorted by time, y, x.
    ///
    /// # Safety
    /// The submission that writes the list is done.
    #[expect(
        unsafe_code,
        reason = "the GPU has written there; the block carries its proof"
    )]
    pub unsafe fn finish(mut self, out: &mut [u8]) -> EventsMade {
        let Some(memory) = self.memory.take() else {
            return EventsMade {
                n_events: 0,
                n_dropped: 0,
                first: self.first,
            };
        };
        let made = if self.first {
            EventsMade {
                n_events: 0,
                n_dropped: 0,
                first: true,
            }
        } else {
            // SAFETY: the list is this one's alone until it goes back to the others, nobody calls
            // `write` on it, and the submission that
            // wrote it is done (the caller's promise).
            self.sort(unsafe { memory.bytes() }, out)
        };
        self.lists
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(memory);
        made
    }

    fn sort(&self, bytes: &[u8], out: &mut [u8]) -> EventsMade {
        let (head, events) = bytes.split_at(HEAD_BYTES);
        let ends: &[u32] = bytemuck::cast_slice(head);
        let events: &[DvsEvent] =
            bytemuck::cast_slice(&events[..self.capacity * size_of::<DvsEvent>()]);
        let n_made = ends[N_SLICES - 1] as usize;
        // Which events of a slice the list took, if not all, depends on the order of the GPU's
        // work: such a slice is dropped, or frames would
        // not be the same twice.
        let n_whole = ends
            .iter()
            .map(|end| *end as usize)
            .take_while(|end| *end <= self.capacity)
            .last()
            .unwrap_or(0);
        let n_events = n_made
            .min(self.max_events)
            .min(n_whole)
            .min(out.len() / size_of::<DvsEvent>());
        let slices = Slices {
            ends,
            window_nanos: self.window_nanos,
        };
        let out = &mut out[..n_events * size_of::<DvsEvent>()];
        match bytemuck::try_cast_slice_mut(out) {
            Ok(place) => Sorter::sort_slices(&slices, events, place),
            Err(_) => {
                let mut sorted = vec![DvsEvent::zeroed(); n_events];
                Sorter::sort_slices(&slices, events, &mut sorted);
                out.copy_from_slice(bytemuck::cast_slice(&sorted));
            }
        }
        EventsMade {
            n_events,
            n_dropped: (n_made - n_events) as u64,
            first: false,
        }
    }
}
