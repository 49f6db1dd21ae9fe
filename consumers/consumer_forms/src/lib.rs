//! The forms in which other programs see a frame, a result and the world.
//!
//! Everything here turns memory into other memory; nothing reads a file, a clock or a topic.
//! [`foxglove`] is the messages of recordings, which Foxglove shows; [`ros2`] those of ROS 2, for
//! its nodes and for bags; [`picture`] makes pictures small in little time of the processor;
//! [`palette`] holds the colours.

#![warn(missing_docs)]

pub mod foxglove;
pub mod palette;
pub mod picture;
pub mod ros2;
