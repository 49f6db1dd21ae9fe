//! What stands between a message and a sample: what its channel is, what was found in it, and what
//! waits for another message.

use std::io;
use std::sync::Arc;

use schema_frames::document::DocumentHeader;
use schema_frames::{FrameHeader, InputRecord, ResultHeader, SnapshotHeader};

use super::fields::Span;

/// Where a message is in a file; of two, the one that comes first is less.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Place {
    pub(super) piece: usize,
    pub(super) at: u64,
}

/// What a channel is to a reader of samples.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    Frame,
    Result,
    Snapshot,
    Document,
    Journal,
    Foreign(ForeignType),
    /// Holds payloads of frames or bodies of results; in `data`, or as a whole.
    Bytes {
        data_field: Option<u32>,
    },
}

/// Type of another program's messages.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct ForeignType {
    pub schema: Arc<str>,
    pub encoding: Arc<str>,
}

/// A channel that is read.
#[derive(Clone, Debug)]
pub(crate) struct Wanted {
    pub topic: Arc<str>,
    pub role: Role,
}

/// A message whose head was read.
#[derive(Clone, Copy, Debug)]
pub(super) struct Message {
    pub place: Place,
    pub channel: u16,
    pub sequence: u32,
    pub log_nanos: u64,
    pub publish_nanos: u64,
    pub data: Span,
}

/// A sample of which everything is known but the place of its bytes.
#[derive(Clone, Debug)]
pub(super) struct Head {
    pub topic: Arc<str>,
    pub message: Message,
    pub of: HeadOf,
}

#[derive(Clone, Debug)]
pub(super) enum HeadOf {
    Frame(Box<FrameHeader>, String),
    Result(Box<ResultHeader>, Vec<InputRecord>),
}

impl HeadOf {
    /// Bytes of the payload or of the body, decoded.
    pub fn payload_bytes(&self) -> u64 {
        match self {
            HeadOf::Frame(header, _) => header.payload_bytes,
            HeadOf::Result(header, _) => header.body_bytes,
        }
    }
}

/// A head that waits for the message with its bytes.
#[derive(Clone, Debug)]
pub(super) struct Waiting {
    pub head: Head,
    pub channel_topic: String,
    pub piece_number: u64,
}

/// What a message turned out to be.
pub(super) enum Found {
    /// A frame or result, of which the bytes are still in the file.
    Whole(Head, Span),
    /// Something that was copied.
    Taken(Message, Taken),
}

/// What was copied out of a message.
pub(super) enum Taken {
    Snapshot(Box<SnapshotHeader>),
    Document(Arc<str>, DocumentHeader),
    Journal,
    Foreign(Arc<str>, ForeignType),
}

/// Why a message is no sample.
pub(super) enum Trouble {
    Io(io::Error),
    Bad(&'static str, String),
}

impl From<io::Error> for Trouble {
    fn from(error: io::Error) -> Trouble {
        Trouble::Io(error)
    }
}
