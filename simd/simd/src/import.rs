//! The one place of the daemon that hands shared memory to the GPU.

#![expect(
    unsafe_code,
    reason = "importing memory is a promise about its lifetime that only the daemon can keep"
)]

use schema_bus::Segment;
use sensor_gpu::{Gpu, ShmTarget};

/// The publisher's whole data segment as a target of copies: imported once, or staged if asked for
/// or if the driver refuses.
///
/// `close_outlet` in `rig.rs` drops the target, waits for the device, and only then drops the
/// publisher.
pub fn target(gpu: &Gpu, segment: &Segment, staged: bool) -> ShmTarget {
    if staged {
        // SAFETY: as below.
        unsafe { ShmTarget::staged(segment.base, segment.len) }
    } else {
        // SAFETY: the segment stays mapped while the publisher lives, and `close_outlet` in
        // `rig.rs` drops the target after the last
        // submission was waited for and before the publisher. Ranges that are copied to are loans
        // which the daemon holds
        // alone and does not touch until the submission's `wait` has returned.
        unsafe { ShmTarget::import(gpu, segment.base, segment.len) }
    }
}
