//! Numbers in the bytes of words, and whole numbers.

use sensor_core::vector_lanes::{Lanes, WordLanes};

use crate::functions::saturate;

/// A word as often as there are lanes.
#[inline(always)]
pub fn word<L: Lanes>(x: u32) -> L::Words {
    <L::Words>::splat(x)
}

/// 0 or 1 where the mask is clear or set, as a number.
#[inline(always)]
pub fn number_of<L: Lanes>(mask: L::Mask) -> L {
    L::select(mask, L::splat(1.0), L::splat(0.0))
}

/// 0 or 1 where the mask is clear or set, as a word.
#[inline(always)]
pub fn word_of<L: Lanes>(mask: L::Mask) -> L::Words {
    <L::Words>::select(mask, word::<L>(1), word::<L>(0))
}

/// A number from 0 to 1 as a byte, so many bits up.
#[inline(always)]
fn unorm_at<L: Lanes>(x: L, bits: u32) -> L::Words {
    let scaled = saturate(x).mul(L::splat(255.0)).add(L::splat(0.5));
    scaled.to_signed().shl(word::<L>(bits))
}

/// Four numbers from 0 to 1 in the bytes of a word, the first in the lowest.
#[inline(always)]
pub fn pack_4x8_unorm<L: Lanes>(x: [L; 4]) -> L::Words {
    let low = unorm_at(x[0], 0).or(unorm_at(x[1], 8));
    let high = unorm_at(x[2], 16).or(unorm_at(x[3], 24));
    low.or(high)
}

/// A whole number of one byte over 255 or 127, correctly rounded without a division: `top` is the
/// upper part of one over it, whose product is exact, and `rest` is what it lacks. A product with the
/// rounded fraction would be another number for some bytes, and shaders compare bytes with constants.
#[inline(always)]
fn quotient<L: Lanes>(whole: L, top: f32, rest: f32) -> L {
    whole.mul(L::splat(top)).add(whole.mul(L::splat(rest)))
}

/// The byte so many bits up as a number from 0 to 1.
#[inline(always)]
fn unorm_of<L: Lanes>(x: L::Words, bits: u32) -> L {
    let byte = x.shr(word::<L>(bits)).and(word::<L>(255));
    let rest = (1.0 / 255.0 - 257.0 / 65536.0) as f32;
    quotient(byte.from_signed(), 257.0 / 65536.0, rest)
}

/// The bytes of a word as numbers from 0 to 1.
#[inline(always)]
pub fn unpack_4x8_unorm<L: Lanes>(x: L::Words) -> [L; 4] {
    [
        unorm_of::<L>(x, 0),
        unorm_of::<L>(x, 8),
        unorm_of::<L>(x, 16),
        unorm_of::<L>(x, 24),
    ]
}

/// The byte so many bits up as a number from −1 to 1.
#[inline(always)]
fn snorm_of<L: Lanes>(x: L::Words, bits: u32) -> L {
    let byte = x.shl(word::<L>(24 - bits)).shr_signed(word::<L>(24));
    let rest = (1.0 / 127.0 - 129.0 / 16384.0) as f32;
    quotient(byte.from_signed(), 129.0 / 16384.0, rest).max(L::splat(-1.0))
}

/// The bytes of a word as numbers from −1 to 1.
#[inline(always)]
pub fn unpack_4x8_snorm<L: Lanes>(x: L::Words) -> [L; 4] {
    [
        snorm_of::<L>(x, 0),
        snorm_of::<L>(x, 8),
        snorm_of::<L>(x, 16),
        snorm_of::<L>(x, 24),
    ]
}

/// The number of the lowest bit that is set; all bits if there is none.
#[inline(always)]
pub fn first_trailing_bit<L: Lanes>(x: L::Words) -> L::Words {
    let lowest = x.and(word::<L>(0).sub(x));
    // A power of 2 is exact as a number, and its exponent is the bit.
    let bits = lowest.from_unsigned().to_words();
    let number = bits.shr(word::<L>(23)).sub(word::<L>(127));
    <L::Words>::select(x.eq(word::<L>(0)), word::<L>(u32::MAX), number)
}

/// Unsigned quotient; by 0 it is the dividend, as WGSL has it.
#[inline(always)]
pub fn divided<L: Lanes>(a: L::Words, b: L::Words) -> L::Words {
    let (a, b) = (a.store(), b.store());
    <L::Words>::load(&std::array::from_fn(|i| {
        a[i].checked_div(b[i]).unwrap_or(a[i])
    }))
}

/// What an unsigned quotient leaves; by 0 it is 0, as WGSL has it.
#[inline(always)]
pub fn remainder<L: Lanes>(a: L::Words, b: L::Words) -> L::Words {
    let (a, b) = (a.store(), b.store());
    <L::Words>::load(&std::array::from_fn(|i| {
        a[i].checked_rem(b[i]).unwrap_or(0)
    }))
}

#[cfg(test)]
mod tests {
    use sensor_core::vector_lanes::{LaneWork, in_arrays, in_lanes};

    use super::*;

    struct Packed([[f32; 8]; 4], [u32; 8], [u32; 8]);

    type Results = ([[u32; 8]; 6], [[[f32; 8]; 4]; 2]);

    impl LaneWork for Packed {
        type Out = Results;

        #[inline(always)]
        fn run<L: Lanes>(self) -> Self::Out {
            let (a, b) = (<L::Words>::load(&self.1), <L::Words>::load(&self.2));
            let words = [
                pack_4x8_unorm::<L>(self.0.map(|x| L::load(&x))),
                first_trailing_bit::<L>(a),
                divided::<L>(a, b),
                remainder::<L>(a, b),
                word_of::<L>(a.eq(b)),
                number_of::<L>(a.eq(b)).to_words(),
            ];
            let numbers = [unpack_4x8_unorm::<L>(a), unpack_4x8_snorm::<L>(a)];
            (
                words.map(WordLanes::store),
                numbers.map(|x| x.map(L::store)),
            )
        }
    }

    #[test]
    fn packing_is_that_of_the_wgsl_specification() {
        let mut rng = fastrand::Rng::with_seed(9);
        for _ in 0..5000 {
            let numbers: [[f32; 8]; 4] =
                std::array::from_fn(|_| std::array::from_fn(|_| rng.f32() * 1.4 - 0.2));
            let mut words = || {
                std::array::from_fn::<u32, 8, _>(|_| match rng.u8(0..4) {
                    0 => rng.u32(0..3),
                    1 => 1 << rng.u32(0..32),
                    _ => rng.u32(..),
                })
            };
            let (a, b) = (words(), words());
            let found = in_lanes(Packed(numbers, a, b));
            assert_eq!(found, in_arrays(Packed(numbers, a, b)));
            for i in 0..8 {
                let bytes = numbers.map(|x| (0.5 + 255.0 * x[i].clamp(0.0, 1.0)).floor() as u8);
                let expected = [
                    u32::from_le_bytes(bytes),
                    if a[i] == 0 {
                        u32::MAX
                    } else {
                        a[i].trailing_zeros()
                    },
                    a[i].checked_div(b[i]).unwrap_or(a[i]),
                    if b[i] == 0 { 0 } else { a[i] % b[i] },
                    (a[i] == b[i]) as u32,
                    if a[i] == b[i] { 1f32.to_bits() } else { 0 },
                ];
                assert_eq!(found.0.map(|x| x[i]), expected, "{a:?} {b:?}");
                for (byte, value) in a[i].to_le_bytes().into_iter().enumerate() {
                    let [unsigned, signed] = found.1.map(|x| x[byte][i]);
                    assert_eq!(unsigned, value as f32 / 255.0);
                    assert_eq!(signed, (value as i8 as f32 / 127.0).max(-1.0));
                }
            }
        }
    }
}
