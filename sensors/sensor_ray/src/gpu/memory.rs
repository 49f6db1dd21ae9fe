//! What lidars are read from and written to on the GPU, besides the world.

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

    /// Makes room for `n_bytes` and says whether the buffer is another one.
    fn fit(&mut self, gpu: &Gpu, n_bytes: u64) -> bool {
        if self.buffer.size() >= n_bytes {
            return false;
        }
        self.buffer = gpu.buffer(self.label, n_bytes.next_power_of_two(), self.usage);
        true
    }
}

/// Buffers of lidars.
pub(super) struct Memory {
    pub lidars: Growing,
    pub tables: Growing,
    pub points: Growing,
    /// Returns per chunk, in two halves: while one is counted in, packing clears the other.
    pub kept: Growing,
    pub packed: Growing,
    pub totals: Growing,
    /// Bound where nothing is written.
    pub unused: wgpu::Buffer,
    /// What the CPU and shaders both reach: number of points per lidar, then lidars and tables to
    /// be uploaded.
    host: Option<Arc<HostMemory>>,
    /// Half that the next submission counts in.
    half: usize,
    /// Counts at the front of each half that may not be zero.
    dirty: [u32; 2],
}

/// Parts of the host's memory begin at multiples of this.
const PART_BYTES: usize = 256;

/// Where lidars and tables begin in the host's memory.
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

    /// Where the number of points of each lidar goes if a shader can write there; known after an
    /// upload.
    pub fn host(&self) -> Option<&Arc<HostMemory>> {
        self.host.as_ref()
    }

    /// Makes room, says where returns are counted, and uploads lidars and tables; what is copied
    /// from (`copies`) is needed only where shaders do not write to readers. True if buffers are
    /// others than before.
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
            // These two are bound anew for every dispatch.
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
                // SAFETY: scans on their way hold what they read and write, and `host_of` gives
                // nobody else's.
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

    /// Whether shaders reach memory of the host, made large enough for this submission.
    pub fn fit_host(&mut self, gpu: &Gpu, submission: &Submission) -> bool {
        let (_, first_table) = parts_of(submission);
        self.host_of(gpu, first_table + size_of_val(&submission.tables[..]))
            .is_some()
    }

    /// The host's memory with room for so many bytes, which no scan on its way holds.
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
