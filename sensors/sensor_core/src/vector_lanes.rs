//! Arithmetic on eight `f32`, and on eight words of 32 bits, at a time. Code is written once over [`Lanes`] and runs with AVX2
//! where the processor has it, elsewhere with plain arrays.
//!
//! Every operation is exactly IEEE's and none is fused, so that both give the same bits.

mod array;
#[cfg(target_arch = "x86_64")]
mod avx2;
mod lanes;

use array::Array;

pub use lanes::{LaneWork, Lanes, WordLanes};

/// Does `work` with the widest vectors that this processor has.
#[inline]
pub fn in_lanes<W: LaneWork>(work: W) -> W::Out {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        return avx2::run(work);
    }
    work.run::<Array>()
}

/// Does `work` with plain arrays, on any processor: the reference in tests.
pub fn in_arrays<W: LaneWork>(work: W) -> W::Out {
    work.run::<Array>()
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
                a.eq(b),
                L::not(a.eq(b)),
                L::mask(true),
                L::mask(false),
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
                a.neg(),
                a.abs(),
                a.floor(),
                a.abs().sqrt(),
            ];
            let bits = |x: L| {
                x.store()
                    .map(|x| if x.is_nan() { 0x7fc0_0000 } else { x.to_bits() })
            };
            let words = [a.to_signed(), a.to_unsigned(), a.abs().to_words()];
            let words = words.map(WordLanes::store);
            let sums = [sums.map(bits).to_vec(), words.to_vec()].concat();
            (sums, masks.map(L::bits).to_vec())
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

    /// Every operation on words once.
    struct EveryWord<'a>(&'a [u32; 8], &'a [u32; 8], &'a [u32]);

    impl LaneWork for EveryWord<'_> {
        type Out = (Vec<[u32; 8]>, Vec<u32>);

        #[inline(always)]
        fn run<L: Lanes>(self) -> Self::Out {
            let (a, b) = (<L::Words>::load(self.0), <L::Words>::load(self.1));
            let masks = [a.eq(b), a.lt_unsigned(b), a.lt_signed(b)];
            let words = [
                <L::Words>::splat(77),
                <L::Words>::splat(a.first()),
                a.add(b),
                a.sub(b),
                a.mul(b),
                a.and(b),
                a.or(b),
                a.xor(b),
                a.shl(b),
                a.shr(b),
                a.shr_signed(b),
                a.min_unsigned(b),
                a.max_unsigned(b),
                a.min_signed(b),
                a.max_signed(b),
                <L::Words>::select(masks[1], a, b),
                a.from_signed().to_words(),
                a.from_unsigned().to_words(),
                a.to_numbers().to_words(),
                <L::Words>::gather(self.2, a),
                <L::Words>::gather(&[], a),
            ];
            let words = words.map(WordLanes::store);
            (words.to_vec(), masks.map(L::bits).to_vec())
        }
    }

    /// Oracle: the same in Rust's own integers.
    fn words_expected(a: &[u32; 8], b: &[u32; 8], memory: &[u32]) -> (Vec<[u32; 8]>, Vec<u32>) {
        let each = |f: &dyn Fn(u32, u32) -> u32| std::array::from_fn(|i| f(a[i], b[i]));
        let mask = |f: &dyn Fn(u32, u32) -> bool| {
            (0..8).fold(0, |bits, i| bits | (f(a[i], b[i]) as u32) << i)
        };
        let words = vec![
            [77; 8],
            [a[0]; 8],
            each(&|a, b| (a as u64 + b as u64) as u32),
            each(&|a, b| (a as i64 - b as i64) as u32),
            each(&|a, b| (a as u64 * b as u64) as u32),
            each(&|a, b| a & b),
            each(&|a, b| a | b),
            each(&|a, b| a ^ b),
            each(&|a, b| ((a as u64) << (b % 32)) as u32),
            each(&|a, b| a >> (b % 32)),
            each(&|a, b| ((a as i32 as i64) >> (b % 32)) as u32),
            each(&|a, b| a.min(b)),
            each(&|a, b| a.max(b)),
            each(&|a, b| (a as i32).min(b as i32) as u32),
            each(&|a, b| (a as i32).max(b as i32) as u32),
            each(&|a, b| a.min(b)),
            // A number of 64 bits holds the word exactly and is rounded once.
            each(&|a, _| (a as i32 as f64 as f32).to_bits()),
            each(&|a, _| (a as f64 as f32).to_bits()),
            *a,
            each(&|a, _| memory[(a as usize).min(memory.len() - 1)]),
            [0; 8],
        ];
        let masks = vec![
            mask(&|a, b| a == b),
            mask(&|a, b| a < b),
            mask(&|a, b| (a as i32) < b as i32),
        ];
        (words, masks)
    }

    #[test]
    fn words_are_those_of_plain_integers() {
        let mut rng = fastrand::Rng::with_seed(7);
        let memory: Vec<u32> = (0..100).map(|_| rng.u32(..)).collect();
        let special = [0, 1, 31, 32, 99, 100, 1 << 31, (1 << 31) - 1, u32::MAX];
        for _ in 0..2000 {
            let mut words = || {
                std::array::from_fn(|_| match rng.u8(0..3) {
                    0 => special[rng.usize(0..special.len())],
                    1 => rng.u32(0..120),
                    _ => rng.u32(..),
                })
            };
            let (a, b) = (words(), words());
            let expected = words_expected(&a, &b, &memory);
            assert_eq!(
                in_lanes(EveryWord(&a, &b, &memory)),
                expected,
                "{a:?} {b:?}"
            );
            assert_eq!(
                in_arrays(EveryWord(&a, &b, &memory)),
                expected,
                "{a:?} {b:?}"
            );
        }
    }

    #[test]
    fn numbers_become_the_nearest_words() {
        struct Whole([f32; 8]);
        impl LaneWork for Whole {
            type Out = [[u32; 8]; 2];
            #[inline(always)]
            fn run<L: Lanes>(self) -> Self::Out {
                let x = L::load(&self.0);
                [x.to_signed().store(), x.to_unsigned().store()]
            }
        }
        let numbers = [
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            -1.9,
            2147483648.0,
            4294967040.0,
            4294967296.0,
            -3e9,
        ];
        let (most, least) = (i32::MAX as u32, i32::MIN as u32);
        let signed = [0, most, least, -1i32 as u32, most, most, most, least];
        let unsigned = [0, u32::MAX, 0, 0, 1 << 31, 4294967040, u32::MAX, 0];
        assert_eq!(in_lanes(Whole(numbers)), [signed, unsigned]);
        assert_eq!(in_arrays(Whole(numbers)), [signed, unsigned]);
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
