//! The buffers that lidars read and write on the GPU, besides the scene.

use std::sync::Arc;

use sensor_gpu::{Gpu, HostMemory};

use super::submission::Submission;

/// A buffer that grows.
pub(super) struct Growing {
    label: &'static str,
    usage: wgpu::BufferUsages,
    pub buffer: wgpu::Buffer,
}

impl Growing {
    fn new(gpu: &Gpu, label: &'static str, usage: wgpu::BufferUsages) -> Self {
        Growing {
            label,
            usage,
            buffer: gpu.buffer(label, 256, usage),
        }
    }

    /// Makes room for `n_bytes`; true if the buffer was replaced.
    fn fit(&mut self, gpu: &Gpu, n_bytes: u64) -> bool {
        if self.buffer.size() >= n_bytes {
            return false;
        }
        self.buffer = gpu.buffer(self.label, n_bytes.next_power_of_two(), self.usage);
        true
    }
}

/// Buffers of lidars; they grow with the largest submission.
pub(super) struct Memory {
    pub lidars: Growing,
    pub tables: Growing,
    pub points: Growing,
    /// Returns per chunk, in two halves: a submission counts in one half while its packing clears
    /// the other for the next submission.
    pub kept: Growing,
    pub packed: Growing,
    pub totals: Growing,
    /// Bound where a shader has no output.
    pub unused: wgpu::Buffer,
    /// Memory that both the CPU and shaders reach: the number of points per lidar, then lidars and
    /// tables to be uploaded.
    host: Option<Arc<HostMemory>>,
    /// Which half the next submission counts in.
    half: usize,
    /// Number of counts at the front of each half that may not be zero.
    dirty: [u32; 2],
}

/// Alignment of the parts of the host's memory.
const PART_BYTES: usize = 256;

/// Offsets of lidars and tables in the host's memory.
fn parts_of(submission: &Submission) -> (usize, usize) {
    let first_lidar = (4 * submission.lidars.len()).next_multiple_of(PART_BYTES);
    (
        first_lidar,
        first_lidar + size_of_val(&submission.lidars[..]).next_multiple_of(PART_BYTES),
    )
}

impl Memory {
    pub fn new(gpu: &Gpu) -> Self {
        use wgpu::BufferUsages as U;
        let buffer = |label, usage| Growing::new(gpu, label, usage | U::STORAGE);
        Memory {
            lidars: buffer("lidars", U::COPY_DST),
            tables: buffer("lidar beams", U::COPY_DST),
            points: buffer("lidar points", U::empty()),
            kept: buffer("lidar returns per chunk", U::COPY_DST),
            packed: buffer("packed lidar points", U::COPY_SRC),
            totals: buffer("lidar returns", U::COPY_SRC),
            unused: gpu.buffer("unused", 256, U::STORAGE),
            host: None,
            half: 0,
            dirty: [0; 2],
        }
    }

    /// Memory for the number of points of each lidar, if shaders can write to the host; valid after
    /// an upload.
    pub fn host(&self) -> Option<&Arc<HostMemory>> {
        self.host.as_ref()
    }

    /// Makes room, chooses where returns are counted, and uploads lidars and tables. `copies` says
    /// whether packed points are copied to readers afterwards, which needs two more buffers. True
    /// if a bound buffer was replaced.
    pub fn upload(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        submission: &mut Submission,
        copies: bool,
    ) -> bool {
        let mut is_new = self
            .lidars
            .fit(gpu, size_of_val(&submission.lidars[..]) as u64);
        is_new |= self
            .tables
            .fit(gpu, size_of_val(&submission.tables[..]) as u64);
        is_new |= self.points.fit(gpu, 4 * submission.n_words as u64);
        if copies {
            // These two are bound again for every dispatch, so replacing them needs no note.
            self.packed.fit(gpu, 4 * submission.n_words as u64);
            self.totals.fit(gpu, 4 * submission.lidars.len() as u64);
        }
        if self.kept.fit(gpu, 8 * submission.n_chunks as u64) {
            self.dirty = [0; 2];
            is_new = true;
        }
        self.choose_half(encoder, submission);
        let (lidars, tables): (&[u8], &[u8]) = (
            bytemuck::cast_slice(&submission.lidars),
            bytemuck::cast_slice(&submission.tables),
        );
        let (first_lidar, first_table) = parts_of(submission);
        match self.host_of(gpu, first_table + tables.len()) {
            Some(host) => {
                #[expect(
                    unsafe_code,
                    reason = "the GPU reads there later; the block carries its proof"
                )]
                // SAFETY: scans in flight hold the memory that they read and write, and `host_of`
                // returns memory that nobody else holds.
                unsafe {
                    host.write(first_lidar, lidars);
                    host.write(first_table, tables);
                }
                let mut copy = |from: usize, to: &Growing, n_bytes: usize| {
                    encoder.copy_buffer_to_buffer(
                        host.buffer(),
                        from as u64,
                        &to.buffer,
                        0,
                        n_bytes as u64,
                    );
                };
                copy(first_lidar, &self.lidars, lidars.len());
                copy(first_table, &self.tables, tables.len());
            }
            None => {
                gpu.queue().write_buffer(&self.lidars.buffer, 0, lidars);
                gpu.queue().write_buffer(&self.tables.buffer, 0, tables);
            }
        }
        is_new
    }

    /// Whether shaders reach the host's memory; makes it large enough for this submission.
    pub fn fit_host(&mut self, gpu: &Gpu, submission: &Submission) -> bool {
        let (_, first_table) = parts_of(submission);
        self.host_of(gpu, first_table + size_of_val(&submission.tables[..]))
            .is_some()
    }

    /// Host memory with room for `n_bytes` that no scan in flight holds.
    fn host_of(&mut self, gpu: &Gpu, n_bytes: usize) -> Option<Arc<HostMemory>> {
        let fits =
            |host: &Arc<HostMemory>| host.n_bytes() >= n_bytes && Arc::strong_count(host) == 1;
        if gpu.can_write_directly() && !self.host.as_ref().is_some_and(fits) {
            self.host = HostMemory::new(gpu, n_bytes.next_power_of_two()).map(Arc::new);
        }
        self.host.clone()
    }

    fn choose_half(&mut self, encoder: &mut wgpu::CommandEncoder, submission: &mut Submission) {
        let half_len = (self.kept.buffer.size() / 8) as u32;
        let (own, other) = (self.half, 1 - self.half);
        if self.dirty[own] > 0 {
            encoder.clear_buffer(
                &self.kept.buffer,
                4 * (own as u32 * half_len) as u64,
                Some(4 * self.dirty[own] as u64),
            );
        }
        for lidar in &mut submission.lidars {
            lidar.count_in(own as u32 * half_len, other as u32 * half_len);
        }
        self.dirty[own] = submission.n_chunks;
        if self.dirty[other] <= submission.n_chunks {
            self.dirty[other] = 0;
        }
        self.half = other;
    }
}
