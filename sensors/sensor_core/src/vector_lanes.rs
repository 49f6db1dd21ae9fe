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

    /// The pairs at two places.
    #[inline(always)]
    fn two_pairs(memory: &[f32], a: u32, b: u32) -> __m128 {
        let pair = |place: u32| -> &[f32; 2] {
            let rest = memory.get(place as usize..).unwrap_or(&[]);
            rest.first_chunk().expect("a number behind each place")
        };
        let (a, b) = (pair(a).as_ptr(), pair(b).as_ptr());
        // SAFETY: each points to eight bytes; only methods of [`Avx`] call this, where AVX2 is.
        unsafe {
            let low = _mm_castpd_ps(_mm_load_sd(a.cast()));
            _mm_movelh_ps(low, _mm_castpd_ps(_mm_load_sd(b.cast())))
        }
    }

    /// First and second numbers of pairs, two in each of four.
    #[inline(always)]
    fn split(fours: [__m128; 4]) -> [Avx; 2] {
        // SAFETY: only methods of [`Avx`] call this, where AVX2 is.
        unsafe {
            let near = _mm256_set_m128(fours[2], fours[0]);
            let far = _mm256_set_m128(fours[3], fours[1]);
            [
                Avx(_mm256_shuffle_ps::<0b10_00_10_00>(near, far)),
                Avx(_mm256_shuffle_ps::<0b11_01_11_01>(near, far)),
            ]
        }
    }

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
        fn smallest(self) -> f32 {
            // SAFETY: see the head of this impl.
            unsafe {
                let four = _mm_min_ps(
                    _mm256_castps256_ps128(self.0),
                    _mm256_extractf128_ps::<1>(self.0),
                );
                let two = _mm_min_ps(four, _mm_movehl_ps(four, four));
                _mm_cvtss_f32(_mm_min_ss(two, _mm_movehdup_ps(two)))
            }
        }
        #[inline(always)]
        fn whole(self) -> Self {
            // SAFETY: see the head of this impl.
            Avx(unsafe { _mm256_cvtepi32_ps(_mm256_cvttps_epi32(self.0)) })
        }
        #[inline(always)]
        fn places(x: Self, y: Self, stride: u32) -> [u32; 8] {
            let mut out = [0; 8];
            // SAFETY: see the head of this impl.
            unsafe {
                let rows =
                    _mm256_mullo_epi32(_mm256_cvttps_epi32(y.0), _mm256_set1_epi32(stride as i32));
                let places = _mm256_add_epi32(rows, _mm256_cvttps_epi32(x.0));
                _mm256_storeu_si256(out.as_mut_ptr().cast(), places);
            }
            out
        }
        #[inline(always)]
        fn pairs(memory: &[f32], places: &[u32; 8]) -> [Self; 2] {
            split([
                two_pairs(memory, places[0], places[1]),
                two_pairs(memory, places[2], places[3]),
                two_pairs(memory, places[4], places[5]),
                two_pairs(memory, places[6], places[7]),
            ])
        }
        #[inline(always)]
        fn unzip(pairs: &[[f32; 2]; 8]) -> [Self; 2] {
            let numbers = pairs.as_ptr().cast::<f32>();
            // SAFETY: see the head of this impl; these are the sixteen numbers of the array.
            unsafe {
                split([
                    _mm_loadu_ps(numbers),
                    _mm_loadu_ps(numbers.add(4)),
                    _mm_loadu_ps(numbers.add(8)),
                    _mm_loadu_ps(numbers.add(12)),
                ])
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

    /// What reads memory, once, over numbers from 0 to 60.
    struct Reading<'a>(&'a [f32], [[f32; 2]; 8]);

    impl LaneWork for Reading<'_> {
        type Out = ([f32; 8], [u32; 8], [[f32; 8]; 4], [f32; 2]);

        #[inline(always)]
        fn run<L: Lanes>(self) -> Self::Out {
            let [x, y] = L::unzip(&self.1);
            let (x, y) = (x.whole(), y.whole());
            let places = L::places(x, y, 61);
            let [a, b] = L::pairs(self.0, &places);
            let rest = [a, b, x, y].map(L::store);
            (x.sub(y).store(), places, rest, [x.smallest(), y.largest()])
        }
    }

    #[test]
    fn memory_is_read_alike_and_at_the_right_places() {
        let mut rng = fastrand::Rng::with_seed(6);
        let memory: Vec<f32> = (0..61 * 61 + 1).map(|_| rng.f32()).collect();
        for _ in 0..200 {
            let at: [[f32; 2]; 8] = std::array::from_fn(|_| [rng.f32() * 60.9, rng.f32() * 60.9]);
            let found = in_lanes(Reading(&memory, at));
            assert_eq!(found, in_arrays(Reading(&memory, at)), "{at:?}");
            for (lane, [x, y]) in at.iter().enumerate() {
                let place = y.floor() as usize * 61 + x.floor() as usize;
                assert_eq!(found.1[lane] as usize, place);
                assert_eq!(found.2[0][lane], memory[place]);
                assert_eq!(found.2[1][lane], memory[place + 1]);
            }
            let smallest = at.iter().map(|[x, _]| x.floor()).fold(61.0, f32::min);
            let largest = at.iter().map(|[_, y]| y.floor()).fold(-1.0, f32::max);
            assert_eq!(found.3, [smallest, largest]);
        }
    }

    #[test]
    #[should_panic]
    fn memory_that_ends_is_not_read_beyond() {
        in_lanes(Reading(&[0.0; 100], [[39.5, 1.5]; 8]));
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
