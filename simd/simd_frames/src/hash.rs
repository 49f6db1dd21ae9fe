//! `--hash`: one line per tick and topic on stdout, equal for equal bytes.
//!
//! The hash covers the first 192 header bytes and the payload in use. The header fields behind
//! these, clocks and the epoch, differ from run to run. Two lanes of SplitMix64 run over 8-byte
//! words. This is no cryptographic hash, but any flipped bit and any moved word changes it.

use schema_types::noise::mix;

/// Hash of a sequence of chunks. Where one chunk ends matters, so header and payload are always two
/// chunks.
#[derive(Clone, Copy, Debug)]
pub struct BytesHash {
    lanes: [u64; 2],
    length: u64,
}

impl Default for BytesHash {
    fn default() -> Self {
        BytesHash {
            lanes: [0x243f_6a88_85a3_08d3, 0x1319_8a2e_0370_7344],
            length: 0,
        }
    }
}

impl BytesHash {
    /// Nothing hashed yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds one chunk.
    pub fn chunk(mut self, bytes: &[u8]) -> Self {
        let mut words = bytes.chunks_exact(16);
        for pair in &mut words {
            let (a, b) = pair.split_at(8);
            self.lanes[0] = mix(self.lanes[0] ^ word(a));
            self.lanes[1] = mix(self.lanes[1] ^ word(b));
        }
        let mut tail = [0u8; 16];
        tail[..words.remainder().len()].copy_from_slice(words.remainder());
        self.lanes[0] = mix(self.lanes[0] ^ word(&tail[..8]));
        self.lanes[1] = mix(self.lanes[1] ^ word(&tail[8..]));
        self.length += bytes.len() as u64;
        self
    }

    /// 64 bits.
    pub fn finish(self) -> u64 {
        mix(mix(self.lanes[0] ^ self.length) ^ self.lanes[1])
    }
}

fn word(bytes: &[u8]) -> u64 {
    u64::from_le_bytes(bytes.try_into().expect("words are 8 bytes"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flipped_bit_a_swapped_word_and_a_longer_tail_all_change_the_hash() {
        let bytes: Vec<u8> = (0..100).collect();
        let base = BytesHash::new().chunk(&bytes).finish();
        for i in 0..bytes.len() * 8 {
            let mut other = bytes.clone();
            other[i / 8] ^= 1 << (i % 8);
            assert_ne!(BytesHash::new().chunk(&other).finish(), base, "bit {i}");
        }
        let mut swapped = bytes.clone();
        swapped.swap(0, 8);
        assert_ne!(BytesHash::new().chunk(&swapped).finish(), base);
        let mut longer = bytes.clone();
        longer.push(0);
        assert_ne!(BytesHash::new().chunk(&longer).finish(), base);
    }
}
