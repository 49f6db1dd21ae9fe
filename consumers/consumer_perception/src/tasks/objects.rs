//! Tasks about things: boxes in images and in space, masks, and tracks.

pub mod boxes2d;
pub mod boxes3d;
pub mod detect;
pub mod masks;
pub mod tracking;
