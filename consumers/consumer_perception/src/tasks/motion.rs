//! Tasks about the ego and its road: where it is, the lines beside it, and how a program drives it.

pub mod driving;
pub mod lanes;
pub mod odometry;
