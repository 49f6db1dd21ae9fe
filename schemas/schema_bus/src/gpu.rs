//! Frames whose payloads stay on a GPU: their readers, and who hands out descriptors of GPU memory
//! over the socket of [`crate::gpu_socket`].

mod message;
mod reader;
mod server;

pub use reader::{GpuFrame, GpuFrameReader, GpuMemory, GpuOffer};
pub(crate) use reader::{fetch, offer};
pub use server::{GpuDevice, GpuServer, GpuTopic, SharedMemory};
