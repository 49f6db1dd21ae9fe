//! What a submission's commands read, written into staging memory that is kept.
//!
//! `wgpu::Queue::write_buffer` makes, maps and destroys a Vulkan buffer each time. Here all writes of
//! a submission share a few large buffers, which are mapped again once the GPU has read them.

use std::num::NonZeroU64;

use wgpu::util::StagingBelt;

use crate::device::Gpu;

/// Bytes of a staging buffer: the lists of 64 small cameras fit. Larger writes get a buffer of their
/// own size, which is kept, too.
const CHUNK_BYTES: u64 = 4 << 20;
/// Every write begins at a multiple of this.
const ALIGN_BYTES: NonZeroU64 = NonZeroU64::new(16).expect("16 is not 0");

/// Writes of one submission after the other. Each user has its own, because staging buffers are
/// closed for all writes of a submission together.
#[derive(Debug)]
pub struct Uploads {
    belt: StagingBelt,
}

impl Uploads {
    /// No staging memory yet.
    pub fn new(gpu: &Gpu) -> Uploads {
        Uploads {
            belt: StagingBelt::new(gpu.device().clone(), CHUNK_BYTES),
        }
    }

    /// Records a copy of `bytes` to where `to` has `offset_bytes`; both are multiples of 4.
    pub fn write(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        to: &wgpu::Buffer,
        offset_bytes: u64,
        bytes: &[u8],
    ) {
        if let Some(mut view) = self.open(encoder, to, offset_bytes, bytes.len() as u64) {
            view.copy_from_slice(bytes);
        }
    }

    /// Records a copy of `n_bytes` to where `to` has `offset_bytes`, both multiples of 4, and returns
    /// the memory that they are to be written to, which is not meant to be read. `None` if there are
    /// none, or the device is lost.
    pub fn open(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        to: &wgpu::Buffer,
        offset_bytes: u64,
        n_bytes: u64,
    ) -> Option<wgpu::BufferViewMut> {
        let staged = self.belt.allocate(NonZeroU64::new(n_bytes)?, ALIGN_BYTES);
        encoder.copy_buffer_to_buffer(staged.buffer(), staged.offset(), to, offset_bytes, n_bytes);
        // A lost device has no memory to write to, and no submission that would read it.
        staged.get_mapped_range_mut().ok()
    }

    /// Ends the writes whose copies were recorded in `encoder`. Call it before each submission.
    pub fn close(&mut self, encoder: &wgpu::CommandEncoder) {
        self.belt.finish_and_recall_on_submit(encoder);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::copy::{CopyBatch, Place};
    use crate::device::GpuOptions;

    /// Bytes of one submission after the other arrive in their order, also where a later write of the
    /// same submission goes over an earlier one, and larger ones than a staging buffer.
    #[test]
    fn writes_arrive_in_their_order_in_every_submission() {
        let gpu = Gpu::open(&GpuOptions::default()).unwrap_or_else(|error| panic!("{error}"));
        let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        let n_bytes = CHUNK_BYTES as usize + 4096;
        let to = gpu.buffer("to", n_bytes as u64, usage);
        let mut uploads = Uploads::new(&gpu);
        for round in 0..12u8 {
            let mut encoder = gpu.encoder("uploads");
            uploads.write(&mut encoder, &to, 0, &[round; 64]);
            uploads.write(&mut encoder, &to, 32, &[round + 100; 64]);
            if round % 4 == 0 {
                uploads.write(&mut encoder, &to, 96, &vec![round + 50; n_bytes - 96]);
            }
            uploads.write(&mut encoder, &to, 0, &[]);
            uploads.close(&encoder);
            let mut found = vec![0; n_bytes];
            let mut batch = CopyBatch::new();
            batch.buffer(&to, 0, n_bytes, Place::Memory(&mut found));
            let done = batch.submit(&gpu, encoder).wait();
            done.unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(found[..32], [round; 32]);
            assert_eq!(found[32..96], [round + 100; 64]);
            assert!(found[96..].iter().all(|byte| *byte == round / 4 * 4 + 50));
        }
    }
}
