//! Reads the records of a whole recording one by one, chunks unpacked as they come.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use launch_cli::files::open_plain;
use mcap::records::{Record, op};
use schema_recording::walk::{self, End, RecordError, RecordWalk, record};

/// Most bytes that are read at once.
const MAX_READ_BYTES: usize = 1 << 20;

/// A recording that is read from its beginning to its end.
pub(crate) struct Pull {
    path: PathBuf,
    walk: RecordWalk<BufReader<File>>,
    /// The records of the chunk that is read, unpacked, and how many bytes of them are done.
    records: Vec<u8>,
    done: usize,
    /// The record outside of chunks that was read last.
    body: Vec<u8>,
}

/// Where the next record is.
enum At {
    /// In the chunk that is read, its opcode and its body from one byte to another.
    Chunk(u8, std::ops::Range<usize>),
    /// Outside of chunks.
    Outside(u8),
    /// Behind the data.
    End,
}

impl Pull {
    /// Opens a recording.
    ///
    /// # Errors
    /// A sentence if it cannot be read or is none.
    pub(crate) fn open(path: &Path) -> anyhow::Result<Pull> {
        let name = path.display();
        let (file, n_bytes) = open_plain(path).with_context(|| format!("cannot open {name}"))?;
        let input = BufReader::with_capacity(MAX_READ_BYTES, file);
        Ok(Pull {
            path: path.to_path_buf(),
            walk: RecordWalk::new(input, n_bytes).with_context(|| name.to_string())?,
            records: Vec::new(),
            done: 0,
            body: Vec::new(),
        })
    }

    /// The next record; `None` at the end of the data, behind which only the summary stands.
    ///
    /// # Errors
    /// A sentence if the file is damaged here, or ends before its end.
    pub(crate) fn next(&mut self) -> anyhow::Result<Option<Record<'_>>> {
        let (opcode, body) = match self.advance()? {
            At::End => return Ok(None),
            At::Chunk(opcode, place) => (opcode, &self.records[place]),
            At::Outside(opcode) => (opcode, &self.body[..]),
        };
        match record(opcode, body) {
            Ok(record) => Ok(Some(record)),
            Err(why) => Err(damaged(&self.path, &why.to_string())),
        }
    }

    fn advance(&mut self) -> anyhow::Result<At> {
        loop {
            let mut rest = &self.records[self.done..];
            let taken = walk::take_record(&mut rest);
            let left = rest.len();
            if let Some((opcode, body)) = taken.map_err(|error| self.broken(&error))? {
                // What is left, and the body before it, are parts of the records.
                let end = self.records.len().saturating_sub(left);
                let place = end.saturating_sub(body.len())..end;
                self.done = end;
                return Ok(At::Chunk(opcode, place));
            }
            let Some((opcode, body)) = self.walk.next_record() else {
                let why = match self.walk.end() {
                    End::Damaged(why) => why,
                    End::CutOff | End::Complete => "it ends too early".to_owned(),
                };
                return Err(damaged(&self.path, &why));
            };
            match opcode {
                op::DATA_END => return Ok(At::End),
                op::CHUNK => {
                    let records = walk::unpack(&body).map_err(|error| self.broken(&error))?;
                    (self.records, self.done) = (records.into_owned(), 0);
                }
                _ => {
                    self.body = body;
                    return Ok(At::Outside(opcode));
                }
            }
        }
    }

    fn broken(&self, error: &RecordError) -> anyhow::Error {
        damaged(&self.path, &error.to_string())
    }
}

fn damaged(path: &Path, why: &str) -> anyhow::Error {
    let name = path.display();
    anyhow::anyhow!(
        "{name} is damaged or not finished ({why}); copy what is whole with `gantry-record recover {name} OUT.mcap`"
    )
}
