//! Msgpack values with bounds: reading a message costs at most [`Limits`], whatever lengths it
//! claims.

use std::io::{self, Read};

use rmp::Marker;
use rmp::decode::{RmpRead as _, read_marker};
use rmp::encode;

use crate::budget::{OverBudget, Share};

/// A msgpack value. Maps and extension types do not occur in CARLA's protocol and are refused.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// Nothing.
    Nil,
    /// Truth.
    Bool(bool),
    /// A negative integer.
    Int(i64),
    /// An integer that is not negative.
    UInt(u64),
    /// Single precision.
    F32(f32),
    /// Double precision.
    F64(f64),
    /// Text.
    Str(String),
    /// Bytes.
    Bin(Vec<u8>),
    /// A list.
    Array(Vec<Value>),
}

/// What one message may cost.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Bytes of texts and binaries together.
    pub bytes: usize,
    /// Values of any kind; one takes 32 bytes of memory.
    pub values: usize,
    /// Lists within lists.
    pub depth: usize,
}

impl Default for Limits {
    /// 16 MiB of text (an OpenDRIVE map has a few) and two million values.
    fn default() -> Self {
        Limits {
            bytes: 16 << 20,
            values: 2_000_000,
            depth: 32,
        }
    }
}

/// Why bytes could not be read as a value.
#[derive(Debug, thiserror::Error)]
pub enum DecodeError {
    /// The connection ended between two messages.
    #[error("the connection was closed")]
    Closed,
    /// The connection ended or failed within a message.
    #[error("the message breaks off ({0})")]
    Io(io::Error),
    /// The message exceeds a limit.
    #[error("the message has more than {limit} {what}")]
    TooLarge {
        /// What the message has too much of.
        what: &'static str,
        /// How much is allowed.
        limit: usize,
    },
    /// The connection, or all together, take too much memory now.
    #[error("{0}")]
    NoRoom(#[from] OverBudget),
    /// A kind that CARLA's protocol does not have.
    #[error("the message contains {0}, which CARLA's protocol does not have")]
    Foreign(&'static str),
    /// A text is not UTF-8.
    #[error("a text of the message is not UTF-8")]
    Utf8,
}

/// Reads one value.
///
/// # Errors
/// [`DecodeError`]; the stream is then of no further use.
pub fn read(reader: &mut impl Read, limits: Limits) -> Result<Value, DecodeError> {
    begin(reader, limits, None)
}

/// Reads one value, whose memory is taken from a budget.
///
/// # Errors
/// [`DecodeError`]; the stream is then of no further use.
pub fn read_within(
    reader: &mut impl Read,
    limits: Limits,
    share: &mut Share,
) -> Result<Value, DecodeError> {
    begin(reader, limits, Some(share))
}

fn begin(
    reader: &mut impl Read,
    limits: Limits,
    share: Option<&mut Share>,
) -> Result<Value, DecodeError> {
    let mut decoder = Decoder {
        reader,
        left: limits,
        limits,
        share,
    };
    let marker = match read_marker(decoder.reader) {
        Ok(marker) => marker,
        Err(error) if error.0.kind() == io::ErrorKind::UnexpectedEof => {
            return Err(DecodeError::Closed);
        }
        Err(error) => return Err(DecodeError::Io(error.0)),
    };
    decoder.value(marker, limits.depth)
}

/// Texts are read in pieces of so many bytes.
const PIECE: usize = 1 << 16;

struct Decoder<'r, R> {
    reader: &'r mut R,
    left: Limits,
    limits: Limits,
    share: Option<&'r mut Share>,
}

impl<R: Read> Decoder<'_, R> {
    fn pay(&mut self, bytes: usize) -> Result<(), DecodeError> {
        match &mut self.share {
            Some(share) => Ok(share.take(bytes)?),
            None => Ok(()),
        }
    }

    fn value(&mut self, marker: Marker, depth: usize) -> Result<Value, DecodeError> {
        self.left.values = self
            .left
            .values
            .checked_sub(1)
            .ok_or(DecodeError::TooLarge {
                what: "values",
                limit: self.limits.values,
            })?;
        Ok(match marker {
            Marker::Null => Value::Nil,
            Marker::True => Value::Bool(true),
            Marker::False => Value::Bool(false),
            Marker::FixPos(n) => Value::UInt(n.into()),
            Marker::FixNeg(n) => Value::Int(n.into()),
            Marker::U8 => Value::UInt(self.number::<1>()?[0].into()),
            Marker::U16 => Value::UInt(u16::from_be_bytes(self.number()?).into()),
            Marker::U32 => Value::UInt(u32::from_be_bytes(self.number()?).into()),
            Marker::U64 => Value::UInt(u64::from_be_bytes(self.number()?)),
            Marker::I8 => signed(i8::from_be_bytes(self.number()?).into()),
            Marker::I16 => signed(i16::from_be_bytes(self.number()?).into()),
            Marker::I32 => signed(i32::from_be_bytes(self.number()?).into()),
            Marker::I64 => signed(i64::from_be_bytes(self.number()?)),
            Marker::F32 => Value::F32(f32::from_be_bytes(self.number()?)),
            Marker::F64 => Value::F64(f64::from_be_bytes(self.number()?)),
            Marker::FixStr(len) => self.text(len.into())?,
            Marker::Str8 => {
                let len = self.number::<1>()?[0];
                self.text(len.into())?
            }
            Marker::Str16 => {
                let len = u16::from_be_bytes(self.number()?);
                self.text(len.into())?
            }
            Marker::Str32 => {
                let len = u32::from_be_bytes(self.number()?);
                self.text(len as usize)?
            }
            Marker::Bin8 => {
                let len = self.number::<1>()?[0];
                Value::Bin(self.bytes(len.into())?)
            }
            Marker::Bin16 => {
                let len = u16::from_be_bytes(self.number()?);
                Value::Bin(self.bytes(len.into())?)
            }
            Marker::Bin32 => {
                let len = u32::from_be_bytes(self.number()?);
                Value::Bin(self.bytes(len as usize)?)
            }
            Marker::FixArray(len) => self.array(len.into(), depth)?,
            Marker::Array16 => {
                let len = u16::from_be_bytes(self.number()?);
                self.array(len.into(), depth)?
            }
            Marker::Array32 => {
                let len = u32::from_be_bytes(self.number()?);
                self.array(len as usize, depth)?
            }
            Marker::FixMap(_) | Marker::Map16 | Marker::Map32 => {
                return Err(DecodeError::Foreign("a map"));
            }
            Marker::Reserved => return Err(DecodeError::Foreign("the reserved byte 0xc1")),
            _ => return Err(DecodeError::Foreign("an extension type")),
        })
    }

    fn number<const N: usize>(&mut self) -> Result<[u8; N], DecodeError> {
        let mut bytes = [0; N];
        self.reader
            .read_exact_buf(&mut bytes)
            .map_err(DecodeError::Io)?;
        Ok(bytes)
    }

    fn text(&mut self, len: usize) -> Result<Value, DecodeError> {
        String::from_utf8(self.bytes(len)?)
            .map(Value::Str)
            .map_err(|_| DecodeError::Utf8)
    }

    /// Memory grows with what arrives, not with what is claimed.
    fn bytes(&mut self, len: usize) -> Result<Vec<u8>, DecodeError> {
        self.left.bytes = self
            .left
            .bytes
            .checked_sub(len)
            .ok_or(DecodeError::TooLarge {
                what: "bytes of text",
                limit: self.limits.bytes,
            })?;
        self.pay(size_of::<Value>())?;
        let mut bytes = Vec::with_capacity(len.min(PIECE));
        while bytes.len() < len {
            let (had, piece) = (bytes.len(), (len - bytes.len()).min(PIECE));
            self.pay(piece)?;
            self.reader
                .by_ref()
                .take(piece as u64)
                .read_to_end(&mut bytes)
                .map_err(DecodeError::Io)?;
            if bytes.len() < had + piece {
                return Err(DecodeError::Io(io::ErrorKind::UnexpectedEof.into()));
            }
        }
        Ok(bytes)
    }

    fn array(&mut self, len: usize, depth: usize) -> Result<Value, DecodeError> {
        let deeper = depth.checked_sub(1).ok_or(DecodeError::TooLarge {
            what: "lists within lists",
            limit: self.limits.depth,
        })?;
        if len > self.left.values {
            return Err(DecodeError::TooLarge {
                what: "values",
                limit: self.limits.values,
            });
        }
        let mut items = Vec::with_capacity(len.min(256));
        for _ in 0..len {
            self.pay(size_of::<Value>())?;
            let marker = read_marker(self.reader).map_err(|error| DecodeError::Io(error.0))?;
            items.push(self.value(marker, deeper)?);
        }
        Ok(Value::Array(items))
    }
}

fn signed(n: i64) -> Value {
    u64::try_from(n).map_or(Value::Int(n), Value::UInt)
}

/// Appends a value's bytes; integers take their smallest form.
pub fn write(out: &mut Vec<u8>, value: &Value) {
    const ROOM: &str = "a vector always has room, and lengths fit 32 bits";
    match value {
        Value::Nil => encode::write_nil(out).expect(ROOM),
        Value::Bool(b) => encode::write_bool(out, *b).expect(ROOM),
        Value::Int(n) => drop(encode::write_sint(out, *n).expect(ROOM)),
        Value::UInt(n) => drop(encode::write_uint(out, *n).expect(ROOM)),
        Value::F32(x) => encode::write_f32(out, *x).expect(ROOM),
        Value::F64(x) => encode::write_f64(out, *x).expect(ROOM),
        Value::Str(text) => encode::write_str(out, text).expect(ROOM),
        Value::Bin(bytes) => encode::write_bin(out, bytes).expect(ROOM),
        Value::Array(items) => {
            encode::write_array_len(out, items.len() as u32).expect(ROOM);
            items.iter().for_each(|item| write(out, item));
        }
    }
}

impl Value {
    /// The kind of value, for error messages.
    pub fn kind(&self) -> &'static str {
        match self {
            Value::Nil => "nil",
            Value::Bool(_) => "a bool",
            Value::Int(_) | Value::UInt(_) => "an integer",
            Value::F32(_) | Value::F64(_) => "a number",
            Value::Str(_) => "a text",
            Value::Bin(_) => "bytes",
            Value::Array(_) => "a list",
        }
    }
}

impl From<bool> for Value {
    fn from(b: bool) -> Self {
        Value::Bool(b)
    }
}
impl From<u8> for Value {
    fn from(n: u8) -> Self {
        Value::UInt(n.into())
    }
}
impl From<u16> for Value {
    fn from(n: u16) -> Self {
        Value::UInt(n.into())
    }
}
impl From<u32> for Value {
    fn from(n: u32) -> Self {
        Value::UInt(n.into())
    }
}
impl From<u64> for Value {
    fn from(n: u64) -> Self {
        Value::UInt(n)
    }
}
impl From<i32> for Value {
    fn from(n: i32) -> Self {
        signed(n.into())
    }
}
impl From<f32> for Value {
    fn from(x: f32) -> Self {
        Value::F32(x)
    }
}
impl From<f64> for Value {
    fn from(x: f64) -> Self {
        Value::F64(x)
    }
}
impl From<&str> for Value {
    fn from(text: &str) -> Self {
        Value::Str(text.to_owned())
    }
}
impl From<String> for Value {
    fn from(text: String) -> Self {
        Value::Str(text)
    }
}
impl From<Vec<Value>> for Value {
    fn from(items: Vec<Value>) -> Self {
        Value::Array(items)
    }
}

/// A list of values of any kinds: `list![1u32, "text", 0.5f32]`.
#[macro_export]
macro_rules! list {
    ($($item:expr),* $(,)?) => { $crate::msgpack::Value::Array(vec![$($crate::msgpack::Value::from($item)),*]) };
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes_of(value: &Value) -> Vec<u8> {
        let mut out = Vec::new();
        write(&mut out, value);
        out
    }

    fn random(rng: &mut fastrand::Rng, depth: u32) -> Value {
        match rng.u32(0..if depth == 0 { 8 } else { 10 }) {
            0 => Value::Nil,
            1 => Value::Bool(rng.bool()),
            2 => Value::Int(-1 - (rng.u64(..) >> rng.u32(1..64)) as i64),
            3 => Value::UInt(rng.u64(..) >> rng.u32(0..64)),
            4 => Value::F32(rng.f32()),
            5 => Value::F64(rng.f64()),
            6 => Value::Str((0..rng.usize(0..300)).map(|_| rng.alphanumeric()).collect()),
            7 => Value::Bin((0..rng.usize(0..300)).map(|_| rng.u8(..)).collect()),
            _ => Value::Array(
                (0..rng.usize(0..20))
                    .map(|_| random(rng, depth - 1))
                    .collect(),
            ),
        }
    }

    #[test]
    fn the_protocols_own_transcript() {
        let request = list![0u32, 1u32, "version", list![list![false]]];
        let wire = [
            &[0x94, 0x00, 0x01, 0xa7][..],
            b"version",
            &[0x91, 0x91, 0xc2],
        ]
        .concat();
        assert_eq!(bytes_of(&request), wire);
        assert_eq!(
            read(&mut wire.as_slice(), Limits::default()).unwrap(),
            request
        );
    }

    #[test]
    fn values_survive_the_wire() {
        let mut rng = fastrand::Rng::with_seed(1);
        for _ in 0..2000 {
            let value = random(&mut rng, 4);
            assert_eq!(
                read(&mut bytes_of(&value).as_slice(), Limits::default()).unwrap(),
                value
            );
        }
    }

    /// Seeded mutations: whatever the bytes, reading ends with a value or an error, within the
    /// limits.
    #[test]
    fn mutated_bytes_never_panic_and_never_cost_more_than_the_limits() {
        let mut rng = fastrand::Rng::with_seed(2);
        let limits = Limits {
            bytes: 1 << 16,
            values: 1 << 12,
            depth: 16,
        };
        for _ in 0..60_000 {
            let mut bytes = bytes_of(&random(&mut rng, 4));
            for _ in 0..rng.usize(1..6) {
                let at = rng.usize(0..bytes.len());
                match rng.u8(0..4) {
                    0 => bytes[at] = rng.u8(..),
                    1 => bytes[at] ^= 1 << rng.u8(0..8),
                    2 => bytes.insert(at, rng.u8(0xc0..=0xdf)),
                    _ => bytes.truncate(at.max(1)),
                }
            }
            let mut reader = bytes.as_slice();
            while let Ok(value) = read(&mut reader, limits) {
                assert!(count(&value) <= limits.values);
            }
        }
    }

    fn count(value: &Value) -> usize {
        if let Value::Array(items) = value {
            1 + items.iter().map(count).sum::<usize>()
        } else {
            1
        }
    }

    #[test]
    fn giant_claims_and_deep_nesting_are_refused_at_once() {
        let giant = |bytes: &[u8]| {
            read(&mut &bytes[..], Limits::default())
                .unwrap_err()
                .to_string()
        };
        assert!(giant(&[0xdd, 0xff, 0xff, 0xff, 0xff]).contains("values"));
        assert!(giant(&[0xdb, 0xff, 0xff, 0xff, 0xff]).contains("bytes of text"));
        assert!(giant(&[0x91; 1000]).contains("lists within lists"));
        assert!(giant(&[0x81, 0x01, 0x01]).contains("a map"));
        assert!(matches!(
            read(&mut &[][..], Limits::default()),
            Err(DecodeError::Closed)
        ));
    }
}
