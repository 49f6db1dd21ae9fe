//! What to record, and where to.

use std::path::PathBuf;

use schema_bus::BusOptions;

use crate::select::Select;
use schema_recording::write::ChunkCompression;

/// What to record.
#[derive(Clone, Debug)]
pub struct Options {
    /// First segment of the service names.
    pub domain: String,
    /// Where iceoryx2 keeps its files.
    pub bus: BusOptions,
    /// Topics of frames and results to record. Snapshots and documents of the world are always
    /// recorded.
    pub select: Select,
    /// File to write.
    pub out: PathBuf,
    /// Compression of its chunks.
    pub compression: ChunkCompression,
    /// Most bytes that wait for the writer.
    pub queue_bytes: usize,
    /// Whether the simulator waits for this recorder.
    pub lockstep: bool,
    /// Name under which it waits; `None` is made from the process id.
    pub lockstep_name: Option<String>,
}
