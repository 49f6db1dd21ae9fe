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
    let end = start.saturating_add(len);
    let mut at = start;
    while at < end {
        let left = end.saturating_sub(at);
        let bytes = reader.look(
            at,
            MAX_TAG_BYTES.min(usize::try_from(left).unwrap_or(usize::MAX)),
        )?;
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
        let head = bytes.len().saturating_sub(rest.len()) as u64;
        let body_at = at.saturating_add(head);
        let next = skip.and_then(|skip| Some((skip, body_at.checked_add(skip)?)));
        let Some((skip, next)) = next.filter(|(_, next)| *next <= end) else {
            break;
        };
        let number = usize::try_from(tag >> 3).unwrap_or(0);
        if tag & 7 == 2
            && let Some(place) = number.checked_sub(1).and_then(|idx| found.get_mut(idx))
        {
            *place = Some((body_at, skip));
        }
        at = next;
    }
    Ok(found)
}
