//! What `gantry top` shows at one moment; its JSON is this, field by field.

use serde::Serialize;

use crate::look::census::{Kind, Member};

/// Everything at one moment.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct View {
    /// The domain.
    pub domain: String,
    /// Time since the look before, seconds.
    pub interval_secs: f64,
    /// The simulated world, if one runs.
    pub world: Option<World>,
    /// Shared memory.
    pub shared_memory: SharedMemory,
    /// Processes by pid.
    pub processes: Vec<ProcessRow>,
    /// Topics by name.
    pub topics: Vec<TopicRow>,
}

/// What the newest snapshot says.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct World {
    /// Its tick.
    pub tick: u64,
    /// Simulated time, seconds since the daemon started.
    pub sim_secs: f64,
    /// Simulated seconds per second; `None` until two snapshots were seen.
    pub speed: Option<f64>,
}

/// `/dev/shm`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SharedMemory {
    /// Size, bytes.
    pub size_bytes: u64,
    /// Free, bytes.
    pub free_bytes: u64,
}

/// A process on the bus.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ProcessRow {
    /// Process id.
    pub pid: u32,
    /// Name under which it joined the bus.
    pub name: String,
    /// Share of one core, percent; `None` if it cannot be told.
    pub cpu_percent: Option<f32>,
    /// Resident memory, bytes, with the shared memory that it has mapped.
    pub resident_bytes: Option<u64>,
    /// Time since its start, seconds.
    pub uptime_secs: Option<u64>,
    /// Stopped by a signal or a debugger.
    pub stopped: bool,
    /// Topics that it writes.
    pub writes: Vec<String>,
    /// Topics that it reads.
    pub reads: Vec<String>,
    /// What its time goes into since the look before, the most expensive first; empty at the first
    /// look, and of a process that counts no stages.
    pub stages: Vec<StageRow>,
}

/// A stage of a process's work.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StageRow {
    /// Its name.
    pub stage: String,
    /// Share of one core, percent.
    pub cpu_percent: f64,
    /// Processor time of a tick of the world, milliseconds; `None` if it stood still.
    pub cpu_ms_per_tick: Option<f64>,
}

/// A topic.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TopicRow {
    /// Name without the domain.
    pub topic: String,
    /// What it carries.
    pub kind: Kind,
    /// Its type in a word.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Samples per second, from the writers' memory; 0 if they are silent.
    pub rate_hz: Option<f64>,
    /// Time since the newest sample was published, nanoseconds.
    pub age_nanos: Option<u64>,
    /// Of results: time from the oldest sensor frame behind the newest one to its publishing.
    pub since_sensor_nanos: Option<u64>,
    /// Bytes per second: rate times mean payload.
    pub bytes_per_sec: Option<f64>,
    /// Payload of the newest sample, bytes.
    pub payload_bytes: Option<u64>,
    /// Longest payload that a writer can send, bytes.
    pub max_payload_bytes: usize,
    /// Number of the newest sample.
    pub seq: Option<u64>,
    /// Tick of the newest sample.
    pub tick: Option<u64>,
    /// Processes that write it.
    #[serde(rename = "written_by")]
    pub writers: Vec<Member>,
    /// Processes that read it.
    #[serde(rename = "read_by")]
    pub readers: Vec<Member>,
    /// Places for readers that are taken.
    #[serde(rename = "readers")]
    pub n_readers: usize,
    /// Places for readers.
    pub max_readers: usize,
    /// What top's own reader measured, if it reads this topic.
    pub measured: Option<Measured>,
    /// Rates of the looks before, oldest first.
    pub rate_history: Vec<f64>,
}

/// Figures of top's own reader since it began to read.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Measured {
    /// Samples that it received.
    pub samples: u64,
    /// Samples that it missed: gaps in the writers' numbers.
    pub lost: u64,
    /// Samples that broke the contract.
    pub refused: u64,
    /// Standard deviation of the intervals, nanoseconds.
    pub jitter_nanos: Option<u64>,
    /// Time from publishing until it had them in hand, median, nanoseconds.
    pub delay_nanos_p50: Option<u64>,
    /// The same, exceeded by one of a hundred.
    pub delay_nanos_p99: Option<u64>,
    /// Why it reads no more; empty while it does.
    pub fault: String,
}

impl TopicRow {
    /// Losses of top's own reader.
    pub fn lost(&self) -> Option<u64> {
        self.measured.as_ref().map(|measured| measured.lost)
    }

    /// Whether the row belongs to a filter.
    pub fn fits(&self, filter: &str) -> bool {
        let mut ends = self.writers.iter().chain(&self.readers);
        self.topic.contains(filter)
            || self.type_name.contains(filter)
            || ends.any(|member| member.name.contains(filter))
    }
}

impl ProcessRow {
    /// Whether the row belongs to a filter.
    pub fn fits(&self, filter: &str) -> bool {
        let mut topics = self.writes.iter().chain(&self.reads);
        self.name.contains(filter) || topics.any(|topic| topic.contains(filter))
    }
}
