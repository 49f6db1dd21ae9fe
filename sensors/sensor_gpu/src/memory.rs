//! Memory of the host that the GPU reaches: segments that frames are copied to, and memory of the
//! process that shaders read and write.

mod host;
mod import;
mod target;

pub use host::HostMemory;
pub use import::ImportError;
pub use target::{DirectTarget, ShmTarget};
