//! A pool of mappable buffers.

use parking_lot::Mutex;

/// Staging buffers kept for reuse; eight cameras with six modalities in two submissions in flight
/// use 96.
const MAX_POOLED_STAGING: usize = 128;

/// Staging buffers that are not in use.
#[derive(Debug, Default)]
pub(crate) struct StagingPool(Mutex<Vec<wgpu::Buffer>>);

impl StagingPool {
    /// An unused buffer of this size, if there is one.
    pub fn take(&self, n_bytes: u64) -> Option<wgpu::Buffer> {
        let mut pool = self.0.lock();
        let known = pool.iter().position(|buffer| buffer.size() == n_bytes)?;
        Some(pool.swap_remove(known))
    }

    /// Returns a buffer to the pool.
    pub fn give(&self, buffer: wgpu::Buffer) {
        let mut pool = self.0.lock();
        // Sizes change when resolutions do: old ones fall out at the front.
        if pool.len() >= MAX_POOLED_STAGING {
            pool.remove(0);
        }
        pool.push(buffer);
    }
}
