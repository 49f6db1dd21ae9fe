//! What readers of GPU frames and their writers say to each other over the writer's socket: one
//! question, one answer, and with an answer about memory its descriptor.

use bytemuck::{Pod, Zeroable};

use crate::version::SCHEMA_VERSION;

/// "GGPU" read as a little-endian `u32`.
pub const GPU_MAGIC: u32 = u32::from_le_bytes(*b"GGPU");

/// A question, 256 bytes: who writes a topic, or the descriptor of a memory.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct GpuAsk {
    /// [`GPU_MAGIC`].
    pub magic: u32,
    /// [`SCHEMA_VERSION`].
    pub schema_version: u16,
    /// 1: does this process write `topic`, and where? It then makes the topic's GPU service. 2: the
    /// descriptor of the memory `generation`.
    pub what: u16,
    /// Number of the memory; 0 when a topic is asked for.
    pub generation: u64,
    /// Name of the topic without domain and without "/gpu", UTF-8, filled up with zeros.
    pub topic: [u8; 240],
}
const _: () = assert!(size_of::<GpuAsk>() == 256);

/// The answer, 128 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct GpuAnswer {
    /// [`GPU_MAGIC`].
    pub magic: u32,
    /// [`SCHEMA_VERSION`].
    pub schema_version: u16,
    /// 0: here it is. 1: this process does not write the topic on a GPU. 2: there is no such memory
    /// any more. 3: the question has another schema.
    pub status: u16,
    /// UUID of the GPU, as Vulkan and CUDA say it.
    pub device_uuid: [u8; 16],
    /// UUID of its Vulkan driver.
    pub driver_uuid: [u8; 16],
    /// Number of the memory, as asked.
    pub generation: u64,
    /// Length of the memory, bytes: with another length it must not be imported.
    pub memory_bytes: u64,
    /// What the descriptor is: 0 there is none, 1 Vulkan's `OPAQUE_FD` of a dedicated allocation, 2
    /// CUDA's shareable POSIX descriptor.
    pub handle_kind: u32,
    /// Bit 0: the device is a software adapter, whose memory can be mapped.
    pub flags: u32,
    /// Places for readers of the topic's GPU service, if a reader makes it.
    pub max_readers: u32,
    /// Frames of it that wait for a reader.
    pub buffer: u32,
    /// Frames of it that a reader may hold.
    pub borrowed: u32,
    /// Zero.
    pub reserved: [u8; 52],
}
const _: () = assert!(size_of::<GpuAnswer>() == 128);

impl GpuAsk {
    /// `what`: a topic's writer.
    pub const TOPIC: u16 = 1;
    /// `what`: a memory's descriptor.
    pub const MEMORY: u16 = 2;

    /// Asks for a topic; `None` if its name is too long to be one.
    pub fn topic(topic: &str) -> Option<GpuAsk> {
        let mut ask = GpuAsk {
            what: GpuAsk::TOPIC,
            ..GpuAsk::new()
        };
        ask.topic
            .get_mut(..topic.len())?
            .copy_from_slice(topic.as_bytes());
        Some(ask)
    }

    /// Asks for the descriptor of a memory.
    pub fn memory(generation: u64) -> GpuAsk {
        GpuAsk {
            what: GpuAsk::MEMORY,
            generation,
            ..GpuAsk::new()
        }
    }

    fn new() -> GpuAsk {
        GpuAsk {
            magic: GPU_MAGIC,
            schema_version: SCHEMA_VERSION,
            ..Zeroable::zeroed()
        }
    }

    /// The topic's name; `None` if it is none.
    pub fn topic_name(&self) -> Option<&str> {
        let end = self.topic.iter().position(|b| *b == 0)?;
        std::str::from_utf8(&self.topic[..end]).ok()
    }
}

impl GpuAnswer {
    /// `status`: here it is.
    pub const OK: u16 = 0;
    /// `status`: another process's topic, or one that stays in shared memory.
    pub const NOT_MINE: u16 = 1;
    /// `status`: memory that is gone.
    pub const GONE: u16 = 2;
    /// `status`: a question of another schema.
    pub const OTHER_SCHEMA: u16 = 3;
    /// `handle_kind`: Vulkan's opaque descriptor of a dedicated allocation.
    pub const VULKAN: u32 = 1;
    /// `handle_kind`: CUDA's shareable descriptor.
    pub const CUDA: u32 = 2;
    /// Flag: memory of a software adapter, which can be mapped.
    pub const MAPPABLE: u32 = 1;

    /// An answer with this status.
    pub fn new(status: u16) -> GpuAnswer {
        GpuAnswer {
            magic: GPU_MAGIC,
            schema_version: SCHEMA_VERSION,
            status,
            ..Zeroable::zeroed()
        }
    }
}
