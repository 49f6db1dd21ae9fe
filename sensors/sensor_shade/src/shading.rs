//! Generated from WGSL by the test `lanes` of `sensor_camera`; `./gantry bless` writes it anew.

use sensor_core::vector_lanes::{Lanes, WordLanes};

use crate::functions::{atan2, cos, exp, exp2, fract, inverse_sqrt, log2, mix, pow, saturate, sin, smoothstep};
use crate::memory::{number, numbers_at, words_at};
use crate::packing::{divided, first_trailing_bit, number_of, pack_4x8_unorm, remainder, unpack_4x8_snorm, unpack_4x8_unorm, word, word_of};
use crate::vectors::{cross, dot, length, normalize, reflect, zip2, zip3, zip4};

/// What a pipeline chooses.
#[derive(Clone, Copy, Debug)]
pub struct Overrides {
    pub with_fog: bool,
    pub with_wet: bool,
    pub with_switched: bool,
    pub simple: bool,
    pub with_lamps: bool,
}

impl Default for Overrides {
    #[inline(always)]
    fn default() -> Self {
        Overrides {
            with_fog: true,
            with_wet: true,
            with_switched: false,
            simple: false,
            with_lamps: true,
        }
    }
}

/// What a pipeline's bind groups hold, and its overrides.
#[derive(Clone, Copy)]
pub struct Bound<'a, M> {
    pub overrides: Overrides,
    pub views: &'a [u32; 128],
    pub light: &'a [u32; 252],
    pub switched: &'a [u32],
    pub lamps: &'a [u32],
    pub lamp_tiles: &'a [u32],
    pub maps: &'a M,
}

/// The images that the shaders read, and how. Lanes that do not run may ask for any place.
pub trait Maps<L: Lanes> {
    fn depth_map_loaded(&self, at: [L::Words; 2]) -> [L; 4];
    fn far_shadow_map_compared(&self, at: [L; 2], depth: L) -> L;
    fn instance_map_loaded(&self, at: [L::Words; 2]) -> [L::Words; 4];
    fn noise_map_sampled(&self, at: [L; 2], level: L) -> [L; 4];
    fn shadow_map_compared(&self, at: [L; 2], depth: L) -> L;
    fn sky_map_sampled(&self, at: [L; 2], level: L) -> [L; 4];
    fn surface_map_loaded(&self, at: [L::Words; 2]) -> [L::Words; 4];
}

#[derive(Clone, Copy)]
pub struct Style<L: Lanes> {
    pub pitch_m: [L; 2],
    pub share: [L; 2],
    pub n_parts: [L; 2],
    pub brick: L,
    pub panels: L,
    pub courses: L,
    pub pipes: L,
    pub pale: L,
    pub board: [L; 3],
}

impl<L: Lanes> Style<L> {
    #[inline(always)]
    pub fn blend(lanes: L::Mask, a: Self, b: Self) -> Self {
        Style {
            pitch_m: zip2(a.pitch_m, b.pitch_m, |a, b| L::select(lanes, a, b)),
            share: zip2(a.share, b.share, |a, b| L::select(lanes, a, b)),
            n_parts: zip2(a.n_parts, b.n_parts, |a, b| L::select(lanes, a, b)),
            brick: L::select(lanes, a.brick, b.brick),
            panels: L::select(lanes, a.panels, b.panels),
            courses: L::select(lanes, a.courses, b.courses),
            pipes: L::select(lanes, a.pipes, b.pipes),
            pale: L::select(lanes, a.pale, b.pale),
            board: zip3(a.board, b.board, |a, b| L::select(lanes, a, b)),
        }
    }
}

#[derive(Clone, Copy)]
pub struct Grain<L: Lanes> {
    pub px_per_m: L,
    pub sharp_per_m: L,
}

impl<L: Lanes> Grain<L> {
    #[inline(always)]
    pub fn blend(lanes: L::Mask, a: Self, b: Self) -> Self {
        Grain {
            px_per_m: L::select(lanes, a.px_per_m, b.px_per_m),
            sharp_per_m: L::select(lanes, a.sharp_per_m, b.sharp_per_m),
        }
    }
}

#[derive(Clone, Copy)]
pub struct Window<L: Lanes> {
    pub pane: L,
    pub frame: L,
    pub shade: L,
    pub place: [L; 2],
    pub in_cell: [L; 2],
    pub lot: [L; 4],
}

impl<L: Lanes> Window<L> {
    #[inline(always)]
    pub fn blend(lanes: L::Mask, a: Self, b: Self) -> Self {
        Window {
            pane: L::select(lanes, a.pane, b.pane),
            frame: L::select(lanes, a.frame, b.frame),
            shade: L::select(lanes, a.shade, b.shade),
            place: zip2(a.place, b.place, |a, b| L::select(lanes, a, b)),
            in_cell: zip2(a.in_cell, b.in_cell, |a, b| L::select(lanes, a, b)),
            lot: zip4(a.lot, b.lot, |a, b| L::select(lanes, a, b)),
        }
    }
}

#[derive(Clone, Copy)]
pub struct Wall<L: Lanes> {
    pub albedo: [L; 3],
    pub pane: L,
    pub glow: L,
    pub cool: L,
}

impl<L: Lanes> Wall<L> {
    #[inline(always)]
    pub fn blend(lanes: L::Mask, a: Self, b: Self) -> Self {
        Wall {
            albedo: zip3(a.albedo, b.albedo, |a, b| L::select(lanes, a, b)),
            pane: L::select(lanes, a.pane, b.pane),
            glow: L::select(lanes, a.glow, b.glow),
            cool: L::select(lanes, a.cool, b.cool),
        }
    }
}

#[derive(Clone, Copy)]
pub struct Finish<L: Lanes> {
    pub albedo: [L; 3],
    pub emitted: [L; 3],
    pub mirror: L,
    pub rough: L,
    pub through: L,
    pub puddle: L,
    pub film: L,
}

impl<L: Lanes> Finish<L> {
    #[inline(always)]
    pub fn blend(lanes: L::Mask, a: Self, b: Self) -> Self {
        Finish {
            albedo: zip3(a.albedo, b.albedo, |a, b| L::select(lanes, a, b)),
            emitted: zip3(a.emitted, b.emitted, |a, b| L::select(lanes, a, b)),
            mirror: L::select(lanes, a.mirror, b.mirror),
            rough: L::select(lanes, a.rough, b.rough),
            through: L::select(lanes, a.through, b.through),
            puddle: L::select(lanes, a.puddle, b.puddle),
            film: L::select(lanes, a.film, b.film),
        }
    }
}

#[derive(Clone, Copy)]
pub struct Lamp<L: Lanes> {
    pub place: [L; 4],
    pub axis: [L; 4],
    pub rgb: [L; 4],
}

impl<L: Lanes> Lamp<L> {
    #[inline(always)]
    pub fn blend(lanes: L::Mask, a: Self, b: Self) -> Self {
        Lamp {
            place: zip4(a.place, b.place, |a, b| L::select(lanes, a, b)),
            axis: zip4(a.axis, b.axis, |a, b| L::select(lanes, a, b)),
            rgb: zip4(a.rgb, b.rgb, |a, b| L::select(lanes, a, b)),
        }
    }
}

#[derive(Clone, Copy)]
pub struct LampLight<L: Lanes> {
    pub diffuse: [L; 3],
    pub glint: [L; 3],
}

impl<L: Lanes> LampLight<L> {
    #[inline(always)]
    pub fn blend(lanes: L::Mask, a: Self, b: Self) -> Self {
        LampLight {
            diffuse: zip3(a.diffuse, b.diffuse, |a, b| L::select(lanes, a, b)),
            glint: zip3(a.glint, b.glint, |a, b| L::select(lanes, a, b)),
        }
    }
}

#[derive(Clone, Copy)]
pub struct Point<L: Lanes> {
    pub pixel: [L::Words; 2],
    pub in_camera: [L; 3],
    pub normal: [L; 3],
    pub uv_m: [L; 2],
    pub labels: [L::Words; 4],
    pub pixel_m: L,
    pub open: L,
}

impl<L: Lanes> Point<L> {
    #[inline(always)]
    pub fn blend(lanes: L::Mask, a: Self, b: Self) -> Self {
        Point {
            pixel: zip2(a.pixel, b.pixel, |a, b| <L::Words>::select(lanes, a, b)),
            in_camera: zip3(a.in_camera, b.in_camera, |a, b| L::select(lanes, a, b)),
            normal: zip3(a.normal, b.normal, |a, b| L::select(lanes, a, b)),
            uv_m: zip2(a.uv_m, b.uv_m, |a, b| L::select(lanes, a, b)),
            labels: zip4(a.labels, b.labels, |a, b| <L::Words>::select(lanes, a, b)),
            pixel_m: L::select(lanes, a.pixel_m, b.pixel_m),
            open: L::select(lanes, a.open, b.open),
        }
    }
}

#[inline(always)]
pub fn transform<L: Lanes>(m: [[L; 4]; 3], point: [L; 3]) -> [L; 3] {
    let p = [point[0], point[1], point[2], L::splat(1.0)];
    return [dot(m[0], p), dot(m[1], p), dot(m[2], p)];
}

#[inline(always)]
pub fn rotate_rows<L: Lanes>(m: [[L; 4]; 3], v: [L; 3]) -> [L; 3] {
    return [dot([m[0][0], m[0][1], m[0][2]], v), dot([m[1][0], m[1][1], m[1][2]], v), dot([m[2][0], m[2][1], m[2][2]], v)];
}

#[inline(always)]
pub fn ray_in_camera<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, pixel: [L; 2]) -> [L; 3] {
    let t = [number::<L>(bound.views[0]), number::<L>(bound.views[1]), number::<L>(bound.views[2]), number::<L>(bound.views[3])];
    let t_2 = [t[2], t[3]];
    let t_3 = [pixel[0].sub(t_2[0]), pixel[1].sub(t_2[1])];
    let t_4 = [number::<L>(bound.views[0]), number::<L>(bound.views[1]), number::<L>(bound.views[2]), number::<L>(bound.views[3])];
    let t_5 = [t_4[0], t_4[1]];
    let t_6 = [t_3[0].div(t_5[0]), t_3[1].div(t_5[1])];
    return [t_6[0], t_6[1], L::splat(1.0)];
}

#[inline(always)]
pub fn pixel_of<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, point_in_camera: [L; 3]) -> [L; 2] {
    let t = [point_in_camera[0], point_in_camera[1]];
    let t_2 = [point_in_camera[2]; 2];
    let t_3 = [t[0].div(t_2[0]), t[1].div(t_2[1])];
    let t_4 = [number::<L>(bound.views[0]), number::<L>(bound.views[1]), number::<L>(bound.views[2]), number::<L>(bound.views[3])];
    let t_5 = [t_4[0], t_4[1]];
    let t_6 = [t_3[0].mul(t_5[0]), t_3[1].mul(t_5[1])];
    let t_7 = [number::<L>(bound.views[0]), number::<L>(bound.views[1]), number::<L>(bound.views[2]), number::<L>(bound.views[3])];
    let t_8 = [t_7[2], t_7[3]];
    return [t_6[0].add(t_8[0]), t_6[1].add(t_8[1])];
}

#[inline(always)]
pub fn blocker_of<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, half: L::Words) -> [L; 4] {
    let at = half.min_unsigned(word::<L>(11)).min_unsigned(word::<L>(11)).mul(word::<L>(4));
    let t = [numbers_at::<L>(bound.views, at, 76), numbers_at::<L>(bound.views, at, 77), numbers_at::<L>(bound.views, at, 78), numbers_at::<L>(bound.views, at, 79)];
    return t;
}

#[inline(always)]
pub fn look_of<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, material: L::Words) -> [L::Words; 2] {
    let at = material.min_unsigned(word::<L>(16)).min_unsigned(word::<L>(16)).mul(word::<L>(4));
    let t = [words_at::<L>(bound.light, at, 184), words_at::<L>(bound.light, at, 185), words_at::<L>(bound.light, at, 186), words_at::<L>(bound.light, at, 187)];
    return [t[0], t[1]];
}

#[inline(always)]
pub fn roughness_of<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, material: L::Words) -> [L; 4] {
    let at = material.min_unsigned(word::<L>(16)).min_unsigned(word::<L>(16)).mul(word::<L>(4));
    let t = [numbers_at::<L>(bound.light, at, 48), numbers_at::<L>(bound.light, at, 49), numbers_at::<L>(bound.light, at, 50), numbers_at::<L>(bound.light, at, 51)];
    return t;
}

#[inline(always)]
pub fn mirror_of<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, material: L::Words) -> [L; 4] {
    let at = material.min_unsigned(word::<L>(16)).min_unsigned(word::<L>(16)).mul(word::<L>(4));
    let t = [numbers_at::<L>(bound.light, at, 116), numbers_at::<L>(bound.light, at, 117), numbers_at::<L>(bound.light, at, 118), numbers_at::<L>(bound.light, at, 119)];
    return t;
}

#[inline(always)]
pub fn near_shadow<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, at: [L; 2], depth: L) -> L {
    let t = bound.maps.shadow_map_compared(at, depth);
    return t;
}

#[inline(always)]
pub fn far_shadow<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, at: [L; 2], depth: L) -> L {
    let t = bound.maps.far_shadow_map_compared(at, depth);
    return t;
}

#[inline(always)]
pub fn luminance_of<L: Lanes>(rgb: [L; 3]) -> L {
    return dot(rgb, [L::splat(0.2126), L::splat(0.7152), L::splat(0.0722)]);
}

#[inline(always)]
pub fn display<L: Lanes>(radiance: [L; 3]) -> [L; 3] {
    let t = [L::splat(0.004); 3];
    let t_2 = [radiance[0].sub(t[0]), radiance[1].sub(t[1]), radiance[2].sub(t[2])];
    let t_3 = [L::splat(0.0); 3];
    let x = [t_2[0].max(t_3[0]), t_2[1].max(t_3[1]), t_2[2].max(t_3[2])];
    let t_4 = L::splat(6.2);
    let t_5 = [t_4.mul(x[0]), t_4.mul(x[1]), t_4.mul(x[2])];
    let t_6 = [L::splat(0.5); 3];
    let t_7 = [t_5[0].add(t_6[0]), t_5[1].add(t_6[1]), t_5[2].add(t_6[2])];
    let t_8 = [x[0].mul(t_7[0]), x[1].mul(t_7[1]), x[2].mul(t_7[2])];
    let t_9 = L::splat(6.2);
    let t_10 = [t_9.mul(x[0]), t_9.mul(x[1]), t_9.mul(x[2])];
    let t_11 = [L::splat(1.7); 3];
    let t_12 = [t_10[0].add(t_11[0]), t_10[1].add(t_11[1]), t_10[2].add(t_11[2])];
    let t_13 = [x[0].mul(t_12[0]), x[1].mul(t_12[1]), x[2].mul(t_12[2])];
    let t_14 = [L::splat(0.06); 3];
    let t_15 = [t_13[0].add(t_14[0]), t_13[1].add(t_14[1]), t_13[2].add(t_14[2])];
    return [t_8[0].div(t_15[0]), t_8[1].div(t_15[1]), t_8[2].div(t_15[2])];
}

#[inline(always)]
pub fn packed_color<L: Lanes>(radiance: [L; 3]) -> L::Words {
    let t = display::<L>(radiance);
    let t_2 = [t[2], t[1], t[0]];
    return pack_4x8_unorm::<L>([t_2[0], t_2[1], t_2[2], L::splat(1.0)]);
}

#[inline(always)]
pub fn sky_sample<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, direction: [L; 3], level: L) -> [L; 3] {
    let t = [direction[0], direction[1]];
    let d = [t[0], t[1], direction[2].max(L::splat(0.0))];
    let t_2 = [d[0], d[1]];
    let t_3 = [d[0].abs().add(d[1].abs()).add(d[2]); 2];
    let p = [t_2[0].div(t_3[0]), t_2[1].div(t_3[1])];
    let t_4 = [p[0].add(p[1]), p[0].sub(p[1])];
    let t_5 = L::splat(0.5);
    let t_6 = [t_4[0].mul(t_5), t_4[1].mul(t_5)];
    let t_7 = [L::splat(0.5); 2];
    let uv = [t_6[0].add(t_7[0]), t_6[1].add(t_7[1])];
    let t_8 = bound.maps.sky_map_sampled(uv, level);
    return [t_8[0], t_8[1], t_8[2]];
}

#[inline(always)]
pub fn haze<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, direction_z: L, distance_m: L) -> L {
    let mut depth: L = L::splat(0.0);
    depth = number::<L>(bound.light[32]).mul(distance_m);
    if bound.overrides.with_fog {
        let through_m = distance_m.sub(number::<L>(bound.light[27])).max(L::splat(0.0));
        let eye_z = number::<L>(bound.views[19]).add(direction_z.mul(number::<L>(bound.light[27])));
        let rise = number::<L>(bound.light[29]).mul(direction_z);
        let slope = L::select(rise.abs().lt(L::splat(0.0001)), L::splat(0.0001), rise);
        let climb = slope.mul(through_m).max(L::splat(-30.0)).min(L::splat(30.0));
        let column_m = L::splat(1.0).sub(exp(climb.neg())).div(slope);
        let t = depth;
        depth = t.add(number::<L>(bound.light[28]).mul(exp(number::<L>(bound.light[29]).mul(eye_z).max(L::splat(-5.0)).min(L::splat(30.0)).neg())).mul(column_m));
    }
    let t_2 = depth;
    return L::splat(1.0).sub(exp(t_2.neg()));
}

#[inline(always)]
pub fn air_rgb<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, direction: [L; 3]) -> [L; 3] {
    let mut forward: L = L::splat(0.0);
    if !bound.overrides.with_fog {
        return [number::<L>(bound.light[24]), number::<L>(bound.light[25]), number::<L>(bound.light[26])];
    }
    forward = dot(direction, [number::<L>(bound.light[0]), number::<L>(bound.light[1]), number::<L>(bound.light[2])]).max(L::splat(0.0));
    let t = forward;
    let t_2 = forward;
    forward = t.mul(t_2);
    let t_3 = forward;
    let t_4 = forward;
    forward = t_3.mul(t_4);
    let t_5 = forward;
    let t_6 = forward;
    let t_7 = [number::<L>(bound.light[24]), number::<L>(bound.light[25]), number::<L>(bound.light[26])];
    let t_8 = [number::<L>(bound.light[4]), number::<L>(bound.light[5]), number::<L>(bound.light[6])];
    let t_9 = number::<L>(bound.light[31]).mul(t_5).mul(t_6);
    let t_10 = [t_8[0].mul(t_9), t_8[1].mul(t_9), t_8[2].mul(t_9)];
    return [t_7[0].add(t_10[0]), t_7[1].add(t_10[1]), t_7[2].add(t_10[2])];
}

#[inline(always)]
pub fn sky_radiance<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, direction: [L; 3]) -> [L; 3] {
    let mut rgb: [L; 3] = [L::splat(0.0); 3];
    let mut glow: L = L::splat(0.0);
    let t = sky_sample::<L, M>(bound, direction, L::splat(0.0));
    rgb = t;
    let towards = dot(direction, [number::<L>(bound.light[0]), number::<L>(bound.light[1]), number::<L>(bound.light[2])]);
    let disc = smoothstep(number::<L>(bound.light[3]), number::<L>(bound.light[3]).add(L::splat(1e-5)), towards);
    glow = towards.sub(L::splat(0.995)).mul(L::splat(200.0)).max(L::splat(0.0));
    let t_2 = glow;
    let t_3 = glow;
    glow = t_2.mul(t_3);
    let t_4 = glow;
    let t_5 = glow;
    glow = t_4.mul(t_5).mul(L::splat(0.02));
    let t_6 = rgb;
    let t_7 = glow;
    let t_8 = glow;
    let t_9 = [number::<L>(bound.light[4]), number::<L>(bound.light[5]), number::<L>(bound.light[6])];
    let t_10 = number::<L>(bound.light[7]).mul(disc).add(t_7.mul(t_8));
    let t_11 = [t_9[0].mul(t_10), t_9[1].mul(t_10), t_9[2].mul(t_10)];
    rgb = [t_6[0].add(t_11[0]), t_6[1].add(t_11[1]), t_6[2].add(t_11[2])];
    let t_12 = rgb;
    let t_13 = [number::<L>(bound.light[24]), number::<L>(bound.light[25]), number::<L>(bound.light[26])];
    let t_14 = L::splat(0.75);
    let t_15 = [t_13[0].mul(t_14), t_13[1].mul(t_14), t_13[2].mul(t_14)];
    let t_16 = direction[2].neg().mul(L::splat(12.0)).max(L::splat(0.0)).min(L::splat(1.0));
    rgb = [mix(t_12[0], t_15[0], t_16), mix(t_12[1], t_15[1], t_16), mix(t_12[2], t_15[2], t_16)];
    if bound.overrides.with_fog {
        let t_17 = rgb;
        let t_18 = air_rgb::<L, M>(bound, direction);
        let t_19 = haze::<L, M>(bound, direction[2], number::<L>(bound.light[30]).div(direction[2].max(L::splat(0.0)).add(L::splat(0.03))));
        rgb = [mix(t_17[0], t_18[0], t_19), mix(t_17[1], t_18[1], t_19), mix(t_17[2], t_18[2], t_19)];
    }
    let t_20 = rgb;
    return t_20;
}

#[inline(always)]
pub fn noise<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, at: [L; 2], level: L) -> [L; 4] {
    let t = L::splat(0.00390625);
    let t_2 = bound.maps.noise_map_sampled([at[0].mul(t), at[1].mul(t)], level);
    return t_2;
}

#[inline(always)]
pub fn rain_over<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, radiance: [L; 3], direction: [L; 3], distance_m: L) -> [L; 3] {
    let mut streaks: L = L::splat(0.0);
    let mut curtain: L::Words = word::<L>(0i32 as u32);
    if !bound.overrides.with_wet {
        return radiance;
    }
    let around = atan2(direction[1], direction[0]).mul(L::splat(0.15915494));
    let up = direction[2].mul(inverse_sqrt(L::splat(1.0).sub(direction[2].mul(direction[2])).max(L::splat(0.001))));
    let mut on = lanes;
    while L::any(on) {
        let m = on;
        let t = curtain;
        let t_2 = t.lt_signed(word::<L>(3i32 as u32));
        let m_2 = L::and(m, L::not(t_2));
        on = L::and(on, L::not(m_2));
        let m_3 = L::and(m, on);
        if L::any(m_3) {
            let t_3 = curtain;
            let away_m = L::splat(2.0).add(L::splat(3.5).mul(t_3.from_signed()));
            let across = around.mul(L::splat(6.2831855)).mul(away_m).add(number::<L>(bound.light[37]).mul(up).mul(away_m));
            let t_4 = curtain;
            let at = [across.mul(L::splat(62.0)), up.mul(away_m).add(number::<L>(bound.light[38]).mul(L::splat(8.0))).mul(L::splat(1.1)).add(t_4.from_signed().mul(L::splat(37.0)))];
            let t_5 = noise::<L, M>(bound, at, L::splat(0.0));
            let drop = t_5[2];
            let t_6 = streaks;
            let t_7 = curtain;
            let t_8 = t_6.add(smoothstep(L::splat(1.0).sub(L::splat(0.26).mul(number::<L>(bound.light[36]))), L::splat(1.02), drop).mul(number_of::<L>(away_m.lt(distance_m))).mul(L::splat(0.6).sub(L::splat(0.12).mul(t_7.from_signed()))));
            streaks = L::select(m_3, t_8, streaks);
        }
        let t_9 = curtain;
        let t_10 = t_9.add(word::<L>(1i32 as u32));
        curtain = <L::Words>::select(on, t_10, curtain);
    }
    let t_11 = [number::<L>(bound.light[8]), number::<L>(bound.light[9]), number::<L>(bound.light[10])];
    let t_12 = L::splat(0.3);
    let t_13 = [t_11[0].mul(t_12), t_11[1].mul(t_12), t_11[2].mul(t_12)];
    let t_14 = [number::<L>(bound.light[24]), number::<L>(bound.light[25]), number::<L>(bound.light[26])];
    let t_15 = L::splat(0.25);
    let t_16 = [t_14[0].mul(t_15), t_14[1].mul(t_15), t_14[2].mul(t_15)];
    let seen = [t_13[0].add(t_16[0]), t_13[1].add(t_16[1]), t_13[2].add(t_16[2])];
    let t_17 = streaks;
    let t_18 = t_17.mul(number::<L>(bound.light[36])).max(L::splat(0.0)).min(L::splat(0.45));
    return [mix(radiance[0], seen[0], t_18), mix(radiance[1], seen[1], t_18), mix(radiance[2], seen[2], t_18)];
}

#[inline(always)]
pub fn linear_of<L: Lanes>(packed: L::Words) -> [L; 3] {
    let t = unpack_4x8_unorm::<L>(packed);
    let s = [t[0], t[1], t[2]];
    let t_2 = L::splat(0.30530602);
    let t_3 = [s[0].mul(t_2), s[1].mul(t_2), s[2].mul(t_2)];
    let t_4 = [L::splat(0.6821711); 3];
    let t_5 = [t_3[0].add(t_4[0]), t_3[1].add(t_4[1]), t_3[2].add(t_4[2])];
    let t_6 = [s[0].mul(t_5[0]), s[1].mul(t_5[1]), s[2].mul(t_5[2])];
    let t_7 = [L::splat(0.012522878); 3];
    let t_8 = [t_6[0].add(t_7[0]), t_6[1].add(t_7[1]), t_6[2].add(t_7[2])];
    return [s[0].mul(t_8[0]), s[1].mul(t_8[1]), s[2].mul(t_8[2])];
}

#[inline(always)]
pub fn lot_of<L: Lanes>(number_2: L::Words) -> [L; 4] {
    let state = number_2.mul(word::<L>(747796405)).add(word::<L>(2891336453));
    let word_2 = state.shr(state.shr(word::<L>(28)).add(word::<L>(4))).xor(state).mul(word::<L>(277803737));
    return unpack_4x8_unorm::<L>(word_2.shr(word::<L>(22)).xor(word_2));
}

#[inline(always)]
pub fn style_of<L: Lanes>(id: L::Words, shop: L::Mask) -> Style<L> {
    let mut out: Style<L> = Style::<L> { pitch_m: [L::splat(0.0); 2], share: [L::splat(0.0); 2], n_parts: [L::splat(0.0); 2], brick: L::splat(0.0), panels: L::splat(0.0), courses: L::splat(0.0), pipes: L::splat(0.0), pale: L::splat(0.0), board: [L::splat(0.0); 3] };
    let lot = lot_of::<L>(id);
    let t = L::splat(21.25);
    let t_2 = [lot[0].mul(t), lot[1].mul(t), lot[2].mul(t), lot[3].mul(t)];
    let more = [fract(t_2[0]), fract(t_2[1]), fract(t_2[2]), fract(t_2[3])];
    let house = number_of::<L>(L::not(shop));
    let t_3 = [L::splat(4.2), L::splat(3.6)];
    let t_4 = [L::splat(2.6).add(L::splat(1.4).mul(lot[2])), L::splat(3.1)];
    out.pitch_m = [L::select(shop, t_3[0], t_4[0]), L::select(shop, t_3[1], t_4[1])];
    let t_5 = [L::splat(0.88), L::splat(0.74)];
    let t_6 = [L::splat(0.36).add(L::splat(0.3).mul(lot[3])), L::splat(0.46).add(L::splat(0.14).mul(more[2]))];
    out.share = [L::select(shop, t_5[0], t_6[0]), L::select(shop, t_5[1], t_6[1])];
    let t_7 = [L::splat(3.0), L::splat(1.0)];
    let t_8 = [L::splat(1.0).add(more[0].mul(L::splat(2.99)).floor()), L::splat(1.0).add(more[1].mul(L::splat(2.4)).floor())];
    out.n_parts = [L::select(shop, t_7[0], t_8[0]), L::select(shop, t_7[1], t_8[1])];
    out.brick = number_of::<L>(lot[0].lt(L::splat(0.5))).mul(house);
    out.panels = number_of::<L>(L::splat(0.82).lt(lot[0])).mul(house);
    out.courses = number_of::<L>(more[3].lt(L::splat(0.6))).mul(house);
    out.pipes = number_of::<L>(L::splat(0.4).lt(more[2])).mul(house);
    out.pale = L::splat(0.3).add(L::splat(0.6).mul(lot[1]).mul(lot[1]));
    let t_9 = [L::splat(0.04); 3];
    let t_10 = L::splat(0.3);
    let t_11 = [more[0], more[1], more[2]];
    let t_12 = [t_10.mul(t_11[0]), t_10.mul(t_11[1]), t_10.mul(t_11[2])];
    out.board = [t_9[0].add(t_12[0]), t_9[1].add(t_12[1]), t_9[2].add(t_12[2])];
    let t_13 = out;
    return t_13;
}

#[inline(always)]
pub fn grain_of<L: Lanes>(pixel_m: L) -> Grain<L> {
    let px_per_m = L::splat(1.0).div(pixel_m.add(L::splat(0.004)));
    return Grain::<L> { px_per_m: px_per_m, sharp_per_m: L::splat(1.4).mul(px_per_m) };
}

#[inline(always)]
pub fn band<L: Lanes>(at_m: L, low_m: L, high_m: L, sharp_per_m: L) -> L {
    let half_m = L::splat(0.5).mul(high_m.sub(low_m));
    return half_m.sub(at_m.sub(low_m).sub(half_m).abs()).mul(sharp_per_m).add(L::splat(0.5)).max(L::splat(0.0)).min(L::splat(1.0));
}

#[inline(always)]
pub fn window_at<L: Lanes>(uv_m: [L; 2], style: Style<L>, grain: Grain<L>, shop: L::Mask, id: L::Words) -> Window<L> {
    let mut out: Window<L> = Window::<L> { pane: L::splat(0.0), frame: L::splat(0.0), shade: L::splat(0.0), place: [L::splat(0.0); 2], in_cell: [L::splat(0.0); 2], lot: [L::splat(0.0); 4] };
    let sharp = grain.sharp_per_m;
    let fine = L::splat(0.5).mul(grain.px_per_m).sub(L::splat(0.5)).max(L::splat(0.0)).min(L::splat(1.0));
    let size_m = [style.share[0].mul(style.pitch_m[0]), style.share[1].mul(style.pitch_m[1])];
    let grid = [uv_m[0].div(style.pitch_m[0]), uv_m[1].div(style.pitch_m[1])];
    let cell = [grid[0].floor(), grid[1].floor()];
    out.in_cell = [grid[0].sub(cell[0]), grid[1].sub(cell[1])];
    let t = out.in_cell;
    let t_2 = [L::splat(0.5), L::select(shop, L::splat(0.45), L::splat(0.52))];
    let t_3 = [t[0].sub(t_2[0]), t[1].sub(t_2[1])];
    let off_m = [t_3[0].mul(style.pitch_m[0]), t_3[1].mul(style.pitch_m[1])];
    let t_4 = L::splat(0.5);
    let t_5 = [t_4.mul(size_m[0]), t_4.mul(size_m[1])];
    let t_6 = [off_m[0].abs(), off_m[1].abs()];
    let within_m = [t_5[0].sub(t_6[0]), t_5[1].sub(t_6[1])];
    let t_7 = [off_m[0].div(size_m[0]), off_m[1].div(size_m[1])];
    let t_8 = [L::splat(0.5); 2];
    out.place = [t_7[0].add(t_8[0]), t_7[1].add(t_8[1])];
    let t_9 = [within_m[0].mul(sharp), within_m[1].mul(sharp)];
    let t_10 = [L::splat(0.5); 2];
    let t_11 = [t_9[0].add(t_10[0]), t_9[1].add(t_10[1])];
    let t_12 = [L::splat(0.0); 2];
    let t_13 = [L::splat(1.0); 2];
    let opened = [t_11[0].max(t_12[0]).min(t_13[0]), t_11[1].max(t_12[1]).min(t_13[1])];
    let open = opened[0].mul(opened[1]);
    let t_14 = out.place;
    let t_15 = [L::splat(0.5); 2];
    let t_16 = [t_14[0].mul(style.n_parts[0]), t_14[1].mul(style.n_parts[1])];
    let t_17 = [fract(t_16[0]), fract(t_16[1])];
    let t_18 = [L::splat(0.5); 2];
    let t_19 = [t_17[0].sub(t_18[0]), t_17[1].sub(t_18[1])];
    let t_20 = [t_19[0].abs(), t_19[1].abs()];
    let t_21 = [t_15[0].sub(t_20[0]), t_15[1].sub(t_20[1])];
    let t_22 = [size_m[0].div(style.n_parts[0]), size_m[1].div(style.n_parts[1])];
    let parts = [t_21[0].mul(t_22[0]), t_21[1].mul(t_22[1])];
    let t_23 = [L::splat(0.04), L::splat(0.035)];
    let t_24 = [parts[0].sub(t_23[0]), parts[1].sub(t_23[1])];
    let t_25 = [t_24[0].mul(sharp), t_24[1].mul(sharp)];
    let t_26 = [L::splat(0.5); 2];
    let t_27 = [t_25[0].add(t_26[0]), t_25[1].add(t_26[1])];
    let t_28 = [L::splat(0.0); 2];
    let t_29 = [L::splat(1.0); 2];
    let glass = [t_27[0].max(t_28[0]).min(t_29[0]), t_27[1].max(t_28[1]).min(t_29[1])];
    let below_m = L::splat(-0.5).mul(size_m[1]).sub(off_m[1]);
    let beside = within_m[0].add(L::splat(0.07)).mul(sharp).add(L::splat(0.5)).max(L::splat(0.0)).min(L::splat(1.0));
    let pane = open.mul(glass[0]).mul(glass[1]);
    out.pane = mix(L::splat(0.8).mul(style.share[0]).mul(style.share[1]), pane, fine);
    let t_30 = band::<L>(below_m, L::splat(0.0), L::splat(0.08), sharp);
    out.frame = open.sub(pane).max(t_30.mul(beside)).mul(fine);
    let recess = L::splat(1.0).sub(L::splat(0.6).mul(L::splat(1.4).sub(L::splat(0.5).mul(size_m[1]).sub(off_m[1]).mul(L::splat(6.25))).max(L::splat(0.0)).min(L::splat(1.0)))).mul(L::splat(1.0).sub(L::splat(0.45).mul(L::splat(1.3).sub(L::splat(0.5).mul(size_m[0]).add(off_m[0]).mul(L::splat(11.0))).max(L::splat(0.0)).min(L::splat(1.0)))));
    let t_31 = band::<L>(below_m, L::splat(0.08), L::splat(0.17), sharp);
    let t_32 = band::<L>(below_m, L::splat(0.08), L::splat(0.75), sharp);
    let under = L::splat(1.0).sub(L::splat(0.36).mul(t_31).add(L::splat(0.1).mul(t_32)).mul(beside));
    out.shade = mix(L::splat(1.0), mix(under, recess, open), fine);
    let t_33 = [cell[0].to_signed(), cell[1].to_signed()];
    let column_row = [t_33[0], t_33[1]];
    let t_34 = lot_of::<L>(id.mul(word::<L>(64)).add(column_row[0]).add(column_row[1].mul(word::<L>(1597))));
    out.lot = t_34;
    let t_35 = out;
    return t_35;
}

#[inline(always)]
pub fn masonry<L: Lanes>(uv_m: [L; 2], style: Style<L>, window: Window<L>, grain: Grain<L>, shop: L::Mask) -> L {
    let mut out: L = L::splat(0.0);
    let sharp = grain.sharp_per_m;
    let coarse = L::splat(0.4).mul(grain.px_per_m).sub(L::splat(0.5)).max(L::splat(0.0)).min(L::splat(1.0));
    let course = uv_m[1].mul(L::splat(13.333333));
    let row = course.floor();
    let along = uv_m[0].mul(L::splat(4.444444)).add(row.mul(L::splat(0.5)));
    let t = [along, course];
    let brick = [fract(t[0]), fract(t[1])];
    let t_2 = [L::splat(0.5); 2];
    let t_3 = [L::splat(0.5); 2];
    let t_4 = [brick[0].sub(t_3[0]), brick[1].sub(t_3[1])];
    let t_5 = [t_4[0].abs(), t_4[1].abs()];
    let t_6 = [t_2[0].sub(t_5[0]), t_2[1].sub(t_5[1])];
    let t_7 = [L::splat(0.225), L::splat(0.075)];
    let brick_m = [t_6[0].mul(t_7[0]), t_6[1].mul(t_7[1])];
    let joint = L::splat(1.0).sub(brick_m[0].min(brick_m[1]).sub(L::splat(0.006)).mul(sharp).add(L::splat(0.5)).max(L::splat(0.0)).min(L::splat(1.0)));
    let shade_2 = fract(along.sub(brick[0]).mul(L::splat(0.7548777)).add(row.mul(L::splat(0.5698403))).add(L::splat(0.37).mul(fract(row.mul(L::splat(0.1371))))));
    let near = style.brick.mul(L::splat(0.05).mul(grain.px_per_m).sub(L::splat(0.5)).max(L::splat(0.0)).min(L::splat(1.0)));
    out = L::splat(1.0).add(near.mul(L::splat(0.5).mul(shade_2.sub(L::splat(0.5))).add(joint.mul(L::splat(0.35)))));
    let t_8 = [L::splat(0.5); 2];
    let t_9 = [L::splat(0.5); 2];
    let t_10 = [window.in_cell[0].sub(t_9[0]), window.in_cell[1].sub(t_9[1])];
    let t_11 = [t_10[0].abs(), t_10[1].abs()];
    let t_12 = [t_8[0].sub(t_11[0]), t_8[1].sub(t_11[1])];
    let rim_m = [t_12[0].mul(style.pitch_m[0]), t_12[1].mul(style.pitch_m[1])];
    let t_13 = out;
    out = t_13.mul(L::splat(1.0).sub(L::splat(0.5).mul(style.panels).mul(coarse).mul(L::splat(1.0).sub(rim_m[0].min(rim_m[1]).sub(L::splat(0.012)).mul(sharp).add(L::splat(0.5)).max(L::splat(0.0)).min(L::splat(1.0))))));
    let storey_m = window.in_cell[1].mul(style.pitch_m[1]);
    let t_14 = out;
    let t_15 = band::<L>(storey_m, L::splat(0.07), L::splat(0.24), sharp);
    let t_16 = band::<L>(storey_m, L::splat(0.0), L::splat(0.07), sharp);
    out = t_14.mul(L::splat(1.0).add(style.courses.mul(coarse).mul(L::splat(0.16).mul(t_15).sub(L::splat(0.45).mul(t_16)))));
    let t_17 = out;
    let t_18 = band::<L>(uv_m[1], L::splat(0.55), L::splat(0.6), sharp);
    out = t_17.mul(L::splat(1.0).sub(L::select(shop, L::splat(0.0), L::splat(0.3)).mul(L::splat(0.55).sub(uv_m[1]).mul(sharp).add(L::splat(0.5)).max(L::splat(0.0)).min(L::splat(1.0)))).sub(L::splat(0.3).mul(coarse).mul(t_18)));
    let pipe_m = fract(uv_m[0].mul(L::splat(0.083)).add(style.pale)).mul(L::splat(12.05));
    let pipe = style.pipes.mul(coarse);
    let t_19 = out;
    let t_20 = band::<L>(pipe_m, L::splat(0.02), L::splat(0.13), sharp);
    let t_21 = band::<L>(pipe_m, L::splat(0.13), L::splat(0.19), sharp);
    out = mix(t_19, L::splat(0.5).add(L::splat(5.0).mul(pipe_m)), pipe.mul(t_20)).mul(L::splat(1.0).sub(L::splat(0.35).mul(pipe).mul(t_21)));
    let t_22 = out;
    return t_22.max(L::splat(0.0));
}

#[inline(always)]
pub fn as_switched<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, id: L::Words, rgb: [L; 3], share: L) -> [L; 4] {
    let mut result = [L::splat(0.0); 4];
    let mut done = L::mask(false);
    let mut v: L::Mask = L::mask(false);
    if !!bound.overrides.with_switched {
        v = id.shr(word::<L>(31)).eq(word::<L>(0));
    } else {
        v = L::mask(true);
    }
    let t = v;
    let m = L::and(lanes, t);
    if L::any(m) {
        let t_2 = [rgb[0], rgb[1], rgb[2], share];
        result = zip4(t_2, result, |a, b| L::select(m, a, b));
        done = L::or(done, m);
    }
    let m_2 = L::and(lanes, L::not(done));
    if L::any(m_2) {
        let at = id.and(word::<L>(2147483647)).min_unsigned(word::<L>((bound.switched.len() / 2) as u32).sub(word::<L>(1))).mul(word::<L>(2));
        let words = [words_at::<L>(bound.switched, at, 0), words_at::<L>(bound.switched, at, 1)];
        let state = words[0].shr(word::<L>(25)).and(word::<L>(3));
        let t_3 = linear_of::<L>(words[0]);
        let t_4 = words[0].shr(word::<L>(24)).and(word::<L>(1)).eq(word::<L>(1));
        let color = [L::select(t_4, t_3[0], rgb[0]), L::select(t_4, t_3[1], rgb[1]), L::select(t_4, t_3[2], rgb[2])];
        let t_5 = words[1].to_numbers();
        let t_6 = [color[0].mul(t_5), color[1].mul(t_5), color[2].mul(t_5)];
        let t_7 = [t_6[0], t_6[1], t_6[2], L::select(L::not(state.eq(word::<L>(0))), number_of::<L>(state.eq(word::<L>(1))), share)];
        return zip4(result, t_7, |a, b| L::select(done, a, b));
    }
    result
}

#[inline(always)]
pub fn wall_at<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, albedo: [L; 3], uv_m: [L; 2], id: L::Words, pixel_m: L, is_shop: L::Mask, is_wall: L) -> Wall<L> {
    let mut out: Wall<L> = Wall::<L> { albedo: [L::splat(0.0); 3], pane: L::splat(0.0), glow: L::splat(0.0), cool: L::splat(0.0) };
    let mut seen: [L; 3] = [L::splat(0.0); 3];
    let mut v: L::Mask = L::mask(false);
    let mut v_2: L::Mask = L::mask(false);
    let mut v_3: L::Mask = L::mask(false);
    let mut v_4: L::Mask = L::mask(false);
    let mut shown: [L; 3] = [L::splat(0.0); 3];
    let mut v_5: L::Mask = L::mask(false);
    let mut v_6: L::Mask = L::mask(false);
    let mut room: [L; 3] = [L::splat(0.0); 3];
    let style = style_of::<L>(id, is_shop);
    let grain = grain_of::<L>(pixel_m);
    let window = window_at::<L>(uv_m, style, grain, is_shop, id);
    out.pane = window.pane.mul(is_wall);
    let foot = L::splat(0.72).add(L::splat(0.28).mul(uv_m[1].mul(L::splat(0.4)).max(L::splat(0.0)).min(L::splat(1.0))));
    let t = masonry::<L>(uv_m, style, window, grain, is_shop);
    let t_2 = foot.mul(t);
    seen = [albedo[0].mul(t_2), albedo[1].mul(t_2), albedo[2].mul(t_2)];
    let shop = number_of::<L>(is_shop);
    let t_3 = seen;
    let t_4 = band::<L>(uv_m[1], L::splat(2.98), L::splat(3.5), grain.sharp_per_m);
    let t_5 = shop.mul(t_4);
    seen = [mix(t_3[0], style.board[0], t_5), mix(t_3[1], style.board[1], t_5), mix(t_3[2], style.board[2], t_5)];
    let t_6 = seen;
    let t_7 = [L::splat(0.62), L::splat(0.6), L::splat(0.56)];
    let t_8 = [t_7[0].mul(style.pale), t_7[1].mul(style.pale), t_7[2].mul(style.pale)];
    seen = [mix(t_6[0], t_8[0], window.frame), mix(t_6[1], t_8[1], window.frame), mix(t_6[2], t_8[2], window.frame)];
    let lot = window.lot;
    let t_9 = L::splat(0.4).lt(lot[0]);
    v = L::and(t_9, L::splat(0.2).add(L::splat(0.25).mul(lot[1])).lt(window.place[0].sub(L::splat(0.5)).abs()));
    let t_10 = v;
    let curtain = L::splat(1.0).sub(shop).mul(number_of::<L>(t_10));
    let t_11 = L::splat(0.72).lt(lot[2]);
    v_2 = L::and(t_11, lot[1].lt(window.place[1]));
    let t_12 = v_2;
    let blind = L::splat(1.0).sub(shop).mul(number_of::<L>(t_12));
    let fine = L::splat(0.25).mul(grain.px_per_m).sub(L::splat(0.5)).max(L::splat(0.0)).min(L::splat(1.0));
    let pane_at = window.place[0].mul(style.n_parts[0]);
    let in_pane = fract(pane_at);
    let t_13 = [pane_at.sub(in_pane).mul(L::splat(0.381966)); 3];
    let t_14 = [lot[0], lot[1], lot[2]];
    let t_15 = [t_13[0].add(t_14[0]), t_13[1].add(t_14[1]), t_13[2].add(t_14[2])];
    let own = [fract(t_15[0]), fract(t_15[1]), fract(t_15[2])];
    let good = uv_m[0].mul(L::splat(1.6).add(L::splat(2.2).mul(lot[1])));
    let in_good = fract(good);
    let t_16 = good.sub(in_good);
    let t_17 = [L::splat(0.7548777), L::splat(0.5698403), L::splat(0.381966)];
    let t_18 = [t_16.mul(t_17[0]), t_16.mul(t_17[1]), t_16.mul(t_17[2])];
    let t_19 = [lot[1], lot[2], lot[0]];
    let t_20 = [t_18[0].add(t_19[0]), t_18[1].add(t_19[1]), t_18[2].add(t_19[2])];
    let look = [fract(t_20[0]), fract(t_20[1]), fract(t_20[2])];
    let up_m = uv_m[1].sub(L::splat(0.62));
    let goods = number_of::<L>(in_good.sub(L::splat(0.5)).abs().lt(L::splat(0.46).sub(L::splat(0.26).mul(up_m.sub(L::splat(0.3).mul(look[1])).max(L::splat(0.0)).min(L::splat(1.0)))))).mul(number_of::<L>(up_m.lt(L::splat(0.12).add(L::splat(1.1).mul(look[0]).mul(look[0]))))).mul(number_of::<L>(L::splat(0.0).lt(up_m)));
    let back = mix(L::splat(0.035), L::splat(0.075), lot[0]).mul(L::splat(0.35).add(L::splat(0.9).mul(window.place[1].max(L::splat(0.0)).min(L::splat(1.0)))));
    let tubes = number_of::<L>(L::splat(0.86).lt(window.place[1])).mul(number_of::<L>(fract(uv_m[0].mul(L::splat(0.9)).add(lot[2])).sub(L::splat(0.5)).abs().lt(L::splat(0.3))));
    let t_21 = [in_pane.sub(L::splat(0.5)), window.place[1].sub(L::splat(0.42))];
    let t_22 = [t_21[0].abs(), t_21[1].abs()];
    let t_23 = [L::splat(1.0), L::splat(0.9)];
    let poster_at = [t_22[0].mul(t_23[0]), t_22[1].mul(t_23[1])];
    let t_24 = L::splat(0.66).lt(own[0]);
    v_3 = L::and(t_24, poster_at[0].lt(L::splat(0.3)));
    let t_25 = v_3;
    v_4 = L::and(t_25, poster_at[1].lt(L::splat(0.24)));
    let t_26 = v_4;
    let poster = number_of::<L>(t_26);
    let t_27 = [back; 3];
    let t_28 = [L::splat(1.05), L::splat(1.0), L::splat(0.9)];
    shown = [t_27[0].mul(t_28[0]), t_27[1].mul(t_28[1]), t_27[2].mul(t_28[2])];
    let t_29 = shown;
    let t_30 = [look[2]; 3];
    let t_31 = L::splat(0.5);
    let t_32 = [mix(t_30[0], look[0], t_31), mix(t_30[1], look[1], t_31), mix(t_30[2], look[2], t_31)];
    let t_33 = L::splat(0.03).add(L::splat(0.2).mul(look[1]));
    let t_34 = [t_32[0].mul(t_33), t_32[1].mul(t_33), t_32[2].mul(t_33)];
    let t_35 = goods.mul(fine);
    shown = [mix(t_29[0], t_34[0], t_35), mix(t_29[1], t_34[1], t_35), mix(t_29[2], t_34[2], t_35)];
    let t_36 = shown;
    let t_37 = up_m.lt(L::splat(0.0));
    v_5 = L::and(t_37, L::splat(-0.3).lt(up_m));
    let t_38 = v_5;
    let t_39 = [L::splat(0.11), L::splat(0.1), L::splat(0.09)];
    let t_40 = number_of::<L>(t_38);
    shown = [mix(t_36[0], t_39[0], t_40), mix(t_36[1], t_39[1], t_40), mix(t_36[2], t_39[2], t_40)];
    let t_41 = shown;
    let t_42 = [L::splat(0.42), L::splat(0.41), L::splat(0.38)];
    let t_43 = tubes.mul(L::splat(0.25).add(L::splat(0.5).mul(lot[3])));
    shown = [mix(t_41[0], t_42[0], t_43), mix(t_41[1], t_42[1], t_43), mix(t_41[2], t_42[2], t_43)];
    let headline = number_of::<L>(poster_at[1].sub(L::splat(0.12)).abs().lt(L::splat(0.05)));
    let t_44 = shown;
    let t_45 = poster_at[0].lt(L::splat(0.16));
    v_6 = L::and(t_45, poster_at[1].lt(L::splat(0.04)));
    let t_46 = v_6;
    let t_47 = [L::splat(0.36), L::splat(0.35), L::splat(0.33)];
    let t_48 = L::splat(0.3);
    let t_49 = [t_48.mul(own[0]), t_48.mul(own[1]), t_48.mul(own[2])];
    let t_50 = [t_49[0].mul(own[0]), t_49[1].mul(own[1]), t_49[2].mul(own[2])];
    let t_51 = headline.max(number_of::<L>(t_46));
    let t_52 = [mix(t_47[0], t_50[0], t_51), mix(t_47[1], t_50[1], t_51), mix(t_47[2], t_50[2], t_51)];
    let t_53 = poster.mul(fine);
    shown = [mix(t_44[0], t_52[0], t_53), mix(t_44[1], t_52[1], t_53), mix(t_44[2], t_52[2], t_53)];
    let t_54 = shown;
    let t_55 = [L::splat(0.018), L::splat(0.02), L::splat(0.024)];
    room = [L::select(is_shop, t_54[0], t_55[0]), L::select(is_shop, t_54[1], t_55[1]), L::select(is_shop, t_54[2], t_55[2])];
    let t_56 = room;
    let t_57 = [L::splat(0.34), L::splat(0.32), L::splat(0.28)];
    let t_58 = L::splat(0.4).add(L::splat(0.6).mul(lot[1]));
    let t_59 = [t_57[0].mul(t_58), t_57[1].mul(t_58), t_57[2].mul(t_58)];
    let t_60 = L::splat(0.7).mul(curtain).max(blind);
    room = [mix(t_56[0], t_59[0], t_60), mix(t_56[1], t_59[1], t_60), mix(t_56[2], t_59[2], t_60)];
    let t_61 = seen;
    let t_62 = room;
    seen = [mix(t_61[0], t_62[0], window.pane), mix(t_61[1], t_62[1], window.pane), mix(t_61[2], t_62[2], window.pane)];
    let t_63 = seen;
    let t_64 = [t_63[0].mul(window.shade), t_63[1].mul(window.shade), t_63[2].mul(window.shade)];
    out.albedo = [mix(albedo[0], t_64[0], is_wall), mix(albedo[1], t_64[1], is_wall), mix(albedo[2], t_64[2], is_wall)];
    out.cool = number_of::<L>(L::splat(0.8).lt(lot[3]));
    let t_65 = as_switched::<L, M>(bound, lanes, id, [L::splat(1.0); 3], number::<L>(bound.light[45]));
    let share = t_65[3].mul(L::select(is_shop, L::splat(0.8), L::splat(0.34)));
    let floor_up = fract(uv_m[1].div(L::select(is_shop, L::splat(3.6), L::splat(3.1))));
    let t_66 = out.pane;
    out.glow = t_66.mul(number_of::<L>(lot[2].lt(share))).mul(L::splat(0.12).add(L::splat(0.88).mul(lot[3]).mul(lot[1]))).mul(L::splat(0.45).add(L::splat(0.9).mul(floor_up)));
    let t_67 = out;
    return t_67;
}

#[inline(always)]
pub fn window_light<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, wall: Wall<L>, id: L::Words) -> [L; 3] {
    let t = [L::splat(1.0), L::splat(0.62), L::splat(0.3)];
    let t_2 = [L::splat(0.85), L::splat(0.92), L::splat(1.0)];
    let own = [mix(t[0], t_2[0], wall.cool), mix(t[1], t_2[1], wall.cool), mix(t[2], t_2[2], wall.cool)];
    let t_3 = as_switched::<L, M>(bound, lanes, id, own, number::<L>(bound.light[45]));
    let t_4 = [t_3[0], t_3[1], t_3[2]];
    let t_5 = number::<L>(bound.light[47]).mul(wall.glow);
    return [t_4[0].mul(t_5), t_4[1].mul(t_5), t_4[2].mul(t_5)];
}

#[inline(always)]
pub fn normal_of<L: Lanes>(packed: L::Words) -> [L; 3] {
    let t = [packed.and(word::<L>(2047)), packed.shr(word::<L>(11)).and(word::<L>(2047)), packed.shr(word::<L>(22))];
    let n = [t[0].from_unsigned(), t[1].from_unsigned(), t[2].from_unsigned()];
    let t_2 = [L::splat(0.0009775171), L::splat(0.0009775171), L::splat(0.0019569471)];
    let t_3 = [n[0].mul(t_2[0]), n[1].mul(t_2[1]), n[2].mul(t_2[2])];
    let t_4 = [L::splat(1.0); 3];
    return normalize([t_3[0].sub(t_4[0]), t_3[1].sub(t_4[1]), t_3[2].sub(t_4[2])]);
}

#[inline(always)]
pub fn albedo_of<L: Lanes>(rgb: L::Words) -> [L; 3] {
    let t = linear_of::<L>(rgb);
    return t;
}

#[inline(always)]
pub fn wall_seen<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, albedo: [L; 3], uv_m: [L; 2], labels: [L::Words; 4], pixel_m: L, ground: L::Mask) -> Wall<L> {
    let mut v: L::Mask = L::mask(false);
    let material = labels[1].shr(word::<L>(8)).and(word::<L>(255));
    let is_shop = material.eq(word::<L>(5));
    let t = L::not(is_shop);
    v = L::or(L::not(t), material.eq(word::<L>(4)));
    let t_2 = v;
    let t_3 = wall_at::<L, M>(bound, lanes, albedo, uv_m, labels[0], pixel_m, is_shop, number_of::<L>(t_2).mul(number_of::<L>(L::not(ground))));
    return t_3;
}

#[inline(always)]
pub fn finish_at<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, world_m: [L; 3], normal: [L; 3], uv_m: [L; 2], labels: [L::Words; 4], pixel_m: L, cosine: L) -> Finish<L> {
    let mut base: [L; 4] = [L::splat(0.0); 4];
    let mut gloss: [L; 4] = [L::splat(0.0); 4];
    let mut out: Finish<L> = Finish::<L> { albedo: [L::splat(0.0); 3], emitted: [L::splat(0.0); 3], mirror: L::splat(0.0), rough: L::splat(0.0), through: L::splat(0.0), puddle: L::splat(0.0), film: L::splat(0.0) };
    let mut rough_at: [L; 2] = [L::splat(0.0); 2];
    let mut albedo: [L; 3] = [L::splat(0.0); 3];
    let mut v: L::Mask = L::mask(false);
    let mut v_2: L::Mask = L::mask(false);
    let mut v_3: L::Mask = L::mask(false);
    let id = labels[0];
    let material = labels[1].shr(word::<L>(8)).and(word::<L>(255));
    let lit_lamp = [labels[1].shr(word::<L>(16)).and(word::<L>(1)).from_unsigned(), labels[1].shr(word::<L>(17)).and(word::<L>(1)).from_unsigned()];
    if bound.overrides.simple {
        let look = look_of::<L, M>(bound, material);
        let t = unpack_4x8_unorm::<L>(look[0]);
        let t_2 = [L::splat(255.0), L::splat(2.0), L::splat(255.0), L::splat(2.0)];
        base = [t[0].mul(t_2[0]), t[1].mul(t_2[1]), t[2].mul(t_2[2]), t[3].mul(t_2[3])];
        let t_3 = unpack_4x8_unorm::<L>(look[1]);
        let t_4 = [L::splat(1.0), L::splat(5.0), L::splat(1.0), L::splat(1.0)];
        gloss = [t_3[0].mul(t_4[0]), t_3[1].mul(t_4[1]), t_3[2].mul(t_4[2]), t_3[3].mul(t_4[3])];
    } else {
        let t_5 = roughness_of::<L, M>(bound, material);
        base = t_5;
        let t_6 = mirror_of::<L, M>(bound, material);
        gloss = t_6;
    }
    let steep = [normal[0].abs(), normal[1].abs(), normal[2].abs()];
    let ground = steep[0].max(steep[1]).le(steep[2]);
    let t_7 = [world_m[0], world_m[1]];
    let t_8 = [L::select(steep[1].lt(steep[0]), world_m[1], world_m[0]), world_m[2]];
    let plane_m = [L::select(ground, t_7[0], t_8[0]), L::select(ground, t_7[1], t_8[1])];
    if bound.overrides.simple {
        let t_9 = base[0];
        let t_10 = noise::<L, M>(bound, [plane_m[0].mul(t_9), plane_m[1].mul(t_9)], L::splat(0.0));
        let seen = [t_10[0], t_10[1]];
        let t_11 = base[0];
        let t_12 = [L::splat(0.5); 2];
        let t_13 = [L::splat(0.5); 2];
        let t_14 = [seen[0].sub(t_13[0]), seen[1].sub(t_13[1])];
        let t_15 = [L::splat(1.6), L::splat(6.0)];
        let t_16 = L::splat(0.5).mul(pixel_m).mul(t_11);
        let t_17 = [L::splat(1.0), L::splat(0.25)];
        let t_18 = [t_16.mul(t_17[0]), t_16.mul(t_17[1])];
        let t_19 = [t_15[0].sub(t_18[0]), t_15[1].sub(t_18[1])];
        let t_20 = [L::splat(0.0); 2];
        let t_21 = [L::splat(1.0); 2];
        let t_22 = [t_19[0].max(t_20[0]).min(t_21[0]), t_19[1].max(t_20[1]).min(t_21[1])];
        let t_23 = [t_14[0].mul(t_22[0]), t_14[1].mul(t_22[1])];
        rough_at = [t_12[0].add(t_23[0]), t_12[1].add(t_23[1])];
    } else {
        let pixel_on_plane_m = pixel_m.mul(inverse_sqrt(cosine.max(L::splat(0.04))));
        let t_24 = base[0];
        let t_25 = base[0];
        let t_26 = noise::<L, M>(bound, [plane_m[0].mul(t_24), plane_m[1].mul(t_24)], log2(pixel_on_plane_m.mul(t_25)));
        rough_at[0] = t_26[0];
        let t_27 = base[2];
        let t_28 = base[2];
        let t_29 = [plane_m[0].mul(t_27), plane_m[1].mul(t_27)];
        let t_30 = [L::splat(57.0), L::splat(91.0)];
        let t_31 = noise::<L, M>(bound, [t_29[0].add(t_30[0]), t_29[1].add(t_30[1])], log2(pixel_on_plane_m.mul(t_28)));
        rough_at[1] = t_31[1];
    }
    let t_32 = albedo_of::<L>(labels[2]);
    let t_33 = base[1];
    let t_34 = rough_at[0];
    let t_35 = base[3];
    let t_36 = rough_at[1];
    let t_37 = L::splat(1.0).add(t_33.mul(t_34.sub(L::splat(0.5)))).add(t_35.mul(t_36.sub(L::splat(0.5)))).max(L::splat(0.0));
    albedo = [t_32[0].mul(t_37), t_32[1].mul(t_37), t_32[2].mul(t_37)];
    let row = world_m[1].mul(L::splat(2.5));
    let row_up = row.floor();
    let slab = [world_m[0].mul(L::splat(1.5625)).add(L::splat(0.5).mul(row_up)), row];
    let in_slab = [fract(slab[0]), fract(slab[1])];
    let t_38 = [L::splat(0.5); 2];
    let t_39 = [L::splat(0.5); 2];
    let t_40 = [in_slab[0].sub(t_39[0]), in_slab[1].sub(t_39[1])];
    let t_41 = [t_40[0].abs(), t_40[1].abs()];
    let t_42 = [t_38[0].sub(t_41[0]), t_38[1].sub(t_41[1])];
    let t_43 = [L::splat(0.64), L::splat(0.4)];
    let joint_m = [t_42[0].mul(t_43[0]), t_42[1].mul(t_43[1])];
    let fine = L::splat(0.07).div(pixel_m).sub(L::splat(0.5)).max(L::splat(0.0)).min(L::splat(1.0));
    let joint = L::splat(0.008).sub(joint_m[0].min(joint_m[1])).div(L::splat(0.6).mul(pixel_m).add(L::splat(0.004))).add(L::splat(0.5)).max(L::splat(0.0)).min(L::splat(1.0));
    let tone = fract(slab[0].sub(in_slab[0]).mul(L::splat(0.734375)).add(row_up.mul(L::splat(0.578125))).add(L::splat(0.37).mul(fract(row_up.mul(L::splat(0.1796875))))));
    let t_44 = albedo;
    let t_45 = material.eq(word::<L>(2));
    v = L::and(t_45, ground);
    let t_46 = v;
    let t_47 = L::splat(1.0).add(L::select(t_46, fine.mul(L::splat(0.26).mul(tone.sub(L::splat(0.5))).sub(L::splat(0.5).mul(joint))), L::splat(0.0)));
    albedo = [t_44[0].mul(t_47), t_44[1].mul(t_47), t_44[2].mul(t_47)];
    let t_48 = albedo;
    let t_49 = gloss[2];
    let t_50 = L::splat(1.0).sub(L::splat(0.9).mul(t_49).mul(L::splat(1.0).sub(normal[2])));
    albedo = [t_48[0].mul(t_50), t_48[1].mul(t_50), t_48[2].mul(t_50)];
    let t_51 = albedo;
    let wall = wall_seen::<L, M>(bound, lanes, t_51, uv_m, labels, pixel_m, ground);
    albedo = wall.albedo;
    let pane = wall.pane;
    out.emitted = [L::splat(0.0); 3];
    if bound.overrides.with_lamps {
        let t_52 = window_light::<L, M>(bound, lanes, wall, id);
        out.emitted = t_52;
    }
    let t_53 = albedo;
    let shining = as_switched::<L, M>(bound, lanes, id, t_53, number::<L>(bound.light[44]));
    let t_54 = gloss[3];
    let on = lit_lamp[0].max(shining[3].mul(lit_lamp[1])).mul(t_54);
    let t_55 = out.emitted;
    let t_56 = [shining[0], shining[1], shining[2]];
    let t_57 = number::<L>(bound.light[46]).mul(on);
    let t_58 = [t_56[0].mul(t_57), t_56[1].mul(t_57), t_56[2].mul(t_57)];
    out.emitted = [t_55[0].add(t_58[0]), t_55[1].add(t_58[1]), t_55[2].add(t_58[2])];
    let t_59 = albedo[0];
    let t_60 = albedo[1];
    let t_61 = albedo[2];
    let t_62 = albedo[0];
    let t_63 = albedo[1];
    let t_64 = albedo[2];
    let palest = t_59.min(t_60.min(t_61)).div(t_62.max(t_63.max(t_64)).max(L::splat(0.01)));
    let t_65 = albedo;
    let t_66 = gloss[3];
    let t_67 = L::splat(1.0).sub(t_66.mul(mix(L::splat(0.88), L::splat(0.6), palest)));
    albedo = [t_65[0].mul(t_67), t_65[1].mul(t_67), t_65[2].mul(t_67)];
    let t_68 = gloss[0];
    out.mirror = t_68.max(L::splat(0.09).mul(pane));
    let t_69 = gloss[1];
    out.rough = mix(t_69, L::splat(2.0), pane);
    let t_70 = gloss[2];
    out.through = t_70;
    out.puddle = L::splat(0.0);
    out.film = L::splat(0.0);
    if bound.overrides.with_wet {
        let t_71 = gloss[3];
        let soaks = number::<L>(bound.light[40]).mul(L::splat(1.0).sub(t_71)).mul(L::select(ground, L::splat(1.0), L::splat(0.35)));
        v_2 = L::and(ground, L::not(material.lt_unsigned(word::<L>(1))));
        let t_72 = v_2;
        v_3 = L::and(t_72, L::not(word::<L>(3).lt_unsigned(material)));
        let t_73 = v_3;
        let paved = number_of::<L>(t_73);
        let t_74 = [world_m[0], world_m[1]];
        let t_75 = L::splat(1.7);
        let t_76 = [t_74[0].mul(t_75), t_74[1].mul(t_75)];
        let t_77 = [L::splat(11.0), L::splat(29.0)];
        let t_78 = noise::<L, M>(bound, [t_76[0].add(t_77[0]), t_76[1].add(t_77[1])], log2(pixel_m.mul(L::splat(1.7))));
        let low = t_78[1];
        out.puddle = smoothstep(L::splat(0.0), L::splat(0.06), number::<L>(bound.light[39]).sub(low)).mul(paved).mul(smoothstep(L::splat(0.985), L::splat(0.998), normal[2]));
        let t_79 = albedo;
        let t_80 = out.puddle;
        let t_81 = L::splat(1.0).sub(L::splat(0.45).mul(soaks)).mul(L::splat(1.0).sub(L::splat(0.5).mul(t_80)));
        albedo = [t_79[0].mul(t_81), t_79[1].mul(t_81), t_79[2].mul(t_81)];
        let t_82 = out.puddle;
        out.film = L::splat(0.035).mul(number::<L>(bound.light[40])).mul(paved).max(L::splat(0.02).mul(number_of::<L>(L::splat(0.0).lt(t_82))));
        let t_83 = out.mirror;
        let t_84 = out.film;
        out.mirror = t_83.max(t_84);
        let t_85 = out.rough;
        let t_86 = out.puddle;
        out.rough = mix(mix(t_85, L::splat(2.6), L::splat(0.9).mul(number::<L>(bound.light[40])).mul(paved)), L::splat(0.0), t_86);
    }
    let t_87 = albedo;
    out.albedo = t_87;
    let t_88 = out;
    return t_88;
}

#[inline(always)]
pub fn lamps_at<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, pixel: [L::Words; 2], point: [L; 3], normal: [L; 3], mirrored: [L; 3], through: L, gloss_power: L) -> LampLight<L> {
    let mut out: LampLight<L> = LampLight::<L> { diffuse: [L::splat(0.0); 3], glint: [L::splat(0.0); 3] };
    let mut words: [L::Words; 2] = [word::<L>(0); 2];
    let tile = [pixel[0].shr(word::<L>(5)), pixel[1].shr(word::<L>(5))];
    let n_across = number::<L>(bound.views[4]).to_unsigned().add(word::<L>(32)).sub(word::<L>(1)).shr(word::<L>(5));
    let at = word::<L>(bound.views[61]).add(tile[1].mul(n_across)).add(tile[0]).mul(word::<L>(2));
    let t = [words_at::<L>(bound.lamp_tiles, at, 0), words_at::<L>(bound.lamp_tiles, at, 1)];
    words = t;
    let mut on = lanes;
    while L::any(on) {
        let m = on;
        let t_2 = words[0];
        let t_3 = words[1];
        let t_4 = L::not(t_2.or(t_3).eq(word::<L>(0)));
        let m_2 = L::and(m, L::not(t_4));
        on = L::and(on, L::not(m_2));
        let m_3 = L::and(m, on);
        if L::any(m_3) {
            let t_5 = words[0];
            let in_first = L::not(t_5.eq(word::<L>(0)));
            let t_6 = words[1];
            let t_7 = words[0];
            let bit = first_trailing_bit::<L>(<L::Words>::select(in_first, t_7, t_6));
            let m_4 = L::and(m_3, in_first);
            if L::any(m_4) {
                let t_8 = words[0];
                let t_9 = words[0];
                let t_10 = t_8.and(t_9.sub(word::<L>(1)));
                words[0] = <L::Words>::select(m_4, t_10, words[0]);
            }
            let m_5 = L::and(m_3, L::not(in_first));
            if L::any(m_5) {
                let t_11 = words[1];
                let t_12 = words[1];
                let t_13 = t_11.and(t_12.sub(word::<L>(1)));
                words[1] = <L::Words>::select(m_5, t_13, words[1]);
            }
            let at_2 = word::<L>(bound.views[60]).add(bit).add(<L::Words>::select(in_first, word::<L>(0), word::<L>(32))).mul(word::<L>(12));
            let lamp = Lamp::<L> { place: [numbers_at::<L>(bound.lamps, at_2, 0), numbers_at::<L>(bound.lamps, at_2, 1), numbers_at::<L>(bound.lamps, at_2, 2), numbers_at::<L>(bound.lamps, at_2, 3)], axis: [numbers_at::<L>(bound.lamps, at_2, 4), numbers_at::<L>(bound.lamps, at_2, 5), numbers_at::<L>(bound.lamps, at_2, 6), numbers_at::<L>(bound.lamps, at_2, 7)], rgb: [numbers_at::<L>(bound.lamps, at_2, 8), numbers_at::<L>(bound.lamps, at_2, 9), numbers_at::<L>(bound.lamps, at_2, 10), numbers_at::<L>(bound.lamps, at_2, 11)] };
            let t_14 = [lamp.place[0], lamp.place[1], lamp.place[2]];
            let away = [t_14[0].sub(point[0]), t_14[1].sub(point[1]), t_14[2].sub(point[2])];
            let squared = dot(away, away);
            let t_15 = inverse_sqrt(squared.max(L::splat(0.0001)));
            let towards = [away[0].mul(t_15), away[1].mul(t_15), away[2].mul(t_15)];
            let reach = squared.div(lamp.place[3].mul(lamp.place[3]));
            let window = L::splat(1.0).sub(reach.mul(reach)).max(L::splat(0.0)).min(L::splat(1.0));
            let beam = dot(towards, [lamp.axis[0], lamp.axis[1], lamp.axis[2]]).neg().sub(lamp.axis[3]).mul(lamp.rgb[3]).max(L::splat(0.0)).min(L::splat(1.0));
            let strength = window.mul(window).mul(beam).mul(beam).div(squared.max(L::splat(0.09)));
            let facing = dot(normal, towards);
            let lit = facing.max(L::splat(0.0)).mul(L::splat(1.0).sub(through)).add(through.mul(facing.abs()));
            let t_16 = out.diffuse;
            let t_17 = [lamp.rgb[0], lamp.rgb[1], lamp.rgb[2]];
            let t_18 = strength.mul(lit);
            let t_19 = [t_17[0].mul(t_18), t_17[1].mul(t_18), t_17[2].mul(t_18)];
            let t_20 = [t_16[0].add(t_19[0]), t_16[1].add(t_19[1]), t_16[2].add(t_19[2])];
            out.diffuse = zip3(t_20, out.diffuse, |a, b| L::select(m_3, a, b));
            if !bound.overrides.simple {
                let along = dot(mirrored, towards).max(L::splat(0.0)).min(L::splat(1.0));
                let t_21 = out.glint;
                let t_22 = [lamp.rgb[0], lamp.rgb[1], lamp.rgb[2]];
                let t_23 = strength.mul(pow(along, gloss_power)).mul(gloss_power).mul(L::splat(0.16));
                let t_24 = [t_22[0].mul(t_23), t_22[1].mul(t_23), t_22[2].mul(t_23)];
                let t_25 = [t_21[0].add(t_24[0]), t_21[1].add(t_24[1]), t_21[2].add(t_24[2])];
                out.glint = zip3(t_25, out.glint, |a, b| L::select(m_3, a, b));
            }
        }
    }
    let t_26 = out;
    return t_26;
}

#[inline(always)]
pub fn shadow_at<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, point_in_camera: [L; 3], facing: L, through: L) -> L {
    let at = transform::<L>([[number::<L>(bound.views[32]), number::<L>(bound.views[33]), number::<L>(bound.views[34]), number::<L>(bound.views[35])], [number::<L>(bound.views[36]), number::<L>(bound.views[37]), number::<L>(bound.views[38]), number::<L>(bound.views[39])], [number::<L>(bound.views[40]), number::<L>(bound.views[41]), number::<L>(bound.views[42]), number::<L>(bound.views[43])]], point_in_camera);
    let edge = at[0].sub(L::splat(0.5)).abs().max(at[1].sub(L::splat(0.5)).abs());
    let slack = L::splat(0.6).add(L::splat(3.0).mul(L::splat(1.0).sub(facing.abs()))).add(L::splat(16.0).mul(through));
    let biased = at[2].sub(number::<L>(bound.views[58]).mul(slack));
    let near = near_shadow::<L, M>(bound, [at[0], at[1]], biased);
    let inside = number::<L>(bound.views[57]).mul(L::splat(1.0).sub(smoothstep(L::splat(0.42), L::splat(0.49), edge)));
    if bound.overrides.simple {
        return mix(L::splat(1.0), near, inside);
    }
    let far_at = transform::<L>([[number::<L>(bound.views[44]), number::<L>(bound.views[45]), number::<L>(bound.views[46]), number::<L>(bound.views[47])], [number::<L>(bound.views[48]), number::<L>(bound.views[49]), number::<L>(bound.views[50]), number::<L>(bound.views[51])], [number::<L>(bound.views[52]), number::<L>(bound.views[53]), number::<L>(bound.views[54]), number::<L>(bound.views[55])]], point_in_camera);
    let far_edge = far_at[0].sub(L::splat(0.5)).abs().max(far_at[1].sub(L::splat(0.5)).abs());
    let far_biased = far_at[2].sub(number::<L>(bound.views[59]).mul(slack));
    let far = far_shadow::<L, M>(bound, [far_at[0], far_at[1]], far_biased);
    let far_inside = number::<L>(bound.views[57]).mul(L::splat(1.0).sub(smoothstep(L::splat(0.42), L::splat(0.49), far_edge)));
    return mix(mix(L::splat(1.0), far, far_inside), near, inside);
}

#[inline(always)]
pub fn hidden_by<L: Lanes>(inside_m: L, per_m: L) -> L {
    let outside = L::splat(1.0).add(inside_m.mul(per_m)).max(L::splat(0.0));
    let below = L::splat(1.0).sub(inside_m.mul(per_m).mul(L::splat(6.0))).max(L::splat(0.0));
    return L::select(inside_m.lt(L::splat(0.0)), L::splat(0.5).mul(outside).mul(outside), L::splat(1.0).sub(L::splat(0.5).mul(below).mul(below)));
}

#[inline(always)]
pub fn blocked_sky<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, offset: [L; 3]) -> L {
    let mut open: L = L::splat(1.0);
    let mut i: L::Words = word::<L>(0);
    let mut on = lanes;
    while L::any(on) {
        let m = on;
        let t = i;
        let t_2 = t.lt_unsigned(word::<L>(bound.views[67]));
        let m_2 = L::and(m, L::not(t_2));
        on = L::and(on, L::not(m_2));
        let m_3 = L::and(m, on);
        if L::any(m_3) {
            let t_3 = i;
            let foot = blocker_of::<L, M>(bound, word::<L>(2).mul(t_3));
            let t_4 = [foot[0], foot[1], foot[2]];
            let away = [offset[0].sub(t_4[0]), offset[1].sub(t_4[1]), offset[2].sub(t_4[2])];
            let low = L::splat(1.3).sub(L::splat(2.5).mul(away[2].abs())).max(L::splat(0.0)).min(L::splat(1.0));
            let t_5 = L::splat(0.0).lt(low);
            let m_4 = L::and(m_3, t_5);
            if L::any(m_4) {
                let t_6 = i;
                let sides = blocker_of::<L, M>(bound, word::<L>(2).mul(t_6).add(word::<L>(1)));
                let along = away[0].mul(sides[0]).add(away[1].mul(sides[1])).abs();
                let across = away[1].mul(sides[0]).sub(away[0].mul(sides[1])).abs();
                let t_7 = open;
                let t_8 = hidden_by::<L>(sides[2].sub(along), foot[3]);
                let t_9 = hidden_by::<L>(sides[3].sub(across), foot[3]);
                let t_10 = t_7.mul(L::splat(1.0).sub(low.mul(t_8).mul(t_9)));
                open = L::select(m_4, t_10, open);
            }
        }
        let t_11 = i;
        let t_12 = t_11.add(word::<L>(1));
        i = <L::Words>::select(on, t_12, i);
    }
    let t_13 = open;
    return L::splat(1.0).sub(t_13);
}

#[inline(always)]
pub fn camera_from_world<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, direction: [L; 3]) -> [L; 3] {
    let t = [number::<L>(bound.views[8]), number::<L>(bound.views[9]), number::<L>(bound.views[10]), number::<L>(bound.views[11])];
    let t_2 = [t[0], t[1], t[2]];
    let t_3 = [t_2[0].mul(direction[0]), t_2[1].mul(direction[0]), t_2[2].mul(direction[0])];
    let t_4 = [number::<L>(bound.views[12]), number::<L>(bound.views[13]), number::<L>(bound.views[14]), number::<L>(bound.views[15])];
    let t_5 = [t_4[0], t_4[1], t_4[2]];
    let t_6 = [t_5[0].mul(direction[1]), t_5[1].mul(direction[1]), t_5[2].mul(direction[1])];
    let t_7 = [t_3[0].add(t_6[0]), t_3[1].add(t_6[1]), t_3[2].add(t_6[2])];
    let t_8 = [number::<L>(bound.views[16]), number::<L>(bound.views[17]), number::<L>(bound.views[18]), number::<L>(bound.views[19])];
    let t_9 = [t_8[0], t_8[1], t_8[2]];
    let t_10 = [t_9[0].mul(direction[2]), t_9[1].mul(direction[2]), t_9[2].mul(direction[2])];
    return [t_7[0].add(t_10[0]), t_7[1].add(t_10[1]), t_7[2].add(t_10[2])];
}

#[inline(always)]
pub fn depth_at<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, pixel: [L::Words; 2]) -> L {
    let t = bound.maps.depth_map_loaded(pixel);
    return t[0];
}

#[inline(always)]
pub fn surface_at<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, pixel: [L::Words; 2]) -> [L::Words; 4] {
    let t = bound.maps.surface_map_loaded(pixel);
    return t;
}

#[inline(always)]
pub fn rough_radiance<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, packed: [L::Words; 4], id: L::Words) -> [L; 3] {
    let mut radiance: [L; 3] = [L::splat(0.0); 3];
    let mut v: L::Mask = L::mask(false);
    let albedo = albedo_of::<L>(packed[1]);
    let normal = normal_of::<L>(packed[0]);
    let direct = dot(normal, [number::<L>(bound.light[0]), number::<L>(bound.light[1]), number::<L>(bound.light[2])]).max(L::splat(0.0));
    let t = [number::<L>(bound.light[8]), number::<L>(bound.light[9]), number::<L>(bound.light[10])];
    let t_2 = [number::<L>(bound.light[4]), number::<L>(bound.light[5]), number::<L>(bound.light[6])];
    let t_3 = [t_2[0].mul(direct), t_2[1].mul(direct), t_2[2].mul(direct)];
    let t_4 = L::splat(0.6);
    let t_5 = [t_3[0].mul(t_4), t_3[1].mul(t_4), t_3[2].mul(t_4)];
    let t_6 = [t[0].add(t_5[0]), t[1].add(t_5[1]), t[2].add(t_5[2])];
    let t_7 = [albedo[0].mul(t_6[0]), albedo[1].mul(t_6[1]), albedo[2].mul(t_6[2])];
    let t_8 = L::splat(0.31830987);
    radiance = [t_7[0].mul(t_8), t_7[1].mul(t_8), t_7[2].mul(t_8)];
    if bound.overrides.with_lamps {
        let material = packed[1].shr(word::<L>(24)).and(word::<L>(31));
        let shining = as_switched::<L, M>(bound, lanes, id, albedo, number::<L>(bound.light[44]));
        let t_9 = mirror_of::<L, M>(bound, material);
        let on = packed[1].shr(word::<L>(29)).and(word::<L>(1)).from_unsigned().max(shining[3].mul(packed[1].shr(word::<L>(30)).and(word::<L>(1)).from_unsigned())).mul(t_9[3]);
        let t_10 = radiance;
        let t_11 = [shining[0], shining[1], shining[2]];
        let t_12 = number::<L>(bound.light[46]).mul(on);
        let t_13 = [t_11[0].mul(t_12), t_11[1].mul(t_12), t_11[2].mul(t_12)];
        radiance = [t_10[0].add(t_13[0]), t_10[1].add(t_13[1]), t_10[2].add(t_13[2])];
        let t_14 = L::not(material.eq(word::<L>(4)));
        v = L::or(L::not(t_14), material.eq(word::<L>(5)));
        let t_15 = v;
        let m = L::and(lanes, t_15);
        if L::any(m) {
            let t_16 = [packed[2], packed[3]];
            let uv_m = [t_16[0].to_numbers(), t_16[1].to_numbers()];
            let t_17 = style_of::<L>(id, material.eq(word::<L>(5)));
            let t_18 = grain_of::<L>(L::splat(0.05));
            let window = window_at::<L>(uv_m, t_17, t_18, material.eq(word::<L>(5)), id);
            let warm = as_switched::<L, M>(bound, m, id, [L::splat(1.0), L::splat(0.72), L::splat(0.45)], number::<L>(bound.light[45]));
            let is_lit = number_of::<L>(window.lot[2].lt(warm[3].mul(L::select(material.eq(word::<L>(5)), L::splat(0.8), L::splat(0.34)))));
            let t_19 = radiance;
            let t_20 = [warm[0], warm[1], warm[2]];
            let t_21 = number::<L>(bound.light[47]).mul(is_lit).mul(window.pane).mul(L::splat(0.5));
            let t_22 = [t_20[0].mul(t_21), t_20[1].mul(t_21), t_20[2].mul(t_21)];
            let t_23 = [t_19[0].add(t_22[0]), t_19[1].add(t_22[1]), t_19[2].add(t_22[2])];
            radiance = zip3(t_23, radiance, |a, b| L::select(m, a, b));
        }
    }
    let t_24 = radiance;
    return t_24;
}

#[inline(always)]
pub fn id_at<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, pixel: [L::Words; 2]) -> L::Words {
    let t = bound.maps.instance_map_loaded(pixel);
    return t[0];
}

#[inline(always)]
pub fn mirrored_on_screen<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, point: Point<L>, direction: [L; 3], sharp: L) -> [L; 4] {
    let mut result = [L::splat(0.0); 4];
    let mut done = L::mask(false);
    let mut step_m: L = L::splat(0.0);
    let mut at: [L; 3] = [L::splat(0.0); 3];
    let mut i: L::Words = word::<L>(0i32 as u32);
    let mut v: L::Mask = L::mask(false);
    let mut v_2: L::Mask = L::mask(false);
    let mut v_3: L::Mask = L::mask(false);
    let mut v_4: L::Mask = L::mask(false);
    let t = direction[2].lt(L::splat(-0.3));
    let m = L::and(lanes, t);
    if L::any(m) {
        let t_2 = [L::splat(0.0); 4];
        result = zip4(t_2, result, |a, b| L::select(m, a, b));
        done = L::or(done, m);
    }
    let m_2 = L::and(lanes, L::not(done));
    if L::any(m_2) {
        step_m = L::splat(0.25).add(L::splat(0.04).mul(point.in_camera[2]));
        let t_3 = step_m;
        let t_4 = [direction[0].mul(t_3), direction[1].mul(t_3), direction[2].mul(t_3)];
        let t_5 = L::splat(0.5).add(L::splat(0.5).mul(fract(L::splat(52.982918).mul(fract(dot([point.pixel[0].from_unsigned(), point.pixel[1].from_unsigned()], [L::splat(0.00583715), L::splat(0.06711056)]))))));
        let t_6 = [t_4[0].mul(t_5), t_4[1].mul(t_5), t_4[2].mul(t_5)];
        at = [point.in_camera[0].add(t_6[0]), point.in_camera[1].add(t_6[1]), point.in_camera[2].add(t_6[2])];
        let mut on = m_2;
        while L::any(on) {
            let m_3 = on;
            let t_7 = i;
            let t_8 = t_7.lt_signed(word::<L>(22i32 as u32));
            let m_4 = L::and(m_3, L::not(t_8));
            on = L::and(on, L::not(m_4));
            let m_5 = L::and(m_3, on);
            if L::any(m_5) {
                let t_9 = at[2];
                let t_10 = t_9.lt(number::<L>(bound.views[6]));
                let m_6 = L::and(m_5, t_10);
                if L::any(m_6) {
                    let t_11 = [L::splat(0.0); 4];
                    result = zip4(t_11, result, |a, b| L::select(m_6, a, b));
                    done = L::or(done, m_6);
                    on = L::and(on, L::not(m_6));
                }
                let m_7 = L::and(m_5, on);
                if L::any(m_7) {
                    let t_12 = at;
                    let pixel = pixel_of::<L, M>(bound, t_12);
                    let t_13 = L::not(pixel[0].lt(L::splat(0.0)));
                    v = L::or(L::not(t_13), pixel[1].lt(L::splat(0.0)));
                    let t_14 = v;
                    let t_15 = L::not(t_14);
                    v_2 = L::or(L::not(t_15), number::<L>(bound.views[4]).le(pixel[0]));
                    let t_16 = v_2;
                    let t_17 = L::not(t_16);
                    v_3 = L::or(L::not(t_17), number::<L>(bound.views[5]).le(pixel[1]));
                    let t_18 = v_3;
                    let m_8 = L::and(m_7, t_18);
                    if L::any(m_8) {
                        let t_19 = [L::splat(0.0); 4];
                        result = zip4(t_19, result, |a, b| L::select(m_8, a, b));
                        done = L::or(done, m_8);
                        on = L::and(on, L::not(m_8));
                    }
                    let m_9 = L::and(m_7, on);
                    if L::any(m_9) {
                        let found = [pixel[0].to_unsigned(), pixel[1].to_unsigned()];
                        let depth_m = depth_at::<L, M>(bound, found);
                        let t_20 = at[2];
                        let t_21 = depth_m.lt(t_20);
                        let t_22 = at[2];
                        let t_23 = step_m;
                        v_4 = L::and(t_21, t_22.sub(L::splat(2.0).mul(t_23)).sub(L::splat(0.3)).lt(depth_m));
                        let t_24 = v_4;
                        let m_10 = L::and(m_9, t_24);
                        if L::any(m_10) {
                            let packed = surface_at::<L, M>(bound, found);
                            let rim = pixel[0].min(number::<L>(bound.views[4]).sub(pixel[0])).min(pixel[1].min(number::<L>(bound.views[5]).sub(pixel[1]))).div(L::splat(0.08).mul(number::<L>(bound.views[5])));
                            let t_25 = id_at::<L, M>(bound, found);
                            let t_26 = rough_radiance::<L, M>(bound, m_10, packed, t_25);
                            let t_27 = [t_26[0], t_26[1], t_26[2], rim.max(L::splat(0.0)).min(L::splat(1.0)).mul(sharp.mul(L::splat(1.5)).sub(L::splat(0.2)).max(L::splat(0.0)).min(L::splat(1.0)))];
                            result = zip4(t_27, result, |a, b| L::select(m_10, a, b));
                            done = L::or(done, m_10);
                            on = L::and(on, L::not(m_10));
                        }
                        let m_11 = L::and(m_9, on);
                        if L::any(m_11) {
                            let t_28 = at;
                            let t_29 = step_m;
                            let t_30 = [direction[0].mul(t_29), direction[1].mul(t_29), direction[2].mul(t_29)];
                            let t_31 = [t_28[0].add(t_30[0]), t_28[1].add(t_30[1]), t_28[2].add(t_30[2])];
                            at = zip3(t_31, at, |a, b| L::select(m_11, a, b));
                            let t_32 = step_m;
                            let t_33 = t_32.mul(L::splat(1.16));
                            step_m = L::select(m_11, t_33, step_m);
                        }
                    }
                }
            }
            let t_34 = i;
            let t_35 = t_34.add(word::<L>(1i32 as u32));
            i = <L::Words>::select(on, t_35, i);
        }
        let m_12 = L::and(m_2, L::not(done));
        if L::any(m_12) {
            let t_36 = [L::splat(0.0); 4];
            return zip4(result, t_36, |a, b| L::select(done, a, b));
        }
    }
    result
}

#[inline(always)]
pub fn plain_radiance<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, pixel: [L::Words; 2]) -> [L; 3] {
    let mut radiance: [L; 3] = [L::splat(0.0); 3];
    let packed = surface_at::<L, M>(bound, pixel);
    let albedo = albedo_of::<L>(packed[1]);
    let t = normal_of::<L>(packed[0]);
    let direct = dot(t, [number::<L>(bound.light[0]), number::<L>(bound.light[1]), number::<L>(bound.light[2])]).max(L::splat(0.0));
    let t_2 = [number::<L>(bound.light[8]), number::<L>(bound.light[9]), number::<L>(bound.light[10])];
    let t_3 = [number::<L>(bound.light[4]), number::<L>(bound.light[5]), number::<L>(bound.light[6])];
    let t_4 = [t_3[0].mul(direct), t_3[1].mul(direct), t_3[2].mul(direct)];
    let t_5 = L::splat(0.6);
    let t_6 = [t_4[0].mul(t_5), t_4[1].mul(t_5), t_4[2].mul(t_5)];
    let t_7 = [t_2[0].add(t_6[0]), t_2[1].add(t_6[1]), t_2[2].add(t_6[2])];
    let t_8 = [albedo[0].mul(t_7[0]), albedo[1].mul(t_7[1]), albedo[2].mul(t_7[2])];
    let t_9 = L::splat(0.31830987);
    radiance = [t_8[0].mul(t_9), t_8[1].mul(t_9), t_8[2].mul(t_9)];
    if bound.overrides.with_lamps {
        let material = packed[1].shr(word::<L>(24)).and(word::<L>(31));
        let t_10 = mirror_of::<L, M>(bound, material);
        let on = packed[1].shr(word::<L>(29)).and(word::<L>(1)).from_unsigned().max(number::<L>(bound.light[44]).mul(packed[1].shr(word::<L>(30)).and(word::<L>(1)).from_unsigned())).mul(t_10[3]);
        let labels = [word::<L>(0), material.shl(word::<L>(8)), packed[1], packed[0]];
        let t_11 = radiance;
        let t_12 = [packed[2], packed[3]];
        let t_13 = wall_seen::<L, M>(bound, lanes, albedo, [t_12[0].to_numbers(), t_12[1].to_numbers()], labels, L::splat(0.05), L::mask(false));
        let t_14 = window_light::<L, M>(bound, lanes, t_13, word::<L>(0));
        let t_15 = number::<L>(bound.light[46]).mul(on);
        let t_16 = [albedo[0].mul(t_15), albedo[1].mul(t_15), albedo[2].mul(t_15)];
        let t_17 = L::splat(0.5);
        let t_18 = [t_17.mul(t_14[0]), t_17.mul(t_14[1]), t_17.mul(t_14[2])];
        let t_19 = [t_16[0].add(t_18[0]), t_16[1].add(t_18[1]), t_16[2].add(t_18[2])];
        radiance = [t_11[0].add(t_19[0]), t_11[1].add(t_19[1]), t_11[2].add(t_19[2])];
    }
    let t_20 = radiance;
    return t_20;
}

#[inline(always)]
pub fn mirrored_on_wet_road<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, point: Point<L>, direction: [L; 3]) -> [L; 4] {
    let mut result = [L::splat(0.0); 4];
    let mut done = L::mask(false);
    let mut step_m: L = L::splat(0.0);
    let mut at: [L; 3] = [L::splat(0.0); 3];
    let mut i: L::Words = word::<L>(0i32 as u32);
    let mut v: L::Mask = L::mask(false);
    let mut v_2: L::Mask = L::mask(false);
    let mut v_3: L::Mask = L::mask(false);
    let mut v_4: L::Mask = L::mask(false);
    let mut v_5: L::Mask = L::mask(false);
    let t = direction[2].lt(L::splat(-0.3));
    let m = L::and(lanes, t);
    if L::any(m) {
        let t_2 = [L::splat(0.0); 4];
        result = zip4(t_2, result, |a, b| L::select(m, a, b));
        done = L::or(done, m);
    }
    let m_2 = L::and(lanes, L::not(done));
    if L::any(m_2) {
        let size_px = [number::<L>(bound.views[4]), number::<L>(bound.views[5])];
        step_m = L::splat(0.3).add(L::splat(0.05).mul(point.in_camera[2]));
        let begin = fract(L::splat(52.982918).mul(fract(dot([point.pixel[0].from_unsigned(), point.pixel[1].from_unsigned()], [L::splat(0.00583715), L::splat(0.06711056)]))));
        let t_3 = step_m;
        let t_4 = [direction[0].mul(t_3), direction[1].mul(t_3), direction[2].mul(t_3)];
        let t_5 = L::splat(0.4).add(L::splat(0.9).mul(begin));
        let t_6 = [t_4[0].mul(t_5), t_4[1].mul(t_5), t_4[2].mul(t_5)];
        at = [point.in_camera[0].add(t_6[0]), point.in_camera[1].add(t_6[1]), point.in_camera[2].add(t_6[2])];
        let mut on = m_2;
        while L::any(on) {
            let m_3 = on;
            let t_7 = i;
            let t_8 = t_7.lt_signed(word::<L>(9i32 as u32));
            let m_4 = L::and(m_3, L::not(t_8));
            on = L::and(on, L::not(m_4));
            let m_5 = L::and(m_3, on);
            if L::any(m_5) {
                let t_9 = at;
                let pixel = pixel_of::<L, M>(bound, t_9);
                let t_10 = at[2];
                let t_11 = L::not(t_10.lt(number::<L>(bound.views[6])));
                v = L::or(L::not(t_11), pixel[0].lt(L::splat(0.0)));
                let t_12 = v;
                let t_13 = L::not(t_12);
                v_2 = L::or(L::not(t_13), pixel[1].lt(L::splat(0.0)));
                let t_14 = v_2;
                let t_15 = L::not(t_14);
                v_3 = L::or(L::not(t_15), size_px[0].le(pixel[0]));
                let t_16 = v_3;
                let t_17 = L::not(t_16);
                v_4 = L::or(L::not(t_17), size_px[1].le(pixel[1]));
                let t_18 = v_4;
                let m_6 = L::and(m_5, t_18);
                if L::any(m_6) {
                    let t_19 = [L::splat(0.0); 4];
                    result = zip4(t_19, result, |a, b| L::select(m_6, a, b));
                    done = L::or(done, m_6);
                    on = L::and(on, L::not(m_6));
                }
                let m_7 = L::and(m_5, on);
                if L::any(m_7) {
                    let depth_m = depth_at::<L, M>(bound, [pixel[0].to_unsigned(), pixel[1].to_unsigned()]);
                    let t_20 = at[2];
                    let t_21 = depth_m.lt(t_20);
                    let t_22 = at[2];
                    let t_23 = step_m;
                    v_5 = L::and(t_21, t_22.sub(L::splat(2.0).mul(t_23)).sub(L::splat(0.3)).lt(depth_m));
                    let t_24 = v_5;
                    let m_8 = L::and(m_7, t_24);
                    if L::any(m_8) {
                        let rim = pixel[0].min(size_px[0].sub(pixel[0])).min(pixel[1]).div(L::splat(0.08).mul(size_px[1]));
                        let t_25 = plain_radiance::<L, M>(bound, m_8, [pixel[0].to_unsigned(), pixel[1].to_unsigned()]);
                        let t_26 = [t_25[0], t_25[1], t_25[2], rim.max(L::splat(0.0)).min(L::splat(1.0))];
                        result = zip4(t_26, result, |a, b| L::select(m_8, a, b));
                        done = L::or(done, m_8);
                        on = L::and(on, L::not(m_8));
                    }
                    let m_9 = L::and(m_7, on);
                    if L::any(m_9) {
                        let t_27 = at;
                        let t_28 = step_m;
                        let t_29 = [direction[0].mul(t_28), direction[1].mul(t_28), direction[2].mul(t_28)];
                        let t_30 = [t_27[0].add(t_29[0]), t_27[1].add(t_29[1]), t_27[2].add(t_29[2])];
                        at = zip3(t_30, at, |a, b| L::select(m_9, a, b));
                        let t_31 = step_m;
                        let t_32 = t_31.mul(L::splat(1.42));
                        step_m = L::select(m_9, t_32, step_m);
                    }
                }
            }
            let t_33 = i;
            let t_34 = t_33.add(word::<L>(1i32 as u32));
            i = <L::Words>::select(on, t_34, i);
        }
        let m_10 = L::and(m_2, L::not(done));
        if L::any(m_10) {
            let t_35 = [L::splat(0.0); 4];
            return zip4(result, t_35, |a, b| L::select(done, a, b));
        }
    }
    result
}

#[inline(always)]
pub fn shade<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, point: Point<L>) -> [L; 3] {
    let mut falling: [L; 3] = [L::splat(0.0); 3];
    let mut mirrored: [L; 3] = [L::splat(0.0); 3];
    let mut glint: [L; 3] = [L::splat(0.0); 3];
    let mut radiance: [L; 3] = [L::splat(0.0); 3];
    let mut above: [L; 3] = [L::splat(0.0); 3];
    let mut seen: [L; 3] = [L::splat(0.0); 3];
    let mut v: L::Mask = L::mask(false);
    let mut v_2: L::Mask = L::mask(false);
    let mut v_3: L::Mask = L::mask(false);
    let mut shine: L = L::splat(0.0);
    let mut keen: L = L::splat(0.0);
    let normal = point.normal;
    let offset = rotate_rows::<L>([[number::<L>(bound.views[8]), number::<L>(bound.views[9]), number::<L>(bound.views[10]), number::<L>(bound.views[11])], [number::<L>(bound.views[12]), number::<L>(bound.views[13]), number::<L>(bound.views[14]), number::<L>(bound.views[15])], [number::<L>(bound.views[16]), number::<L>(bound.views[17]), number::<L>(bound.views[18]), number::<L>(bound.views[19])]], point.in_camera);
    let t = [number::<L>(bound.views[11]), number::<L>(bound.views[15]), number::<L>(bound.views[19])];
    let world_m = [offset[0].add(t[0]), offset[1].add(t[1]), offset[2].add(t[2])];
    let distance_m = length(offset);
    let t_2 = [distance_m; 3];
    let towards_point = [offset[0].div(t_2[0]), offset[1].div(t_2[1]), offset[2].div(t_2[2])];
    let cosine = dot(towards_point, normal).neg().max(L::splat(0.0)).min(L::splat(1.0));
    let finish = finish_at::<L, M>(bound, lanes, world_m, normal, point.uv_m, point.labels, point.pixel_m, cosine);
    let sun = [number::<L>(bound.light[0]), number::<L>(bound.light[1]), number::<L>(bound.light[2])];
    let facing = dot(normal, sun);
    let direct = facing.max(L::splat(0.0)).mul(L::splat(1.0).sub(finish.through)).add(finish.through.mul(L::splat(0.35).add(L::splat(0.65).mul(facing.abs()))));
    let t_3 = blocked_sky::<L, M>(bound, lanes, offset);
    let blocked = t_3.mul(L::splat(0.5).add(L::splat(0.5).mul(normal[2].abs())));
    let open = point.open.mul(L::splat(1.0).sub(blocked));
    let t_4 = shadow_at::<L, M>(bound, point.in_camera, facing, finish.through);
    let lit = t_4.mul(L::splat(2.0).sub(L::splat(2.0).mul(blocked)).max(L::splat(0.0)).min(L::splat(1.0)));
    let t_5 = [number::<L>(bound.light[8]), number::<L>(bound.light[9]), number::<L>(bound.light[10])];
    let t_6 = [number::<L>(bound.light[12]), number::<L>(bound.light[13]), number::<L>(bound.light[14]), number::<L>(bound.light[15])];
    let t_7 = [t_6[0], t_6[1], t_6[2]];
    let t_8 = [normal[0].mul(t_7[0]), normal[0].mul(t_7[1]), normal[0].mul(t_7[2])];
    let t_9 = [t_5[0].add(t_8[0]), t_5[1].add(t_8[1]), t_5[2].add(t_8[2])];
    let t_10 = [number::<L>(bound.light[16]), number::<L>(bound.light[17]), number::<L>(bound.light[18]), number::<L>(bound.light[19])];
    let t_11 = [t_10[0], t_10[1], t_10[2]];
    let t_12 = [normal[1].mul(t_11[0]), normal[1].mul(t_11[1]), normal[1].mul(t_11[2])];
    let t_13 = [t_9[0].add(t_12[0]), t_9[1].add(t_12[1]), t_9[2].add(t_12[2])];
    let t_14 = [number::<L>(bound.light[20]), number::<L>(bound.light[21]), number::<L>(bound.light[22]), number::<L>(bound.light[23])];
    let t_15 = [t_14[0], t_14[1], t_14[2]];
    let t_16 = [normal[2].mul(t_15[0]), normal[2].mul(t_15[1]), normal[2].mul(t_15[2])];
    let sky = [t_13[0].add(t_16[0]), t_13[1].add(t_16[1]), t_13[2].add(t_16[2])];
    let t_17 = [number::<L>(bound.light[4]), number::<L>(bound.light[5]), number::<L>(bound.light[6])];
    let t_18 = direct.mul(lit);
    let t_19 = [t_17[0].mul(t_18), t_17[1].mul(t_18), t_17[2].mul(t_18)];
    let t_20 = [L::splat(0.0); 3];
    let t_21 = [sky[0].max(t_20[0]), sky[1].max(t_20[1]), sky[2].max(t_20[2])];
    let t_22 = [t_21[0].mul(open), t_21[1].mul(open), t_21[2].mul(open)];
    falling = [t_19[0].add(t_22[0]), t_19[1].add(t_22[1]), t_19[2].add(t_22[2])];
    mirrored = reflect(towards_point, normal);
    if bound.overrides.with_wet {
        let t_23 = [world_m[0], world_m[1]];
        let t_24 = L::splat(24.0);
        let t_25 = [t_23[0].mul(t_24), t_23[1].mul(t_24)];
        let t_26 = number::<L>(bound.light[38]);
        let t_27 = [L::splat(31.0), L::splat(17.0)];
        let t_28 = [t_26.mul(t_27[0]), t_26.mul(t_27[1])];
        let t_29 = noise::<L, M>(bound, [t_25[0].add(t_28[0]), t_25[1].add(t_28[1])], log2(point.pixel_m.mul(L::splat(24.0))));
        let t_30 = [t_29[2], t_29[3]];
        let t_31 = [L::splat(0.5); 2];
        let ring = [t_30[0].sub(t_31[0]), t_30[1].sub(t_31[1])];
        let ripple = finish.puddle.mul(number::<L>(bound.light[36])).mul(L::splat(0.12));
        let t_32 = mirrored;
        let t_33 = [ring[0].mul(ripple), ring[1].mul(ripple)];
        let t_34 = [t_33[0], t_33[1], L::splat(0.0)];
        mirrored = normalize([t_32[0].add(t_34[0]), t_32[1].add(t_34[1]), t_32[2].add(t_34[2])]);
    }
    let sharp = L::splat(5.5).sub(finish.rough).mul(L::splat(0.25)).max(L::splat(0.1)).min(L::splat(1.0));
    if bound.overrides.with_lamps {
        let in_camera_normal = camera_from_world::<L, M>(bound, normal);
        let t_35 = mirrored;
        let t_36 = camera_from_world::<L, M>(bound, t_35);
        let lamps = lamps_at::<L, M>(bound, lanes, point.pixel, point.in_camera, in_camera_normal, t_36, finish.through, mix(L::splat(8.0), L::splat(180.0), sharp.mul(sharp)));
        let t_37 = falling;
        falling = [t_37[0].add(lamps.diffuse[0]), t_37[1].add(lamps.diffuse[1]), t_37[2].add(lamps.diffuse[2])];
        glint = [lamps.glint[0].mul(sharp), lamps.glint[1].mul(sharp), lamps.glint[2].mul(sharp)];
    }
    let t_38 = falling;
    let t_39 = [finish.albedo[0].mul(t_38[0]), finish.albedo[1].mul(t_38[1]), finish.albedo[2].mul(t_38[2])];
    let t_40 = L::splat(0.31830987);
    let t_41 = [t_39[0].mul(t_40), t_39[1].mul(t_40), t_39[2].mul(t_40)];
    radiance = [t_41[0].add(finish.emitted[0]), t_41[1].add(finish.emitted[1]), t_41[2].add(finish.emitted[2])];
    let away = L::splat(1.0).sub(cosine);
    let away2 = away.mul(away);
    let fresnel = finish.mirror.add(L::splat(0.75).sub(finish.mirror).max(L::splat(0.0)).mul(sharp).mul(away2).mul(away2).mul(away)).mul(number_of::<L>(L::splat(0.0).lt(finish.mirror)));
    if bound.overrides.simple {
        let t_42 = mirrored[2];
        let t_43 = [number::<L>(bound.light[24]), number::<L>(bound.light[25]), number::<L>(bound.light[26])];
        let t_44 = [number::<L>(bound.light[8]), number::<L>(bound.light[9]), number::<L>(bound.light[10])];
        let t_45 = [number::<L>(bound.light[20]), number::<L>(bound.light[21]), number::<L>(bound.light[22]), number::<L>(bound.light[23])];
        let t_46 = [t_45[0], t_45[1], t_45[2]];
        let t_47 = [t_44[0].add(t_46[0]), t_44[1].add(t_46[1]), t_44[2].add(t_46[2])];
        let t_48 = number::<L>(bound.light[11]);
        let t_49 = [t_47[0].mul(t_48), t_47[1].mul(t_48), t_47[2].mul(t_48)];
        let t_50 = t_42.max(L::splat(0.0)).min(L::splat(1.0)).sqrt();
        above = [mix(t_43[0], t_49[0], t_50), mix(t_43[1], t_49[1], t_50), mix(t_43[2], t_49[2], t_50)];
    } else {
        let t_51 = mirrored;
        let t_52 = sky_sample::<L, M>(bound, t_51, finish.rough);
        above = t_52;
    }
    let t_53 = [number::<L>(bound.light[8]), number::<L>(bound.light[9]), number::<L>(bound.light[10])];
    let t_54 = L::splat(0.09);
    let wall = [t_53[0].mul(t_54), t_53[1].mul(t_54), t_53[2].mul(t_54)];
    let t_55 = above;
    let t_56 = mirrored[2];
    let t_57 = smoothstep(L::splat(-0.05), L::splat(0.35), t_56);
    let t_58 = [mix(wall[0], t_55[0], t_57), mix(wall[1], t_55[1], t_57), mix(wall[2], t_55[2], t_57)];
    seen = [t_58[0].mul(open), t_58[1].mul(open), t_58[2].mul(open)];
    if !bound.overrides.simple {
        v = L::splat(0.01).lt(fresnel);
    } else {
        v = L::mask(false);
    }
    let t_59 = v;
    let m = L::and(lanes, t_59);
    if L::any(m) {
        let t_60 = mirrored;
        let t_61 = camera_from_world::<L, M>(bound, t_60);
        let found = mirrored_on_screen::<L, M>(bound, m, point, t_61, sharp);
        let t_62 = seen;
        let t_63 = [found[0], found[1], found[2]];
        let t_64 = [mix(t_62[0], t_63[0], found[3]), mix(t_62[1], t_63[1], found[3]), mix(t_62[2], t_63[2], found[3])];
        seen = zip3(t_64, seen, |a, b| L::select(m, a, b));
    }
    if bound.overrides.simple {
        v_2 = L::mask(bound.overrides.with_wet);
    } else {
        v_2 = L::mask(false);
    }
    let t_65 = v_2;
    v_3 = L::and(t_65, L::splat(0.0).lt(finish.film));
    let t_66 = v_3;
    let m_2 = L::and(lanes, t_66);
    if L::any(m_2) {
        let t_67 = mirrored;
        let t_68 = camera_from_world::<L, M>(bound, t_67);
        let found_2 = mirrored_on_wet_road::<L, M>(bound, m_2, point, t_68);
        let t_69 = seen;
        let t_70 = [found_2[0], found_2[1], found_2[2]];
        let t_71 = found_2[3].mul(sharp.mul(L::splat(1.5)).sub(L::splat(0.2)).max(L::splat(0.0)).min(L::splat(1.0)));
        let t_72 = [mix(t_69[0], t_70[0], t_71), mix(t_69[1], t_70[1], t_71), mix(t_69[2], t_70[2], t_71)];
        seen = zip3(t_72, seen, |a, b| L::select(m_2, a, b));
    }
    let t_73 = mirrored;
    shine = dot(t_73, sun).max(L::splat(0.0));
    let t_74 = shine;
    let t_75 = shine;
    shine = t_74.mul(t_75);
    let t_76 = shine;
    let t_77 = shine;
    shine = t_76.mul(t_77);
    let t_78 = shine;
    let t_79 = shine;
    shine = t_78.mul(t_79);
    let t_80 = shine;
    let t_81 = shine;
    shine = t_80.mul(t_81);
    let t_82 = shine;
    let t_83 = shine;
    shine = t_82.mul(t_83);
    let t_84 = shine;
    let t_85 = shine;
    keen = t_84.mul(t_85);
    let t_86 = keen;
    let t_87 = keen;
    keen = t_86.mul(t_87);
    let t_88 = keen;
    let t_89 = keen;
    keen = t_88.mul(t_89);
    let t_90 = shine;
    let t_91 = keen;
    let sunlit = mix(L::splat(0.5).mul(t_90), L::splat(5.0).mul(t_91), sharp).mul(lit);
    let t_92 = radiance;
    let t_93 = seen;
    let t_94 = glint;
    let t_95 = [number::<L>(bound.light[4]), number::<L>(bound.light[5]), number::<L>(bound.light[6])];
    let t_96 = [t_95[0].mul(sunlit), t_95[1].mul(sunlit), t_95[2].mul(sunlit)];
    let t_97 = [t_93[0].add(t_96[0]), t_93[1].add(t_96[1]), t_93[2].add(t_96[2])];
    let t_98 = [t_97[0].add(t_94[0]), t_97[1].add(t_94[1]), t_97[2].add(t_94[2])];
    radiance = [mix(t_92[0], t_98[0], fresnel), mix(t_92[1], t_98[1], fresnel), mix(t_92[2], t_98[2], fresnel)];
    let t_99 = radiance;
    let t_100 = air_rgb::<L, M>(bound, towards_point);
    let t_101 = haze::<L, M>(bound, towards_point[2], distance_m);
    let t_102 = rain_over::<L, M>(bound, lanes, [mix(t_99[0], t_100[0], t_101), mix(t_99[1], t_100[1], t_101), mix(t_99[2], t_100[2], t_101)], towards_point, distance_m);
    return t_102;
}

#[inline(always)]
pub fn open_sky<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, point: Point<L>) -> L {
    let mut hidden: L = L::splat(0.0);
    let mut i: L::Words = word::<L>(0i32 as u32);
    let normal = camera_from_world::<L, M>(bound, point.normal);
    let reach_px = L::splat(0.9).div(point.pixel_m).max(L::splat(2.0)).min(L::splat(0.12).mul(number::<L>(bound.views[4])));
    let turn = L::splat(6.2831855).mul(fract(L::splat(52.982918).mul(fract(dot([point.pixel[0].from_unsigned(), point.pixel[1].from_unsigned()], [L::splat(0.06711056), L::splat(0.00583715)])))));
    let mut on = lanes;
    while L::any(on) {
        let m = on;
        let t = i;
        let t_2 = t.lt_signed(word::<L>(12i32 as u32));
        let m_2 = L::and(m, L::not(t_2));
        on = L::and(on, L::not(m_2));
        let m_3 = L::and(m, on);
        if L::any(m_3) {
            let t_3 = i;
            let share = t_3.from_signed().add(L::splat(0.5)).div(L::splat(12.0));
            let angle = turn.add(share.mul(L::splat(6.2831855)).mul(L::splat(5.0)));
            let t_4 = [point.pixel[0].from_unsigned(), point.pixel[1].from_unsigned()];
            let t_5 = [L::splat(0.5); 2];
            let t_6 = [t_4[0].add(t_5[0]), t_4[1].add(t_5[1])];
            let t_7 = [cos(angle), sin(angle)];
            let t_8 = share.mul(reach_px);
            let t_9 = [t_7[0].mul(t_8), t_7[1].mul(t_8)];
            let at = [t_6[0].add(t_9[0]), t_6[1].add(t_9[1])];
            let t_10 = [L::splat(0.0); 2];
            let t_11 = [number::<L>(bound.views[4]), number::<L>(bound.views[5])];
            let t_12 = [L::splat(1.0); 2];
            let t_13 = [t_11[0].sub(t_12[0]), t_11[1].sub(t_12[1])];
            let t_14 = [at[0].max(t_10[0]).min(t_13[0]), at[1].max(t_10[1]).min(t_13[1])];
            let pixel = [t_14[0].to_unsigned(), t_14[1].to_unsigned()];
            let depth_m = depth_at::<L, M>(bound, pixel);
            let t_15 = [pixel[0].from_unsigned(), pixel[1].from_unsigned()];
            let t_16 = [L::splat(0.5); 2];
            let t_17 = ray_in_camera::<L, M>(bound, [t_15[0].add(t_16[0]), t_15[1].add(t_16[1])]);
            let t_18 = depth_m.min(L::splat(1000000000.0));
            let t_19 = [t_17[0].mul(t_18), t_17[1].mul(t_18), t_17[2].mul(t_18)];
            let away = [t_19[0].sub(point.in_camera[0]), t_19[1].sub(point.in_camera[1]), t_19[2].sub(point.in_camera[2])];
            let squared = dot(away, away);
            let near = L::splat(1.0).sub(squared.div(L::splat(1.6199999))).max(L::splat(0.0));
            let t_20 = hidden;
            let t_21 = t_20.add(near.mul(dot(away, normal).sub(L::splat(0.01)).sub(L::splat(0.002).mul(point.in_camera[2])).max(L::splat(0.0))).mul(inverse_sqrt(squared.add(L::splat(0.001)))));
            hidden = L::select(m_3, t_21, hidden);
        }
        let t_22 = i;
        let t_23 = t_22.add(word::<L>(1i32 as u32));
        i = <L::Words>::select(on, t_23, i);
    }
    let t_24 = hidden;
    let open = L::splat(1.0).sub(L::splat(1.9).mul(t_24).div(L::splat(12.0))).max(L::splat(0.0)).min(L::splat(1.0));
    return mix(open, L::splat(1.0), point.in_camera[2].div(L::splat(90.0)).sub(L::splat(0.3)).max(L::splat(0.0)).min(L::splat(1.0)));
}

#[inline(always)]
pub fn surface_radiance<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, at: [L::Words; 2], depth_m: L, ray: [L; 3]) -> [L; 3] {
    let mut point: Point<L> = Point::<L> { pixel: [word::<L>(0); 2], in_camera: [L::splat(0.0); 3], normal: [L::splat(0.0); 3], uv_m: [L::splat(0.0); 2], labels: [word::<L>(0); 4], pixel_m: L::splat(0.0), open: L::splat(0.0) };
    let packed = surface_at::<L, M>(bound, at);
    let id = id_at::<L, M>(bound, at);
    point.pixel = at;
    point.in_camera = [ray[0].mul(depth_m), ray[1].mul(depth_m), ray[2].mul(depth_m)];
    let t = normal_of::<L>(packed[0]);
    point.normal = t;
    let t_2 = [packed[2], packed[3]];
    point.uv_m = [t_2[0].to_numbers(), t_2[1].to_numbers()];
    point.labels = [id, packed[1].shr(word::<L>(16)).and(word::<L>(7936)).or(packed[1].shr(word::<L>(29)).shl(word::<L>(16))), packed[1], packed[0]];
    point.pixel_m = depth_m.div(number::<L>(bound.views[0]));
    point.open = L::splat(1.0);
    if !bound.overrides.simple {
        let t_3 = point;
        let t_4 = open_sky::<L, M>(bound, lanes, t_3);
        point.open = t_4;
    }
    let t_5 = point;
    let t_6 = shade::<L, M>(bound, lanes, t_5);
    return t_6;
}

#[inline(always)]
pub fn sky_at<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, ray: [L; 3]) -> [L; 3] {
    let t = rotate_rows::<L>([[number::<L>(bound.views[8]), number::<L>(bound.views[9]), number::<L>(bound.views[10]), number::<L>(bound.views[11])], [number::<L>(bound.views[12]), number::<L>(bound.views[13]), number::<L>(bound.views[14]), number::<L>(bound.views[15])], [number::<L>(bound.views[16]), number::<L>(bound.views[17]), number::<L>(bound.views[18]), number::<L>(bound.views[19])]], ray);
    let direction = normalize(t);
    let t_2 = sky_radiance::<L, M>(bound, direction);
    let t_3 = rain_over::<L, M>(bound, lanes, t_2, direction, L::splat(10000.0));
    return t_3;
}
