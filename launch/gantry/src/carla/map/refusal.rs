//! Why a map is not read or not imported.

use std::io;
use std::path::PathBuf;

use schema_roads::{MAX_TEXT_BYTES, MapError};

/// Longest name of a map, bytes.
pub const MAX_NAME_BYTES: usize = 100;

/// Why a map is not read or not imported.
#[derive(Debug, thiserror::Error)]
pub enum Refusal {
    /// The file cannot be read.
    #[error("cannot be read: {0}")]
    Unreadable(io::Error),
    /// The file is too large.
    #[error("has {n_bytes} bytes; at most {MAX_TEXT_BYTES} are read")]
    TooLarge {
        /// Its size.
        n_bytes: u64,
    },
    /// The text is no map.
    #[error(transparent)]
    Broken(#[from] MapError),
    /// Nothing could drive there.
    #[error(
        "no driving lane is long and wide enough for a vehicle; at least one must be 2.4 m wide and a few metres long"
    )]
    NoSpawnPoint,
    /// Its name is not one of a file in the map folder.
    #[error(
        "a map cannot be called {name:?}; give 1 to {MAX_NAME_BYTES} letters, digits, '-', '_', '.', '+' and spaces with --name"
    )]
    Name {
        /// The name.
        name: String,
    },
    /// Another file that was found has its name.
    #[error("{} has the same name and other contents; name the file that is meant", .other.display())]
    Ambiguous {
        /// The other file.
        other: PathBuf,
    },
    /// A map of the map folder has its name.
    #[error("{} has this name and other contents; --replace puts the new map in its place, --name gives the new map another name", .path.display())]
    NameTaken {
        /// The map that is there.
        path: PathBuf,
    },
    /// What is in its place cannot be read.
    #[error("{} cannot be read: {error}", .path.display())]
    PlaceUnreadable {
        /// The place.
        path: PathBuf,
        /// What the system says.
        error: io::Error,
    },
    /// Its place cannot be written.
    #[error("{} cannot be written: {error}", .path.display())]
    PlaceUnwritable {
        /// The place.
        path: PathBuf,
        /// What the system says.
        error: io::Error,
    },
}
