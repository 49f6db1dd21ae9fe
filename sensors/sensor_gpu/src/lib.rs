//! Opens the GPU, imports shared memory into it, and copies results to where readers are.
//!
//! Results are written straight into their readers' memory: [`ShmTarget::import`] wraps a whole
//! shared-memory segment as a GPU buffer (`VK_EXT_external_memory_host`), and [`CopyBatch`] records
//! copies from textures and buffers to offsets in it, with tight rows. Where the adapter has a queue
//! that only copies, they run while the next submission is drawn. Shaders that know where their
//! results go write there themselves ([`Gpu::submit_direct`]). Where the driver cannot import
//! memory, the same calls go through a staging buffer and one CPU copy; `cpu_copies` states which
//! way was taken. Memory of the device that other processes import ([`ShmTarget::export`]) is one
//! more target. Vulkan only. Sensors describe their passes; this crate owns the device, the
//! submission and the wait.
//!
//! | Modules, in reading order | What they hold |
//! |---|---|
//! | `counters`, `error`, `timing` | counts, errors and times of submissions |
//! | `queue` | the drawing queue, the copy queue, and the semaphores between them |
//! | `device`, `resource`, `shared_texture` | [`Gpu`], its buffers, textures and shaders |
//! | `memory` | segments of readers, and memory of the process that shaders reach |
//! | `copy` | batches of copies, and submissions in flight |
//! | `direct` | submissions whose shaders write to readers themselves |
//! | `prefix_sum` | WGSL that several crates share |
//!
//! ```no_run
//! use sensor_gpu::{CopyBatch, Gpu, GpuOptions, Place};
//!
//! let gpu = Gpu::open(&GpuOptions::default())?;
//! let usage = wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::RENDER_ATTACHMENT;
//! let depth = gpu.texture("depth", [64, 48], 1, wgpu::TextureFormat::R32Float, usage);
//! let mut bytes = vec![0; 4 * 64 * 48];
//! let mut batch = CopyBatch::new();
//! batch.texture(&depth, 4, Place::Memory(&mut bytes));
//! batch.submit(&gpu, gpu.encoder("depth")).wait()?;
//! # Ok::<(), sensor_gpu::GpuError>(())
//! ```

#![expect(
    unsafe_code,
    reason = "importing host memory and raw copies are Vulkan calls; each block carries its proof"
)]
#![warn(missing_docs)]

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
mod uploads;

mod prefix_sum;

pub use copy::{CopyBatch, CopyOutcome, InFlight, Mapped, PaddedRows, Place, ShmPlace};
pub use counters::{Counters, Counts};
pub use device::{AdapterInfo, DeviceIds, Gpu, GpuOptions};
pub use direct::Direct;
pub use error::GpuError;
pub use memory::{DirectTarget, ExportError, ExportedMemory, HostMemory, ImportError, ShmTarget};
pub use prefix_sum::prefix_sum_wgsl;
pub use queue::{CopyPath, MAX_GPU_WAIT, Reads};
pub use shared_texture::LayeredTexture;
pub use timing::Span;
pub use uploads::Uploads;
