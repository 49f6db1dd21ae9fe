//! Memory that more than the GPU's own work reaches: segments that frames are copied to, memory of
//! the process that shaders read and write, and memory of the device that other processes import.

mod export;
mod host;
mod import;
mod target;

pub use export::{ExportError, ExportedMemory};
pub use host::HostMemory;
pub use import::ImportError;
pub use target::{DirectTarget, ShmTarget};
