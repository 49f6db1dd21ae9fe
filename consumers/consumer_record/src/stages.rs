//! Stages of recording, whose processor time is counted always; `gantry bench tick --profile` shows
//! them.

use schema_stages::Stage;

/// Taking what arrived, and queueing it.
pub(crate) static TAKE: Stage = Stage::new("take");
/// Snapshots as messages.
pub(crate) static SNAPSHOTS: Stage = Stage::new("snapshots");
/// Coding payloads.
pub(crate) static CODE: Stage = Stage::new("code");
/// Small pictures for other programs.
pub(crate) static PREVIEW: Stage = Stage::new("preview");
/// Chunks into the file.
pub(crate) static WRITE: Stage = Stage::new("write");
/// Bringing the file to the disk.
pub(crate) static SYNC: Stage = Stage::new("sync");
