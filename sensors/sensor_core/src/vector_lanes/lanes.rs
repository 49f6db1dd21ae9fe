//! What can be done with eight numbers at a time.

/// Eight numbers.
pub trait Lanes: Copy {
    /// Eight booleans.
    type Mask: Copy;

    /// The same number eight times.
    fn splat(x: f32) -> Self;
    /// From an array.
    fn load(x: &[f32; 8]) -> Self;
    /// To an array.
    fn store(self) -> [f32; 8];
    /// Sum.
    fn add(self, other: Self) -> Self;
    /// Difference.
    fn sub(self, other: Self) -> Self;
    /// Product.
    fn mul(self, other: Self) -> Self;
    /// Quotient.
    fn div(self, other: Self) -> Self;
    /// `if self < other { self } else { other }`.
    fn min(self, other: Self) -> Self;
    /// `if self > other { self } else { other }`.
    fn max(self, other: Self) -> Self;
    /// The largest of the eight, none of which is NaN.
    fn largest(self) -> f32;
    /// The smallest of the eight, none of which is NaN.
    fn smallest(self) -> f32;
    /// Integer parts of numbers from 0 to 2²²; other numbers give some numbers.
    fn whole(self) -> Self;
    /// `y · stride + x` of whole numbers from 0 to 2²²; other numbers give some integers.
    fn places(x: Self, y: Self, stride: u32) -> [u32; 8];
    /// Numbers at these places of `memory`, and the numbers behind them.
    ///
    /// # Panics
    /// If a place is that of the last number or beyond it.
    fn pairs(memory: &[f32], places: &[u32; 8]) -> [Self; 2];
    /// The first and the second numbers of eight pairs.
    fn unzip(pairs: &[[f32; 2]; 8]) -> [Self; 2];
    /// Where `self ≤ other`; false for NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// Where `self < other`; false for NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// `a` where the mask is set, else `b`. Bits are kept, whatever they mean.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;
    /// Where both masks are set.
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Where either mask is set.
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Lane `i` as bit `i`.
    fn bits(mask: Self::Mask) -> u32;
    /// Prefetches something that is read soon.
    fn prefetch<T>(x: &T);
}

/// Work over eight lanes. Mark `run` and everything it calls `#[inline(always)]`: a function that
/// is not inlined is compiled without AVX2.
pub trait LaneWork {
    /// Its result.
    type Out;

    /// Does the work.
    fn run<L: Lanes>(self) -> Self::Out;
}
