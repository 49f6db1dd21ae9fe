//! Opens the GPU, imports shared memory into it, and copies results to where readers are.
//!
//! Results are written straight into their readers' memory: [`ShmTarget::import`] wraps a whole
//! shared-memory segment as a GPU buffer (`VK_EXT_external_memory_host`), and [`CopyBatch`] records
//! copies from textures and buffers to offsets in it, with tight rows. Where the adapter has a
//! queue that only copies, they run while the next submission is drawn. Shaders that know where
//! their results go write there themselves ([`Gpu::submit_direct`]). Where the driver cannot import
//! memory, the same calls go through a staging buffer and one CPU copy; `cpu_copies` states which
//! way was taken. Vulkan only. Sensors describe their passes; this crate owns the device, the
//! submission and the wait.

#![expect(
    unsafe_code,
    reason = "importing host memory and raw copies are Vulkan calls; each block carries its proof"
)]
#![warn(missing_docs)]

mod prefix_sum;

mod counters;
mod error;
mod timing;

mod queue;

mod device;
mod resource;
mod shared_texture;

mod memory;

mod copy;
mod direct;

pub use copy::{CopyBatch, CopyOutcome, InFlight, Mapped, Place};
pub use counters::{Counters, Counts};
pub use device::{AdapterInfo, Gpu, GpuOptions};
pub use direct::Direct;
pub use error::GpuError;
pub use memory::{DirectTarget, HostMemory, ShmTarget};
pub use prefix_sum::prefix_sum_wgsl;
pub use queue::{CopyPath, Reads};
pub use timing::Span;
