//! Metrics of perception, each implemented once: how right a list of boxes, a mask, an image of
//! classes or depths, a flow, a set of tracks, a trajectory, lanes or a drive is, given the truth.
//!
//! Everything here is plain numbers in, plain numbers out: no bus, no files, no clocks. A metric is
//! a collector that is fed frame by frame and asked for its scores at the end. Each follows the
//! definition of the benchmark that introduced it, which its module names, and is held against an
//! independent public implementation in the tests.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod assignment;
pub mod average_precision;
pub mod classes;
pub mod coco_json;
pub mod depth;
pub mod detection3d;
pub mod driving;
mod errors;
pub mod event_flow;
pub mod flow;
pub mod lanes;
mod numbers;
pub mod odometry;
mod sequences;
pub mod sizes;
pub mod stereo;
pub mod tracking;
