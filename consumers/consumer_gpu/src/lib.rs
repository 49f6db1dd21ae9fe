//! Frames and results on the GPU on which they were made: the writer's memory imported into CUDA,
//! or, of a software adapter, mapped. Nothing is copied, and a sample's slot stays the reader's until
//! the work that it gave to the GPU is done. [`GpuPublisher`] is the writing end of results.
//!
//! CUDA's driver is looked for when it is first used; programs start without it. Where the writer
//! is on another GPU than CUDA computes on, [`GpuTopic`] and [`GpuResults`] read the topic from
//! shared memory and upload it through page-locked memory, and [`Topic::fallback`] says why.
//!
//! | Modules, in reading order | What they hold |
//! |---|---|
//! | `error` | errors, as sentences |
//! | `cuda`, `mapping` | memory of another process in CUDA, and as bytes |
//! | `device` | which GPU, and whether it is the simulator's |
//! | `release` | slots that go back once the GPU is done with them |
//! | `shared`, `stream` | memory of CUDA that processes share, and copies within the device |
//! | `upload` | the way over page-locked memory |
//! | `memory` | memory of writers as this process has it |
//! | `port`, `sample` | the ways that samples come, and a sample that came |
//! | `kinds`, `topic` | a topic of frames or results, whichever way they come |
//! | `watch` | when to look whether they still come that way |
//! | `publisher` | results that are written on the device |
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
mod kinds;
mod mapping;
mod memory;
mod port;
mod publisher;
mod release;
mod sample;
mod shared;
mod stream;
mod topic;
mod upload;
mod watch;

pub use cuda::device_of;
pub use device::Device;
pub use error::GpuError;
pub use kinds::{Frames, Kind, Results};
pub use publisher::{Body, GpuLoan, GpuPublisher, SlotMemory};
pub use sample::{FrameOnGpu, OnGpu, ResultOnGpu};
pub use topic::{GpuResults, GpuTopic, Topic};
