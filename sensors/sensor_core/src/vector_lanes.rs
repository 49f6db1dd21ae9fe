//! Arithmetic on eight `f32` at a time. Code is written once over [`Lanes`] and runs with AVX2
//! where the processor has it, elsewhere with plain arrays.
//!
//! Every operation is exactly IEEE's and none is fused, so that both give the same bits.

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

/// Does `work` with the widest vectors that this processor has.
#[inline]
pub fn in_lanes<W: LaneWork>(work: W) -> W::Out {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        return x86::run(work);
    }
    work.run::<Array>()
}

/// Does `work` with plain arrays, on any processor: the reference in tests.
pub fn in_arrays<W: LaneWork>(work: W) -> W::Out {
    work.run::<Array>()
}

/// Plain arrays.
#[derive(Clone, Copy)]
struct Array([f32; 8]);

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

#[cfg(target_arch = "x86_64")]
#[expect(
    unsafe_code,
    reason = "vector instructions, asked for before they are used"
)]
mod x86 {
    use std::arch::x86_64::*;

    use super::{LaneWork, Lanes};

    /// Does `work` with AVX2, which the caller has found on this processor.
    #[inline]
    pub fn run<W: LaneWork>(work: W) -> W::Out {
        assert!(std::arch::is_x86_feature_detected!("avx2"));
        // SAFETY: AVX2 is there.
        unsafe { with_avx2(work) }
    }

    #[target_feature(enable = "avx2")]
    fn with_avx2<W: LaneWork>(work: W) -> W::Out {
        work.run::<Avx>()
    }

    /// Only [`with_avx2`] names this type, so its methods run where AVX2 is.
    #[derive(Clone, Copy)]
    struct Avx(__m256);

    /// SAFETY of every block: AVX2 is there (see [`Avx`]); loads and stores go to whole arrays, at
    /// any alignment.
    impl Lanes for Avx {
        type Mask = Avx;

        #[inline(always)]
        fn splat(x: f32) -> Self {
            // SAFETY: see the head of this impl.
            Avx(unsafe { _mm256_set1_ps(x) })
        }
        #[inline(always)]
        fn load(x: &[f32; 8]) -> Self {
            // SAFETY: see the head of this impl.
            Avx(unsafe { _mm256_loadu_ps(x.as_ptr()) })
        }
        #[inline(always)]
        fn store(self) -> [f32; 8] {
            let mut out = [0.0; 8];
            // SAFETY: see the head of this impl.
            unsafe { _mm256_storeu_ps(out.as_mut_ptr(), self.0) };
            out
        }
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            // SAFETY: see the head of this impl.
            Avx(unsafe { _mm256_add_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            // SAFETY: see the head of this impl.
            Avx(unsafe { _mm256_sub_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            // SAFETY: see the head of this impl.
            Avx(unsafe { _mm256_mul_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn div(self, other: Self) -> Self {
            // SAFETY: see the head of this impl.
            Avx(unsafe { _mm256_div_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            // SAFETY: see the head of this impl.
            Avx(unsafe { _mm256_min_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: see the head of this impl.
            Avx(unsafe { _mm256_max_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn largest(self) -> f32 {
            // SAFETY: see the head of this impl.
            unsafe {
                let four = _mm_max_ps(
                    _mm256_castps256_ps128(self.0),
                    _mm256_extractf128_ps::<1>(self.0),
                );
                let two = _mm_max_ps(four, _mm_movehl_ps(four, four));
                _mm_cvtss_f32(_mm_max_ss(two, _mm_movehdup_ps(two)))
            }
        }
        #[inline(always)]
        fn le(self, other: Self) -> Avx {
            // SAFETY: see the head of this impl.
            Avx(unsafe { _mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0) })
        }
        #[inline(always)]
        fn lt(self, other: Self) -> Avx {
            // SAFETY: see the head of this impl.
            Avx(unsafe { _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0) })
        }
        #[inline(always)]
        fn select(mask: Avx, a: Self, b: Self) -> Self {
            // SAFETY: see the head of this impl.
            Avx(unsafe { _mm256_blendv_ps(b.0, a.0, mask.0) })
        }
        #[inline(always)]
        fn and(a: Avx, b: Avx) -> Avx {
            // SAFETY: see the head of this impl.
            Avx(unsafe { _mm256_and_ps(a.0, b.0) })
        }
        #[inline(always)]
        fn or(a: Avx, b: Avx) -> Avx {
            // SAFETY: see the head of this impl.
            Avx(unsafe { _mm256_or_ps(a.0, b.0) })
        }
        #[inline(always)]
        fn bits(mask: Avx) -> u32 {
            // SAFETY: see the head of this impl.
            unsafe { _mm256_movemask_ps(mask.0) as u32 }
        }
        #[inline(always)]
        fn prefetch<T>(x: &T) {
            let first: *const T = x;
            for line in (0..size_of::<T>()).step_by(64) {
                // SAFETY: a hint, which reads nothing.
                unsafe { _mm_prefetch::<_MM_HINT_T0>(first.cast::<i8>().wrapping_add(line)) };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every operation once, over numbers that hold NaN, infinities, zeros of both signs and
    /// subnormals.
    struct Everything<'a>(&'a [f32; 8], &'a [f32; 8]);

    impl LaneWork for Everything<'_> {
        type Out = (Vec<[u32; 8]>, Vec<u32>);

        #[inline(always)]
        fn run<L: Lanes>(self) -> Self::Out {
            let (a, b) = (L::load(self.0), L::load(self.1));
            let masks = [
                a.le(b),
                a.lt(b),
                L::and(a.le(b), b.le(a)),
                L::or(a.lt(b), b.lt(a)),
            ];
            let sums = [
                a.add(b),
                a.sub(b),
                a.mul(b),
                a.div(b),
                a.min(b),
                a.max(b),
                L::splat(3.5),
                L::select(masks[0], a, b),
            ];
            let bits = |x: L| {
                x.store()
                    .map(|x| if x.is_nan() { 0x7fc0_0000 } else { x.to_bits() })
            };
            (sums.map(bits).to_vec(), masks.map(L::bits).to_vec())
        }
    }

    #[test]
    fn vectors_and_arrays_give_the_same_bits() {
        let mut rng = fastrand::Rng::with_seed(5);
        let special = [
            0.0,
            -0.0,
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            1e-42,
            -1e-42,
            f32::MAX,
        ];
        for _ in 0..2000 {
            let mut numbers = || {
                std::array::from_fn(|_| {
                    if rng.u8(0..4) == 0 {
                        special[rng.usize(0..8)]
                    } else {
                        (rng.f32() - 0.5) * 100.0
                    }
                })
            };
            let (a, b) = (numbers(), numbers());
            assert_eq!(
                in_lanes(Everything(&a, &b)),
                in_arrays(Everything(&a, &b)),
                "{a:?} {b:?}"
            );
        }
    }

    #[test]
    fn masks_say_which_lanes_and_the_largest_is_found_in_every_lane() {
        struct Below;
        impl LaneWork for Below {
            type Out = u32;
            #[inline(always)]
            fn run<L: Lanes>(self) -> u32 {
                L::bits(L::load(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]).lt(L::splat(2.5)))
            }
        }
        assert_eq!(in_lanes(Below), 0b111);
        struct Largest([f32; 8]);
        impl LaneWork for Largest {
            type Out = f32;
            #[inline(always)]
            fn run<L: Lanes>(self) -> f32 {
                L::load(&self.0).largest()
            }
        }
        for lane in 0..8 {
            let numbers = std::array::from_fn(|i| if i == lane { 3.0 } else { -(i as f32) });
            assert_eq!(
                (in_lanes(Largest(numbers)), in_arrays(Largest(numbers))),
                (3.0, 3.0)
            );
        }
    }
}
