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
//!
//! ```
//! use sensor_camera::dvs::{EventCamera, EventImages, Rows};
//! use sensor_spec::DvsSpec;
//!
//! // Two pixels that do not move.
//! fn images(luminance: &[u8]) -> EventImages<'_> {
//!     const ZEROS: &[u8] = &[0; 16];
//!     EventImages {
//!         luminance: Rows::tight(luminance, 8),
//!         flow: Rows::tight(ZEROS, 16),
//!         depth: Rows::tight(ZEROS, 8),
//!         instance: Rows::tight(ZEROS, 8),
//!         class: Rows::tight(ZEROS, 2),
//!     }
//! }
//! let bytes = |levels: [f32; 2]| levels.map(f32::to_le_bytes).concat();
//! let mut camera = EventCamera::new(DvsSpec::default(), [2, 1], 0, 0);
//! let mut events = [0; 1024];
//! let made = camera.advance(&images(&bytes([0.2, 0.5])), 0, &mut events);
//! assert!(made.first && made.n_events == 0);
//! // The left pixel brightens within 10 ms.
//! let made = camera.advance(&images(&bytes([0.8, 0.5])), 10_000_000, &mut events);
//! assert!(made.n_events > 0);
//! ```

mod beginnings;
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
mod stage;
mod tiles;
mod window;

pub use camera::EventCamera;
pub use events_made::EventsMade;
pub use gpu::EventJob;
pub(crate) use gpu::{EventList, EventPass, GpuEventCamera, events_wgsl};
pub use images::{EventImages, Rows};
