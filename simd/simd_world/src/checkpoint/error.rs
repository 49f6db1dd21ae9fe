//! Why a checkpoint cannot be read or restored.

use crate::errors::NoRoom;

/// Version of the head; the body's version is `LAYOUT` of the build. The checksum of version 1 was the body's
/// alone.
pub(super) const VERSION: u32 = 2;

/// Why a checkpoint cannot be read or restored.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CheckpointError {
    /// Not a checkpoint at all.
    #[error("this is not a checkpoint: it does not begin with GCKP")]
    Foreign,
    /// A head of another version.
    #[error(
        "the checkpoint's format is version {0}, but this program reads version {VERSION}; save it anew"
    )]
    Version(u32),
    /// Another build wrote it, with another layout.
    #[error(
        "the checkpoint was saved by another build of Gantry, whose world is laid out differently; save it anew with this one"
    )]
    Layout,
    /// The file is shorter or longer than its head states.
    #[error(
        "the checkpoint has {found} bytes after its head, but its head says {said}; the file is cut off or damaged"
    )]
    Length {
        /// Bytes found.
        found: u64,
        /// Bytes stated in the head.
        said: u64,
    },
    /// The bytes are not those that were written (checksum).
    #[error("the checkpoint's checksum does not fit its bytes; the file is damaged")]
    Checksum,
    /// The body cannot be read.
    #[error("the checkpoint's body cannot be read ({0}); the file is damaged")]
    Body(String),
    /// A value that no world has.
    #[error(
        "the checkpoint says that {what} is {value}, but it must be {allowed}; the file is damaged"
    )]
    Value {
        /// Which value.
        what: String,
        /// The value.
        value: String,
        /// What is allowed.
        allowed: String,
    },
    /// It belongs to another map.
    #[error("the checkpoint is of map {of:?}, but {loaded:?} is loaded; load that map first")]
    OtherMap {
        /// Its map.
        of: String,
        /// The map that is loaded.
        loaded: String,
    },
    /// The map of this name differs from the one it was saved on.
    #[error(
        "the checkpoint is of another version of map {0:?}: roads or solid ground differ; load the map it was saved on"
    )]
    ChangedMap(String),
    /// With the sensors that live it would have too many actors.
    #[error("the checkpoint and the sensors that exist now do not fit into one world: {0}")]
    NoRoom(NoRoom),
}
