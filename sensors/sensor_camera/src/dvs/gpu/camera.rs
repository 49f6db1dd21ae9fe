//! State of an event camera on the GPU.

use schema_frames::DvsEvent;
use sensor_gpu::{Gpu, HostMemory};
use sensor_spec::{DvsMode, DvsSpec};

use super::job::{EventJob, JOB_BYTES};
use super::list::{HEAD_BYTES, Lists, N_SLICES};
use crate::dvs::chance::Chance;
use crate::dvs::tiles::tiles_of;

/// Limit of a list; cameras that may make more events in one frame use the CPU.
const MAX_LIST_BYTES: usize = 256 << 20;

/// State of an event camera on the GPU.
pub(crate) struct GpuEventCamera {
    pub(super) spec: DvsSpec,
    pub(super) size_px: [u32; 2],
    pub(super) max_events: usize,
    pub(super) capacity: usize,
    pub(super) job: wgpu::Buffer,
    /// Two images in one buffer, used in turn: the one that ends the window has index `now`.
    pub(super) levels: wgpu::Buffer,
    /// The same in two buffers.
    pub(super) flow: [wgpu::Buffer; 2],
    pub(super) now: usize,
    pub(super) source: wgpu::Buffer,
    pub(super) passing: wgpu::Buffer,
    pub(super) motion_before: wgpu::Buffer,
    pub(super) range_now: wgpu::Buffer,
    pub(super) range_before: wgpu::Buffer,
    pub(super) jump: wgpu::Buffer,
    pub(super) references: wgpu::Buffer,
    /// How far each pixel has leaked at the start; the shader adds the first image.
    pub(super) leaked: Vec<f32>,
    pub(super) silent_nanos: wgpu::Buffer,
    pub(super) mismatch: wgpu::Buffer,
    pub(super) differs: bool,
    pub(super) slices: wgpu::Buffer,
    pub(super) lists: Lists,
    pub(super) has_begun: bool,
    pub(super) previous_window_nanos: u64,
}

impl GpuEventCamera {
    /// Whether the GPU supports such a camera.
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
        let chance: Chance = Chance::of_camera(spec, seed, sensor);
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
    pub(super) fn take_list(&self, gpu: &Gpu) -> Option<HostMemory> {
        let waiting = self.lists.lock().pop();
        waiting.or_else(|| HostMemory::new(gpu, HEAD_BYTES + size_of::<DvsEvent>() * self.capacity))
    }

    pub(super) fn next_window(&mut self, window_nanos: u64) -> EventJob {
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
            threshold_up: spec.positive_threshold,
            threshold_down: spec.negative_threshold,
            log_eps: spec.log_eps,
            substep_px: spec.substep_px,
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

/// Capacity of the list. It is larger than a frame's, so that in all but the worst case the events
/// that are cut off are the last ones.
fn capacity_of(spec: &DvsSpec, [width, height]: [u32; 2]) -> usize {
    // If all pixels flicker at one time, all events are in one slice.
    let max_events =
        (spec.max_events_of(width, height) as usize).max(width as usize * height as usize);
    max_events + max_events / 4 + 65_536
}
