//! The records of one chunk, or of a run of records outside of chunks.
//!
//! A compressed chunk is unpacked into memory and its checksum compared before anything of it is
//! handed out. An uncompressed one stays in the file: what is asked for is read from there, and its
//! checksum is computed over what goes by, so that it is compared if every byte was read.

use std::fs::File;
use std::io;
use std::sync::Arc;

use mcap::records::op;

use super::bytes::{RECORD_HEAD_BYTES, Window, record_head, u32_at, u64_at};
use super::piece::Piece;
use crate::walk::{self, RecordError};

/// Most bytes of a compressed chunk, packed or unpacked.
pub const MAX_CHUNK_BYTES: u64 = 256 << 20;

/// What stands before the records of a chunk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ChunkHead {
    pub start_nanos: u64,
    pub end_nanos: u64,
    pub unpacked_bytes: u64,
    pub crc: u32,
    pub compression: String,
    pub packed_bytes: u64,
    /// Bytes before the packed records.
    pub len: u64,
}

impl ChunkHead {
    /// Reads it from the first bytes of a chunk's body.
    pub fn parse(body: &[u8]) -> Option<ChunkHead> {
        let name_bytes = u32_at(body, 28)? as usize;
        let name_end = name_bytes.checked_add(32)?;
        let name = body.get(32..name_end)?;
        Some(ChunkHead {
            start_nanos: u64_at(body, 0)?,
            end_nanos: u64_at(body, 8)?,
            unpacked_bytes: u64_at(body, 16)?,
            crc: u32_at(body, 24)?,
            compression: std::str::from_utf8(name).ok()?.to_string(),
            packed_bytes: u64_at(body, name_end)?,
            len: (name_end as u64).checked_add(8)?,
        })
    }
}

/// Why a chunk, or the rest of it, cannot be read.
#[derive(Debug)]
pub(crate) enum Fault {
    /// The disk.
    Io(io::Error),
    /// The bytes.
    Damaged(String),
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Fault {
        Fault::Io(error)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Where {
    Memory,
    /// In the file, from this byte on.
    File(u64),
}

/// Reads the records of one piece of a file after another. Positions count from the piece's first
/// record.
#[derive(Debug)]
pub(crate) struct PieceReader {
    window: Window,
    packed: Vec<u8>,
    unpacked: Vec<u8>,
    place: Where,
    len: u64,
    next: u64,
    /// The given checksum, the one so far, and up to where it was computed; `None` if none is given
    /// or bytes were passed over.
    crc: Option<(u32, crc32fast::Hasher, u64)>,
}

impl PieceReader {
    pub fn new(file: Arc<File>) -> PieceReader {
        PieceReader {
            window: Window::new(file),
            packed: Vec::new(),
            unpacked: Vec::new(),
            place: Where::Memory,
            len: 0,
            next: 0,
            crc: None,
        }
    }

    /// Another reader of the same file.
    pub fn another(&self) -> PieceReader {
        PieceReader::new(self.window.file())
    }

    /// Whether the piece was compressed, so that all of it is in memory.
    pub fn is_unpacked(&self) -> bool {
        self.place == Where::Memory
    }

    /// Turns to the first record of `piece`.
    pub fn open(&mut self, piece: &Piece) -> Result<(), Fault> {
        self.open_within(piece, MAX_CHUNK_BYTES)
    }

    /// As [`PieceReader::open`]; a compressed chunk may have so many bytes.
    pub fn open_within(&mut self, piece: &Piece, max_bytes: u64) -> Result<(), Fault> {
        (self.len, self.next, self.crc) = (0, 0, None);
        if piece.is_loose {
            (self.place, self.len) = (Where::File(piece.offset), piece.len);
            return Ok(());
        }
        let bad =
            |what: String| Fault::Damaged(format!("the chunk at byte {} {what}", piece.offset));
        let start = self.window.look(piece.offset, 128)?;
        let body_bytes = piece.len.checked_sub(RECORD_HEAD_BYTES);
        if body_bytes.is_none_or(|len| record_head(start) != Some((op::CHUNK, len))) {
            return Err(bad("is not where the summary puts it".into()));
        }
        let head = ChunkHead::parse(&start[RECORD_HEAD_BYTES as usize..])
            .ok_or_else(|| bad("has an impossible header".into()))?;
        let head_bytes = RECORD_HEAD_BYTES.saturating_add(head.len);
        let data_at = piece.offset.saturating_add(head_bytes);
        let room = piece.len.saturating_sub(head_bytes);
        if head.packed_bytes > room {
            return Err(bad(format!(
                "claims {} bytes of records and has {room}",
                head.packed_bytes
            )));
        }
        if head.compression.is_empty() {
            if head.unpacked_bytes != head.packed_bytes {
                return Err(bad(format!(
                    "is not compressed, but gives its records {} and {} bytes",
                    head.packed_bytes, head.unpacked_bytes
                )));
            }
            (self.place, self.len) = (Where::File(data_at), head.packed_bytes);
            self.crc = (head.crc != 0).then(|| (head.crc, crc32fast::Hasher::new(), 0));
            return Ok(());
        }
        let claimed = head.unpacked_bytes.max(head.packed_bytes);
        if claimed > max_bytes {
            return Err(bad(format!(
                "claims {claimed} bytes, but at most {max_bytes} of a compressed chunk are unpacked"
            )));
        }
        self.unpack(&head, data_at).map_err(|fault| match fault {
            Fault::Damaged(what) => bad(what),
            other => other,
        })
    }

    fn unpack(&mut self, head: &ChunkHead, data_at: u64) -> Result<(), Fault> {
        self.packed.resize(head.packed_bytes as usize, 0);
        self.window.read_exact(&mut self.packed, data_at)?;
        let len = head.unpacked_bytes as usize;
        if self.unpacked.len() < len {
            self.unpacked.resize(len, 0);
        }
        let out = &mut self.unpacked[..len];
        walk::unpack_into(&head.compression, &self.packed, out).map_err(|error| match error {
            RecordError::Compression(other) => Fault::Damaged(format!(
                "is compressed with {other:?}, known are lz4 and zstd"
            )),
            RecordError::Packed(error) => Fault::Damaged(format!("cannot be unpacked: {error}")),
            other => Fault::Damaged(other.to_string()),
        })?;
        if head.crc != 0 && crc32fast::hash(out) != head.crc {
            return Err(Fault::Damaged(
                "does not have the checksum that is given for it".into(),
            ));
        }
        (self.place, self.len) = (Where::Memory, head.unpacked_bytes);
        Ok(())
    }

    /// Position of the next record.
    pub fn position(&self) -> u64 {
        self.next
    }

    /// Goes on with the record at a position that [`PieceReader::position`] gave.
    pub fn go_to(&mut self, position: u64) {
        self.next = position.min(self.len);
        self.crc = None;
    }

    /// Opcode, and position and length of the body, of the next record.
    pub fn next_record(&mut self) -> Result<Option<(u8, u64, u64)>, Fault> {
        if self.next == self.len {
            return Ok(None);
        }
        let at = self.next;
        let head = self.look(at, RECORD_HEAD_BYTES as usize)?;
        let head = record_head(head);
        let body_at = at.saturating_add(RECORD_HEAD_BYTES);
        let whole = head.and_then(|(opcode, len)| {
            let end = body_at.checked_add(len)?;
            (end <= self.len).then_some((opcode, len, end))
        });
        match whole {
            Some((opcode, len, end)) => {
                self.next = end;
                Ok(Some((opcode, body_at, len)))
            }
            None => {
                self.next = self.len;
                self.crc = None;
                Err(Fault::Damaged(
                    "a record reaches beyond the chunk that holds it".to_string(),
                ))
            }
        }
    }

    /// Up to `want` bytes from `at` on; fewer only at the end of the piece.
    pub fn look(&mut self, at: u64, want: usize) -> io::Result<&[u8]> {
        let want = want.min(usize::try_from(self.len.saturating_sub(at)).unwrap_or(usize::MAX));
        match self.place {
            Where::Memory => {
                let from = usize::try_from(at).unwrap_or(usize::MAX);
                let rest = self.unpacked.get(from..).unwrap_or_default();
                rest.get(..want)
                    .ok_or_else(|| io::ErrorKind::UnexpectedEof.into())
            }
            Where::File(base) => {
                let place = base.saturating_add(at);
                if self.window.inside(place, want).is_none() {
                    // The window moves on, so what is in it is computed first.
                    let end = self.window.range().end.saturating_sub(base);
                    self.hash_to(end.min(at));
                }
                let bytes = self.window.look(place, want)?;
                if bytes.len() < want {
                    return Err(io::ErrorKind::UnexpectedEof.into());
                }
                Ok(bytes)
            }
        }
    }

    /// Copies the bytes from `at` on into `out`: large ones straight from the file.
    pub fn copy(&mut self, at: u64, out: &mut [u8]) -> io::Result<()> {
        if at.saturating_add(out.len() as u64) > self.len {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let Where::File(base) = self.place else {
            let n_bytes = out.len();
            out.copy_from_slice(self.look(at, n_bytes)?);
            return Ok(());
        };
        let place = base.saturating_add(at);
        if let Some(bytes) = self.window.inside(place, out.len()) {
            out.copy_from_slice(bytes);
            return Ok(());
        }
        let end = self.window.range().end.saturating_sub(base);
        self.hash_to(end.min(at));
        self.window.read_exact(out, place)?;
        self.hash_to(at);
        if let Some((_, hasher, done)) = &mut self.crc
            && *done == at
        {
            hasher.update(out);
            *done = done.saturating_add(out.len() as u64);
        }
        Ok(())
    }

    /// Computes the checksum up to `end` from what is in the window, if it is.
    fn hash_to(&mut self, end: u64) {
        let (Where::File(base), Some((_, hasher, done))) = (self.place, &mut self.crc) else {
            return;
        };
        let Some(n_bytes) = end.checked_sub(*done).filter(|n| *n > 0) else {
            return;
        };
        let n_bytes = usize::try_from(n_bytes).unwrap_or(usize::MAX);
        if let Some(bytes) = self.window.inside(base.saturating_add(*done), n_bytes) {
            hasher.update(bytes);
            *done = end;
        }
    }

    /// Whether every byte of an uncompressed chunk went by and its checksum is wrong. What was read
    /// has been handed out then.
    pub fn is_wrong_at_end(&mut self) -> bool {
        self.hash_to(self.len);
        match self.crc.take() {
            Some((given, hasher, done)) => done == self.len && hasher.finalize() != given,
            None => false,
        }
    }
}
