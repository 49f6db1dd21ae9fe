//! Tasks about every pixel of an image, or every point of a cloud: depth, disparity, flow, classes.

pub mod depth;
pub mod event_flow;
pub mod flow;
pub mod lidar_semantic;
pub mod pixels;
pub mod semantic;
pub mod stereo;
