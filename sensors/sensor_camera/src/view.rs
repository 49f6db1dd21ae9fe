//! What is asked of a camera in a tick, its state between ticks, and the results.

mod camera_view;
mod merge;
mod submission;

pub use camera_view::{Output, View, ViewJob, ViewSpec};
pub(crate) use merge::leaders;
pub(crate) use submission::{DvsMaps, Plan};
pub use submission::{OutputResult, Submission, ViewResult};
