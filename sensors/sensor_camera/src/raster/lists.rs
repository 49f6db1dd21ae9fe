//! Writes what views see into lists for the GPU: draws, chunks of triangles, and instances. Several
//! threads share large lists.

use bytemuck::Pod;
use rayon::prelude::*;
use sensor_gpu::Gpu;

use super::plan::{CHUNK, RasterDraw, RasterJob, ViewLists};
use crate::uniform::InstanceData;
use crate::visible::Drawn;

/// The lists.
pub(super) struct Lists<'l> {
    pub instances: &'l wgpu::Buffer,
    pub draws: &'l wgpu::Buffer,
    pub chunks: &'l wgpu::Buffer,
}

/// Draws that are worth another thread.
const MIN_DRAWS: usize = 2048;
/// Limit of threads, because each needs staging memory of its own, which costs time.
const MAX_THREADS: usize = 8;

/// Workgroups of one draw.
pub(super) fn n_chunks(drawn: &Drawn) -> u32 {
    drawn
        .calls
        .iter()
        .map(|call| (call.mesh.n_indices / 3).div_ceil(CHUNK))
        .sum()
}

/// Neighbouring views whose parts of the lists one thread writes.
struct Part<'p> {
    jobs: &'p [RasterJob<'p>],
    places: &'p [ViewLists],
    first_view: u32,
}

/// Writes the lists; they are large enough.
pub(super) fn write(gpu: &Gpu, lists: &Lists<'_>, jobs: &[RasterJob<'_>], places: &[ViewLists]) {
    let n_draws: usize = jobs.iter().map(|job| job.drawn.calls.len()).sum();
    let n_parts = (n_draws / MIN_DRAWS).clamp(1, MAX_THREADS);
    let n_views = jobs.len().div_ceil(n_parts).max(1);
    let part = |(first_view, (jobs, places))| Part {
        jobs,
        places,
        first_view,
    };
    let parts: Vec<Part<'_>> = (0..)
        .step_by(n_views)
        .zip(jobs.chunks(n_views).zip(places.chunks(n_views)))
        .map(part)
        .collect();
    if let [only] = &parts[..] {
        only.write(gpu, lists);
    } else {
        parts.par_iter().for_each(|part| part.write(gpu, lists));
    }
}

/// Staging memory for a range of a list; `None` if it is empty.
fn open<T: Pod>(
    gpu: &Gpu,
    list: &wgpu::Buffer,
    first: u32,
    n: u32,
) -> Option<wgpu::QueueWriteBufferView> {
    let bytes = |n: u32| n as u64 * size_of::<T>() as u64;
    std::num::NonZeroU64::new(bytes(n))
        .and_then(|n_bytes| gpu.queue().write_buffer_with(list, bytes(first), n_bytes))
}

impl Part<'_> {
    fn write(&self, gpu: &Gpu, lists: &Lists<'_>) {
        let n_instances = self
            .jobs
            .iter()
            .map(|job| job.drawn.instances.len() as u32)
            .sum();
        if let Some(mut to) = open::<InstanceData>(
            gpu,
            lists.instances,
            self.jobs[0].drawn.first_instance,
            n_instances,
        ) {
            let mut at = 0;
            for job in self.jobs {
                let bytes: &[u8] = bytemuck::cast_slice(&job.drawn.instances);
                to.slice(at..at + bytes.len()).copy_from_slice(bytes);
                at += bytes.len();
            }
        }
        let (mut draws, mut chunks) = (Vec::new(), Vec::new());
        for (view, (job, place)) in (self.first_view..).zip(self.jobs.iter().zip(self.places)) {
            for (number, draw) in (place.first_draw..).zip(RasterDraw::all_of(job.drawn, view)) {
                chunks.extend(
                    (0..draw.n_triangles)
                        .step_by(CHUNK as usize)
                        .map(|first| [number, first]),
                );
                draws.push(draw);
            }
        }
        if let Some(mut to) = open::<RasterDraw>(
            gpu,
            lists.draws,
            self.places[0].first_draw,
            draws.len() as u32,
        ) {
            to.copy_from_slice(bytemuck::cast_slice(&draws));
        }
        if let Some(mut to) = open::<[u32; 2]>(
            gpu,
            lists.chunks,
            self.places[0].first_chunk,
            chunks.len() as u32,
        ) {
            to.copy_from_slice(bytemuck::cast_slice(&chunks));
        }
    }
}
