//! The one place of the daemon that hands shared memory to the GPU.

#![expect(
    unsafe_code,
    reason = "importing memory is a promise about its lifetime that only the daemon can keep"
)]

use schema_bus::Segment;
use sensor_gpu::{Gpu, ShmTarget};

/// How the GPU's frames get into shared memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// The GPU writes into the imported segment, if its driver can import it.
    Imported,
    /// The GPU writes into a buffer of its own, and the CPU copies it once (`--staged`).
    Staged,
}

/// The publisher's whole data segment as a target of copies: imported once, or staged if asked for
/// or if the driver refuses.
pub fn target(gpu: &Gpu, segment: &Segment, transfer: Transfer) -> ShmTarget {
    match transfer {
        // SAFETY: as below.
        Transfer::Staged => unsafe { ShmTarget::staged(segment.base, segment.len) },
        // SAFETY: the segment stays mapped while its publisher lives, and `Outlet::close` in
        // `memory.rs` drops the target, waits for the device, and only then drops the publisher.
        // Ranges that are copied to are loans, which the daemon holds alone and does not touch
        // until the submission's `wait` has returned.
        Transfer::Imported => unsafe { ShmTarget::import(gpu, segment.base, segment.len) },
    }
}
