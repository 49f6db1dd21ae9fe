//! Frames, results and the world as messages of ROS 2, and such messages read: one set for the node
//! that the bridge is and for bags.
//!
//! Axes are those of REP 103 and 105: x forward, y left, z up, which are Gantry's own; cameras have a
//! second frame, `…_optical`, with z forward, x right, y down. Stamps are simulated time.
//!
//! [`cdr`] is the bytes, [`types`] the types' names, hashes and fields; [`sensors`] and [`world`] write
//! messages, [`read`] reads those of others.

pub mod cdr;
mod definitions;
pub mod read;
pub mod sensors;
pub mod types;
pub mod world;
