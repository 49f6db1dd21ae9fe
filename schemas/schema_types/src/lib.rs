//! Units, spaces, poses, time, ids and classes that every crate shares.
//!
//! No I/O, no clock, no allocation in hot paths. Everything here is plain data or pure arithmetic.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod class;
pub mod id;
pub mod noise;
pub mod pose;
pub mod space;
pub mod time;

pub use class::Class;
pub use id::{ActorId, ObjectId};
pub use pose::Pose;
pub use time::{MonoTime, SimTime, Tick};
