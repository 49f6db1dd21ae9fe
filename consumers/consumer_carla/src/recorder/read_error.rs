//! Why a file cannot be used as a recording.

use std::io;
use std::path::Path;

use crate::wire::fields::Wrong;
use crate::wire::msgpack::DecodeError;

/// Why a file cannot be used as a recording.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// There is no such file, or it cannot be opened.
    #[error("File {name} not found on server ({cause})")]
    NotFound {
        /// Name of the file.
        name: String,
        /// Why.
        cause: io::Error,
    },
    /// The file is too large.
    #[error("{name} has {n_bytes} bytes, at most {max} are read")]
    TooLarge {
        /// Name of the file.
        name: String,
        /// Its size.
        n_bytes: u64,
        /// How many it may have.
        max: u64,
    },
    /// The file's contents are no recording.
    #[error("{name} cannot be used: {cause}")]
    Contents {
        /// Name of the file.
        name: String,
        /// Why.
        cause: ReadError,
    },
}

/// The last part of a path.
pub(super) fn name(path: &Path) -> String {
    path.file_name()
        .map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

impl OpenError {
    /// A file's contents are wrong for this reason.
    pub fn of(path: &Path, cause: ReadError) -> OpenError {
        OpenError::Contents {
            name: name(path),
            cause,
        }
    }
}

/// Why bytes are no recording.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// It begins neither as Gantry's recordings do nor as CARLA's.
    #[error("it is not a recording of gantry-carla or of CARLA")]
    Foreign,
    /// Its format is too old or too new.
    #[error(
        "its format is version {version}, but this program reads versions {oldest} to {newest}"
    )]
    Version {
        /// Version of its format.
        version: u32,
        /// The oldest version that is read.
        oldest: u32,
        /// The newest version that is read.
        newest: u32,
    },
    /// It is CARLA's, of another version.
    #[error("its format is version {version} of CARLA's, but this program reads version {known}")]
    CarlaVersion {
        /// Version of its format.
        version: u16,
        /// The version that is read.
        known: u16,
    },
    /// A field is wrong.
    #[error(transparent)]
    Field(#[from] Wrong),
    /// A frame is no list.
    #[error("a frame is {kind}, but must be a list")]
    NoList {
        /// What it is.
        kind: &'static str,
    },
    /// Its bytes cannot be decoded.
    #[error(transparent)]
    Bytes(DecodeError),
    /// A packet's bytes are not those of its kind.
    #[error("packet {packet} of frame {number} is damaged: its size and its contents differ")]
    Packet {
        /// CARLA's number of the kind of packet.
        packet: u8,
        /// The frame.
        number: u64,
    },
    /// A frame begins before the one before it has ended.
    #[error("frame {number} does not end")]
    Unfinished {
        /// The frame.
        number: u64,
    },
    /// A frame is too large.
    #[error("frame {number} has more than {max} bytes")]
    LargeFrame {
        /// The frame.
        number: u64,
        /// How many it may have.
        max: u64,
    },
    /// It is too long.
    #[error("it has more than {max} frames")]
    TooLong {
        /// How many it may have.
        max: u64,
    },
    /// It has too many actors.
    #[error("it has more than {max} actors, or too long descriptions of them")]
    ManyActors {
        /// How many it may have.
        max: usize,
    },
    /// A text about it is too long.
    #[error("the text about it would have more than {max} bytes; ask for less")]
    LongText {
        /// How many it may have.
        max: usize,
    },
    /// It is empty.
    #[error("it has no frame")]
    Empty,
    /// Time runs backwards in it.
    #[error("its frames are not in the order of time")]
    Disorder,
    /// The file cannot be read.
    #[error("reading it failed ({0})")]
    Io(#[from] io::Error),
}
