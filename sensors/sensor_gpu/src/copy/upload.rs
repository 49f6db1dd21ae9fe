//! Bytes of the processor's into memory on the device, for lists that the processor makes.

use super::place::Place;
use super::raw::release;
use crate::device::Gpu;
use crate::error::GpuError;
use crate::queue::RawCopies;

impl Gpu {
    /// Writes each list of bytes to its place in exported memory, and waits until it is there.
    ///
    /// Panics if bytes do not fit their place, their number is no multiple of 4, or a place is not
    /// in exported memory.
    ///
    /// # Errors
    /// [`GpuError::Lost`], [`GpuError::Hung`].
    pub fn upload(&self, lists: &[(Place<'static>, &[u8])]) -> Result<(), GpuError> {
        let mut released = Vec::with_capacity(lists.len());
        for (place, bytes) in lists {
            let Place::Shm(to) = place else {
                panic!("only places in exported memory are written this way");
            };
            assert!(to.target().is_exported() && bytes.len() <= to.capacity_bytes());
            let buffer = to
                .target()
                .imported()
                .expect("exported memory has a buffer");
            if !bytes.is_empty() {
                self.queue()
                    .write_buffer(buffer, to.offset_bytes() as u64, bytes);
                released.extend(release(self, to, bytes.len()));
            }
        }
        let mut encoder = self.gpu_release(&RawCopies {
            copies: Vec::new(),
            released,
        });
        self.mark(&mut encoder, "uploads");
        let submission = self.submit([encoder.finish()]);
        self.counters().add_submission(lists.len() as u64);
        self.wait_for(Some(&submission))
    }
}
