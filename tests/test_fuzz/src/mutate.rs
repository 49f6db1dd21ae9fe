//! Changes bytes a little, so that most of what could be read still can be.

const NUMBERS: [&str; 12] = [
    "0",
    "-1",
    "1e9",
    "-1e9",
    "1e308",
    "nan",
    "inf",
    "1e-12",
    "999999",
    "4294967295",
    "0.5",
    "-0.0000001",
];
const EDGES: [u64; 8] = [0, 1, 0x7f, 0xff, 0xffff, 0x7fff_ffff, 0xffff_ffff, u64::MAX];

/// One to four changes of one of the seeds; in texts mostly of numbers.
pub fn mutant(seeds: &[Vec<u8>], is_text: bool, random: &mut fastrand::Rng) -> Vec<u8> {
    let mut bytes = seeds[random.usize(0..seeds.len())].clone();
    for _ in 0..random.u32(1..5) {
        if bytes.is_empty() {
            break;
        }
        if is_text && random.u8(0..10) < 7 {
            change_number(&mut bytes, random);
        } else {
            change_bytes(&mut bytes, random);
        }
    }
    bytes
}

/// Puts a hostile number in place of one that stands in a text.
fn change_number(text: &mut Vec<u8>, random: &mut fastrand::Rng) {
    let starts: Vec<usize> = (1..text.len())
        .filter(|i| text[*i].is_ascii_digit() && !text[*i - 1].is_ascii_alphanumeric())
        .collect();
    let Some(start) = random.choice(&starts).copied() else {
        return;
    };
    let is_part = |byte: &u8| byte.is_ascii_digit() || *byte == b'.';
    let len = text[start..].iter().take_while(|b| is_part(b)).count();
    let number = NUMBERS[random.usize(0..NUMBERS.len())];
    text.splice(start..start + len, number.bytes());
}

fn change_bytes(bytes: &mut Vec<u8>, random: &mut fastrand::Rng) {
    let at = random.usize(0..bytes.len());
    let end = (at + random.usize(1..40)).min(bytes.len());
    match random.u8(0..7) {
        0 => bytes[at] ^= 1 << random.u8(0..8),
        1 => bytes[at] = random.u8(..),
        2 => bytes.truncate(at),
        3 => drop(bytes.drain(at..end)),
        4 => {
            let copy = bytes[at..end].to_vec();
            bytes.splice(at..at, copy);
        }
        5 => {
            // A number of 1, 2, 4 or 8 bytes becomes one at an edge, in either order of bytes.
            let n = (1usize << random.u8(0..4)).min(bytes.len() - at);
            let edge = EDGES[random.usize(0..EDGES.len())];
            let word = if random.bool() {
                edge.to_le_bytes()
            } else {
                edge.rotate_right(8 * n as u32 % 64).to_be_bytes()
            };
            bytes[at..at + n].copy_from_slice(&word[..n]);
        }
        _ => bytes[at..end].fill(0),
    }
}
