//! The event camera: brightness of every pixel followed through the time between two firings.
//!
//! Nothing is drawn in between. What lies at a pixel at a time of the window is found by moving the
//! two rendered pictures along their
//! motion field, in steps of at most `substep_px`; between steps the logarithm of the brightness is
//! a straight line, and each crossing
//! of the pixel's threshold is an event. Model: Rebecq, Gehrig, Scaramuzza, *ESIM: an Open Event
//! Camera Simulator* (2018), section 3,
//! with warped pictures in place of extra renders.
//!
//! An edge is known to half a pixel of the rendered pictures, so an event's time is known to half a
//! pixel of motion.
//!
//! In mode `two_frame` the level of every pixel goes in a straight line from picture to picture, as
//! in CARLA.
//!
//! [`EventCamera`] works on the processor; `gpu` is the same model where the pictures are.

mod block;
mod camera;
mod chance;
mod crossing;
mod events_made;
mod gpu;
mod images;
mod lanes;
mod level_image;
mod motion_field;
mod sort;
mod tiles;
mod window;

pub use camera::EventCamera;
pub use events_made::EventsMade;
pub use gpu::EventJob;
pub(crate) use gpu::{EventList, EventPass, GpuEventCamera, events_wgsl};
pub use images::{EventImages, Rows};
