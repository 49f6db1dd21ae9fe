//! What a recording of the truth holds, and how such recordings are made.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::scenario::InputTopic;

/// A frame of an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordedFrame {
    /// Its tick.
    pub tick: u64,
    /// Number of its firing.
    pub seq: u64,
    /// Its simulated time, nanoseconds.
    pub sim_nanos: u64,
}

/// What a recording holds.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Found {
    pub map: String,
    pub seed: u64,
    pub rig: String,
    pub frames_hash: String,
    pub begin_nanos: u64,
    pub end_nanos: u64,
    pub last_tick: u64,
    pub inputs: Vec<InputTopic>,
    pub frames: BTreeMap<String, Vec<RecordedFrame>>,
    pub topics: Vec<String>,
    pub adapter: String,
}

/// How truth passes are made.
#[derive(Clone, Debug)]
pub struct Options {
    /// Folder in which recordings are kept.
    pub cache: PathBuf,
    /// Most bytes of recordings in it; the one that was not used for longest goes first.
    pub cache_limit_bytes: u64,
    /// GPU for the simulator, as `simd --adapter` takes it.
    pub adapter: Option<String>,
    /// Longest time without a finished tick before the simulator counts as hanging.
    pub stall: std::time::Duration,
    /// Version and hash of the programs that make recordings, see [`super::build`].
    pub build: String,
}
