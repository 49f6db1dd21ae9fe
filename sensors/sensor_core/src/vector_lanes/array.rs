//! Eight lanes as plain arrays, for any processor.

use super::lanes::Lanes;

/// Plain arrays.
#[derive(Clone, Copy)]
pub struct Array([f32; 8]);

#[inline(always)]
fn each(f: impl Fn(usize) -> f32) -> Array {
    Array(std::array::from_fn(f))
}

impl Lanes for Array {
    type Mask = [bool; 8];

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
    fn bits(mask: [bool; 8]) -> u32 {
        (0..8).fold(0, |bits, i| bits | (mask[i] as u32) << i)
    }
    #[inline(always)]
    fn prefetch<T>(_: &T) {}
}
