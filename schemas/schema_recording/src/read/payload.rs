//! The bytes of a frame or a result, read when they are asked for.

use std::io;

use schema_frames::FrameHeader;

use super::chunk::PieceReader;
use super::fields::Span;
use crate::codec::{self, CodecError};

/// Why bytes cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum PayloadError {
    /// The caller's memory has another length.
    #[error("the payload has {have} bytes, the memory for it {given}")]
    Length {
        /// Bytes of the payload.
        have: usize,
        /// Bytes of the memory.
        given: usize,
    },
    /// The coded bytes cannot be decoded.
    #[error("the payload is coded as {codec:?} and cannot be decoded: {cause}")]
    Codec {
        /// Name of the codec.
        codec: String,
        /// What it says.
        cause: CodecError,
    },
    /// The file cannot be read.
    #[error("the payload cannot be read: {0}")]
    Io(#[from] io::Error),
}

/// The bytes of a frame's payload or a result's body. Nothing of a large one has been read yet.
#[derive(Debug)]
pub struct Payload<'a> {
    pub(crate) reader: &'a mut PieceReader,
    pub(crate) span: Span,
    pub(crate) len: usize,
    pub(crate) codec: String,
    pub(crate) header: FrameHeader,
    pub(crate) coded: &'a mut Vec<u8>,
}

impl Payload<'_> {
    /// Bytes, decoded.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Name of the codec of the stored bytes; empty if they are stored as they are.
    pub fn codec(&self) -> &str {
        &self.codec
    }

    /// Bytes in the file, before the compression of its chunk.
    pub fn stored_len(&self) -> usize {
        self.span.1 as usize
    }

    /// Writes all bytes into `out`, which has [`Payload::len`]. Of an uncompressed chunk they come
    /// straight from the file.
    ///
    /// # Errors
    /// [`PayloadError`]; `out` then holds anything.
    pub fn read_into(&mut self, out: &mut [u8]) -> Result<(), PayloadError> {
        if out.len() != self.len {
            return Err(PayloadError::Length {
                have: self.len,
                given: out.len(),
            });
        }
        let (at, stored) = self.span;
        if self.codec.is_empty() {
            return Ok(self.reader.copy(at, out)?);
        }
        self.coded.resize(stored as usize, 0);
        self.reader.copy(at, self.coded)?;
        codec::decode(&self.codec, &self.header, self.coded, out).map_err(|cause| {
            PayloadError::Codec {
                codec: self.codec.clone(),
                cause,
            }
        })
    }

    /// All bytes.
    ///
    /// # Errors
    /// As [`Payload::read_into`].
    pub fn to_vec(&mut self) -> Result<Vec<u8>, PayloadError> {
        let mut bytes = vec![0; self.len];
        self.read_into(&mut bytes)?;
        Ok(bytes)
    }

    /// The bytes as they are stored: coded, if there is a codec.
    ///
    /// # Errors
    /// [`PayloadError::Io`].
    pub fn stored(&mut self) -> Result<Vec<u8>, PayloadError> {
        let mut bytes = vec![0; self.stored_len()];
        self.reader.copy(self.span.0, &mut bytes)?;
        Ok(bytes)
    }
}
