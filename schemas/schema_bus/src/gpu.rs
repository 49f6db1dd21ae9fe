//! Frames whose payloads stay on a GPU: their readers, and the socket over which descriptors of
//! GPU memory travel.

mod message;
mod reader;
mod server;
mod socket;

pub use reader::{GpuFrame, GpuFrameReader, GpuMemory, GpuOffer};
pub(crate) use reader::{fetch, offer};
pub use server::{GpuDevice, GpuServer, GpuTopic, SharedMemory};
pub(crate) use socket::sweep;
