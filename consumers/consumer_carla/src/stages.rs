//! Stages of the gateway's work, whose processor time is counted always; `gantry bench tick --profile`
//! shows them.

use schema_stages::Stage;

/// Snapshots and documents of the world.
pub(crate) static SNAPSHOT: Stage = Stage::new("snapshot");
/// Answers to clients' calls.
pub(crate) static CALLS: Stage = Stage::new("calls");
/// Messages made of frames.
pub(crate) static CONVERT: Stage = Stage::new("convert");
/// Messages into connections, which includes the kernel's copy.
pub(crate) static SEND: Stage = Stage::new("send");
