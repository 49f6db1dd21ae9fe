//! Eight lanes as plain arrays, for any processor.

use super::lanes::{Lanes, WordLanes};

/// Plain arrays.
#[derive(Clone, Copy)]
pub struct Array([f32; 8]);

/// Plain arrays of words.
#[derive(Clone, Copy)]
pub struct Words([u32; 8]);

#[inline(always)]
fn each(f: impl Fn(usize) -> f32) -> Array {
    Array(std::array::from_fn(f))
}

impl Lanes for Array {
    type Mask = [bool; 8];
    type Words = Words;

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Array([x; 8])
    }
    #[inline(always)]
    fn load(x: &[f32; 8]) -> Self {
        Array(*x)
    }
    #[inline(always)]
    fn store(self) -> [f32; 8] {
        self.0
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        each(|i| self.0[i] + other.0[i])
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        each(|i| self.0[i] - other.0[i])
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        each(|i| self.0[i] * other.0[i])
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        each(|i| self.0[i] / other.0[i])
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        each(|i| {
            if self.0[i] < other.0[i] {
                self.0[i]
            } else {
                other.0[i]
            }
        })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        each(|i| {
            if self.0[i] > other.0[i] {
                self.0[i]
            } else {
                other.0[i]
            }
        })
    }
    #[inline(always)]
    fn largest(self) -> f32 {
        self.0
            .iter()
            .fold(f32::NEG_INFINITY, |a, b| if a > *b { a } else { *b })
    }
    #[inline(always)]
    fn smallest(self) -> f32 {
        self.0
            .iter()
            .fold(f32::INFINITY, |a, b| if a < *b { a } else { *b })
    }
    #[inline(always)]
    fn whole(self) -> Self {
        each(|i| (self.0[i] as i32) as f32)
    }
    #[inline(always)]
    fn places(x: Self, y: Self, stride: u32) -> [u32; 8] {
        let whole = |x: f32| x as i32 as u32;
        std::array::from_fn(|i| {
            whole(y.0[i])
                .wrapping_mul(stride)
                .wrapping_add(whole(x.0[i]))
        })
    }
    #[inline(always)]
    fn pairs(memory: &[f32], places: &[u32; 8]) -> [Self; 2] {
        let pairs = places.map(|at| [memory[at as usize], memory[at as usize + 1]]);
        Self::unzip(&pairs)
    }
    #[inline(always)]
    fn unzip(pairs: &[[f32; 2]; 8]) -> [Self; 2] {
        [each(|i| pairs[i][0]), each(|i| pairs[i][1])]
    }
    #[inline(always)]
    fn le(self, other: Self) -> [bool; 8] {
        std::array::from_fn(|i| self.0[i] <= other.0[i])
    }
    #[inline(always)]
    fn lt(self, other: Self) -> [bool; 8] {
        std::array::from_fn(|i| self.0[i] < other.0[i])
    }
    #[inline(always)]
    fn select(mask: [bool; 8], a: Self, b: Self) -> Self {
        each(|i| if mask[i] { a.0[i] } else { b.0[i] })
    }
    #[inline(always)]
    fn and(a: [bool; 8], b: [bool; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] & b[i])
    }
    #[inline(always)]
    fn or(a: [bool; 8], b: [bool; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] | b[i])
    }
    #[inline(always)]
    fn mask(value: bool) -> [bool; 8] {
        [value; 8]
    }
    #[inline(always)]
    fn not(mask: [bool; 8]) -> [bool; 8] {
        mask.map(|lane| !lane)
    }
    #[inline(always)]
    fn eq(self, other: Self) -> [bool; 8] {
        std::array::from_fn(|i| self.0[i] == other.0[i])
    }
    #[inline(always)]
    fn neg(self) -> Self {
        each(|i| f32::from_bits(self.0[i].to_bits() ^ 0x8000_0000))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        each(|i| f32::from_bits(self.0[i].to_bits() & 0x7fff_ffff))
    }
    #[inline(always)]
    fn floor(self) -> Self {
        each(|i| self.0[i].floor())
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        each(|i| self.0[i].sqrt())
    }
    #[inline(always)]
    fn to_words(self) -> Words {
        Words(self.0.map(f32::to_bits))
    }
    #[inline(always)]
    fn to_signed(self) -> Words {
        Words(self.0.map(|x| x as i32 as u32))
    }
    #[inline(always)]
    fn to_unsigned(self) -> Words {
        Words(self.0.map(|x| x as u32))
    }
    #[inline(always)]
    fn bits(mask: [bool; 8]) -> u32 {
        (0..8).fold(0, |bits, i| bits | (mask[i] as u32) << i)
    }
    #[inline(always)]
    fn prefetch<T>(_: &T) {}
}

#[inline(always)]
fn both(a: Words, b: Words, f: impl Fn(u32, u32) -> u32) -> Words {
    Words(std::array::from_fn(|i| f(a.0[i], b.0[i])))
}

impl WordLanes for Words {
    type Numbers = Array;
    type Mask = [bool; 8];

    #[inline(always)]
    fn splat(x: u32) -> Self {
        Words([x; 8])
    }
    #[inline(always)]
    fn load(x: &[u32; 8]) -> Self {
        Words(*x)
    }
    #[inline(always)]
    fn store(self) -> [u32; 8] {
        self.0
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        both(self, other, |a, b| a.wrapping_add(b))
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        both(self, other, |a, b| a.wrapping_sub(b))
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        both(self, other, |a, b| a.wrapping_mul(b))
    }
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        both(self, other, |a, b| a & b)
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        both(self, other, |a, b| a | b)
    }
    #[inline(always)]
    fn xor(self, other: Self) -> Self {
        both(self, other, |a, b| a ^ b)
    }
    #[inline(always)]
    fn shl(self, other: Self) -> Self {
        both(self, other, |a, b| a << (b & 31))
    }
    #[inline(always)]
    fn shr(self, other: Self) -> Self {
        both(self, other, |a, b| a >> (b & 31))
    }
    #[inline(always)]
    fn shr_signed(self, other: Self) -> Self {
        both(self, other, |a, b| ((a as i32) >> (b & 31)) as u32)
    }
    #[inline(always)]
    fn min_unsigned(self, other: Self) -> Self {
        both(self, other, |a, b| a.min(b))
    }
    #[inline(always)]
    fn max_unsigned(self, other: Self) -> Self {
        both(self, other, |a, b| a.max(b))
    }
    #[inline(always)]
    fn min_signed(self, other: Self) -> Self {
        both(self, other, |a, b| (a as i32).min(b as i32) as u32)
    }
    #[inline(always)]
    fn max_signed(self, other: Self) -> Self {
        both(self, other, |a, b| (a as i32).max(b as i32) as u32)
    }
    #[inline(always)]
    fn eq(self, other: Self) -> [bool; 8] {
        std::array::from_fn(|i| {
            let (a, b) = (self.0[i], other.0[i]);
            a == b
        })
    }
    #[inline(always)]
    fn lt_unsigned(self, other: Self) -> [bool; 8] {
        std::array::from_fn(|i| {
            let (a, b) = (self.0[i], other.0[i]);
            a < b
        })
    }
    #[inline(always)]
    fn lt_signed(self, other: Self) -> [bool; 8] {
        std::array::from_fn(|i| {
            let (a, b) = (self.0[i], other.0[i]);
            (a as i32) < b as i32
        })
    }
    #[inline(always)]
    fn select(mask: [bool; 8], a: Self, b: Self) -> Self {
        Words(std::array::from_fn(
            |i| if mask[i] { a.0[i] } else { b.0[i] },
        ))
    }
    #[inline(always)]
    fn to_numbers(self) -> Array {
        Array(self.0.map(f32::from_bits))
    }
    #[inline(always)]
    fn from_signed(self) -> Array {
        Array(self.0.map(|x| x as i32 as f32))
    }
    #[inline(always)]
    fn from_unsigned(self) -> Array {
        Array(self.0.map(|x| x as f32))
    }
    #[inline(always)]
    fn first(self) -> u32 {
        self.0[0]
    }
    #[inline(always)]
    fn gather(memory: &[u32], places: Self) -> Self {
        assert!(memory.len() < 1 << 31, "too many words: {}", memory.len());
        let Some(last) = memory.len().checked_sub(1) else {
            return Words([0; 8]);
        };
        Words(places.0.map(|at| memory[last.min(at as usize)]))
    }
}
