//! Writes what views see into lists for the GPU: draws, instances that move, and the numbers of those
//! that do not. Several threads share large lists.

use bytemuck::Pod;
use rayon::prelude::*;
use sensor_gpu::{Gpu, Uploads};

use super::plan::{CHUNK, RasterDraw, RasterJob, ViewLists};
use crate::binding_layout::grow;
use crate::uniform::InstanceData;
use crate::visible::Drawn;

/// The lists.
pub(super) struct Lists<'l> {
    pub instances: &'l wgpu::Buffer,
    pub numbers: &'l mut wgpu::Buffer,
    pub draws: &'l mut wgpu::Buffer,
}

/// Draws that are worth another thread.
const MIN_DRAWS: usize = 8192;

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
    instances: Room,
    numbers: Room,
    draws: Room,
}

/// Memory for entries of a list.
struct Room {
    /// None if there are no entries, or on a lost device.
    memory: Option<wgpu::BufferViewMut>,
    n_used: usize,
}

impl Room {
    fn put<T: Pod>(&mut self, entries: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(entries);
        if let Some(memory) = &mut self.memory {
            let end = self.n_used + bytes.len();
            memory.slice(self.n_used..end).copy_from_slice(bytes);
            self.n_used = end;
        }
    }
}

/// A list that is being written from its beginning.
struct Filling<'f> {
    list: &'f wgpu::Buffer,
    n_bytes: u64,
}

impl Filling<'_> {
    /// Memory for the next `n` entries.
    fn room<T: Pod>(
        &mut self,
        uploads: &mut Uploads,
        encoder: &mut wgpu::CommandEncoder,
        n: usize,
    ) -> Room {
        let n_bytes = (size_of::<T>() * n) as u64;
        let memory = uploads.open(encoder, self.list, self.n_bytes, n_bytes);
        self.n_bytes += n_bytes;
        Room { memory, n_used: 0 }
    }
}

/// Writes the lists; that of instances is large enough.
pub(super) fn write(
    gpu: &Gpu,
    uploads: &mut Uploads,
    encoder: &mut wgpu::CommandEncoder,
    lists: Lists<'_>,
    jobs: &[RasterJob<'_>],
    places: &[ViewLists],
) {
    let sum = |jobs: &[RasterJob<'_>], n: fn(&Drawn) -> usize| {
        jobs.iter().map(|job| n(job.drawn)).sum::<usize>()
    };
    let n_instances = |jobs: &[RasterJob<'_>]| sum(jobs, |drawn| drawn.instances.len());
    let n_numbers = |jobs: &[RasterJob<'_>]| sum(jobs, |drawn| drawn.still.len());
    let n_draws = |jobs: &[RasterJob<'_>]| sum(jobs, |drawn| drawn.calls.len());
    let bytes_of = |n: usize, entry: usize| (n * entry) as u64;
    grow(
        gpu,
        lists.numbers,
        bytes_of(n_numbers(jobs), size_of::<u32>()),
    );
    grow(
        gpu,
        lists.draws,
        bytes_of(n_draws(jobs), size_of::<RasterDraw>()),
    );
    let filling = |list| Filling { list, n_bytes: 0 };
    let mut instances = filling(lists.instances);
    let mut numbers = filling(lists.numbers);
    let mut draws = filling(lists.draws);
    let n_parts = (n_draws(jobs) / MIN_DRAWS).max(1);
    let n_views = jobs.len().div_ceil(n_parts).max(1);
    let mut parts = Vec::with_capacity(n_parts);
    for (jobs, places) in jobs.chunks(n_views).zip(places.chunks(n_views)) {
        parts.push(Part {
            jobs,
            places,
            first_view: (parts.len() * n_views) as u32,
            instances: instances.room::<InstanceData>(uploads, encoder, n_instances(jobs)),
            numbers: numbers.room::<u32>(uploads, encoder, n_numbers(jobs)),
            draws: draws.room::<RasterDraw>(uploads, encoder, n_draws(jobs)),
        });
    }
    if let [only] = &mut parts[..] {
        only.write();
    } else {
        parts.par_iter_mut().for_each(Part::write);
    }
}

impl Part<'_> {
    fn write(&mut self) {
        let mut draws = Vec::new();
        for (view, (job, place)) in (self.first_view..).zip(self.jobs.iter().zip(self.places)) {
            self.instances.put(&job.drawn.instances);
            self.numbers.put(&job.drawn.still);
            draws.clear();
            draws.extend(RasterDraw::all_of(job.drawn, view, place.first_chunk));
            self.draws.put(&draws);
        }
    }
}
