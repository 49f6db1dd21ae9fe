//! The event camera on the GPU: `shader/events.wgsl` follows every pixel and writes events into the
//! host's memory, grouped by slices of time. The CPU sorts each slice.
//!
//! Cameras whose noise is drawn again in every window (spread of thresholds, shot noise) use
//! [`crate::dvs::EventCamera`] on the CPU instead.

mod camera;
mod job;
mod list;
mod pass;

pub(crate) use camera::GpuEventCamera;
pub use job::EventJob;
pub(crate) use list::EventList;
pub(crate) use pass::{EventPass, events_wgsl};
