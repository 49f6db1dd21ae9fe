//! Bytes of a file at any place, through a small window that moves along.
//!
//! Small things (heads of records, headers of messages) are looked at in the window; large ones are
//! read straight into the caller's memory.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt as _;
use std::sync::Arc;

/// Bytes that are read ahead of a look.
const WINDOW_BYTES: usize = 32 << 10;

/// A window onto a file.
#[derive(Debug)]
pub(crate) struct Window {
    file: Arc<File>,
    buffer: Vec<u8>,
    at: u64,
}

impl Window {
    pub fn new(file: Arc<File>) -> Window {
        Window {
            file,
            buffer: Vec::new(),
            at: 0,
        }
    }

    /// Up to `want` bytes from `at` on; fewer only at the end of the file.
    pub fn look(&mut self, at: u64, want: usize) -> io::Result<&[u8]> {
        if self.inside(at, want).is_none() {
            self.fill(at, want)?;
        }
        // Both ways the window begins at or before `at`.
        let from = usize::try_from(at.saturating_sub(self.at)).unwrap_or(usize::MAX);
        let rest = self.buffer.get(from..).unwrap_or_default();
        Ok(&rest[..want.min(rest.len())])
    }

    /// The bytes in the window from `at` on, if it has `len` of them.
    pub fn inside(&self, at: u64, len: usize) -> Option<&[u8]> {
        let from = usize::try_from(at.checked_sub(self.at)?).ok()?;
        self.buffer.get(from..from.checked_add(len)?)
    }

    /// Where the window is.
    pub fn range(&self) -> std::ops::Range<u64> {
        self.at..self.at.saturating_add(self.buffer.len() as u64)
    }

    fn fill(&mut self, at: u64, want: usize) -> io::Result<()> {
        self.buffer.resize(want.max(WINDOW_BYTES), 0);
        let n_read = read_up_to(&self.file, &mut self.buffer, at);
        self.buffer.truncate(*n_read.as_ref().unwrap_or(&0));
        self.at = at;
        n_read.map(drop)
    }

    /// The file.
    pub fn file(&self) -> Arc<File> {
        self.file.clone()
    }

    /// Reads exactly `out.len()` bytes from `at` on, past the window.
    pub fn read_exact(&self, out: &mut [u8], at: u64) -> io::Result<()> {
        self.file.read_exact_at(out, at)
    }
}

/// Reads until `out` is full or the file ends; returns the number of bytes.
pub(crate) fn read_up_to(file: &File, out: &mut [u8], at: u64) -> io::Result<usize> {
    let mut n_read = 0;
    while n_read < out.len() {
        match file.read_at(&mut out[n_read..], at.saturating_add(n_read as u64)) {
            Ok(0) => break,
            Ok(n) => n_read = n_read.saturating_add(n),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(n_read)
}

/// The opcode and body length of the record head that these nine bytes are.
pub(crate) fn record_head(bytes: &[u8]) -> Option<(u8, u64)> {
    let len = bytes.get(1..RECORD_HEAD_BYTES as usize)?;
    Some((bytes[0], u64::from_le_bytes(len.try_into().ok()?)))
}

/// Opcode and length before each record's body.
pub(crate) const RECORD_HEAD_BYTES: u64 = 9;

/// A little-endian number at `at`, if the bytes are there.
pub(crate) fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    let eight = bytes.get(at..at.checked_add(8)?)?;
    Some(u64::from_le_bytes(eight.try_into().ok()?))
}

/// As [`u64_at`].
pub(crate) fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    let four = bytes.get(at..at.checked_add(4)?)?;
    Some(u32::from_le_bytes(four.try_into().ok()?))
}

/// As [`u64_at`].
pub(crate) fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    let two = bytes.get(at..at.checked_add(2)?)?;
    Some(u16::from_le_bytes(two.try_into().ok()?))
}
