//! The event camera: follows the brightness of every pixel through the time between two firings.
//!
//! The time between two firings is a window. No images are drawn inside it: the two rendered images
//! at its ends are warped along their motion field, in steps of at most `substep_px`. Between steps
//! the logarithm of the brightness is interpolated linearly, and each crossing of the pixel's
//! threshold is an event. Model: Rebecq, Gehrig, Scaramuzza, *ESIM: an Open Event Camera Simulator*
//! (2018), section 3, with warped images in place of extra renders.
//!
//! The place of an edge is known to half a pixel of the rendered images, so the time of an event is
//! known to half a pixel of motion.
//!
//! In mode `two_frame` the level of every pixel is interpolated linearly from image to image, as in
//! CARLA.
//!
//! [`EventCamera`] works on the CPU; `gpu` is the same model on the GPU.

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
