//! A part of a file that is read as one: a chunk, or records outside of chunks.

/// A run of the file that holds messages.
#[derive(Clone, Debug)]
pub(crate) struct Piece {
    /// Of the chunk record's head, or of the first record outside of chunks.
    pub offset: u64,
    /// Bytes, head included.
    pub len: u64,
    pub start_nanos: u64,
    pub end_nanos: u64,
    /// Whether its records stand in the file as they are, outside of any chunk.
    pub is_loose: bool,
    /// Channels that have messages in it; `None` if that is not written.
    pub channels: Option<Box<[u16]>>,
}

impl Piece {
    /// A chunk at a place, head included, with the times of its first and last message: those of a
    /// file may be the wrong way round.
    pub fn of_chunk((offset, len): (u64, u64), (a_nanos, b_nanos): (u64, u64)) -> Piece {
        Piece {
            offset,
            len,
            start_nanos: a_nanos.min(b_nanos),
            end_nanos: a_nanos.max(b_nanos),
            is_loose: false,
            channels: None,
        }
    }
}
