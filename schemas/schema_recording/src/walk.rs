//! Walks the records of an MCAP file that may be whole, cut off, or damaged. Nothing here trusts a
//! length before it is compared with the bytes that are there.

use std::borrow::Cow;
use std::io::Read;

use mcap::records::{ChunkHeader, Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

/// Largest record, packed or unpacked chunk that is read; a recorder's chunk is 4 MiB plus one message.
pub const MAX_RECORD_BYTES: u64 = 256 << 20;

/// How the walk through a file ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum End {
    /// At the closing magic.
    Complete,
    /// The bytes end inside a record, or before the closing magic.
    CutOff,
    /// A record is impossible; the reason.
    Damaged(String),
}

/// Reads record after record.
pub struct RecordWalk<R> {
    input: R,
    left: u64,
    end: Option<End>,
}

impl<R: Read> RecordWalk<R> {
    /// A walk over `file_bytes` bytes.
    ///
    /// # Errors
    /// A sentence if it does not begin like an MCAP file.
    pub fn new(mut input: R, file_bytes: u64) -> anyhow::Result<RecordWalk<R>> {
        let mut magic = [0u8; 8];
        let whole = file_bytes >= 8 && input.read_exact(&mut magic).is_ok();
        anyhow::ensure!(
            whole && magic == mcap::MAGIC,
            "this is not an MCAP file: it does not begin with the bytes 89 4D 43 41 50 30 0D 0A"
        );
        Ok(RecordWalk {
            input,
            left: file_bytes - 8,
            end: None,
        })
    }

    /// The next record's opcode and body; `None` at the end, see [`RecordWalk::end`].
    pub fn next_record(&mut self) -> Option<(u8, Vec<u8>)> {
        if self.end.is_some() {
            return None;
        }
        if self.left == 8 && self.at_closing_magic() {
            return self.stop(End::Complete);
        }
        if self.left < 9 {
            return self.stop(End::CutOff);
        }
        let mut head = [0u8; 9];
        if self.input.read_exact(&mut head).is_err() {
            return self.stop(End::CutOff);
        }
        self.left -= 9;
        let len = u64::from_le_bytes(head[1..].try_into().expect("nine bytes less one are eight"));
        if len > self.left {
            return self.stop(End::CutOff);
        }
        if len > MAX_RECORD_BYTES {
            return self.stop(End::Damaged(format!(
                "a record claims {len} bytes, the limit is {MAX_RECORD_BYTES}"
            )));
        }
        let mut body = vec![0u8; len as usize];
        if self.input.read_exact(&mut body).is_err() {
            return self.stop(End::CutOff);
        }
        self.left -= len;
        Some((head[0], body))
    }

    /// How the walk ended; [`End::CutOff`] while it has not.
    pub fn end(&self) -> End {
        self.end.clone().unwrap_or(End::CutOff)
    }

    fn at_closing_magic(&mut self) -> bool {
        let mut magic = [0u8; 8];
        self.left = 0;
        self.input.read_exact(&mut magic).is_ok() && magic == mcap::MAGIC
    }

    fn stop(&mut self, end: End) -> Option<(u8, Vec<u8>)> {
        self.end = Some(end);
        None
    }
}

/// Why the bytes of a record cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// A chunk would take more memory than is given to it.
    #[error("a chunk claims {0} unpacked bytes, the limit is {MAX_RECORD_BYTES}")]
    TooLarge(u64),
    /// The record that is called a chunk is none.
    #[error("a chunk record holds something else")]
    NotAChunk,
    /// An attachment ends within its own header.
    #[error("an attachment record of {0} bytes is too short for its own header")]
    ShortAttachment(usize),
    /// The record breaks the rules of MCAP.
    #[error(transparent)]
    Mcap(#[from] mcap::McapError),
}

/// Splits the body of a chunk record into its header and compressed bytes, and checks every length.
///
/// # Errors
/// If the record is no chunk, or one of its lengths cannot be true.
pub fn chunk(body: &[u8]) -> Result<(ChunkHeader, &[u8]), RecordError> {
    match mcap::parse_record(op::CHUNK, body) {
        Ok(Record::Chunk {
            header,
            data: Cow::Borrowed(data),
        }) => {
            if header.uncompressed_size > MAX_RECORD_BYTES {
                return Err(RecordError::TooLarge(header.uncompressed_size));
            }
            Ok((header, data))
        }
        Ok(_) => Err(RecordError::NotAChunk),
        Err(error) => Err(error.into()),
    }
}

/// Parses a record outside of chunks. Any bytes are safe to pass.
///
/// # Errors
/// If the record breaks the rules of MCAP.
pub fn record(opcode: u8, body: &[u8]) -> Result<Record<'_>, RecordError> {
    if opcode == op::ATTACHMENT
        && body.len() < MIN_ATTACHMENT_BYTES.saturating_add(attachment_text_bytes(body))
    {
        return Err(RecordError::ShortAttachment(body.len()));
    }
    Ok(mcap::parse_record(opcode, body)?)
}

/// Two times, two text lengths, the data's length and the checksum.
const MIN_ATTACHMENT_BYTES: usize = 8 + 8 + 4 + 4 + 8 + 4;

/// Bytes of an attachment's name and media type, as far as their lengths can be read.
fn attachment_text_bytes(body: &[u8]) -> usize {
    let len_at = |at: usize| {
        body.get(at..at + 4).map_or(0, |b| {
            u32::from_le_bytes(b.try_into().expect("four bytes")) as usize
        })
    };
    let name = len_at(16);
    name.saturating_add(if name > body.len() {
        0
    } else {
        len_at(20 + name)
    })
}

/// Calls `each` with every record of a chunk, after the chunk's checksum was verified.
///
/// # Errors
/// A sentence that says what is wrong; `each` may have been called before.
pub fn for_each_in_chunk(
    body: &[u8],
    each: &mut dyn FnMut(Record<'_>) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let (header, _) = chunk(body)?;
    // The chunk's own size bounds every record in it, so that a damaged length cannot ask for more
    // memory than the chunk has.
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(header.uncompressed_size as usize);
    let mut reader = LinearReader::new_with_options(options);
    let head = [&[op::CHUNK][..], &(body.len() as u64).to_le_bytes()].concat();
    let mut input = head.as_slice().chain(body);
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(wanted) => {
                let n_read = input.read(reader.insert(wanted.min(head.len() + body.len())))?;
                reader.notify_read(n_read);
            }
            LinearReadEvent::Record { data, opcode } => each(record(opcode, data)?)?,
        }
    }
    Ok(())
}
