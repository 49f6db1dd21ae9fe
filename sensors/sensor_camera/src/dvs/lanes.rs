//! Numbers of neighbouring pixels, followed together.

/// Number of pixels that are followed together.
pub(super) const LANES: usize = 8;

/// Natural logarithm of a positive finite number, to 2e-7 of it or of 1, in arithmetic that every
/// CPU can vectorise.
///
/// The mantissa m in √½..√2 by ln m = 2 artanh((m − 1) / (m + 1)), of which seven terms are more
/// than `f32` holds.
#[inline(always)]
pub(super) fn ln(x: f32) -> f32 {
    const SQRT_HALF: i32 = 0x3f35_04f3;
    let bits = x.to_bits() as i32;
    let exponent = bits.wrapping_sub(SQRT_HALF) >> 23;
    let m = f32::from_bits(bits.wrapping_sub(exponent << 23) as u32);
    let s = (m - 1.0) / (m + 1.0);
    let s2 = s * s;
    let series = 1.0 + s2 * (1.0 / 3.0 + s2 * (1.0 / 5.0 + s2 * (1.0 / 7.0 + s2 * (1.0 / 9.0))));
    exponent as f32 * std::f32::consts::LN_2 + 2.0 * s * series
}

/// As `f32::max` without its handling of NaN, which would double the cost; a NaN in `a` gives `b`.
#[inline(always)]
pub(super) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// As [`larger`], for the smaller one.
#[inline(always)]
pub(super) fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}
