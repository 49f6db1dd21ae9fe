//! Reads the entries of a journal that is run again (`simd --journal`), ahead of the ticks at which
//! they act, on the thread for files.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use launch_cli::wrong_usage;
use schema_frames::journal::JOURNAL_VERSION;
use schema_frames::{JournalAct, JournalEntry, JournalFile, JournalHead, VehicleControlRecord};

/// Longest line of a journal: a request of 16 MiB, every byte of it escaped.
const MAX_LINE_BYTES: u64 = 100 << 20;
/// Entries that are read in one go.
const STRETCH_ENTRIES: usize = 4096;
/// Bytes of lines behind which no further entry is read in the same go.
const STRETCH_BYTES: usize = 16 << 20;
/// Most bytes of files, and of their names, of which not all pieces are there: as much as checkpoints
/// that a request restores may have together.
const MAX_PIECES_BYTES: usize = 1 << 30;

/// What an entry asks for.
#[derive(Debug)]
pub enum Act {
    /// Run the commands of this request that act on the world.
    Commands {
        client: String,
        seq: u64,
        text: String,
        outcomes: Vec<String>,
        is_last_of_round: bool,
    },
    /// Hold these controls.
    Controls {
        writer: String,
        records: Vec<VehicleControlRecord>,
    },
    /// Make the frames of a topic, or no longer.
    Audience { topic: String, is_made: bool },
    /// Keep a file that a later command reads.
    File {
        of: JournalFile,
        name: String,
        title: String,
        bytes: Vec<u8>,
    },
}

/// Something that acts at the edge behind a tick.
#[derive(Debug)]
pub struct Entry {
    /// The tick.
    pub edge: u64,
    /// What acts.
    pub act: Act,
}

/// Entries that follow one another.
#[derive(Debug)]
pub struct Stretch {
    /// The entries.
    pub entries: Vec<Entry>,
    /// What comes behind them: `None` if further entries may, else the end of the journal, or why it
    /// cannot be read further.
    pub end: Option<anyhow::Result<()>>,
}

/// A journal: lines of JSON, the head first, then the entries.
pub struct JournalReader {
    file: BufReader<File>,
    path: PathBuf,
    line: u64,
    /// Pieces of files that are not complete yet.
    pieces: BTreeMap<(JournalFile, String), Pieces>,
    /// Bytes of all of them, with their names.
    pieces_bytes: usize,
}

/// The beginning of a file.
#[derive(Debug, Default)]
struct Pieces {
    n: u32,
    bytes: Vec<u8>,
}

impl JournalReader {
    /// Opens a journal, and reads its head.
    ///
    /// # Errors
    /// If it is no journal, or one of a later version.
    pub fn open(path: &Path) -> anyhow::Result<(JournalReader, JournalHead)> {
        let (file, _) = launch_cli::files::open_plain(path)
            .map_err(|error| wrong_usage(format!("--journal {}: {error}", path.display())))?;
        let mut reader = JournalReader {
            file: BufReader::new(file),
            path: path.to_owned(),
            line: 0,
            pieces: BTreeMap::new(),
            pieces_bytes: 0,
        };
        let head = reader.read_line()?;
        if head.is_empty() {
            return Err(wrong_usage(format!(
                "--journal {} is empty; its first line must be the head of a journal",
                path.display()
            )));
        }
        let head: JournalHead =
            serde_json::from_slice(&head).map_err(|error| reader.bad(&error))?;
        if head.v > JOURNAL_VERSION {
            return Err(wrong_usage(format!(
                "--journal {} has version {}, but this simulator reads up to {JOURNAL_VERSION}; use the Gantry that recorded it",
                path.display(),
                head.v
            )));
        }
        Ok((reader, head))
    }

    /// Reads the next entries.
    pub fn read_on(&mut self) -> Stretch {
        let (mut entries, mut n_bytes) = (Vec::new(), 0);
        let end = loop {
            if entries.len() >= STRETCH_ENTRIES || n_bytes >= STRETCH_BYTES {
                break None;
            }
            match self.next_entry(&mut n_bytes) {
                Ok(Some(entry)) => entries.push(entry),
                Ok(None) => break Some(Ok(())),
                Err(error) => break Some(Err(error)),
            }
        };
        Stretch { entries, end }
    }

    /// The next entry of which all pieces are there; `None` behind the last one. Adds the bytes that
    /// were read for it to `n_bytes`.
    fn next_entry(&mut self, n_bytes: &mut usize) -> anyhow::Result<Option<Entry>> {
        loop {
            let line = self.read_line()?;
            if line.is_empty() {
                return Ok(None);
            }
            *n_bytes = n_bytes.saturating_add(line.len());
            let entry: JournalEntry =
                serde_json::from_slice(&line).map_err(|error| self.bad(&error))?;
            let (n, edge) = (entry.n, entry.edge);
            let act = self
                .decoded(entry.act)
                .with_context(|| format!("entry {n} of {} cannot be used", self.path.display()))?;
            if let Some(act) = act {
                return Ok(Some(Entry { edge, act }));
            }
        }
    }

    fn read_line(&mut self) -> anyhow::Result<Vec<u8>> {
        let mut line = Vec::new();
        self.line = self.line.saturating_add(1);
        self.file
            .by_ref()
            .take(MAX_LINE_BYTES)
            .read_until(b'\n', &mut line)
            .with_context(|| format!("cannot read {}", self.path.display()))?;
        Ok(line)
    }

    fn bad(&self, error: &serde_json::Error) -> anyhow::Error {
        wrong_usage(format!(
            "--journal {}, line {}, is not a journal's: {error}",
            self.path.display(),
            self.line
        ))
    }

    /// Adds a piece to its file; the whole file if it was the last one.
    fn add_piece(
        &mut self,
        key: &(JournalFile, String),
        piece: u32,
        bytes: Vec<u8>,
        is_last: bool,
    ) -> anyhow::Result<Option<Vec<u8>>> {
        let name_bytes = key.1.len();
        if piece == 0
            && let Some(old) = self.pieces.remove(key)
        {
            let old_bytes = old.bytes.len().saturating_add(name_bytes);
            self.pieces_bytes = self.pieces_bytes.saturating_sub(old_bytes);
        }
        let n_before = self.pieces.get(key).map_or(0, |before| before.n);
        if piece != n_before {
            bail!(
                "it is piece {piece} of a file of which {n_before} pieces came before; the journal lacks some"
            );
        }
        let added = if piece == 0 { name_bytes } else { 0 };
        let total = self
            .pieces_bytes
            .saturating_add(added)
            .saturating_add(bytes.len());
        if total > MAX_PIECES_BYTES {
            bail!(
                "files of which pieces are missing have {total} bytes up to here; {MAX_PIECES_BYTES} are allowed"
            );
        }
        self.pieces_bytes = total;
        let whole = self.pieces.entry(key.clone()).or_default();
        whole.n = piece.saturating_add(1);
        whole.bytes.extend(bytes);
        if !is_last {
            return Ok(None);
        }
        let whole = self.pieces.remove(key).unwrap_or_default();
        let whole_bytes = whole.bytes.len().saturating_add(name_bytes);
        self.pieces_bytes = self.pieces_bytes.saturating_sub(whole_bytes);
        Ok(Some(whole.bytes))
    }

    /// What an entry asks for; `None` for a piece of a file that is not the last.
    fn decoded(&mut self, act: JournalAct) -> anyhow::Result<Option<Act>> {
        Ok(Some(match act {
            JournalAct::Commands {
                client,
                seq,
                text,
                outcomes,
                is_last_of_round,
            } => Act::Commands {
                client,
                seq,
                text,
                outcomes,
                is_last_of_round,
            },
            JournalAct::Controls { writer, records } => {
                let bytes = STANDARD.decode(records).context("its records")?;
                let size = size_of::<VehicleControlRecord>();
                if !bytes.len().is_multiple_of(size) {
                    bail!(
                        "its records have {} bytes, no multiple of {size}",
                        bytes.len()
                    );
                }
                let records = bytes.chunks_exact(size).map(bytemuck::pod_read_unaligned);
                Act::Controls {
                    writer,
                    records: records.collect(),
                }
            }
            JournalAct::Audience { topic, is_made } => Act::Audience { topic, is_made },
            JournalAct::File {
                of,
                name,
                title,
                piece,
                n_pieces,
                bytes,
            } => {
                let bytes = STANDARD.decode(bytes).context("its bytes")?;
                let key = (of, name);
                let is_last = piece.saturating_add(1) >= n_pieces;
                let Some(bytes) = self.add_piece(&key, piece, bytes, is_last)? else {
                    return Ok(None);
                };
                Act::File {
                    of,
                    name: key.1,
                    title,
                    bytes,
                }
            }
        }))
    }
}
