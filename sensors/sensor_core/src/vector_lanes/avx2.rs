//! Eight lanes as vectors of AVX2.

#![expect(
    unsafe_code,
    reason = "vector instructions, asked for before they are used"
)]

use std::arch::x86_64::*;

use super::lanes::{LaneWork, Lanes, WordLanes};

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

/// Words of [`Avx`], under the same rule.
#[derive(Clone, Copy)]
struct AvxWords(__m256i);

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
    type Words = AvxWords;

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
    fn mask(value: bool) -> Avx {
        // SAFETY: see the head of this impl.
        Avx(unsafe { _mm256_castsi256_ps(_mm256_set1_epi32(-(value as i32))) })
    }
    #[inline(always)]
    fn not(mask: Avx) -> Avx {
        // SAFETY: see the head of this impl.
        Avx(unsafe { _mm256_xor_ps(mask.0, _mm256_castsi256_ps(_mm256_set1_epi32(-1))) })
    }
    #[inline(always)]
    fn eq(self, other: Self) -> Avx {
        // SAFETY: see the head of this impl.
        Avx(unsafe { _mm256_cmp_ps::<_CMP_EQ_OQ>(self.0, other.0) })
    }
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: see the head of this impl.
        Avx(unsafe { _mm256_xor_ps(self.0, _mm256_set1_ps(-0.0)) })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: see the head of this impl.
        Avx(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
    }
    #[inline(always)]
    fn floor(self) -> Self {
        // SAFETY: see the head of this impl.
        Avx(unsafe { _mm256_floor_ps(self.0) })
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: see the head of this impl.
        Avx(unsafe { _mm256_sqrt_ps(self.0) })
    }
    #[inline(always)]
    fn to_words(self) -> AvxWords {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe { _mm256_castps_si256(self.0) })
    }
    #[inline(always)]
    fn to_signed(self) -> AvxWords {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe {
            // The instruction gives the least word for everything beyond; inverted it is the
            // greatest.
            let whole = _mm256_cvttps_epi32(self.0);
            let beyond = _mm256_cmp_ps::<_CMP_GE_OQ>(self.0, _mm256_set1_ps(2147483648.0));
            let is_number = _mm256_cmp_ps::<_CMP_ORD_Q>(self.0, self.0);
            let within = _mm256_xor_si256(whole, _mm256_castps_si256(beyond));
            _mm256_and_si256(within, _mm256_castps_si256(is_number))
        })
    }
    #[inline(always)]
    fn to_unsigned(self) -> AvxWords {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe {
            // The second operand is taken for NaN.
            let positive = _mm256_max_ps(self.0, _mm256_setzero_ps());
            let half = _mm256_set1_ps(2147483648.0);
            let is_high = _mm256_cmp_ps::<_CMP_GE_OQ>(positive, half);
            let rest = _mm256_sub_ps(positive, _mm256_and_ps(is_high, half));
            let high = _mm256_and_si256(_mm256_castps_si256(is_high), _mm256_set1_epi32(i32::MIN));
            // Words of `rest` are below 2³¹ except where the number is beyond all.
            let beyond = _mm256_cmp_ps::<_CMP_GE_OQ>(positive, _mm256_set1_ps(4294967296.0));
            let word = _mm256_add_epi32(_mm256_cvttps_epi32(rest), high);
            _mm256_or_si256(word, _mm256_castps_si256(beyond))
        })
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

/// SAFETY of every block: AVX2 is there (see [`Avx`]); loads and stores go to whole arrays, at any
/// alignment.
impl WordLanes for AvxWords {
    type Numbers = Avx;
    type Mask = Avx;

    #[inline(always)]
    fn splat(x: u32) -> Self {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe { _mm256_set1_epi32(x as i32) })
    }
    #[inline(always)]
    fn load(x: &[u32; 8]) -> Self {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe { _mm256_loadu_si256(x.as_ptr().cast()) })
    }
    #[inline(always)]
    fn store(self) -> [u32; 8] {
        let mut out = [0; 8];
        // SAFETY: see the head of this impl.
        unsafe { _mm256_storeu_si256(out.as_mut_ptr().cast(), self.0) };
        out
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe { _mm256_add_epi32(self.0, other.0) })
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe { _mm256_sub_epi32(self.0, other.0) })
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe { _mm256_mullo_epi32(self.0, other.0) })
    }
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe { _mm256_and_si256(self.0, other.0) })
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe { _mm256_or_si256(self.0, other.0) })
    }
    #[inline(always)]
    fn xor(self, other: Self) -> Self {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe { _mm256_xor_si256(self.0, other.0) })
    }
    #[inline(always)]
    fn min_unsigned(self, other: Self) -> Self {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe { _mm256_min_epu32(self.0, other.0) })
    }
    #[inline(always)]
    fn max_unsigned(self, other: Self) -> Self {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe { _mm256_max_epu32(self.0, other.0) })
    }
    #[inline(always)]
    fn min_signed(self, other: Self) -> Self {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe { _mm256_min_epi32(self.0, other.0) })
    }
    #[inline(always)]
    fn max_signed(self, other: Self) -> Self {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe { _mm256_max_epi32(self.0, other.0) })
    }
    #[inline(always)]
    fn shl(self, by: Self) -> Self {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe {
            _mm256_sllv_epi32(self.0, _mm256_and_si256(by.0, _mm256_set1_epi32(31)))
        })
    }
    #[inline(always)]
    fn shr(self, by: Self) -> Self {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe {
            _mm256_srlv_epi32(self.0, _mm256_and_si256(by.0, _mm256_set1_epi32(31)))
        })
    }
    #[inline(always)]
    fn shr_signed(self, by: Self) -> Self {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe {
            _mm256_srav_epi32(self.0, _mm256_and_si256(by.0, _mm256_set1_epi32(31)))
        })
    }
    #[inline(always)]
    fn eq(self, other: Self) -> Avx {
        // SAFETY: see the head of this impl.
        Avx(unsafe { _mm256_castsi256_ps(_mm256_cmpeq_epi32(self.0, other.0)) })
    }
    #[inline(always)]
    fn lt_unsigned(self, other: Self) -> Avx {
        let low = Self::splat(1 << 31);
        self.xor(low).lt_signed(other.xor(low))
    }
    #[inline(always)]
    fn lt_signed(self, other: Self) -> Avx {
        // SAFETY: see the head of this impl.
        Avx(unsafe { _mm256_castsi256_ps(_mm256_cmpgt_epi32(other.0, self.0)) })
    }
    #[inline(always)]
    fn select(mask: Avx, a: Self, b: Self) -> Self {
        // SAFETY: see the head of this impl.
        AvxWords(unsafe {
            let (a, b) = (_mm256_castsi256_ps(a.0), _mm256_castsi256_ps(b.0));
            _mm256_castps_si256(_mm256_blendv_ps(b, a, mask.0))
        })
    }
    #[inline(always)]
    fn to_numbers(self) -> Avx {
        // SAFETY: see the head of this impl.
        Avx(unsafe { _mm256_castsi256_ps(self.0) })
    }
    #[inline(always)]
    fn from_signed(self) -> Avx {
        // SAFETY: see the head of this impl.
        Avx(unsafe { _mm256_cvtepi32_ps(self.0) })
    }
    #[inline(always)]
    fn from_unsigned(self) -> Avx {
        // SAFETY: see the head of this impl.
        Avx(unsafe {
            // Both halves are exact, so only their sum rounds.
            let high = _mm256_cvtepi32_ps(_mm256_srli_epi32::<16>(self.0));
            let low = _mm256_cvtepi32_ps(_mm256_and_si256(self.0, _mm256_set1_epi32(0xffff)));
            _mm256_add_ps(_mm256_mul_ps(high, _mm256_set1_ps(65536.0)), low)
        })
    }
    #[inline(always)]
    fn first(self) -> u32 {
        // SAFETY: see the head of this impl.
        unsafe { _mm_cvtsi128_si32(_mm256_castsi256_si128(self.0)) as u32 }
    }
    #[inline(always)]
    fn gather(memory: &[u32], places: Self) -> Self {
        assert!(memory.len() < 1 << 31, "too many words: {}", memory.len());
        let Some(last) = memory.len().checked_sub(1) else {
            return Self::splat(0);
        };
        let places = places.min_unsigned(Self::splat(last as u32));
        // SAFETY: see the head of this impl; every place is at most that of the last word, and so
        // no negative offset.
        AvxWords(unsafe { _mm256_i32gather_epi32::<4>(memory.as_ptr().cast(), places.0) })
    }
}
