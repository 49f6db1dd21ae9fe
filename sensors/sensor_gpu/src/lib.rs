//! The one crate that opens GPU devices, imports shared memory into them and copies results to
//! where readers are.
//!
//! A frame is born in its reader's memory: [`ShmTarget::import`] wraps a whole shared-memory
//! segment as a GPU buffer
//! (`VK_EXT_external_memory_host`), and [`CopyBatch`] records copies from textures and buffers to
//! offsets in it, with tight rows, where the
//! adapter has a queue for that beside the drawing of the next frame.
//! Shaders that know where their results go write there themselves ([`Gpu::submit_direct`]).
//! Where the driver cannot do that, the same calls go through a staging buffer and one CPU copy;
//! `cpu_copies` tells which.
//! Vulkan only. Sensors describe their passes; this crate owns the device, the submission and the
//! wait.

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
