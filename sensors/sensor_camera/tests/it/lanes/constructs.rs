//! Generated from WGSL by the test `lanes` of `sensor_camera`; `./gantry bless` writes it anew.

use sensor_core::vector_lanes::{Lanes, WordLanes};

use sensor_shade::functions::{atan2, cos, exp, exp2, fract, inverse_sqrt, log2, mix, pow, saturate, sin, smoothstep};
use sensor_shade::memory::{number, numbers_at, words_at};
use sensor_shade::packing::{divided, first_trailing_bit, number_of, pack_4x8_unorm, remainder, unpack_4x8_snorm, unpack_4x8_unorm, word, word_of};
use sensor_shade::vectors::{cross, dot, length, normalize, reflect, zip2, zip3, zip4};

/// What a pipeline chooses.
#[derive(Clone, Copy, Debug)]
pub struct Overrides {
    pub chosen: bool,
    pub other: bool,
}

impl Default for Overrides {
    #[inline(always)]
    fn default() -> Self {
        Overrides {
            chosen: true,
            other: false,
        }
    }
}

/// What a pipeline's bind groups hold, and its overrides.
#[derive(Clone, Copy)]
pub struct Bound<'a, M> {
    pub overrides: Overrides,
    pub maps: &'a M,
}

/// The images that the shaders read, and how. Lanes that do not run may ask for any place.
pub trait Maps<L: Lanes> {
}

#[derive(Clone, Copy)]
pub struct Inside<L: Lanes> {
    pub row: [L; 3],
    pub signed: [L::Words; 2],
}

impl<L: Lanes> Inside<L> {
    #[inline(always)]
    pub fn blend(lanes: L::Mask, a: Self, b: Self) -> Self {
        Inside {
            row: zip3(a.row, b.row, |a, b| L::select(lanes, a, b)),
            signed: zip2(a.signed, b.signed, |a, b| <L::Words>::select(lanes, a, b)),
        }
    }
}

#[derive(Clone, Copy)]
pub struct Pair<L: Lanes> {
    pub number: L,
    pub word: L::Words,
    pub flags: [L::Mask; 2],
    pub inside: Inside<L>,
}

impl<L: Lanes> Pair<L> {
    #[inline(always)]
    pub fn blend(lanes: L::Mask, a: Self, b: Self) -> Self {
        Pair {
            number: L::select(lanes, a.number, b.number),
            word: <L::Words>::select(lanes, a.word, b.word),
            flags: zip2(a.flags, b.flags, |a, b| L::or(L::and(lanes, a), L::and(L::not(lanes), b))),
            inside: Inside::<L>::blend(lanes, a.inside, b.inside),
        }
    }
}

#[inline(always)]
pub fn rounds<L: Lanes>(lanes: L::Mask, limit: L::Words, stride: L::Words) -> [L::Words; 2] {
    let mut result = [word::<L>(0); 2];
    let mut done = L::mask(false);
    let mut sum: L::Words = word::<L>(0);
    let mut n: L::Words = word::<L>(0);
    let mut i: L::Words = word::<L>(0);
    let mut k: L::Words = word::<L>(0);
    let mut v: L::Mask = L::mask(false);
    let mut on = lanes;
    while L::any(on) {
        let mut next = L::mask(false);
        let m = on;
        let t = i;
        let t_2 = t.lt_unsigned(word::<L>(20));
        let m_2 = L::and(m, L::not(t_2));
        on = L::and(on, L::not(m_2));
        let m_3 = L::and(L::and(m, on), L::not(next));
        if L::any(m_3) {
            let t_3 = i;
            let t_4 = L::not(t_3.lt_unsigned(limit));
            let m_4 = L::and(m_3, t_4);
            on = L::and(on, L::not(m_4));
            let m_5 = L::and(L::and(m_3, on), L::not(next));
            if L::any(m_5) {
                let t_5 = i;
                let t_6 = remainder::<L>(t_5, word::<L>(3)).eq(word::<L>(1));
                let m_6 = L::and(m_5, t_6);
                next = L::or(next, m_6);
                let m_7 = L::and(L::and(m_5, on), L::not(next));
                if L::any(m_7) {
                    let t_7 = i;
                    k = <L::Words>::select(m_7, t_7, k);
                    let mut on_2 = m_7;
                    while L::any(on_2) {
                        let mut next_2 = L::mask(false);
                        let m_8 = on_2;
                        let t_8 = k;
                        let t_9 = t_8.lt_unsigned(word::<L>(12));
                        let m_9 = L::and(m_8, L::not(t_9));
                        on_2 = L::and(on_2, L::not(m_9));
                        let m_10 = L::and(L::and(m_8, on_2), L::not(next_2));
                        if L::any(m_10) {
                            let t_10 = k;
                            let t_11 = t_10.eq(word::<L>(11));
                            let t_12 = i;
                            v = L::and(t_11, word::<L>(4).lt_unsigned(t_12));
                            let t_13 = v;
                            let m_11 = L::and(m_10, t_13);
                            if L::any(m_11) {
                                let t_14 = sum;
                                let t_15 = n;
                                let t_16 = [t_14.add(word::<L>(1000)), t_15];
                                result = zip2(t_16, result, |a, b| <L::Words>::select(m_11, a, b));
                                done = L::or(done, m_11);
                                on = L::and(on, L::not(m_11));
                                on_2 = L::and(on_2, L::not(m_11));
                            }
                            let m_12 = L::and(L::and(m_10, on_2), L::not(next_2));
                            if L::any(m_12) {
                                let t_17 = k;
                                let t_18 = t_17.and(word::<L>(1)).eq(word::<L>(1));
                                let m_13 = L::and(m_12, t_18);
                                next_2 = L::or(next_2, m_13);
                                let m_14 = L::and(L::and(m_12, on_2), L::not(next_2));
                                if L::any(m_14) {
                                    let t_19 = sum;
                                    let t_20 = k;
                                    let t_21 = i;
                                    let t_22 = t_19.add(t_20.mul(t_21));
                                    sum = <L::Words>::select(m_14, t_22, sum);
                                    let t_23 = n;
                                    let t_24 = t_23.add(word::<L>(1));
                                    n = <L::Words>::select(m_14, t_24, n);
                                }
                            }
                        }
                        let t_25 = k;
                        let t_26 = t_25.add(word::<L>(1).add(remainder::<L>(stride, word::<L>(4))));
                        k = <L::Words>::select(on_2, t_26, k);
                    }
                    let m_15 = L::and(L::and(m_7, on), L::not(next));
                    if L::any(m_15) {
                        let t_27 = sum;
                        let t_28 = i;
                        let t_29 = t_27.xor(t_28.shl(word::<L>(3)));
                        sum = <L::Words>::select(m_15, t_29, sum);
                    }
                }
            }
        }
        let t_30 = i;
        let t_31 = t_30.add(word::<L>(1));
        i = <L::Words>::select(on, t_31, i);
    }
    let m_16 = L::and(lanes, L::not(done));
    if L::any(m_16) {
        let t_32 = sum;
        let t_33 = n;
        let t_34 = [t_32, t_33];
        return zip2(result, t_34, |a, b| <L::Words>::select(done, a, b));
    }
    result
}

#[inline(always)]
pub fn halved<L: Lanes>(lanes: L::Mask, number_2: L) -> L::Words {
    let mut x: L = L::splat(0.0);
    let mut n: L::Words = word::<L>(0);
    let mut v: L::Mask = L::mask(false);
    x = number_2.abs();
    let mut on = lanes;
    while L::any(on) {
        let m = on;
        let t = x;
        let t_2 = t.mul(L::splat(0.5));
        x = L::select(m, t_2, x);
        let t_3 = n;
        let t_4 = t_3.add(word::<L>(1));
        n = <L::Words>::select(on, t_4, n);
        let t_5 = x;
        let t_6 = L::not(t_5.lt(L::splat(1.0)));
        let t_7 = n;
        v = L::or(L::not(t_6), word::<L>(30).lt_unsigned(t_7));
        let t_8 = v;
        on = L::and(on, L::not(t_8));
    }
    let t_9 = n;
    return t_9;
}

#[inline(always)]
pub fn sorted<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, x: L, y: L) -> L {
    let mut result = L::splat(0.0);
    let mut done = L::mask(false);
    if bound.overrides.other {
        let t = L::splat(-1.0);
        return L::select(done, result, t);
    }
    let t_2 = x.lt(L::splat(0.0));
    let m = L::and(lanes, t_2);
    if L::any(m) {
        let t_3 = y.lt(L::splat(0.0));
        let m_2 = L::and(m, t_3);
        if L::any(m_2) {
            let t_4 = x.mul(y);
            result = L::select(m_2, t_4, result);
            done = L::or(done, m_2);
        }
        let m_3 = L::and(m, L::not(done));
        if L::any(m_3) {
            let t_5 = y.lt(L::splat(0.5));
            let m_4 = L::and(m_3, t_5);
            if L::any(m_4) {
                let t_6 = x.sub(y);
                result = L::select(m_4, t_6, result);
                done = L::or(done, m_4);
            }
        }
    }
    let m_5 = L::and(lanes, L::not(t_2));
    if L::any(m_5) {
        let t_7 = L::splat(0.75).lt(x);
        let m_6 = L::and(m_5, t_7);
        if L::any(m_6) {
            let t_8 = L::splat(7.0);
            result = L::select(m_6, t_8, result);
            done = L::or(done, m_6);
        }
    }
    let m_7 = L::and(lanes, L::not(done));
    if L::any(m_7) {
        if bound.overrides.chosen {
            let t_9 = x.add(L::splat(10.0).mul(y));
            return L::select(done, result, t_9);
        }
        let t_10 = L::splat(5.0);
        return L::select(done, result, t_10);
    }
    result
}

#[inline(always)]
pub fn changed<L: Lanes>(lanes: L::Mask, given: Pair<L>, by: L) -> Pair<L> {
    let mut out: Pair<L> = Pair::<L> { number: L::splat(0.0), word: word::<L>(0), flags: [L::mask(false); 2], inside: Inside::<L> { row: [L::splat(0.0); 3], signed: [word::<L>(0); 2] } };
    let mut v: L::Mask = L::mask(false);
    out = given;
    let t = L::splat(0.0).lt(by);
    let m = L::and(lanes, t);
    if L::any(m) {
        let t_2 = out.number;
        let t_3 = t_2.mul(by);
        out.number = L::select(m, t_3, out.number);
        out.inside.row[1] = L::select(m, by, out.inside.row[1]);
        let t_4 = out.flags[1];
        let t_5 = L::not(t_4);
        out.flags[0] = L::or(L::and(m, t_5), L::and(L::not(m), out.flags[0]));
    }
    let m_2 = L::and(lanes, L::not(t));
    if L::any(m_2) {
        let t_6 = out.word;
        let t_7 = t_6.xor(word::<L>(u32::MAX));
        out.word = <L::Words>::select(m_2, t_7, out.word);
        let t_8 = out.inside.signed[0];
        let t_9 = word::<L>(0).sub(t_8);
        out.inside.signed[1] = <L::Words>::select(m_2, t_9, out.inside.signed[1]);
        let t_10 = [by, L::splat(2.0).mul(by), by.mul(by)];
        out.inside.row = zip3(t_10, out.inside.row, |a, b| L::select(m_2, a, b));
    }
    let t_11 = out.flags;
    let t_12 = L::not(L::and(t_11[0], t_11[1]));
    let t_13 = out.word;
    v = L::or(L::not(t_12), t_13.eq(word::<L>(3)));
    let t_14 = v;
    let m_3 = L::and(lanes, t_14);
    if L::any(m_3) {
        let t_15 = out.inside.signed;
        let t_16 = [word::<L>(1i32 as u32), word::<L>(2i32 as u32)];
        let t_17 = [t_15[0].add(t_16[0]), t_15[1].add(t_16[1])];
        out.inside.signed = zip2(t_17, out.inside.signed, |a, b| <L::Words>::select(m_3, a, b));
    }
    let t_18 = out;
    return t_18;
}

#[inline(always)]
pub fn called_in_branches<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, given: Pair<L>, x: L) -> L {
    let mut sum: L = L::splat(0.0);
    let t = L::splat(0.25).lt(x);
    let m = L::and(lanes, t);
    if L::any(m) {
        let t_2 = changed::<L>(m, given, x);
        let t_3 = sorted::<L, M>(bound, m, x, given.number);
        let t_4 = t_2.number.add(t_3);
        sum = L::select(m, t_4, sum);
    }
    let m_2 = L::and(lanes, L::not(t));
    if L::any(m_2) {
        let t_5 = L::or(given.flags[0], given.flags[1]);
        let m_3 = L::and(m_2, t_5);
        if L::any(m_3) {
            let t_6 = sorted::<L, M>(bound, m_3, given.number, x);
            let t_7 = t_6.sub(L::splat(1.0));
            sum = L::select(m_3, t_7, sum);
        }
    }
    let t_8 = sum;
    return t_8;
}

#[inline(always)]
pub fn whole_numbers<L: Lanes>(a: L::Words, b: L::Words, c: L::Words, d: L::Words) -> [[L::Words; 4]; 3] {
    let signed = [a.min_signed(b), a.max_signed(b), a.max_signed(word::<L>(-5i32 as u32)).min_signed(word::<L>(9i32 as u32)), a.shr_signed(c.and(word::<L>(31)))];
    let unsigned = [c.min_unsigned(d), c.max_unsigned(d), c.max_unsigned(word::<L>(7)).min_unsigned(word::<L>(90)), divided::<L>(c, d.max_unsigned(word::<L>(1)))];
    let compared = [word_of::<L>(a.lt_signed(b)).add(word::<L>(2).mul(word_of::<L>(L::not(b.lt_signed(a))))), word_of::<L>(d.lt_unsigned(c)).add(word::<L>(2).mul(word_of::<L>(L::not(c.lt_unsigned(d))))), word_of::<L>(L::not(d.lt_unsigned(c))).or(word_of::<L>(L::not(a.lt_signed(b))).shl(word::<L>(1))).or(word_of::<L>(b.lt_signed(a)).shl(word::<L>(2))), first_trailing_bit::<L>(c)];
    let t = [c; 4];
    let t_2 = [word::<L>(7), word::<L>(8), d.max_unsigned(word::<L>(1)), word::<L>(16)];
    let t_3 = [remainder::<L>(t[0], t_2[0]), remainder::<L>(t[1], t_2[1]), remainder::<L>(t[2], t_2[2]), remainder::<L>(t[3], t_2[3])];
    let t_4 = [c.shr(word::<L>(4)); 4];
    return [[signed[0], signed[1], signed[2], signed[3]], [unsigned[0].add(t_3[0]), unsigned[1].add(t_3[1]), unsigned[2].add(t_3[2]), unsigned[3].add(t_3[3])], [compared[0].xor(t_4[0]), compared[1].xor(t_4[1]), compared[2].xor(t_4[2]), compared[3].xor(t_4[3])]];
}

#[inline(always)]
pub fn numbers_and_words<L: Lanes>(a: L, b: L::Words, c: L::Words) -> [[L::Words; 4]; 2] {
    let bits = [a.to_words(), a.mul(L::splat(1000.0)).to_signed(), a.abs().mul(L::splat(3000000.0)).to_unsigned(), b.from_signed().to_words()];
    let more = [c.from_unsigned().to_words(), <L::Words>::select(L::splat(0.0).lt(a), word::<L>(5), c), word_of::<L>(L::not(a.eq(L::splat(0.0)))), number_of::<L>(L::splat(0.5).le(a)).to_words()];
    return [bits, more];
}

#[inline(always)]
pub fn functions<L: Lanes>(x: L, y: L) -> [[L; 4]; 4] {
    let p = x.abs().add(L::splat(0.1));
    let v = [x, y, x.mul(y).add(L::splat(1.0))];
    let t = normalize(v);
    return [[exp(p.neg()), exp2(x), log2(p), pow(p, y)], [sin(L::splat(9.0).mul(x)), cos(L::splat(9.0).mul(y)), atan2(y, x), inverse_sqrt(p)], [t[0], t[1], t[2], length(v)], [fract(L::splat(8.0).mul(x)), mix(x, y, L::splat(0.3)), smoothstep(L::splat(-0.5), L::splat(0.5), x), saturate(y)]];
}

#[inline(always)]
pub fn vectors<L: Lanes>(a: [L; 3], b: [L; 3]) -> [[L; 3]; 4] {
    let larger = [b[0].lt(a[0]), b[1].lt(a[1]), b[2].lt(a[2])];
    let t = [b[2], b[0], b[1]];
    let t_2 = cross(a, b);
    let t_3 = dot([a[0], a[1]], [b[1], b[2]]);
    let t_4 = L::splat(4.0);
    let t_5 = [a[0].mul(t_4), a[1].mul(t_4), a[2].mul(t_4)];
    let t_6 = [t_5[0].floor(), t_5[1].floor(), t_5[2].floor()];
    let t_7 = [b[0].abs(), b[1].abs(), b[2].abs()];
    let t_8 = [L::splat(0.125); 3];
    let t_9 = [t_7[0].max(t_8[0]), t_7[1].max(t_8[1]), t_7[2].max(t_8[2])];
    let t_10 = reflect(a, normalize(b));
    let t_11 = [L::splat(-0.5); 3];
    let t_12 = [L::splat(2.0); 3];
    let t_13 = [a[0].add(t_12[0]), a[1].add(t_12[1]), a[2].add(t_12[2])];
    let t_14 = [b[0].max(t_11[0]).min(t_13[0]), b[1].max(t_11[1]).min(t_13[1]), b[2].max(t_11[2]).min(t_13[2])];
    let t_15 = [t_10[0].add(t_14[0]), t_10[1].add(t_14[1]), t_10[2].add(t_14[2])];
    let t_16 = [a[0].abs(), a[1].abs(), a[2].abs()];
    let t_17 = [t_16[0].sqrt(), t_16[1].sqrt(), t_16[2].sqrt()];
    let t_18 = L::splat(0.5);
    let t_19 = [t_17[0].mul(t_18), t_17[1].mul(t_18), t_17[2].mul(t_18)];
    return [[L::select(larger[0], t[0], a[0]), L::select(larger[1], t[1], a[1]), L::select(larger[2], t[2], a[2])], [t_2[0].mul(t_3), t_2[1].mul(t_3), t_2[2].mul(t_3)], [t_6[0].div(t_9[0]), t_6[1].div(t_9[1]), t_6[2].div(t_9[2])], [t_15[0].sub(t_19[0]), t_15[1].sub(t_19[1]), t_15[2].sub(t_19[2])]];
}

#[inline(always)]
pub fn packed<L: Lanes>(word_2: L::Words, number_2: [L; 4]) -> [[L; 4]; 3] {
    let again = unpack_4x8_unorm::<L>(pack_4x8_unorm::<L>(number_2));
    return [again, unpack_4x8_unorm::<L>(word_2), unpack_4x8_snorm::<L>(word_2)];
}
