//! What to record, how it is stored, and where to.

use std::path::PathBuf;

use crossbeam_channel::Receiver;
use schema_bus::BusOptions;
use schema_recording::write::ChunkCompression;

use crate::dump::DumpRequest;
use crate::select::Select;

/// What to record.
#[derive(Clone, Debug)]
pub struct Options {
    /// First segment of the service names.
    pub domain: String,
    /// Where iceoryx2 keeps its files.
    pub bus: BusOptions,
    /// Topics of frames and results to record. Snapshots and documents of the world are always
    /// recorded.
    pub select: Select,
    /// File to write; with [`Options::split`] or [`Options::ring`] the stem of several.
    pub out: PathBuf,
    /// Compression of its chunks.
    pub compression: ChunkCompression,
    /// How payloads of frames are stored.
    pub coding: Coding,
    /// When a file is closed and the next begun.
    pub split: Split,
    /// Keep the newest in memory instead, and write on request.
    pub ring: Option<Ring>,
    /// Most bytes that wait for the writer.
    pub queue_bytes: usize,
    /// Whether the simulator waits for this recorder.
    pub lockstep: bool,
    /// Name under which it waits; `None` is made from the process id.
    pub lockstep_name: Option<String>,
}

impl Options {
    /// Everything of a domain into one file, with the defaults of the program.
    pub fn new(domain: &str, out: PathBuf) -> Options {
        Options {
            domain: domain.to_string(),
            bus: BusOptions::default(),
            select: Select::default(),
            out,
            compression: ChunkCompression::None,
            coding: Coding::default(),
            split: Split::default(),
            ring: None,
            queue_bytes: 256 << 20,
            lockstep: false,
            lockstep_name: None,
        }
    }
}

/// Simulated time from one key frame of a video to the next, nanoseconds. With video, files begin
/// at its multiples, so that each begins with key frames.
pub const KEY_EVERY_NANOS: u64 = 1_000_000_000;

/// How payloads of frames are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Coding {
    /// Whether [`schema_recording::codec`] makes them smaller, losslessly.
    pub lossless: bool,
    /// Whether topics whose payload no other program can show get a small picture for those.
    pub previews: bool,
    /// Colour images as JPEG of this quality, 1 to 100, instead of their payload.
    pub jpeg_quality: Option<u8>,
    /// Colour images as H.264 video with this quantiser, 1 to 51, instead of their payload.
    pub video_qp: Option<u8>,
    /// Threads that code; 0 for as many as suit the machine.
    pub n_threads: usize,
}

impl Default for Coding {
    fn default() -> Self {
        Coding {
            lossless: true,
            previews: true,
            jpeg_quality: None,
            video_qp: None,
            n_threads: 0,
        }
    }
}

impl Coding {
    /// Payloads as they are on the bus, in messages that other programs show.
    pub fn none() -> Coding {
        Coding {
            lossless: false,
            ..Coding::default()
        }
    }

    /// Whether frames go into the file as they come.
    pub fn is_plain(&self) -> bool {
        !self.lossless && self.jpeg_quality.is_none() && self.video_qp.is_none()
    }

    /// Threads that code: half of the processors, at least one, at most four.
    pub fn threads(&self) -> usize {
        let processors = std::thread::available_parallelism().map_or(1, |n| n.get());
        match self.n_threads {
            0 => (processors / 2).clamp(1, 4),
            n => n,
        }
    }
}

/// When a file is closed and the next begun; between two simulated times, so that no tick is divided.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Split {
    /// Once it has this many bytes.
    pub max_bytes: Option<u64>,
    /// Once it covers this much simulated time, nanoseconds.
    pub max_sim_nanos: Option<u64>,
}

impl Split {
    /// Whether there can be several files.
    pub fn is_on(&self) -> bool {
        self.max_bytes.is_some() || self.max_sim_nanos.is_some()
    }
}

/// A recording in memory, of which nothing is written until it is asked for.
#[derive(Clone, Debug)]
pub struct Ring {
    /// Simulated time to keep, nanoseconds.
    pub keep_nanos: u64,
    /// Most memory for it, bytes; what does not fit is forgotten, oldest first.
    pub max_bytes: usize,
    /// Whether it is written at the end too.
    pub dump_at_end: bool,
    /// Where requests to write it come from.
    pub requests: Receiver<DumpRequest>,
}
