//! `[topic."NAME"]`: how many may read a topic and how much waits for them, and the types of topics
//! that processes of the launch file publish.

use schema_frames::ResultType;

/// Fewest and most readers of a topic at a time. Each also listens to the topic's event, which has
/// this many places.
pub const READERS: (u32, u32) = (1, 32);
/// Fewest and most samples that may wait for a reader, or that a reader may hold.
pub const SAMPLES: (u32, u32) = (1, 256);
/// Fewest and most payload bytes that a topic of a process can be announced with: up to 1 TiB.
pub const MAX_BYTES: (u64, u64) = (1, 1 << 40);

/// One topic.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Topic {
    /// Limits that differ from the usual ones.
    pub limits: TopicLimits,
    /// What a process publishes there. A topic of the launch file's sensors has no such key.
    pub result: Option<ResultType>,
    /// Bytes of the largest result without its inputs, for the sum of shared memory; without it,
    /// 4096.
    pub max_bytes: Option<u64>,
}

/// Limits of a topic; `None` keeps the usual number of its kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TopicLimits {
    /// Readers at a time.
    pub readers: Option<u32>,
    /// Samples that wait for a reader; beyond that the oldest is dropped.
    pub buffer: Option<u32>,
    /// Samples that a reader may hold at a time.
    pub borrowed: Option<u32>,
    /// Whether its frames can stay on the GPU from the start; otherwise once a reader asks.
    pub gpu: bool,
    /// Readers on the GPU at a time.
    pub gpu_readers: Option<u32>,
}
