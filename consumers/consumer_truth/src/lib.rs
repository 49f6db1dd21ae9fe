//! What is true about a tick: boxes in space and in images, what of them can be seen, masks, and
//! points per box. It follows from snapshots and from exact images alone, so whoever has a
//! recording can compute it again.
//!
//! In reading order: [`scenario`] (what a recording holds), [`ticks`] and [`recording`] (a recording
//! as one set of frames per tick), [`bodies`], [`camera`], [`boxes`], [`segments`], [`masks`] and
//! [`points`] (the truth about one tick).
//!
//! # Words
//!
//! - A **body** is an actor with a box: a vehicle, a walker or a prop. Its box is that of
//!   `world/actors`, so wheels and mirrors lie inside it, and the limbs of a walker may swing out
//!   of it. A vehicle of the map (a parked car) is a body too; its box is that of its mesh.
//! - Its **hull** in an image is the convex outline of the projected box; what of the box lies
//!   nearer than the near plane (0.1 m) is cut off first.
//! - **Truncation** is the share of the hull's area outside of the image.
//! - A pixel of the hull is **covered** if it shows something else that is nearer than the box.
//!   With a depth image that is exact: its depth is less than that at which the pixel's ray enters
//!   the box, by more than [`boxes::DEPTH_SLACK_M`]. Without one only other bodies count, those
//!   whose centres are nearer; scenery then covers nothing.
//! - **Occlusion** is the share of covered pixels among the hull's pixels inside the image.
//! - The **visible fraction** is (1 − occlusion) · (1 − truncation), and 0 if no pixel shows the
//!   body. A body does not fill its hull; that its covered part fills the hull like the part that
//!   is not covered is the one assumption in it.
//! - The **visible box** is the smallest rectangle round the pixels that show the body; the
//!   **projected box** is that of its hull and may reach out of the image.
//!
//! Pixel coordinates count from the outer corner of the top-left pixel.
//!
//! # Scenery
//!
//! Objects of the map (ids with bit 31) have no actor record. Vehicles and people among them, parked
//! cars above all, are bodies that stand still, if the recording lists them (attachments
//! `scenery.<tick>.json`, see [`schema_recording::scenery`]). All others, and those of recordings
//! without such lists, have no box in space. They do have pixels and points: [`segments`] lists
//! them like bodies, with class, mask and visible box.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod bodies;
pub mod boxes;
pub mod camera;
pub mod masks;
pub mod points;
pub mod recording;
pub mod scenario;
pub mod segments;
pub mod ticks;

pub use bodies::{Body, bodies};
pub use boxes::{BoxTruth, Images, box_truths};
pub use camera::Camera;
pub use masks::Mask;
pub use points::PointCounts;
pub use segments::{Segment, segments};
