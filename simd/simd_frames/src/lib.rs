//! From a scene to published frames: sensors with their schedules and models, topics with their
//! memory, and the passes that fill it.
//!
//! Nothing here knows where a scene comes from: the world is another crate's.

pub mod batch;
pub mod carrier;
pub mod frames;
pub mod gpu_end;
pub mod hash;
pub mod rig;
pub mod sensor;
pub mod share;
pub mod stages;
pub mod topic;
