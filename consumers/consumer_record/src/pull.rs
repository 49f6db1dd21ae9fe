//! Reads the records of a whole recording one by one, chunks unpacked as they come.

use std::fs::File;
use std::io::{BufReader, Read as _};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use schema_recording::walk::{MAX_RECORD_BYTES, record};

/// Most bytes that are read at once.
const MAX_READ_BYTES: usize = 1 << 20;

/// A recording that is read from its beginning to its end.
pub(crate) struct Pull {
    path: PathBuf,
    input: BufReader<File>,
    reader: LinearReader,
    body: Vec<u8>,
}

impl Pull {
    /// Opens a recording.
    ///
    /// # Errors
    /// A sentence if it cannot be read or is none.
    pub(crate) fn open(path: &Path) -> anyhow::Result<Pull> {
        let name = path.display();
        let mut file = File::open(path).with_context(|| format!("cannot open {name}"))?;
        let mut magic = [0u8; 8];
        let is_mcap = file.read_exact(&mut magic).is_ok() && magic == mcap::MAGIC;
        anyhow::ensure!(
            is_mcap,
            "{name} is not an MCAP file: it does not begin with the bytes 89 4D 43 41 50 30 0D 0A"
        );
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_validate_chunk_crcs(true)
            .with_record_length_limit(MAX_RECORD_BYTES as usize);
        Ok(Pull {
            path: path.to_path_buf(),
            input: BufReader::with_capacity(MAX_READ_BYTES, file),
            reader: LinearReader::new_with_options(options),
            body: Vec::new(),
        })
    }

    /// The next record; `None` at the end of the data, behind which only the summary stands.
    ///
    /// # Errors
    /// A sentence if the file is damaged here, or ends before its end.
    pub(crate) fn next(&mut self) -> anyhow::Result<Option<Record<'_>>> {
        let opcode = loop {
            match self.step() {
                Ok(Step::Record(op::DATA_END)) => return Ok(None),
                Ok(Step::Record(opcode)) => break opcode,
                Ok(Step::More) => {}
                Ok(Step::End) => return Err(self.damaged("it ends too early")),
                Err(error) => return Err(self.damaged(&error.to_string())),
            }
        };
        match record(opcode, &self.body) {
            Ok(record) => Ok(Some(record)),
            Err(why) => Err(self.damaged(&why.to_string())),
        }
    }

    fn step(&mut self) -> anyhow::Result<Step> {
        match self.reader.next_event().transpose()? {
            None => Ok(Step::End),
            Some(LinearReadEvent::Record { data, opcode }) => {
                self.body.clear();
                self.body.extend_from_slice(data);
                Ok(Step::Record(opcode))
            }
            Some(LinearReadEvent::ReadRequest(wanted)) => {
                let space = self.reader.insert(wanted.min(MAX_READ_BYTES));
                let n_read = self.input.read(space)?;
                self.reader.notify_read(n_read);
                Ok(Step::More)
            }
        }
    }

    fn damaged(&self, why: &str) -> anyhow::Error {
        let name = self.path.display();
        anyhow::anyhow!(
            "{name} is damaged or not finished ({why}); copy what is whole with `gantry-record recover {name} OUT.mcap`"
        )
    }
}

enum Step {
    Record(u8),
    More,
    End,
}
