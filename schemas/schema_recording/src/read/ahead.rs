//! Unpacks the chunks that come next on threads of their own, while the present one is read.

use std::collections::VecDeque;
use std::thread::JoinHandle;

use super::chunk::{Fault, PieceReader};
use super::piece::Piece;

/// Longest chunk that is unpacked ahead, bytes; a longer one waits until it is read, so that several
/// of them are never in memory together.
const MAX_AHEAD_BYTES: u64 = 32 << 20;

/// A chunk that is being unpacked.
type Unpacking = JoinHandle<(PieceReader, Result<(), Fault>)>;

/// The chunks that come next.
#[derive(Debug, Default)]
pub(crate) struct Ahead {
    n_threads: usize,
    waiting: VecDeque<(usize, Unpacking)>,
    spare: Vec<PieceReader>,
}

impl Ahead {
    /// Unpacks up to so many chunks at a time; none is the same as reading without it.
    pub fn new(n_threads: usize) -> Ahead {
        Ahead {
            n_threads,
            ..Ahead::default()
        }
    }

    /// Number of chunks that are unpacked at a time.
    pub fn n_threads(&self) -> usize {
        self.n_threads
    }

    /// The unpacked chunk with this number, in exchange for the reader of the last; `None` if it was
    /// not unpacked ahead, or could not be.
    pub fn take(&mut self, number: usize, last: &mut PieceReader) -> Option<()> {
        while let Some((of, unpacking)) = self.waiting.pop_front() {
            if of != number {
                continue;
            }
            let (mut reader, Ok(())) = unpacking.join().ok()? else {
                return None;
            };
            std::mem::swap(&mut reader, last);
            self.spare.push(reader);
            return Some(());
        }
        None
    }

    /// Begins to unpack the chunks with these numbers.
    pub fn begin<'a>(
        &mut self,
        pieces: impl Iterator<Item = (usize, &'a Piece)>,
        like: &PieceReader,
    ) {
        let newest = self.waiting.back().map_or(0, |(number, _)| *number);
        for (number, piece) in pieces.take(self.n_threads) {
            if number <= newest || piece.is_loose || piece.len > MAX_AHEAD_BYTES {
                continue;
            }
            let mut reader = self.spare.pop().unwrap_or_else(|| like.another());
            let piece = piece.clone();
            let unpack = move || {
                let outcome = reader.open_within(&piece, MAX_AHEAD_BYTES);
                (reader, outcome)
            };
            let name = std::thread::Builder::new().name("unpack".into());
            match name.spawn(unpack) {
                Ok(unpacking) => self.waiting.push_back((number, unpacking)),
                Err(_) => return,
            }
        }
    }
}
