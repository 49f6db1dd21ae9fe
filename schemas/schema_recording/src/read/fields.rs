//! Where the fields of a protobuf message are, without reading the large ones.

use std::io;

use super::chunk::PieceReader;

/// Longest tag and length, bytes: two base-128 varints of 64 bits.
const MAX_TAG_BYTES: usize = 20;

/// Place of a `bytes`, `string` or message field: position in the piece, and bytes.
pub(crate) type Span = (u64, u64);

/// The places of the fields with numbers 1 to `N`, each at its number less 1. Of a field that comes
/// more than once the last counts. Stops at the first byte that cannot be a field.
pub(crate) fn spans<const N: usize>(
    reader: &mut PieceReader,
    (start, len): Span,
) -> io::Result<[Option<Span>; N]> {
    let mut found = [None; N];
    let end = start + len;
    let mut at = start;
    while at < end {
        let left = end - at;
        let bytes = reader.look(at, MAX_TAG_BYTES.min(left as usize))?;
        let mut rest = bytes;
        let Some(tag) = crate::wire::take_varint(&mut rest) else {
            break;
        };
        let skip = match tag & 7 {
            0 => crate::wire::take_varint(&mut rest).map(|_| 0),
            1 => Some(8),
            2 => crate::wire::take_varint(&mut rest),
            5 => Some(4),
            _ => None,
        };
        let head = (bytes.len() - rest.len()) as u64;
        let Some(skip) = skip.filter(|skip| *skip <= left - head) else {
            break;
        };
        let number = (tag >> 3) as usize;
        if tag & 7 == 2 && (1..=N).contains(&number) {
            found[number - 1] = Some((at + head, skip));
        }
        at += head + skip;
    }
    Ok(found)
}
