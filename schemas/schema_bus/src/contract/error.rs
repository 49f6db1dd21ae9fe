//! Errors of the bus, as sentences that say what failed, with which value, and what to do.

use std::path::PathBuf;
use std::sync::Arc;

use schema_frames::{FrameError, ResultError, SCHEMA_VERSION};

use crate::contract::origin::Origin;

/// Why an operation on the bus failed.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// Unusable domain.
    #[error(
        "domain {domain:?} is not usable: it must be 1 to 32 characters of a-z, A-Z, 0-9, '_' and '-'; choose another with --domain"
    )]
    Domain {
        /// What was given.
        domain: String,
    },
    /// Unusable topic name.
    #[error(
        "topic {topic:?} is not usable: it must be 1 to 200 characters of a-z, A-Z, 0-9, '_', '-' and '.', in segments joined by '/'"
    )]
    Name {
        /// What was given.
        topic: String,
    },
    /// No node could be made.
    #[error(
        "cannot join the shared-memory bus as {program:?} ({cause}); check that /dev/shm and /tmp/iceoryx2 exist and are writable"
    )]
    Node {
        /// Name of this program.
        program: String,
        /// iceoryx2's name for the error.
        cause: String,
    },
    /// Unusable private root or prefix.
    #[error(
        "cannot use {value:?} as iceoryx2 {what}; it must be a short path or file name without special characters"
    )]
    Option {
        /// `root` or `prefix`.
        what: &'static str,
        /// What was given.
        value: String,
    },
    /// No process has made the topic.
    #[error("there is no topic {topic:?}{hint}")]
    NoSuchTopic {
        /// Service that was looked for.
        topic: String,
        /// The topics that exist instead, as a continuation of the sentence.
        hint: String,
    },
    /// The other side speaks another version of the layouts.
    #[error(
        "cannot join service {service:?}: it carries schema {theirs}, this binary reads {SCHEMA_VERSION}; {advice}"
    )]
    SchemaSkew {
        /// The service.
        service: String,
        /// Its version; `none` for a foreign service.
        theirs: String,
        /// What to do.
        advice: &'static str,
    },
    /// The service has as many readers as it allows.
    #[error(
        "service {service:?} already has {limit} readers (limit {limit}); stop one before another can join"
    )]
    TooManyReaders {
        /// The service.
        service: String,
        /// The limit.
        limit: usize,
    },
    /// The service has as many writers as it allows.
    #[error(
        "service {service:?} already has {limit} writers (limit {limit}); stop the other simulator, or give this one another --domain"
    )]
    TooManyWriters {
        /// The service.
        service: String,
        /// The limit.
        limit: usize,
    },
    /// Another process writes the topic of results.
    #[error(
        "topic {topic:?} is written by {writer}, and a topic has one writer; stop that process, or publish under another name"
    )]
    TopicTaken {
        /// The service.
        topic: String,
        /// Who writes it.
        writer: String,
    },
    /// A name that users' programs may not take.
    #[error(
        "topic {topic:?} cannot be published: names that begin with \"world/\" or \"control/\" are the simulator's, those that end in \"/about\" or \"/gpu\" are descriptions or results on a GPU; choose another"
    )]
    Reserved {
        /// What was given.
        topic: String,
    },
    /// The topic carries something else than was asked for.
    #[error("topic {topic:?} carries {theirs}, not {wanted}; {advice}")]
    OtherKind {
        /// The service.
        topic: String,
        /// What it carries.
        theirs: String,
        /// What was asked for.
        wanted: String,
        /// What to do.
        advice: &'static str,
    },
    /// A topic that cannot be described so.
    #[error("topic {topic:?} cannot be made: {fault}")]
    Description {
        /// The service.
        topic: String,
        /// What is wrong, as a sentence.
        fault: String,
    },
    /// A result breaks the contract.
    #[error("{service}{}: {source}", from(.writer))]
    BadResult {
        /// The service.
        service: String,
        /// Who sent it; `None` if this process was about to.
        writer: Option<Arc<Origin>>,
        /// The broken rule.
        source: ResultError,
    },
    /// The service is open in as many processes as it allows.
    #[error("service {service:?} is already open in {limit} processes (limit {limit}); stop one")]
    TooManyProcesses {
        /// The service.
        service: String,
        /// The limit.
        limit: usize,
    },
    /// Readers keep the service alive with other capacities.
    #[error(
        "service {service:?} exists with another capacity ({cause}); a reader keeps it alive: stop all readers of this domain and start again"
    )]
    Capacity {
        /// The service.
        service: String,
        /// iceoryx2's name for the error.
        cause: String,
    },
    /// The service belongs to another user.
    #[error(
        "not allowed to open service {service:?}: it belongs to another user; run as that user, or use another --domain"
    )]
    Permission {
        /// The service.
        service: String,
    },
    /// Shared memory is full.
    #[error("cannot reserve {need} of shared memory for {service}: /dev/shm has {free} free; free space, make it larger, or ask for fewer or smaller images", need = mebibytes(*.need_bytes), free = mebibytes(*.free_bytes))]
    Memory {
        /// The service.
        service: String,
        /// Bytes of the segment.
        need_bytes: u64,
        /// Bytes that are free.
        free_bytes: u64,
    },
    /// The reader holds all the frames it may.
    #[error(
        "cannot take another sample of {service:?}: this reader already holds {limit} (limit {limit}); drop one, or copy what has to be kept"
    )]
    BorrowLimit {
        /// The service.
        service: String,
        /// Most that may be held.
        limit: usize,
    },
    /// A frame breaks the contract.
    #[error("{service}{}: {source}", from(.writer))]
    BadFrame {
        /// The service.
        service: String,
        /// Who sent it; `None` if this process was about to.
        writer: Option<Arc<Origin>>,
        /// The broken rule.
        source: FrameError,
    },
    /// Frames or results cannot be had on a GPU.
    #[error("{topic:?} does not come over the GPU: {fault}")]
    Gpu {
        /// The topic.
        topic: String,
        /// Why, as a clause.
        fault: String,
    },
    /// The memory of a sample on a GPU is not what the sample says.
    #[error("{topic:?} cannot be read on the GPU: {fault}")]
    GpuMemory {
        /// The topic.
        topic: String,
        /// What does not agree, as a clause.
        fault: String,
    },
    /// Another sample breaks the contract.
    #[error("sample of {service:?}{} {fault}; the writer is broken or of another version", from(.writer))]
    BadSample {
        /// The service.
        service: String,
        /// Who sent it, if that is known.
        writer: Option<Arc<Origin>>,
        /// The broken rule, as a predicate.
        fault: String,
    },
    /// A sample does not fit.
    #[error("cannot send {len} bytes on {service:?}: its slots have {limit}")]
    TooLong {
        /// The service.
        service: String,
        /// Bytes asked for.
        len: usize,
        /// Bytes of a slot.
        limit: usize,
    },
    /// The segment's mapping was not found.
    #[error(
        "cannot find the segment of {service:?} in /proc/self/maps ({cause}); GPU import is not possible, use the staged path"
    )]
    Segment {
        /// The service.
        service: String,
        /// Why.
        cause: String,
    },
    /// A file could not be written.
    #[error("cannot write iceoryx2's configuration: {source} at {path}", path = .path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Anything else of iceoryx2.
    #[error(
        "cannot {action} {service:?} ({cause}); if a process was killed a moment ago, try again, else restart this domain"
    )]
    Service {
        /// What was tried: `open`, `write to`, …
        action: &'static str,
        /// The service.
        service: String,
        /// iceoryx2's name for the error.
        cause: String,
    },
}

/// Why a frame could not be loaned.
#[derive(Debug, thiserror::Error)]
pub enum LoanError {
    /// All slots are loaned or held. The sensor skips this firing and its readers see a gap.
    #[error("no free slot on {topic:?}: all {loans} loans are in use; raise frames_in_flight")]
    NoFreeSlot {
        /// The topic.
        topic: String,
        /// Loans at a time.
        loans: usize,
    },
    /// A longer slot than there is memory for.
    #[error("cannot reserve {need} of shared memory for longer results of {topic:?}: /dev/shm has {free} free; free space, make it larger, or publish less", need = mebibytes(*.need_bytes), free = mebibytes(*.free_bytes))]
    Memory {
        /// The topic.
        topic: String,
        /// Bytes of the longer segment.
        need_bytes: u64,
        /// Bytes that are free.
        free_bytes: u64,
    },
    /// Longer than a slot.
    #[error("cannot loan {len} bytes on {topic:?}: its slots have {limit}")]
    TooLong {
        /// The topic.
        topic: String,
        /// Bytes asked for.
        len: usize,
        /// Bytes of a slot.
        limit: usize,
    },
    /// Anything else.
    #[error("cannot loan a slot of {topic:?} ({cause})")]
    Failed {
        /// The topic.
        topic: String,
        /// iceoryx2's name for the error.
        cause: String,
    },
}

/// The writer as part of a sentence.
fn from(writer: &Option<Arc<Origin>>) -> String {
    writer
        .as_ref()
        .map(|writer| format!(" from {writer}"))
        .unwrap_or_default()
}

/// `n` bytes as MiB, rounded up.
pub(crate) fn mebibytes(n: u64) -> String {
    format!("{} MiB", n.div_ceil(1 << 20))
}
