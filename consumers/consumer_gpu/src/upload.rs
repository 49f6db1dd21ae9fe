//! The way over shared memory, for devices that the simulator does not draw on.

use std::sync::Arc;

use parking_lot::Mutex;

use crate::cuda::{Cuda, Staged};
use crate::error::GpuError;

/// Memory that is kept for the next frames; a reader rarely holds more.
const MAX_KEPT: usize = 4;

/// Memory of the device for frames, used again and again.
#[derive(Debug)]
pub struct Uploads {
    cuda: Arc<Cuda>,
    free: Mutex<Vec<Staged>>,
}

impl Uploads {
    /// None yet.
    pub fn new(cuda: Arc<Cuda>) -> Arc<Uploads> {
        Arc::new(Uploads {
            cuda,
            free: Mutex::new(Vec::new()),
        })
    }

    /// The bytes on the device.
    ///
    /// # Errors
    /// [`GpuError::Cuda`].
    pub fn upload(&self, bytes: &[u8]) -> Result<Staged, GpuError> {
        let mut free = self.free.lock();
        let fits = free.iter().position(|it| it.n_bytes >= bytes.len());
        let kept = fits.map(|i| free.swap_remove(i));
        drop(free);
        let mut staged = match kept {
            Some(staged) => staged,
            None => self.cuda.staged(bytes.len())?,
        };
        staged.upload(bytes)?;
        Ok(staged)
    }

    /// Takes memory back that the GPU is done with.
    pub fn give_back(&self, staged: Staged) {
        let mut free = self.free.lock();
        if free.len() < MAX_KEPT {
            free.push(staged);
        }
    }
}
