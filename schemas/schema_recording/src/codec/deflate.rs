//! Deflate (RFC 1951) in zlib's envelope (RFC 1950) for filtered images: one block, whose codes are
//! made for a sample of the image, with runs of one byte as its only matches.
//!
//! A filtered image is noise around zero and runs of zeros. A search for matches finds little more in
//! it and takes most of the time, and codes that suit the image are worth more than matches.

/// Symbols of literals, the end of the block, and lengths of matches.
const N_SYMBOLS: usize = 286;
const END: usize = 256;
/// Longest code, bits: four fit a word of 64 bits beside what waits there.
const MAX_BITS: usize = 12;
/// Every so many stretches of bytes one is looked at for the codes.
const SAMPLED: usize = 8;
/// Bytes of a stretch.
const STRETCH: usize = 2048;
/// Longest match.
const MAX_MATCH: usize = 258;
/// Bits of a code and their number.
type Code = (u64, u32);

/// Extra bits of the symbols of lengths, 257 to 285.
const EXTRA_BITS: [u8; 29] = [
    0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4, 5, 5, 5, 5, 0,
];
/// Shortest length of these symbols.
const BASE: [u16; 29] = [
    3, 4, 5, 6, 7, 8, 9, 10, 11, 13, 15, 17, 19, 23, 27, 31, 35, 43, 51, 59, 67, 83, 99, 115, 131,
    163, 195, 227, 258,
];
/// The order in which a block tells the lengths of the codes for lengths of codes.
const N_LENGTH_CODES: usize = 19;

/// Appends `bytes` as a zlib stream; `room` is kept for the next one.
pub(super) fn zlib(bytes: &[u8], room: &mut Vec<u8>, out: &mut Vec<u8>) {
    let lengths = code_lengths(&sample(bytes));
    let codes = codes_of(&lengths);
    let mut bits = Bits::new(room, bytes.len());
    bits.head(&lengths);
    bits.body(bytes, &codes);
    // A window of 32 kB, and no more care than needed.
    out.extend_from_slice(&[0x78, 0x01]);
    out.extend_from_slice(bits.finish());
    out.extend_from_slice(&simd_adler32::adler32(&bytes).to_be_bytes());
}

/// What a stretch of bytes becomes.
enum Token<'a> {
    /// Bytes as they are.
    Literals(&'a [u8]),
    /// The byte before so many times more, at least 3 and at most [`MAX_MATCH`].
    Run(usize),
}

/// Cuts bytes into tokens. Runs are seen eight bytes at a time.
#[inline(always)]
fn tokens(bytes: &[u8], mut take: impl FnMut(Token<'_>)) {
    let word = |at: usize| -> Option<u64> {
        let bytes = bytes.get(at..at.wrapping_add(8))?;
        Some(u64::from_le_bytes(bytes.try_into().ok()?))
    };
    if bytes.is_empty() {
        return;
    }
    let mut at = 1;
    take(Token::Literals(&bytes[..at]));
    while let (Some(now), Some(before)) = (word(at), word(at - 1)) {
        if now != before {
            take(Token::Literals(&bytes[at..at + 8]));
            at += 8;
            continue;
        }
        let begin = at;
        while let (Some(now), Some(before)) = (word(at), word(at - 1))
            && now == before
        {
            at += 8;
        }
        at += bytes[at..]
            .iter()
            .take_while(|byte| **byte == bytes[begin - 1])
            .count();
        let mut n = at - begin;
        // What is left after a match must be long enough for one itself.
        while n > MAX_MATCH {
            let part = if n < MAX_MATCH + 3 { n - 3 } else { MAX_MATCH };
            take(Token::Run(part));
            n -= part;
        }
        take(Token::Run(n));
    }
    for byte in &bytes[at..] {
        take(Token::Literals(std::slice::from_ref(byte)));
    }
}

/// How often each symbol comes in a sample of the bytes; never 0, since the others have them all.
fn sample(bytes: &[u8]) -> [u32; N_SYMBOLS] {
    let symbols = length_symbols();
    let mut counts = [1u32; N_SYMBOLS];
    for stretch in bytes.chunks(STRETCH).step_by(SAMPLED) {
        tokens(stretch, |token| match token {
            Token::Literals(bytes) => bytes.iter().for_each(|byte| counts[*byte as usize] += 16),
            Token::Run(n) => counts[symbols[n] as usize] += 16,
        });
    }
    counts
}

/// The symbol of each length of a match.
fn length_symbols() -> [u16; MAX_MATCH + 1] {
    let mut symbols = [0; MAX_MATCH + 1];
    for (i, base) in BASE.iter().enumerate() {
        for symbol in &mut symbols[*base as usize..] {
            *symbol = 257 + i as u16;
        }
    }
    symbols
}

/// Lengths of a prefix code for symbols that come so often, at most [`MAX_BITS`] bits.
fn code_lengths(counts: &[u32; N_SYMBOLS]) -> [u8; N_SYMBOLS] {
    // Huffman's tree: nodes are made in the order of their counts, so two queues are enough.
    let mut order: Vec<usize> = (0..N_SYMBOLS).collect();
    order.sort_by_key(|symbol| counts[*symbol]);
    let mut weights: Vec<u64> = order.iter().map(|symbol| counts[*symbol] as u64).collect();
    let mut parents = vec![0usize; 2 * N_SYMBOLS - 1];
    let (mut leaf, mut node) = (0, N_SYMBOLS);
    for made in N_SYMBOLS..2 * N_SYMBOLS - 1 {
        let mut lightest = || {
            let is_leaf = leaf < N_SYMBOLS && (node >= made || weights[leaf] <= weights[node]);
            let queue = if is_leaf { &mut leaf } else { &mut node };
            *queue += 1;
            *queue - 1
        };
        let pair = [lightest(), lightest()];
        pair.iter().for_each(|child| parents[*child] = made);
        weights.push(weights[pair[0]] + weights[pair[1]]);
    }
    let mut depths = vec![0usize; 2 * N_SYMBOLS - 1];
    for at in (0..2 * N_SYMBOLS - 2).rev() {
        depths[at] = depths[parents[at]] + 1;
    }
    // Codes that are too long become as long as is allowed; what that overdraws is paid for by the
    // rarest of the shorter ones.
    let mut lengths = [0u8; N_SYMBOLS];
    let mut used = 0usize;
    for (rank, symbol) in order.iter().enumerate() {
        let length = depths[rank].min(MAX_BITS);
        lengths[*symbol] = length as u8;
        used += 1 << (MAX_BITS - length);
    }
    while used > 1 << MAX_BITS {
        let longer = order
            .iter()
            .rev()
            .filter(|symbol| (lengths[**symbol] as usize) < MAX_BITS)
            .max_by_key(|symbol| lengths[**symbol]);
        let Some(symbol) = longer else { break };
        used -= 1 << (MAX_BITS - 1 - lengths[*symbol] as usize);
        lengths[*symbol] += 1;
    }
    // What is left over again goes to the most frequent that it suffices for.
    while used < 1 << MAX_BITS {
        for symbol in order.iter().rev() {
            let gain = 1 << (MAX_BITS - lengths[*symbol] as usize);
            if lengths[*symbol] > 1 && used + gain <= 1 << MAX_BITS {
                used += gain;
                lengths[*symbol] -= 1;
            }
        }
    }
    lengths
}

/// Codes of literals, and of matches by their length with extra bits and distance.
struct Codes {
    literals: [u32; 256],
    runs: [Code; MAX_MATCH + 1],
    end: Code,
}

/// Bits of the number of bits in [`Codes::literals`].
const LENGTH_AT: u32 = 16;

/// The canonical code of these lengths, its bits in the order in which they are written.
fn codes_of(lengths: &[u8; N_SYMBOLS]) -> Codes {
    let mut next = [0u32; MAX_BITS + 2];
    for length in 1..=MAX_BITS {
        let n = lengths.iter().filter(|it| **it as usize == length).count() as u32;
        next[length + 1] = (next[length] + n) << 1;
    }
    let codes: Vec<Code> = lengths
        .iter()
        .map(|length| {
            let code = next[*length as usize];
            next[*length as usize] += 1;
            let length = *length as u32;
            ((code.reverse_bits() >> (32 - length)) as u64, length)
        })
        .collect();
    let literal = |i: usize| codes[i].0 as u32 | codes[i].1 << LENGTH_AT;
    let symbols = length_symbols();
    let run = |n: usize| {
        let symbol = symbols[n.max(3)] as usize;
        let (bits, length) = codes[symbol];
        let extra = EXTRA_BITS[symbol - 257] as u32;
        let more = (n.max(3) - BASE[symbol - 257] as usize) as u64;
        // Behind them the distance 1, whose code is one zero.
        (bits | more << length, length + extra + 1)
    };
    Codes {
        literals: std::array::from_fn(literal),
        runs: std::array::from_fn(run),
        end: codes[END],
    }
}

/// One code behind another; together they have at most 63 bits.
#[inline(always)]
fn join((first, n_first): Code, (second, n_second): Code) -> Code {
    let bits = first | second.wrapping_shl(n_first);
    (bits, n_first.wrapping_add(n_second))
}

/// Writes bits, lowest first.
struct Bits<'r> {
    room: &'r mut [u8],
    at: usize,
    waiting: u64,
    n_waiting: u32,
}

impl<'r> Bits<'r> {
    /// At the beginning of `room`, which becomes large enough for so many bytes as literals.
    fn new(room: &'r mut Vec<u8>, n_bytes: usize) -> Bits<'r> {
        let needed = n_bytes.div_ceil(2) * 3 + 1024;
        if room.len() < needed {
            room.resize(needed, 0);
        }
        Bits {
            room,
            at: 0,
            waiting: 0,
            n_waiting: 0,
        }
    }

    /// Appends at most 56 bits.
    #[inline(always)]
    fn put(&mut self, (bits, n): Code) {
        (self.waiting, self.n_waiting) = join((self.waiting, self.n_waiting), (bits, n));
        if let Some(place) = self.room.get_mut(self.at..self.at.wrapping_add(8)) {
            place.copy_from_slice(&self.waiting.to_le_bytes());
        }
        let n_bytes = self.n_waiting / 8;
        self.at = self.at.wrapping_add(n_bytes as usize);
        self.waiting = self.waiting.wrapping_shr(8 * n_bytes);
        self.n_waiting %= 8;
    }

    /// The block's head: it is the last one and has codes of its own, of these lengths.
    fn head(&mut self, lengths: &[u8; N_SYMBOLS]) {
        self.put((0b101, 3));
        self.put(((N_SYMBOLS - 257) as u64, 5));
        // One code of distances.
        self.put((0, 5));
        self.put(((N_LENGTH_CODES - 4) as u64, 4));
        // Each length is a code of four bits; there are none for repetitions, which come first.
        (0..N_LENGTH_CODES).for_each(|i| self.put((if i < 3 { 0 } else { 4 }, 3)));
        for length in lengths.iter().chain(&[1]) {
            self.put(((*length as u64).reverse_bits() >> 60, 4));
        }
    }

    #[inline(always)]
    fn body(&mut self, bytes: &[u8], codes: &Codes) {
        let one = |byte: &u8| {
            let code = codes.literals[*byte as usize];
            ((code & 0xffff) as u64, code >> LENGTH_AT)
        };
        tokens(bytes, |token| match token {
            Token::Run(n) => self.put(codes.runs[n]),
            Token::Literals(bytes) => {
                let (fours, rest) = bytes.as_chunks::<4>();
                for [a, b, c, d] in fours {
                    self.put(join(join(one(a), one(b)), join(one(c), one(d))));
                }
                rest.iter().for_each(|byte| self.put(one(byte)));
            }
        });
        self.put(codes.end);
    }

    /// Ends with a whole byte; all bytes.
    fn finish(mut self) -> &'r [u8] {
        if self.n_waiting > 0 {
            self.put((0, 8 - self.n_waiting));
        }
        &self.room[..self.at]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image by a decoder of others, with our stream as its only data.
    fn decoded(bytes: &[u8], stream: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        let mut decoder = flate2::read::ZlibDecoder::new(stream);
        std::io::Read::read_to_end(&mut decoder, &mut out).expect("a whole stream");
        assert_eq!(
            decoder.total_in() as usize,
            stream.len(),
            "{} bytes",
            bytes.len()
        );
        out
    }

    #[test]
    fn streams_are_what_zlib_reads() {
        let (mut random, mut room) = (1u32, Vec::new());
        let mut noise = |scale: u32| {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (random >> 24) / scale
        };
        for n in (0..40).chain([255, 258, 259, 260, 261, 262, 300, 518, 777, 100_000]) {
            for scale in [1, 7, 60, 256] {
                let flat = vec![3u8; n];
                let noisy: Vec<u8> = (0..n).map(|_| noise(scale) as u8).collect();
                let mixed: Vec<u8> = (0..n)
                    .map(|i| {
                        if i / 300 % 2 == 0 {
                            0
                        } else {
                            noise(scale) as u8
                        }
                    })
                    .collect();
                for bytes in [flat, noisy, mixed] {
                    let mut stream = Vec::new();
                    zlib(&bytes, &mut room, &mut stream);
                    assert!(
                        decoded(&bytes, &stream) == bytes,
                        "{n} bytes, scale {scale}"
                    );
                }
            }
        }
    }

    #[test]
    fn codes_are_full_and_short_enough() {
        // Counts like Fibonacci's numbers make the deepest tree.
        let mut counts = [1u32; N_SYMBOLS];
        for i in 2..40 {
            counts[i] = counts[i - 1] + counts[i - 2];
        }
        for counts in [counts, [1; N_SYMBOLS]] {
            let lengths = code_lengths(&counts);
            let used: usize = lengths.iter().map(|n| 1 << (MAX_BITS - *n as usize)).sum();
            assert_eq!(used, 1 << MAX_BITS);
            assert!(
                lengths
                    .iter()
                    .all(|n| (1..=MAX_BITS).contains(&(*n as usize)))
            );
        }
    }
}
