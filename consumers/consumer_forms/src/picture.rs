//! Pictures made small in little time of the processor, for programs that show or keep them.
//!
//! Pixels in memory in, a picture's bytes out; nothing here reads a file or knows a topic.
//! [`mod@jpeg`] is for colour, [`mod@indexed`] for pictures of few colours, without loss,
//! [`mod@depth`] for distances, [`mod@h264`] for video, [`PictureError`] for what cannot be coded.

pub mod depth;
mod error;
pub mod h264;
pub mod indexed;
pub mod jpeg;

pub use error::PictureError;
