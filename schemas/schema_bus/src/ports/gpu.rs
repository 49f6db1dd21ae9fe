//! Frames and results whose payloads stay on a GPU: their writers and readers, and who hands out
//! descriptors of GPU memory over the socket of [`crate::gpu_socket`].

mod message;
mod reader;
mod result_reader;
mod result_writer;
mod server;

pub use reader::{GpuFrame, GpuFrameReader, GpuFrames, GpuMemory, GpuOffer, GpuSample};
pub(crate) use reader::{fetch, offer};
pub use result_reader::{GpuResult, GpuResultReader, GpuResults};
pub use result_writer::{GpuPlaces, GpuResultPublisher, GpuResultSlot};
pub use server::{GpuDevice, GpuServer, GpuTopic, SharedMemory};
