//! Functions of WGSL that processors do not have, from sums, products, quotients and roots in one
//! fixed order, so that every processor gives the same bits. Their errors are those that the tests
//! below hold them to, against `f64`.

use sensor_core::vector_lanes::{Lanes, WordLanes};

/// The polynomial with these coefficients, the highest power first.
#[inline(always)]
fn polynomial<L: Lanes, const N: usize>(x: L, coefficients: [f32; N]) -> L {
    let mut sum = L::splat(coefficients[0]);
    let mut i = 1;
    while i < N {
        sum = sum.mul(x).add(L::splat(coefficients[i]));
        i += 1;
    }
    sum
}

/// From 0 to 1.
#[inline(always)]
pub fn saturate<L: Lanes>(x: L) -> L {
    x.max(L::splat(0.0)).min(L::splat(1.0))
}

/// What is above the whole number below.
#[inline(always)]
pub fn fract<L: Lanes>(x: L) -> L {
    x.sub(x.floor())
}

/// `a` where `t` is 0, `b` where it is 1.
#[inline(always)]
pub fn mix<L: Lanes>(a: L, b: L, t: L) -> L {
    a.mul(L::splat(1.0).sub(t)).add(b.mul(t))
}

/// From 0 at `low` to 1 at `high`, level at both.
#[inline(always)]
pub fn smoothstep<L: Lanes>(low: L, high: L, x: L) -> L {
    let t = saturate(x.sub(low).div(high.sub(low)));
    t.mul(t).mul(L::splat(3.0).sub(L::splat(2.0).mul(t)))
}

/// One over the root.
#[inline(always)]
pub fn inverse_sqrt<L: Lanes>(x: L) -> L {
    L::splat(1.0).div(x.sqrt())
}

/// 2 to this power, to 2e-7 of the result. Below 2⁻¹²⁶ the result is 0, or exact to a subnormal
/// number; from 2^127.5 on it is infinite.
#[inline(always)]
pub fn exp2<L: Lanes>(x: L) -> L {
    let x = x.max(L::splat(-127.0)).min(L::splat(128.0));
    let whole = x.add(L::splat(0.5)).floor();
    // Interpolated at Chebyshev's points of −0.5 to 0.5: 5e-9.
    let part = polynomial(
        x.sub(whole),
        [
            0.000_154_531_63,
            0.001_339_086_3,
            0.009_618_083,
            0.055_503_57,
            0.240_226_5,
            std::f32::consts::LN_2,
            1.0,
        ],
    );
    let exponent = whole.to_signed().add(<L::Words>::splat(127));
    part.mul(exponent.shl(<L::Words>::splat(23)).to_numbers())
}

/// e to this power, to 1e-7 · (3 + |x|) of the result.
#[inline(always)]
pub fn exp<L: Lanes>(x: L) -> L {
    exp2(x.mul(L::splat(std::f32::consts::LOG2_E)))
}

/// The power of 2 that this number is, to 1.5e-7 of the result, and to 1.5e-7 where that is below 1.
/// Numbers below 2⁻¹²⁶, negative ones too, give −126.
#[inline(always)]
pub fn log2<L: Lanes>(x: L) -> L {
    let bits = x
        .max(L::splat(f32::MIN_POSITIVE))
        .min(L::splat(f32::MAX))
        .to_words();
    // The exponent for which the rest lies between the root of a half and that of 2.
    let low = <L::Words>::splat(std::f32::consts::FRAC_1_SQRT_2.to_bits());
    let by = <L::Words>::splat(23);
    let exponent = bits.sub(low).shr_signed(by);
    let rest = bits.sub(exponent.shl(by)).to_numbers();
    let one = L::splat(1.0);
    let s = rest.sub(one).div(rest.add(one));
    // 2 / ln 2 · (s + s³ / 3 + s⁵ / 5 + …); s is at most 0.172.
    let series = polynomial(
        s.mul(s),
        [0.320_598_9, 0.412_198_6, 0.577_078, 0.961_796_7, 2.885_39],
    );
    exponent.from_signed().add(s.mul(series))
}

/// x to this power; x is at least 0, and 0 counts as 2⁻¹²⁶. The error is 2e-7 · (2 + |y · log2 x|) of
/// the result.
#[inline(always)]
pub fn pow<L: Lanes>(x: L, y: L) -> L {
    exp2(log2(x).mul(y))
}

#[inline(always)]
fn has_bit<L: Lanes>(word: L::Words, bit: u32) -> L::Mask {
    let bit = <L::Words>::splat(bit);
    word.and(bit).eq(bit)
}

/// Sine and cosine of angles up to 1000, to 2e-7.
#[inline(always)]
fn sin_cos<L: Lanes>(x: L) -> [L; 2] {
    let turns = x
        .mul(L::splat(std::f32::consts::FRAC_2_PI))
        .add(L::splat(0.5))
        .floor();
    // A right angle in three parts, of which products with the number of turns are exact (Cody and
    // Waite).
    let rest = x
        .sub(turns.mul(L::splat(1.570_312_5)))
        .sub(turns.mul(L::splat(4.837_513e-4)))
        .sub(turns.mul(L::splat(7.549_79e-8)));
    let squared = rest.mul(rest);
    let sine = polynomial(
        squared,
        [-1.951_529_6e-4, 8.332_161e-3, -1.666_665_5e-1, 1.0],
    )
    .mul(rest);
    let cosine = polynomial(
        squared,
        [2.443_315_7e-5, -1.388_731_6e-3, 4.166_664_6e-2, -0.5, 1.0],
    );
    let quarter = turns.to_signed();
    let odd = has_bit::<L>(quarter, 1);
    let sine_of = L::select(odd, cosine, sine);
    let cosine_of = L::select(odd, sine, cosine);
    let next = quarter.add(<L::Words>::splat(1));
    [
        L::select(has_bit::<L>(quarter, 2), sine_of.neg(), sine_of),
        L::select(has_bit::<L>(next, 2), cosine_of.neg(), cosine_of),
    ]
}

/// Sine of angles up to 1000, to 2e-7.
#[inline(always)]
pub fn sin<L: Lanes>(x: L) -> L {
    sin_cos(x)[0]
}

/// Cosine of angles up to 1000, to 2e-7.
#[inline(always)]
pub fn cos<L: Lanes>(x: L) -> L {
    sin_cos(x)[1]
}

/// The angle of the direction (x, y) from (1, 0), −π to π, to 5e-7; 0 for (0, 0).
#[inline(always)]
pub fn atan2<L: Lanes>(y: L, x: L) -> L {
    let (along, aside) = (x.abs(), y.abs());
    let steep = along.lt(aside);
    let long = along.max(aside).max(L::splat(f32::MIN_POSITIVE));
    let ratio = along.min(aside).div(long);
    // Above tan(π / 8) the angle from π / 4.
    let far = L::splat(0.414_213_57).lt(ratio);
    let one = L::splat(1.0);
    let turned = ratio.sub(one).div(ratio.add(one));
    let small = L::select(far, turned, ratio);
    let squared = small.mul(small);
    let rest = polynomial(
        squared,
        [8.053_745e-2, -1.387_768_6e-1, 1.997_771e-1, -3.333_295e-1],
    );
    let angle = small.add(small.mul(squared).mul(rest));
    let from = L::select(far, L::splat(std::f32::consts::FRAC_PI_4), L::splat(0.0));
    let angle = from.add(angle);
    let angle = L::select(
        steep,
        L::splat(std::f32::consts::FRAC_PI_2).sub(angle),
        angle,
    );
    let behind = x.lt(L::splat(0.0));
    let angle = L::select(behind, L::splat(std::f32::consts::PI).sub(angle), angle);
    L::select(y.lt(L::splat(0.0)), angle.neg(), angle)
}

#[cfg(test)]
mod tests {
    use sensor_core::vector_lanes::{LaneWork, in_arrays, in_lanes};

    use super::*;

    struct Every([f32; 8], [f32; 8]);

    impl LaneWork for Every {
        type Out = [[f32; 8]; 12];

        #[inline(always)]
        fn run<L: Lanes>(self) -> Self::Out {
            let (x, y) = (L::load(&self.0), L::load(&self.1));
            [
                exp2(x),
                exp(x),
                log2(x),
                pow(x.abs(), y),
                sin(x),
                cos(x),
                atan2(y, x),
                fract(x),
                saturate(x),
                mix(x, y, L::splat(0.25)),
                smoothstep(L::splat(-1.0), L::splat(3.0), x),
                inverse_sqrt(x.abs()),
            ]
            .map(L::store)
        }
    }

    /// The results for eight numbers of each range, with vectors, which must be those with arrays.
    fn results(
        rng: &mut fastrand::Rng,
        x: std::ops::Range<f32>,
        y: std::ops::Range<f32>,
    ) -> ([f32; 8], [f32; 8], [[f32; 8]; 12]) {
        let mut eight = |range: std::ops::Range<f32>| {
            std::array::from_fn(|_| range.start + rng.f32() * (range.end - range.start))
        };
        let (x, y) = (eight(x), eight(y));
        let found = in_lanes(Every(x, y));
        let bits = |all: [[f32; 8]; 12]| all.map(|x| x.map(f32::to_bits));
        assert_eq!(bits(found), bits(in_arrays(Every(x, y))), "{x:?} {y:?}");
        (x, y, found)
    }

    /// Holds function `which` to a bound of the error, both from x, y and the true result.
    fn check(
        which: usize,
        x: std::ops::Range<f32>,
        y: std::ops::Range<f32>,
        truth: impl Fn(f64, f64) -> f64,
        bound: impl Fn(f64, f64, f64) -> f64,
    ) {
        let mut rng = fastrand::Rng::with_seed(which as u64);
        for _ in 0..20_000 {
            let (x, y, found) = results(&mut rng, x.clone(), y.clone());
            for lane in 0..8 {
                let (x, y) = (x[lane] as f64, y[lane] as f64);
                let expected = truth(x, y);
                let error = (found[which][lane] as f64 - expected).abs();
                assert!(
                    error <= bound(x, y, expected),
                    "function {which} of {x}, {y}: {} for {expected}, {error:e} beside it",
                    found[which][lane]
                );
            }
        }
    }

    #[test]
    fn powers_are_within_their_bounds() {
        check(
            0,
            -126.0..127.4,
            0.0..1.0,
            |x, _| x.exp2(),
            |_, _, r| 2e-7 * r,
        );
        check(0, -1.0..1.0, 0.0..1.0, |x, _| x.exp2(), |_, _, r| 2e-7 * r);
        let of_e = |x: f64, _: f64, r: f64| 1e-7 * (3.0 + x.abs()) * r;
        check(1, -80.0..80.0, 0.0..1.0, |x, _| x.exp(), of_e);
        check(1, -1.0..1.0, 0.0..1.0, |x, _| x.exp(), of_e);
        let of_power = |x: f64, y: f64, r: f64| 2e-7 * (2.0 + (y * x.log2()).abs()) * r;
        check(3, 1e-6..1.0, 0.1..6.0, f64::powf, of_power);
        check(3, 0.5..40.0, -8.0..8.0, f64::powf, of_power);
    }

    #[test]
    fn logarithms_are_within_their_bounds() {
        let bound = |_: f64, _: f64, r: f64| 1.5e-7 * r.abs().max(1.0);
        for range in [
            1e-30..1e-29,
            1e-6..1e-3,
            0.4..2.5,
            0.999..1.001,
            1.0..1e6,
            1e30..3e38,
        ] {
            check(2, range, 0.0..1.0, |x, _| x.log2(), bound);
        }
    }

    #[test]
    fn angles_are_within_their_bounds() {
        for range in [-4.0..4.0, -100.0..100.0, -1000.0..1000.0] {
            check(4, range.clone(), 0.0..1.0, |x, _| x.sin(), |_, _, _| 2e-7);
            check(5, range, 0.0..1.0, |x, _| x.cos(), |_, _, _| 2e-7);
        }
        let angle = |x: f64, y: f64| y.atan2(x);
        for (x, y) in [
            (-1.0..1.0, -1.0..1.0),
            (-1e-3..1e-3, -5.0..5.0),
            (-9.0..9.0, -1e-3..1e-3),
        ] {
            check(6, x, y, angle, |_, _, _| 5e-7);
        }
    }

    #[test]
    fn blends_are_within_their_bounds() {
        check(7, -9.0..9.0, 0.0..1.0, |x, _| x - x.floor(), |_, _, _| 1e-6);
        check(
            8,
            -2.0..2.0,
            0.0..1.0,
            |x, _| x.clamp(0.0, 1.0),
            |_, _, _| 0.0,
        );
        check(
            9,
            -9.0..9.0,
            -9.0..9.0,
            |x, y| 0.75 * x + 0.25 * y,
            |_, _, _| 1e-6,
        );
        let step = |x: f64, _: f64| {
            let t = ((x + 1.0) / 4.0).clamp(0.0, 1.0);
            t * t * (3.0 - 2.0 * t)
        };
        check(10, -2.0..4.0, 0.0..1.0, step, |_, _, _| 5e-7);
        check(
            11,
            1e-6..1e6,
            0.0..1.0,
            |x, _| 1.0 / x.sqrt(),
            |_, _, r| 2e-7 * r,
        );
    }

    #[test]
    fn ends_of_the_ranges_are_as_documented() {
        let found = |x: f32, y: f32| in_lanes(Every([x; 8], [y; 8])).map(|lanes| lanes[0]);
        assert_eq!(found(-200.0, 0.0)[0], 0.0);
        assert_eq!(found(200.0, 0.0)[0], f32::INFINITY);
        assert_eq!(found(0.0, 0.0)[2], -126.0);
        assert_eq!(found(-3.0, 0.0)[2], -126.0);
        assert_eq!(found(f32::NAN, 0.0)[2], -126.0);
        assert_eq!(found(1.0, 0.0)[2], 0.0);
        assert_eq!(found(0.0, 3.0)[3], 0.0);
        assert_eq!(found(0.0, 0.0)[3], 1.0);
        assert_eq!(found(0.0, 0.0)[6], 0.0);
        assert_eq!(found(-1.0, 0.0)[6], std::f32::consts::PI);
    }
}
