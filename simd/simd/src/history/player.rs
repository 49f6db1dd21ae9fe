//! Runs the entries of a journal again (`simd --journal`): each at its edge, in order, as when they
//! were noted. Until it ends nobody else changes the world.

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

/// A journal that is being run again.
pub struct Player {
    file: BufReader<File>,
    path: PathBuf,
    line: u64,
    /// What the run began with.
    head: JournalHead,
    /// The entry that comes next; `None` behind the last one.
    next: Option<JournalEntry>,
    /// Simulated time up to which the journal holds, nanoseconds; without it, up to the last entry.
    until_nanos: Option<u64>,
    /// Pieces of files that are not complete yet.
    pieces: BTreeMap<(JournalFile, String), Vec<u8>>,
    is_difference_said: bool,
}

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

impl Player {
    /// Opens a journal: lines of JSON, the head first, then the entries.
    pub fn open(path: &Path, until_nanos: Option<u64>) -> anyhow::Result<Player> {
        let (file, _) = launch_cli::files::open_plain(path)
            .map_err(|error| wrong_usage(format!("--journal {}: {error}", path.display())))?;
        let mut player = Player {
            file: BufReader::new(file),
            path: path.to_owned(),
            line: 0,
            head: JournalHead::default(),
            next: None,
            until_nanos,
            pieces: BTreeMap::new(),
            is_difference_said: false,
        };
        let head = player.read_line()?;
        if head.is_empty() {
            return Err(wrong_usage(format!(
                "--journal {} is empty; its first line must be the head of a journal",
                path.display()
            )));
        }
        player.head = serde_json::from_slice(&head).map_err(|error| player.bad(&error))?;
        if player.head.v > JOURNAL_VERSION {
            return Err(wrong_usage(format!(
                "--journal {} has version {}, but this simulator reads up to {JOURNAL_VERSION}; use the Gantry that recorded it",
                path.display(),
                player.head.v
            )));
        }
        player.advance()?;
        Ok(player)
    }

    /// What the run began with.
    pub fn head(&self) -> &JournalHead {
        &self.head
    }

    /// The next act at the edge behind tick `edge`; `None` if there is none.
    pub fn next_at(&mut self, edge: u64) -> anyhow::Result<Option<Act>> {
        while let Some(entry) = self.next.take_if(|entry| entry.edge <= edge) {
            let n = entry.n;
            self.advance()?;
            if let Some(act) = self
                .decoded(entry.act)
                .with_context(|| format!("entry {n} of {} cannot be used", self.path.display()))?
            {
                return Ok(Some(act));
            }
        }
        Ok(None)
    }

    /// The files in front of everything else, of which the first map may be one.
    pub fn first_files(&mut self) -> anyhow::Result<Vec<Act>> {
        let mut files = Vec::new();
        while matches!(&self.next, Some(entry) if entry.edge == 0 && matches!(entry.act, JournalAct::File { .. }))
        {
            let entry = self.next.take().expect("just looked at");
            self.advance()?;
            files.extend(self.decoded(entry.act)?);
        }
        Ok(files)
    }

    /// Whether the journal holds no longer at simulated time `now_nanos`, from which the next tick
    /// takes `period_nanos`.
    pub fn is_over(&self, now_nanos: u64, period_nanos: u64) -> bool {
        match self.until_nanos {
            Some(until_nanos) => now_nanos.saturating_add(period_nanos) > until_nanos,
            None => self.next.is_none(),
        }
    }

    /// Says for the first time that an answer is not what it was.
    pub fn compare(&mut self, tick: u64, client: &str, now: &[String], noted: &[String]) {
        if now == noted || noted.is_empty() || std::mem::replace(&mut self.is_difference_said, true)
        {
            return;
        }
        let idx = now.iter().zip(noted).take_while(|(a, b)| a == b).count();
        let none = "nothing".to_owned();
        tracing::warn!(
            tick,
            "the run goes another way: a command of {client:?} was answered with {}, now with {}; said once",
            noted.get(idx).unwrap_or(&none),
            now.get(idx).unwrap_or(&none)
        );
    }

    fn advance(&mut self) -> anyhow::Result<()> {
        let line = self.read_line()?;
        self.next = match line.is_empty() {
            true => None,
            false => Some(serde_json::from_slice(&line).map_err(|error| self.bad(&error))?),
        };
        Ok(())
    }

    fn read_line(&mut self) -> anyhow::Result<Vec<u8>> {
        let mut line = Vec::new();
        self.line += 1;
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
                if bytes.len() % size != 0 {
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
                let whole = self.pieces.entry(key.clone()).or_default();
                if piece == 0 {
                    whole.clear();
                }
                whole.extend(bytes);
                if piece + 1 < n_pieces {
                    return Ok(None);
                }
                let bytes = self.pieces.remove(&key).unwrap_or_default();
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

#[cfg(test)]
mod tests {
    use super::*;

    fn open(name: &str, text: &str, until_nanos: Option<u64>) -> anyhow::Result<Player> {
        let path =
            std::env::temp_dir().join(format!("gantry-player-{name}-{}", std::process::id()));
        std::fs::write(&path, text).unwrap();
        let player = Player::open(&path, until_nanos);
        std::fs::remove_file(&path).unwrap();
        player
    }

    fn entry(n: u64, edge: u64, act: JournalAct) -> String {
        serde_json::to_string(&JournalEntry { n, edge, act }).unwrap() + "\n"
    }

    fn piece(piece: u32, bytes: &[u8]) -> JournalAct {
        JournalAct::File {
            of: JournalFile::Map,
            name: "a".into(),
            title: "a".into(),
            piece,
            n_pieces: 2,
            bytes: STANDARD.encode(bytes),
        }
    }

    #[test]
    fn entries_come_at_their_edges_and_files_in_one_piece() {
        let head = serde_json::to_string(&JournalHead::default()).unwrap() + "\n";
        let record = VehicleControlRecord {
            throttle_ratio: f32::NAN,
            ..VehicleControlRecord::new(7, Default::default())
        };
        let controls = JournalAct::Controls {
            writer: "w".into(),
            records: STANDARD.encode(bytemuck::bytes_of(&record)),
        };
        let text = head
            + &entry(1, 0, piece(0, b"ab"))
            + &entry(2, 0, piece(1, b"c"))
            + &entry(3, 4, controls);
        let mut player = open("edges", &text, None).unwrap();
        let files = player.first_files().unwrap();
        assert!(matches!(&files[..], [Act::File { bytes, .. }] if bytes == b"abc"));
        assert!(player.next_at(3).unwrap().is_none() && !player.is_over(0, 1));
        let Some(Act::Controls { records, .. }) = player.next_at(4).unwrap() else {
            panic!("no controls")
        };
        assert_eq!(bytemuck::bytes_of(&records[0]), bytemuck::bytes_of(&record));
        assert!(player.next_at(4).unwrap().is_none() && player.is_over(0, 1));
        let player = open("until", &text, Some(100)).unwrap();
        assert!(!player.is_over(50, 50) && player.is_over(51, 50));
    }

    #[test]
    fn what_is_no_journal_is_refused_with_its_line() {
        let error =
            |name: &str, text: &str| open(name, text, None).err().expect("refused").to_string();
        assert!(error("empty", "").contains("is empty"));
        assert!(error("foreign", "hello\n").contains("line 1"));
        let head = serde_json::to_string(&JournalHead::default()).unwrap();
        assert!(error("cut", &format!("{head}\n{{\"n\":1")).contains("line 2"));
        let newer = head.replace("\"v\":0", "\"v\":9");
        assert!(error("newer", &newer).contains("version 9"));
    }
}
