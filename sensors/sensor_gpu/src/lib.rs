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

pub mod copy;
pub mod copy_queue;
pub mod counters;
pub mod device;
pub mod direct;
pub mod host;
mod import;
pub mod in_flight;
pub mod prefix_sum;
mod raw_copy;
pub mod resource;
mod shared;
pub mod target;
pub mod timing;

pub use copy::{CopyBatch, Place};
pub use copy_queue::{CopyPath, Reads};
pub use counters::{Counters, Counts};
pub use device::{AdapterInfo, Gpu, GpuError, GpuOptions};
pub use direct::Direct;
pub use host::HostMemory;
pub use in_flight::{CopyOutcome, InFlight, Mapped};
pub use prefix_sum::prefix_sum_wgsl;
pub use target::ShmTarget;
pub use timing::Span;
