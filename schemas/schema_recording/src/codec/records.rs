//! Lists of elements of 32-bit words: each word is expected to continue the line through the same
//! word of the two elements before, what remains is folded, and split into planes of bytes, lowest
//! first, word after word.

use schema_frames::FrameHeader;

use super::bytes::{fold32, join, split, unfold32, unpack, word};
use super::error::CodecError;

/// Elements that are filtered at a time.
const BLOCK: usize = 1024;

/// Words of an element, and how many elements there are.
fn shape(header: &FrameHeader, payload_bytes: usize) -> Option<(usize, usize)> {
    let element_bytes = header.element_bytes as usize;
    let fits = element_bytes >= 4
        && element_bytes.is_multiple_of(4)
        && payload_bytes > 0
        && payload_bytes.is_multiple_of(element_bytes);
    fits.then(|| (element_bytes / 4, payload_bytes / element_bytes))
}

/// Filters a list; `false` if it is none.
pub(super) fn encode(header: &FrameHeader, payload: &[u8], out: &mut Vec<u8>) -> bool {
    let Some((n_words, n_elements)) = shape(header, payload.len()) else {
        return false;
    };
    out.resize(payload.len(), 0);
    let element_bytes = 4 * n_words;
    let (mut words, mut folded) = ([0u32; BLOCK + 2], [0u32; BLOCK]);
    for (k, planes) in out.chunks_exact_mut(4 * n_elements).enumerate() {
        words[..2].fill(0);
        for (block, elements) in payload.chunks(element_bytes * BLOCK).enumerate() {
            let n = elements.len() / element_bytes;
            match n_words {
                4 => gather::<16>(&mut words[2..], elements, k),
                6 => gather::<24>(&mut words[2..], elements, k),
                _ => {
                    let elements = elements.chunks_exact(element_bytes);
                    for (word_out, element) in words[2..].iter_mut().zip(elements) {
                        *word_out = word(&element[4 * k..]);
                    }
                }
            }
            let steps = words[2..].iter().zip(words[1..].iter().zip(&words));
            for (folded, (now, (last, before))) in folded.iter_mut().zip(steps) {
                let expected = last.wrapping_mul(2).wrapping_sub(*before);
                *folded = fold32(now.wrapping_sub(expected));
            }
            split(&folded[..n], planes, n_elements, block * BLOCK);
            words.copy_within(n..n + 2, 0);
        }
    }
    true
}

/// Reads word `k` of each element of `N` bytes.
#[inline]
fn gather<const N: usize>(words: &mut [u32], elements: &[u8], k: usize) {
    let at = 4 * k.min(N / 4 - 1);
    let (elements, _) = elements.as_chunks::<N>();
    for (word, element) in words.iter_mut().zip(elements) {
        *word = u32::from_le_bytes([
            element[at],
            element[at + 1],
            element[at + 2],
            element[at + 3],
        ]);
    }
}

/// Decodes a list.
pub(super) fn decode(header: &FrameHeader, coded: &[u8], out: &mut [u8]) -> Result<(), CodecError> {
    let (n_words, n_elements) =
        shape(header, out.len()).ok_or("the header describes no list of whole words")?;
    let planes = unpack(coded, out.len())?;
    if planes.len() != out.len() {
        return Err(CodecError(format!(
            "coded bytes unpack to {} bytes, the list has {}",
            planes.len(),
            out.len()
        )));
    }
    let mut folded = [0u32; BLOCK];
    for (k, planes) in planes.chunks_exact(4 * n_elements).enumerate() {
        let (mut now, mut step) = (0u32, 0u32);
        for (block, elements) in out.chunks_mut(4 * n_words * BLOCK).enumerate() {
            let n = elements.len() / (4 * n_words);
            join(&mut folded[..n], planes, n_elements, block * BLOCK);
            for (folded, element) in folded.iter().zip(elements.chunks_exact_mut(4 * n_words)) {
                step = step.wrapping_add(unfold32(*folded));
                now = now.wrapping_add(step);
                element[4 * k..4 * k + 4].copy_from_slice(&now.to_le_bytes());
            }
        }
    }
    Ok(())
}
