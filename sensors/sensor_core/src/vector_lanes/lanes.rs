//! What can be done with eight numbers at a time.

/// Eight numbers.
pub trait Lanes: Copy {
    /// Eight booleans.
    type Mask: Copy;
    /// Eight words of 32 bits.
    type Words: WordLanes<Numbers = Self, Mask = Self::Mask>;

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
    /// The mask with this boolean in every lane.
    fn mask(value: bool) -> Self::Mask;
    /// Where the mask is not set.
    fn not(mask: Self::Mask) -> Self::Mask;
    /// Lane `i` as bit `i`.
    fn bits(mask: Self::Mask) -> u32;
    /// Whether any lane of the mask is set.
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        Self::bits(mask) != 0
    }
    /// Where `self = other`; false for NaN.
    fn eq(self, other: Self) -> Self::Mask;
    /// With the other sign.
    fn neg(self) -> Self;
    /// Without sign.
    fn abs(self) -> Self;
    /// The largest whole number that is not larger.
    fn floor(self) -> Self;
    /// The root, correctly rounded.
    fn sqrt(self) -> Self;
    /// The bits of the numbers.
    fn to_words(self) -> Self::Words;
    /// Integer parts as signed words. Beyond their range the nearest one, and 0 for NaN.
    fn to_signed(self) -> Self::Words;
    /// Integer parts as unsigned words. Beyond their range the nearest one, and 0 for NaN.
    fn to_unsigned(self) -> Self::Words;
    /// Prefetches something that is read soon.
    fn prefetch<T>(x: &T);
}

/// Eight words of 32 bits. Sums, differences and products wrap around.
pub trait WordLanes: Copy {
    /// Eight numbers.
    type Numbers: Copy;
    /// Eight booleans.
    type Mask: Copy;

    /// The same word eight times.
    fn splat(x: u32) -> Self;
    /// From an array.
    fn load(x: &[u32; 8]) -> Self;
    /// To an array.
    fn store(self) -> [u32; 8];
    /// Sum.
    fn add(self, other: Self) -> Self;
    /// Difference.
    fn sub(self, other: Self) -> Self;
    /// Product.
    fn mul(self, other: Self) -> Self;
    /// Bits that are set in both.
    fn and(self, other: Self) -> Self;
    /// Bits that are set in either.
    fn or(self, other: Self) -> Self;
    /// Bits that differ.
    fn xor(self, other: Self) -> Self;
    /// Moves bits up by the number in the lowest five bits of `by`.
    fn shl(self, by: Self) -> Self;
    /// Moves bits down by the number in the lowest five bits of `by`; zeros follow.
    fn shr(self, by: Self) -> Self;
    /// Moves bits down by the number in the lowest five bits of `by`; the sign follows.
    fn shr_signed(self, by: Self) -> Self;
    /// The smaller of two unsigned words.
    fn min_unsigned(self, other: Self) -> Self;
    /// The larger of two unsigned words.
    fn max_unsigned(self, other: Self) -> Self;
    /// The smaller of two signed words.
    fn min_signed(self, other: Self) -> Self;
    /// The larger of two signed words.
    fn max_signed(self, other: Self) -> Self;
    /// Where both are the same.
    fn eq(self, other: Self) -> Self::Mask;
    /// Where `self < other` as unsigned words.
    fn lt_unsigned(self, other: Self) -> Self::Mask;
    /// Where `self < other` as signed words.
    fn lt_signed(self, other: Self) -> Self::Mask;
    /// `a` where the mask is set, else `b`.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;
    /// The numbers that have these bits.
    fn to_numbers(self) -> Self::Numbers;
    /// Signed words as the nearest numbers.
    #[expect(
        clippy::wrong_self_convention,
        reason = "the words are what is converted"
    )]
    fn from_signed(self) -> Self::Numbers;
    /// Unsigned words as the nearest numbers.
    #[expect(
        clippy::wrong_self_convention,
        reason = "the words are what is converted"
    )]
    fn from_unsigned(self) -> Self::Numbers;
    /// The word of the first lane.
    fn first(self) -> u32;
    /// The words of `memory` at these places. A place beyond is that of the last word; of empty
    /// memory every word is 0.
    ///
    /// # Panics
    /// If there are more than 2³¹ − 1 words.
    fn gather(memory: &[u32], places: Self) -> Self;
}

/// Work over eight lanes. Mark `run` and everything it calls `#[inline(always)]`: a function that
/// is not inlined is compiled without AVX2.
pub trait LaneWork {
    /// Its result.
    type Out;

    /// Does the work.
    fn run<L: Lanes>(self) -> Self::Out;
}
