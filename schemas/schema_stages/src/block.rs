//! The file in memory through which a process shows its stages: a head, then one row per stage.
//!
//! | Bytes | Field |
//! |---|---|
//! | 0..8 | `GANTRYST` |
//! | 8..12 | version, 1 |
//! | 12..16 | number of rows |
//! | 16..24 | number of this writing |
//! | 24..32 | tick of the program's newest work; 0 if it knows none |
//! | then 48 per row | name padded with zeros (24), processor nanoseconds, wall nanoseconds, spans |
//! | last 8 | number of this writing again: unlike the first one, the block was read half-written |
//!
//! All numbers are little-endian.

use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::time::{Duration, Instant};

use nix::sys::memfd::{MFdFlags, memfd_create};
use parking_lot::Mutex;

use crate::span::{Sums, entered};

/// Name of the file; `/proc/PID/fd` shows it as `/memfd:gantry-stages (deleted)`.
pub(crate) const NAME: &str = "gantry-stages";
const MAGIC: &[u8; 8] = b"GANTRYST";
const VERSION: u32 = 1;
const HEAD_BYTES: usize = 32;
const NAME_BYTES: usize = 24;
const ROW_BYTES: usize = NAME_BYTES + 3 * 8;
/// More rows are no block of ours.
const MAX_ROWS: usize = 256;
/// Least time between two writings.
const EVERY: Duration = Duration::from_millis(100);

/// The file and when it was last written.
struct Posted {
    file: Option<File>,
    last: Instant,
    n_writings: u64,
}

static POSTED: Mutex<Option<Posted>> = Mutex::new(None);

/// Shows the sums of all stages to other processes, at most ten times a second; `tick` is the tick
/// that the program works on, 0 if it knows none. Call it often, in the program's main loop: where
/// nothing is due it costs some 50 ns. A kernel that has no such files shows nothing.
pub fn post(tick: u64) {
    let now = Instant::now();
    let mut posted = POSTED.lock();
    let posted = match &mut *posted {
        Some(posted) if now.duration_since(posted.last) < EVERY => return,
        Some(posted) => posted,
        none => none.insert(Posted {
            file: memfd_create(NAME, MFdFlags::MFD_CLOEXEC)
                .ok()
                .map(File::from),
            last: now,
            n_writings: 0,
        }),
    };
    posted.last = now;
    posted.n_writings += 1;
    if let Some(file) = &posted.file {
        let rows: Vec<(&str, Sums)> = entered(|stages| {
            stages
                .iter()
                .map(|stage| (stage.name(), stage.sums()))
                .collect()
        });
        // A memory that is full leaves the last block, which readers see to be old.
        let _ = file.write_all_at(&encode(posted.n_writings, tick, &rows), 0);
    }
}

fn encode(number: u64, tick: u64, rows: &[(&str, Sums)]) -> Vec<u8> {
    let rows = &rows[..rows.len().min(MAX_ROWS)];
    let mut block = Vec::with_capacity(HEAD_BYTES + rows.len() * ROW_BYTES + 8);
    block.extend(MAGIC);
    block.extend(VERSION.to_le_bytes());
    block.extend((rows.len() as u32).to_le_bytes());
    block.extend(number.to_le_bytes());
    block.extend(tick.to_le_bytes());
    for (name, sums) in rows {
        let mut padded = [0; NAME_BYTES];
        padded[..name.len()].copy_from_slice(name.as_bytes());
        block.extend(padded);
        for value in [sums.cpu_nanos, sums.wall_nanos, sums.n_spans] {
            block.extend(value.to_le_bytes());
        }
    }
    block.extend(number.to_le_bytes());
    block
}

/// What a block says.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Block {
    /// Tick of the program's newest work; 0 if it knows none.
    pub tick: u64,
    /// Stages in the order in which they were first entered.
    pub rows: Vec<(String, Sums)>,
}

/// Reads a block; `None` if it is none, of another version, or half-written.
pub(crate) fn decode(bytes: &[u8]) -> Option<Block> {
    let number_at = |at: usize| Some(u64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?));
    let short_at = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    let n_rows = short_at(12)? as usize;
    if bytes.get(..8)? != MAGIC || short_at(8)? != VERSION || n_rows > MAX_ROWS {
        return None;
    }
    if number_at(16)? != number_at(HEAD_BYTES + n_rows * ROW_BYTES)? {
        return None;
    }
    let row = |i: usize| {
        let at = HEAD_BYTES + i * ROW_BYTES;
        let name = bytes
            .get(at..at + NAME_BYTES)?
            .split(|byte| *byte == 0)
            .next()?;
        let sums = Sums {
            cpu_nanos: number_at(at + NAME_BYTES)?,
            wall_nanos: number_at(at + NAME_BYTES + 8)?,
            n_spans: number_at(at + NAME_BYTES + 16)?,
        };
        Some((String::from_utf8_lossy(name).into_owned(), sums))
    };
    Some(Block {
        tick: number_at(24)?,
        rows: (0..n_rows).map(row).collect::<Option<_>>()?,
    })
}

/// Longest block, bytes.
pub(crate) const MAX_BYTES: usize = HEAD_BYTES + MAX_ROWS * ROW_BYTES + 8;

#[cfg(test)]
mod tests {
    use super::*;

    fn sums(seed: u64) -> Sums {
        Sums {
            cpu_nanos: seed,
            wall_nanos: 2 * seed,
            n_spans: 3,
        }
    }

    #[test]
    fn a_block_is_read_as_it_was_written() {
        let rows = [
            ("physics", sums(1 << 40)),
            ("a-name-of-23-bytes-here", sums(7)),
        ];
        let block = decode(&encode(9, 1234, &rows)).expect("a block");
        assert_eq!(block.tick, 1234);
        assert_eq!(block.rows, rows.map(|(name, sums)| (name.to_owned(), sums)));
    }

    #[test]
    fn what_is_no_whole_block_is_none() {
        let whole = encode(9, 1, &[("physics", sums(5))]);
        for length in 0..whole.len() {
            assert_eq!(decode(&whole[..length]), None, "{length}");
        }
        let mut half = whole.clone();
        half[16] = 10;
        assert_eq!(decode(&half), None);
        let mut greedy = whole;
        greedy[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(decode(&greedy), None);
    }
}
