//! The event camera on the GPU, beside the pictures it looks at: `shader/events.wgsl` follows every
//! pixel and deals events out into slices
//! of time, right into the host's memory; the processor puts each slice in order.
//!
//! Chance that is drawn anew in every window (spread of thresholds, shot noise) stays with the
//! processor's [`crate::dvs::EventCamera`].

mod camera;
mod job;
mod list;
mod pass;

pub(crate) use camera::GpuEventCamera;
pub use job::EventJob;
pub(crate) use list::EventList;
pub(crate) use pass::{EventPass, events_wgsl};
