//! Protocol buffers written by hand, as far as a recorder needs them: fields are appended to a
//! buffer, large ones straight from shared memory.
//!
//! Encoding as in the Protocol Buffers documentation, "Encoding": a tag is `number << 3 | wire
//! type`, lengths are base-128 varints.

/// Appends a base-128 varint.
pub fn put_varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

/// Appends an integer field of wire type 0.
pub fn put_uint(out: &mut Vec<u8>, number: u32, value: u64) {
    put_varint(out, (number as u64) << 3);
    put_varint(out, value);
}

/// Appends a `fixed64` field.
pub fn put_fixed64(out: &mut Vec<u8>, number: u32, value: u64) {
    put_varint(out, (number as u64) << 3 | 1);
    out.extend_from_slice(&value.to_le_bytes());
}

/// Appends a `double` field.
pub fn put_double(out: &mut Vec<u8>, number: u32, value: f64) {
    put_fixed64(out, number, value.to_bits());
}

/// Appends a `bytes`, `string` or message field.
pub fn put_bytes(out: &mut Vec<u8>, number: u32, value: &[u8]) {
    put_varint(out, (number as u64) << 3 | 2);
    put_varint(out, value.len() as u64);
    out.extend_from_slice(value);
}

/// Number of `data` in `foxglove.RawImage` and `foxglove.PointCloud`.
pub const DATA_FIELD: u32 = 6;
/// Number of `data` in `foxglove.CompressedImage`.
pub const COMPRESSED_DATA_FIELD: u32 = 2;

/// Type of a field, with its number in `descriptor.proto`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldType {
    /// `double`.
    Double = 1,
    /// `fixed64`.
    Fixed64 = 6,
    /// `string`.
    String = 9,
    /// `bytes`.
    Bytes = 12,
}

/// One field of a message of ours; the number is its place in the list, from 1.
pub type Field = (&'static str, FieldType);

/// A serialised `google.protobuf.FileDescriptorSet` with one proto3 file that holds one message
/// `gantry.<name>`.
pub fn descriptor_set(name: &str, fields: &[Field]) -> Vec<u8> {
    let mut message = Vec::new();
    put_bytes(&mut message, 1, name.as_bytes());
    for (idx, (field_name, field_type)) in fields.iter().enumerate() {
        let mut field = Vec::new();
        put_bytes(&mut field, 1, field_name.as_bytes());
        put_uint(&mut field, 3, (idx as u64).saturating_add(1));
        put_uint(&mut field, 4, LABEL_OPTIONAL);
        put_uint(&mut field, 5, *field_type as u64);
        put_bytes(&mut message, 2, &field);
    }
    let mut file = Vec::new();
    put_bytes(&mut file, 1, format!("gantry/{name}.proto").as_bytes());
    put_bytes(&mut file, 2, b"gantry");
    put_bytes(&mut file, 4, &message);
    put_bytes(&mut file, 12, b"proto3");
    let mut set = Vec::new();
    put_bytes(&mut set, 1, &file);
    set
}

/// `FieldDescriptorProto.Label.LABEL_OPTIONAL`; proto3 fields without a label have it.
const LABEL_OPTIONAL: u64 = 1;

/// A field as found in a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Value<'a> {
    /// Wire type 0.
    Varint(u64),
    /// Wire type 1.
    Fixed64(u64),
    /// Wire type 2.
    Bytes(&'a [u8]),
    /// Wire type 5.
    Fixed32(u32),
}

/// Reads the fields of a message, in order; stops at the first byte that cannot be a field. Any
/// bytes are safe to pass.
pub fn fields(message: &[u8]) -> impl Iterator<Item = (u32, Value<'_>)> {
    let mut rest = message;
    std::iter::from_fn(move || {
        let tag = take_varint(&mut rest)?;
        let number = u32::try_from(tag >> 3).ok()?;
        let value = match tag & 7 {
            0 => Value::Varint(take_varint(&mut rest)?),
            1 => Value::Fixed64(u64::from_le_bytes(take(&mut rest, 8)?.try_into().ok()?)),
            2 => {
                let len = usize::try_from(take_varint(&mut rest)?).ok()?;
                Value::Bytes(take(&mut rest, len)?)
            }
            5 => Value::Fixed32(u32::from_le_bytes(take(&mut rest, 4)?.try_into().ok()?)),
            _ => return None,
        };
        Some((number, value))
    })
}

/// The first field with this number, if it holds bytes.
pub fn bytes_field(message: &[u8], number: u32) -> Option<&[u8]> {
    fields(message).find_map(|(n, value)| match value {
        Value::Bytes(bytes) if n == number => Some(bytes),
        _ => None,
    })
}

fn take<'a>(rest: &mut &'a [u8], len: usize) -> Option<&'a [u8]> {
    let (head, tail) = rest.split_at_checked(len)?;
    *rest = tail;
    Some(head)
}

pub(crate) fn take_varint(rest: &mut &[u8]) -> Option<u64> {
    let mut value = 0u64;
    for shift in (0..64u32).step_by(7) {
        let byte = take(rest, 1)?[0];
        value |= u64::from(byte & 0x7f).wrapping_shl(shift);
        if byte < 0x80 {
            return Some(value);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn varints_match_the_examples_of_the_documentation() {
        let mut out = Vec::new();
        put_varint(&mut out, 150);
        assert_eq!(out, [0x96, 0x01]);
        out.clear();
        put_bytes(&mut out, 2, b"testing");
        assert_eq!(out, b"\x12\x07testing");
    }

    #[test]
    fn what_is_written_is_read_back() {
        let mut out = Vec::new();
        put_uint(&mut out, 1, u64::MAX);
        put_double(&mut out, 2, -0.5);
        put_bytes(&mut out, 300, &[7; 200]);
        let read: Vec<_> = fields(&out).collect();
        assert_eq!(
            read,
            [
                (1, Value::Varint(u64::MAX)),
                (2, Value::Fixed64((-0.5f64).to_bits())),
                (300, Value::Bytes(&[7; 200]))
            ]
        );
    }

    #[test]
    fn random_bytes_never_panic() {
        let mut state = 1u64;
        for _ in 0..20_000 {
            let bytes: Vec<u8> = (0..24)
                .map(|_| {
                    state = state
                        .wrapping_mul(6364136223846793005)
                        .wrapping_add(1442695040888963407);
                    (state >> 56) as u8
                })
                .collect();
            let _ = fields(&bytes).count();
        }
    }
}
