//! What the codecs share: checksum and zstd frame around filtered bytes, and signed differences as
//! small unsigned numbers.

use std::io::Cursor;

use super::error::CodecError;

/// Bytes of the checksum in front.
const CRC_BYTES: usize = 4;

/// Replaces `coded` by the checksum and the zstd frame of `plain`.
pub(super) fn pack(
    zstd: &mut zstd::bulk::Compressor<'_>,
    plain: &[u8],
    coded: &mut Vec<u8>,
) -> std::io::Result<()> {
    coded.clear();
    coded.reserve(CRC_BYTES + zstd::zstd_safe::compress_bound(plain.len()));
    coded.extend_from_slice(&[0; CRC_BYTES]);
    let mut tail = Cursor::new(std::mem::take(coded));
    tail.set_position(CRC_BYTES as u64);
    let outcome = zstd.compress_to_buffer(plain, &mut tail);
    *coded = tail.into_inner();
    outcome?;
    let crc = crc32fast::hash(&coded[CRC_BYTES..]);
    coded[..CRC_BYTES].copy_from_slice(&crc.to_le_bytes());
    Ok(())
}

/// The zstd frame behind the checksum.
fn frame(coded: &[u8]) -> Result<&[u8], CodecError> {
    let (crc, frame) = coded
        .split_at_checked(CRC_BYTES)
        .ok_or("coded bytes are too short for their checksum")?;
    if crc32fast::hash(frame).to_le_bytes() != crc {
        return Err("coded bytes do not match their checksum".into());
    }
    Ok(frame)
}

/// Unpacks into `out`, which must be filled exactly.
pub(super) fn unpack_into(coded: &[u8], out: &mut [u8]) -> Result<(), CodecError> {
    let n = zstd::bulk::decompress_to_buffer(frame(coded)?, out)
        .map_err(|error| CodecError(format!("coded bytes cannot be unpacked: {error}")))?;
    if n != out.len() {
        return Err(CodecError(format!(
            "coded bytes unpack to {n} bytes, {} are expected",
            out.len()
        )));
    }
    Ok(())
}

/// Unpacks at most `limit` bytes.
pub(super) fn unpack(coded: &[u8], limit: usize) -> Result<Vec<u8>, CodecError> {
    let frame = frame(coded)?;
    let claimed = zstd::zstd_safe::get_frame_content_size(frame)
        .ok()
        .flatten()
        .ok_or("coded bytes do not say how much they unpack to")?;
    if claimed > limit as u64 {
        return Err(CodecError(format!(
            "coded bytes claim to unpack to {claimed} bytes, at most {limit} are possible"
        )));
    }
    let mut plain = vec![0; claimed as usize];
    unpack_into(coded, &mut plain)?;
    Ok(plain)
}

/// A signed difference as an unsigned number that is small when the difference is: 0, −1, 1, −2, …
#[inline]
pub(super) fn fold32(difference: u32) -> u32 {
    (difference << 1) ^ (((difference as i32) >> 31) as u32)
}

/// The difference that [`fold32`] made `folded` of.
#[inline]
pub(super) fn unfold32(folded: u32) -> u32 {
    (folded >> 1) ^ (folded & 1).wrapping_neg()
}

/// The 32-bit word that `bytes` begin with.
#[inline]
pub(super) fn word(bytes: &[u8]) -> u32 {
    u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}

/// [`fold32`] of 16 bits.
#[inline]
pub(super) fn fold16(difference: u32) -> u32 {
    fold32(difference as u16 as i16 as u32) & 0xffff
}

/// Undoes [`fold16`], modulo 2^16.
#[inline]
pub(super) fn unfold16(folded: u32) -> u32 {
    unfold32(folded)
}

/// Writes words as planes of bytes, lowest byte first, as many as `planes` holds: plane `k` holds
/// byte `k` of every word and begins at `k * plane_bytes`; the words begin at `at` of each.
#[inline]
pub(super) fn split(words: &[u32], planes: &mut [u8], plane_bytes: usize, at: usize) {
    for (k, plane) in planes.chunks_exact_mut(plane_bytes).take(4).enumerate() {
        let shift = 8 * k as u32;
        let place = &mut plane[at..at + words.len()];
        for (byte, word) in place.iter_mut().zip(words) {
            *byte = (word >> shift) as u8;
        }
    }
}

/// Reads words back that [`split`] wrote.
#[inline]
pub(super) fn join(words: &mut [u32], planes: &[u8], plane_bytes: usize, at: usize) {
    words.fill(0);
    for (k, plane) in planes.chunks_exact(plane_bytes).take(4).enumerate() {
        let shift = 8 * k as u32;
        let place = &plane[at..at + words.len()];
        for (word, byte) in words.iter_mut().zip(place) {
            *word |= (*byte as u32) << shift;
        }
    }
}
