//! What the launcher does to its processes, one JSON object per line, for programs that watch them.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::Path;

use launch_cli::files::open_plain;
use serde::{Deserialize, Serialize};

use crate::error::RunError;

/// Name of the file in the folder of a run.
pub const NOTES: &str = "processes.jsonl";
/// Most bytes that are read in one look, so that a launcher that restarts without end cannot hold
/// its reader.
const MAX_LOOK_BYTES: u64 = 1 << 20;

/// What became of a process.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Note {
    /// It was started.
    Started {
        /// Its name.
        process: String,
        /// Its id, which is its group's too.
        pid: u32,
    },
    /// It ended.
    Ended {
        /// Its name.
        process: String,
        /// How: `exit code 3`, `signal SIGKILL`.
        how: String,
    },
    /// It will be started again.
    Restarting {
        /// Its name.
        process: String,
        /// When, and how often it was before, as a sentence.
        text: String,
    },
    /// It was started too often.
    GaveUp {
        /// Its name.
        process: String,
        /// How often, as a sentence.
        text: String,
    },
}

/// Writes notes.
#[derive(Debug)]
pub struct NoteWriter(File);

impl NoteWriter {
    /// Makes the file in the folder of a run.
    ///
    /// # Errors
    /// [`RunError::Write`].
    pub fn make(folder: &Path) -> Result<NoteWriter, RunError> {
        let path = folder.join(NOTES);
        let made = File::options().create(true).append(true).open(&path);
        made.map(NoteWriter)
            .map_err(|source| RunError::Write { path, source })
    }

    /// Writes a note. A disk that is full does not end the processes.
    pub fn write(&mut self, note: &Note) {
        if let Ok(text) = serde_json::to_string(note) {
            let _ = self.0.write_all((text + "\n").as_bytes());
        }
    }
}

/// Reads notes as they are written.
#[derive(Debug, Default)]
pub struct NoteReader {
    file: Option<File>,
    read_to: u64,
    rest: Vec<u8>,
    /// Process ids by name, of those that run.
    pub pids: BTreeMap<String, u32>,
}

impl NoteReader {
    /// The notes since the last look; none before the launcher has begun the file in `folder`.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn look(&mut self, folder: &Path) -> io::Result<Vec<Note>> {
        if self.file.is_none() {
            self.file = match open_plain(&folder.join(NOTES)) {
                Ok((file, _)) => Some(file),
                Err(error) if error.kind() == io::ErrorKind::NotFound => None,
                Err(error) => return Err(error),
            };
        }
        let Some(file) = &mut self.file else {
            return Ok(Vec::new());
        };
        file.seek(SeekFrom::Start(self.read_to))?;
        let mut new = Vec::new();
        file.take(MAX_LOOK_BYTES).read_to_end(&mut new)?;
        self.read_to += new.len() as u64;
        self.rest.extend(new);
        let mut notes = Vec::new();
        while let Some(end) = self.rest.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = self.rest.drain(..=end).collect();
            // A newer launcher may write notes of further kinds.
            notes.extend(serde_json::from_slice::<Note>(&line).ok());
        }
        for note in &notes {
            match note {
                Note::Started { process, pid } => drop(self.pids.insert(process.clone(), *pid)),
                Note::Ended { process, .. } => drop(self.pids.remove(process)),
                Note::Restarting { .. } | Note::GaveUp { .. } => {}
            }
        }
        Ok(notes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_are_read_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let mut reader = NoteReader::default();
        assert_eq!(reader.look(folder.path()).unwrap(), []);
        let mut writer = NoteWriter::make(folder.path()).unwrap();
        let process = || "quick".to_owned();
        let started = Note::Started {
            process: process(),
            pid: 3724,
        };
        writer.write(&started);
        assert_eq!(reader.look(folder.path()).unwrap(), [started]);
        assert_eq!(reader.pids["quick"], 3724);
        let ended = Note::Ended {
            process: process(),
            how: "signal SIGKILL".into(),
        };
        let again = Note::Restarting {
            process: process(),
            text: "restarting quick in 500 ms (1 of 5)".into(),
        };
        writer.write(&ended);
        writer.write(&again);
        writer.0.write_all(b"{\"event\":\"newer\"}\n{\"ev").unwrap();
        assert_eq!(reader.look(folder.path()).unwrap(), [ended, again]);
        assert!(reader.pids.is_empty());
        assert_eq!(reader.look(folder.path()).unwrap(), []);
    }
}
