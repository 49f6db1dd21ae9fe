//! Walks the records of an MCAP file that may be whole, cut off, or damaged. Nothing here trusts a
//! length before it is compared with the bytes that are there.

use std::borrow::Cow;
use std::io::{self, Read};

use mcap::records::{ChunkHeader, Record, op};

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
            left: file_bytes.saturating_sub(8),
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
        let mut head = [0u8; 9];
        let Some(left) = self.left.checked_sub(9) else {
            return self.stop(End::CutOff);
        };
        if self.input.read_exact(&mut head).is_err() {
            return self.stop(End::CutOff);
        }
        self.left = left;
        let [opcode, len @ ..] = head;
        let len = u64::from_le_bytes(len);
        let Some(left) = self.left.checked_sub(len) else {
            return self.stop(End::CutOff);
        };
        if len > MAX_RECORD_BYTES {
            return self.stop(End::Damaged(format!(
                "a record claims {len} bytes, the limit is {MAX_RECORD_BYTES}"
            )));
        }
        let mut body = vec![0u8; len as usize];
        if self.input.read_exact(&mut body).is_err() {
            return self.stop(End::CutOff);
        }
        self.left = left;
        Some((opcode, body))
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
    /// A chunk that is not compressed has two sizes.
    #[error("a chunk is not compressed, but gives its records {packed} and {unpacked} bytes")]
    Sizes {
        /// Bytes in the file.
        packed: u64,
        /// Bytes of its records.
        unpacked: u64,
    },
    /// A compression that MCAP does not know.
    #[error("a chunk is compressed with {0:?}, known are lz4 and zstd")]
    Compression(String),
    /// The bytes are no compressed ones, or not of the number that is given.
    #[error("a chunk cannot be unpacked: {0}")]
    Packed(#[source] io::Error),
    /// The records are others than those that were written.
    #[error("a chunk does not have the checksum that is given for it")]
    Checksum,
    /// A record is longer than its chunk.
    #[error("a record reaches beyond the chunk that holds it")]
    Beyond,
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
        let four = body.get(at..).and_then(|rest| rest.first_chunk());
        four.map_or(0, |four| u32::from_le_bytes(*four) as usize)
    };
    let name = len_at(16);
    name.saturating_add(len_at(name.saturating_add(20)))
}

/// The records of a chunk one after another, unpacked, after the chunk's checksum was compared.
///
/// # Errors
/// If a length cannot be true, or the chunk cannot be unpacked.
pub fn unpack(body: &[u8]) -> Result<Cow<'_, [u8]>, RecordError> {
    let (header, packed) = chunk(body)?;
    let records = match header.compression.as_str() {
        "" if header.uncompressed_size != header.compressed_size => {
            return Err(RecordError::Sizes {
                packed: header.compressed_size,
                unpacked: header.uncompressed_size,
            });
        }
        "" => Cow::Borrowed(packed),
        compression => {
            // `chunk` bounds the size, which therefore fits.
            let n_bytes = usize::try_from(header.uncompressed_size).unwrap_or(usize::MAX);
            let mut unpacked = vec![0; n_bytes];
            unpack_into(compression, packed, &mut unpacked)?;
            Cow::Owned(unpacked)
        }
    };
    match header.uncompressed_crc {
        0 => Ok(records),
        crc if crc == crc32fast::hash(&records) => Ok(records),
        _ => Err(RecordError::Checksum),
    }
}

/// Unpacks the records of a chunk into memory of exactly their size.
///
/// # Errors
/// If the compression is unknown, or the bytes are not of that many.
pub(crate) fn unpack_into(
    compression: &str,
    packed: &[u8],
    out: &mut [u8],
) -> Result<(), RecordError> {
    let unpacked = match compression {
        "lz4" => lz4::Decoder::new(packed).and_then(|from| fill(from, out)),
        "zstd" => zstd::stream::read::Decoder::with_buffer(packed).and_then(|from| fill(from, out)),
        other => return Err(RecordError::Compression(other.to_owned())),
    };
    unpacked.map_err(RecordError::Packed)
}

/// Fills `out`, and makes sure that there is no more.
fn fill(mut from: impl Read, out: &mut [u8]) -> io::Result<()> {
    from.read_exact(out)?;
    match from.read(&mut [0])? {
        0 => Ok(()),
        _ => Err(io::Error::other("it is longer than it claims")),
    }
}

/// Takes the first record off the records of a chunk: its opcode and body; `None` if there is none.
///
/// # Errors
/// If it reaches beyond the chunk.
pub fn take_record<'r>(records: &mut &'r [u8]) -> Result<Option<(u8, &'r [u8])>, RecordError> {
    let Some((opcode, rest)) = records.split_first() else {
        return Ok(None);
    };
    let (len, rest) = rest.split_first_chunk::<8>().ok_or(RecordError::Beyond)?;
    let len = usize::try_from(u64::from_le_bytes(*len)).map_err(|_| RecordError::Beyond)?;
    let (body, rest) = rest.split_at_checked(len).ok_or(RecordError::Beyond)?;
    *records = rest;
    Ok(Some((*opcode, body)))
}

/// Calls `each` with every record of a chunk, after the chunk's checksum was verified.
///
/// # Errors
/// A sentence that says what is wrong; `each` may have been called before.
pub fn for_each_in_chunk(
    body: &[u8],
    each: &mut dyn FnMut(Record<'_>) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let unpacked = unpack(body)?;
    let mut records = &*unpacked;
    while let Some((opcode, body)) = take_record(&mut records)? {
        each(record(opcode, body)?)?;
    }
    Ok(())
}
