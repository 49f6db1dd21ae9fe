//! Frames on the GPU on which they were made: the simulator's memory imported into CUDA, or, of a
//! software adapter, mapped. Nothing is copied, and a frame's slot stays the reader's until the
//! work that it gave to the GPU is done.
//!
//! CUDA's driver is looked for when it is first used; programs start without it. Where the
//! simulator draws on another GPU than CUDA computes on, [`GpuTopic`] reads the topic from shared
//! memory and uploads it through page-locked memory, and [`GpuTopic::fallback`] says why.
//!
//! | Modules, in reading order | What they hold |
//! |---|---|
//! | `error` | errors, as sentences |
//! | `cuda`, `mapping` | memory of another process in CUDA, and as bytes |
//! | `device` | which GPU, and whether it is the simulator's |
//! | `release` | slots that go back once the GPU is done with them |
//! | `upload` | the way over page-locked memory |
//! | `topic` | a topic's frames, whichever way they come |
//! | `watch` | when to look whether they still come that way |
//!
//! ```no_run
//! use consumer_gpu::{Device, GpuTopic};
//!
//! let bus = schema_bus::Bus::open("gantry", "my-network")?;
//! let mut camera = GpuTopic::open(&bus, "ego/front/rgb", Device::Cuda)?;
//! if let Some(frame) = camera.wait(&bus, std::time::Duration::from_secs(10))? {
//!     println!("{} bytes at device address {:#x}", frame.n_bytes(), frame.address());
//! }
//! # Ok::<(), consumer_gpu::GpuError>(())
//! ```

#![warn(missing_docs)]
#![deny(unsafe_op_in_unsafe_fn)]
#![expect(
    unsafe_code,
    reason = "CUDA's driver interface and mappings; each block carries its proof"
)]

mod cuda;
mod device;
mod error;
mod mapping;
mod release;
mod topic;
mod upload;
mod watch;

pub use device::Device;
pub use error::GpuError;
pub use topic::{FrameOnGpu, GpuTopic};
