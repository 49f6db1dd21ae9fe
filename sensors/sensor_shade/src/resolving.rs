//! Generated from WGSL by the test `lanes` of `sensor_camera`; `./gantry bless` writes it anew.

use sensor_core::vector_lanes::{Lanes, WordLanes};

use crate::functions::{atan2, cos, exp, exp2, fract, inverse_sqrt, log2, mix, pow, saturate, sin, smoothstep};
use crate::memory::{number, numbers_at, words_at};
use crate::packing::{divided, first_trailing_bit, number_of, pack_4x8_unorm, remainder, unpack_4x8_snorm, unpack_4x8_unorm, word, word_of};
use crate::vectors::{cross, dot, length, normalize, reflect, zip2, zip3, zip4};

/// What a pipeline chooses.
#[derive(Clone, Copy, Debug)]
pub struct Overrides {
}

impl Default for Overrides {
    #[inline(always)]
    fn default() -> Self {
        Overrides {
        }
    }
}

/// What a pipeline's bind groups hold, and its overrides.
#[derive(Clone, Copy)]
pub struct Bound<'a, M> {
    pub overrides: Overrides,
    pub views: &'a [u32; 128],
    pub instances: &'a [u32],
    pub draws: &'a [u32],
    pub vertices: &'a [u32],
    pub indices: &'a [u32],
    pub maps: &'a M,
}

/// The images that the shaders read, and how. Lanes that do not run may ask for any place.
pub trait Maps<L: Lanes> {
}

#[derive(Clone, Copy)]
pub struct Pixel<L: Lanes> {
    pub surface: [L::Words; 4],
    pub depth_m: L,
    pub class_code: L::Words,
    pub instance: L::Words,
    pub flow_px: [L; 2],
    pub normal: [L; 4],
}

impl<L: Lanes> Pixel<L> {
    #[inline(always)]
    pub fn blend(lanes: L::Mask, a: Self, b: Self) -> Self {
        Pixel {
            surface: zip4(a.surface, b.surface, |a, b| <L::Words>::select(lanes, a, b)),
            depth_m: L::select(lanes, a.depth_m, b.depth_m),
            class_code: <L::Words>::select(lanes, a.class_code, b.class_code),
            instance: <L::Words>::select(lanes, a.instance, b.instance),
            flow_px: zip2(a.flow_px, b.flow_px, |a, b| L::select(lanes, a, b)),
            normal: zip4(a.normal, b.normal, |a, b| L::select(lanes, a, b)),
        }
    }
}

#[derive(Clone, Copy)]
pub struct Draw<L: Lanes> {
    pub first_triangle: L::Words,
    pub n_triangles: L::Words,
    pub first_idx: L::Words,
    pub base_vertex: L::Words,
    pub instance: L::Words,
    pub view: L::Words,
    pub rest: [L::Words; 2],
}

impl<L: Lanes> Draw<L> {
    #[inline(always)]
    pub fn blend(lanes: L::Mask, a: Self, b: Self) -> Self {
        Draw {
            first_triangle: <L::Words>::select(lanes, a.first_triangle, b.first_triangle),
            n_triangles: <L::Words>::select(lanes, a.n_triangles, b.n_triangles),
            first_idx: <L::Words>::select(lanes, a.first_idx, b.first_idx),
            base_vertex: <L::Words>::select(lanes, a.base_vertex, b.base_vertex),
            instance: <L::Words>::select(lanes, a.instance, b.instance),
            view: <L::Words>::select(lanes, a.view, b.view),
            rest: zip2(a.rest, b.rest, |a, b| <L::Words>::select(lanes, a, b)),
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
pub fn rotate<L: Lanes>(q: [L; 4], v: [L; 3]) -> [L; 3] {
    let t = L::splat(2.0);
    let t_2 = cross([q[0], q[1], q[2]], v);
    let t_3 = [q[3].mul(v[0]), q[3].mul(v[1]), q[3].mul(v[2])];
    let t_4 = cross([q[0], q[1], q[2]], [t_2[0].add(t_3[0]), t_2[1].add(t_3[1]), t_2[2].add(t_3[2])]);
    let t_5 = [t.mul(t_4[0]), t.mul(t_4[1]), t.mul(t_4[2])];
    return [v[0].add(t_5[0]), v[1].add(t_5[1]), v[2].add(t_5[2])];
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
pub fn pixel_of<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, point_in_camera_2: [L; 3]) -> [L; 2] {
    let t = [point_in_camera_2[0], point_in_camera_2[1]];
    let t_2 = [point_in_camera_2[2]; 2];
    let t_3 = [t[0].div(t_2[0]), t[1].div(t_2[1])];
    let t_4 = [number::<L>(bound.views[0]), number::<L>(bound.views[1]), number::<L>(bound.views[2]), number::<L>(bound.views[3])];
    let t_5 = [t_4[0], t_4[1]];
    let t_6 = [t_3[0].mul(t_5[0]), t_3[1].mul(t_5[1])];
    let t_7 = [number::<L>(bound.views[0]), number::<L>(bound.views[1]), number::<L>(bound.views[2]), number::<L>(bound.views[3])];
    let t_8 = [t_7[2], t_7[3]];
    return [t_6[0].add(t_8[0]), t_6[1].add(t_8[1])];
}

#[inline(always)]
pub fn point_in_camera<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, instance: L::Words, point: [L; 3]) -> [L; 3] {
    let at = instance.mul(word::<L>(32));
    let t = [[numbers_at::<L>(bound.instances, at, 0), numbers_at::<L>(bound.instances, at, 1), numbers_at::<L>(bound.instances, at, 2), numbers_at::<L>(bound.instances, at, 3)], [numbers_at::<L>(bound.instances, at, 4), numbers_at::<L>(bound.instances, at, 5), numbers_at::<L>(bound.instances, at, 6), numbers_at::<L>(bound.instances, at, 7)], [numbers_at::<L>(bound.instances, at, 8), numbers_at::<L>(bound.instances, at, 9), numbers_at::<L>(bound.instances, at, 10), numbers_at::<L>(bound.instances, at, 11)]];
    let t_2 = transform::<L>(t, point);
    return t_2;
}

#[inline(always)]
pub fn point_before<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, instance: L::Words, point: [L; 3]) -> [L; 3] {
    let at = instance.mul(word::<L>(32));
    let t = [[numbers_at::<L>(bound.instances, at, 12), numbers_at::<L>(bound.instances, at, 13), numbers_at::<L>(bound.instances, at, 14), numbers_at::<L>(bound.instances, at, 15)], [numbers_at::<L>(bound.instances, at, 16), numbers_at::<L>(bound.instances, at, 17), numbers_at::<L>(bound.instances, at, 18), numbers_at::<L>(bound.instances, at, 19)], [numbers_at::<L>(bound.instances, at, 20), numbers_at::<L>(bound.instances, at, 21), numbers_at::<L>(bound.instances, at, 22), numbers_at::<L>(bound.instances, at, 23)]];
    let t_2 = transform::<L>(t, point);
    return t_2;
}

#[inline(always)]
pub fn direction_in_world<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, instance: L::Words, direction: [L; 3]) -> [L; 3] {
    let at = instance.mul(word::<L>(32));
    let t = [numbers_at::<L>(bound.instances, at, 24), numbers_at::<L>(bound.instances, at, 25), numbers_at::<L>(bound.instances, at, 26), numbers_at::<L>(bound.instances, at, 27)];
    let t_2 = rotate::<L>(t, direction);
    return t_2;
}

#[inline(always)]
pub fn marks_of<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, instance: L::Words) -> [L::Words; 4] {
    let at = instance.mul(word::<L>(32));
    let t = words_at::<L>(bound.instances, at, 28);
    let at_2 = instance.mul(word::<L>(32));
    let t_2 = words_at::<L>(bound.instances, at_2, 29);
    let at_3 = instance.mul(word::<L>(32));
    let t_3 = words_at::<L>(bound.instances, at_3, 30);
    let at_4 = instance.mul(word::<L>(32));
    let t_4 = words_at::<L>(bound.instances, at_4, 31);
    return [t, t_2, t_3, t_4];
}

#[inline(always)]
pub fn flow_of<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, at: [L; 2], depth_m: L, instance: L::Words) -> [L; 2] {
    let mut result = [L::splat(0.0); 2];
    let mut done = L::mask(false);
    let t = marks_of::<L, M>(bound, instance);
    let t_2 = t[3].eq(word::<L>(0));
    let m = L::and(lanes, t_2);
    if L::any(m) {
        let t_3 = [L::splat(0.0); 2];
        result = zip2(t_3, result, |a, b| L::select(m, a, b));
        done = L::or(done, m);
    }
    let m_2 = L::and(lanes, L::not(done));
    if L::any(m_2) {
        let t_4 = ray_in_camera::<L, M>(bound, at);
        let before = point_before::<L, M>(bound, instance, [t_4[0].mul(depth_m), t_4[1].mul(depth_m), t_4[2].mul(depth_m)]);
        let t_5 = before[2].lt(number::<L>(bound.views[6]));
        let m_3 = L::and(m_2, t_5);
        if L::any(m_3) {
            let t_6 = [L::splat(0.0); 2];
            result = zip2(t_6, result, |a, b| L::select(m_3, a, b));
            done = L::or(done, m_3);
        }
        let m_4 = L::and(m_2, L::not(done));
        if L::any(m_4) {
            let t_7 = pixel_of::<L, M>(bound, before);
            let t_8 = [at[0].sub(t_7[0]), at[1].sub(t_7[1])];
            return zip2(result, t_8, |a, b| L::select(done, a, b));
        }
    }
    result
}

#[inline(always)]
pub fn surface_of<L: Lanes>(normal_in_world: [L; 3], labels: [L::Words; 3], uv_m: [L; 2], pixel_m: L) -> [L::Words; 4] {
    let t = L::splat(0.5);
    let t_2 = [normal_in_world[0].mul(t), normal_in_world[1].mul(t), normal_in_world[2].mul(t)];
    let t_3 = [L::splat(0.5); 3];
    let t_4 = [t_2[0].add(t_3[0]), t_2[1].add(t_3[1]), t_2[2].add(t_3[2])];
    let t_5 = [L::splat(0.0); 3];
    let t_6 = [L::splat(1.0); 3];
    let t_7 = [t_4[0].max(t_5[0]).min(t_6[0]), t_4[1].max(t_5[1]).min(t_6[1]), t_4[2].max(t_5[2]).min(t_6[2])];
    let t_8 = [L::splat(2046.0), L::splat(2046.0), L::splat(1022.0)];
    let t_9 = [t_7[0].mul(t_8[0]), t_7[1].mul(t_8[1]), t_7[2].mul(t_8[2])];
    let t_10 = [L::splat(0.5); 3];
    let t_11 = [t_9[0].add(t_10[0]), t_9[1].add(t_10[1]), t_9[2].add(t_10[2])];
    let n = [t_11[0].to_unsigned(), t_11[1].to_unsigned(), t_11[2].to_unsigned()];
    let look = labels[2].and(word::<L>(16777215)).or(labels[1].and(word::<L>(7936)).shl(word::<L>(16))).or(labels[1].shr(word::<L>(16)).shl(word::<L>(29)));
    let t_12 = [uv_m[0].to_words(), uv_m[1].to_words()];
    return [n[0].or(n[1].shl(word::<L>(11))).or(n[2].shl(word::<L>(22))), look, t_12[0], t_12[1]];
}

#[inline(always)]
pub fn labels_of<L: Lanes>(lanes: L::Mask, albedo: L::Words, labels: [L::Words; 4], object_id: L::Words, marks: [L::Words; 4]) -> [L::Words; 3] {
    let mut v: L::Mask = L::mask(false);
    let mut v_2: L::Mask = L::mask(false);
    let id = <L::Words>::select(object_id.eq(word::<L>(0)), marks[0], object_id);
    let t = labels[1].eq(word::<L>(10));
    v = L::and(t, L::not(marks[1].shr(word::<L>(24)).eq(word::<L>(0))));
    let t_2 = v;
    let rgb = <L::Words>::select(t_2, marks[1], albedo);
    let by_itself = <L::Words>::select(id.shr(word::<L>(31)).eq(word::<L>(1)), word::<L>(2), word::<L>(0));
    let t_3 = labels[1].eq(word::<L>(14));
    v_2 = L::and(t_3, labels[2].lt_unsigned(word::<L>(31)));
    let t_4 = v_2;
    let lit = <L::Words>::select(t_4, marks[2].shr(labels[2].and(word::<L>(31))).and(word::<L>(1)).or(by_itself), word::<L>(0));
    return [id, labels[0].or(labels[1].shl(word::<L>(8))).or(lit.shl(word::<L>(16))), rgb];
}

#[inline(always)]
pub fn surface_pixel<L: Lanes>(depth_m: L, normal_in_world: [L; 3], uv_m: [L; 2], labels: [L::Words; 3], pixel_m: L) -> Pixel<L> {
    let mut out: Pixel<L> = Pixel::<L> { surface: [word::<L>(0); 4], depth_m: L::splat(0.0), class_code: word::<L>(0), instance: word::<L>(0), flow_px: [L::splat(0.0); 2], normal: [L::splat(0.0); 4] };
    out.depth_m = depth_m;
    out.class_code = labels[1].and(word::<L>(255));
    out.instance = labels[0];
    let t = normalize(normal_in_world);
    out.normal = [t[0], t[1], t[2], L::splat(0.0)];
    let t_2 = surface_of::<L>(normal_in_world, labels, uv_m, pixel_m);
    out.surface = t_2;
    let t_3 = out;
    return t_3;
}

#[inline(always)]
pub fn sky_pixel<L: Lanes>(far_m: L) -> Pixel<L> {
    let mut out: Pixel<L> = Pixel::<L> { surface: [word::<L>(0); 4], depth_m: L::splat(0.0), class_code: word::<L>(0), instance: word::<L>(0), flow_px: [L::splat(0.0); 2], normal: [L::splat(0.0); 4] };
    out.surface = [word::<L>(0); 4];
    out.depth_m = far_m;
    out.class_code = word::<L>(11);
    out.instance = word::<L>(0);
    out.normal = [L::splat(0.0); 4];
    let t = out;
    return t;
}

#[inline(always)]
pub fn wants<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, number_2: L::Words) -> L::Mask {
    return L::not(word::<L>(bound.views[63]).shr(number_2).and(word::<L>(1)).eq(word::<L>(0)));
}

#[inline(always)]
pub fn wants_flow<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>) -> L::Mask {
    let t = wants::<L, M>(bound, word::<L>(4));
    return t;
}

#[inline(always)]
pub fn draw_with<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, triangle: L::Words) -> L::Words {
    let mut low: L::Words = word::<L>(0);
    let mut n: L::Words = word::<L>(0);
    low = word::<L>(bound.views[64]);
    n = word::<L>(bound.views[65]);
    let mut on = lanes;
    while L::any(on) {
        let m = on;
        let t = n;
        let t_2 = word::<L>(1).lt_unsigned(t);
        let m_2 = L::and(m, L::not(t_2));
        on = L::and(on, L::not(m_2));
        let m_3 = L::and(m, on);
        if L::any(m_3) {
            let t_3 = n;
            let half = t_3.shr(word::<L>(1));
            let t_4 = low;
            let at = t_4.add(half).mul(word::<L>(8));
            let t_5 = words_at::<L>(bound.draws, at, 0);
            let is_behind = L::not(triangle.lt_unsigned(t_5));
            let t_6 = low;
            let t_7 = low;
            let t_8 = <L::Words>::select(is_behind, t_7.add(half), t_6);
            low = <L::Words>::select(m_3, t_8, low);
            let t_9 = n;
            let t_10 = <L::Words>::select(is_behind, t_9.sub(half), half);
            n = <L::Words>::select(m_3, t_10, n);
        }
    }
    let t_11 = low;
    return t_11;
}

#[inline(always)]
pub fn position_of<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, vertex: L::Words) -> [L; 3] {
    let at = vertex.mul(word::<L>(9));
    let t = words_at::<L>(bound.vertices, at, 0);
    let at_2 = at.add(word::<L>(1));
    let t_2 = words_at::<L>(bound.vertices, at_2, 0);
    let at_3 = at.add(word::<L>(2));
    let t_3 = words_at::<L>(bound.vertices, at_3, 0);
    let t_4 = [t, t_2, t_3];
    return [t_4[0].to_numbers(), t_4[1].to_numbers(), t_4[2].to_numbers()];
}

#[inline(always)]
pub fn normal_of<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, vertex: L::Words) -> [L; 3] {
    let at = vertex.mul(word::<L>(9)).add(word::<L>(3));
    let t = words_at::<L>(bound.vertices, at, 0);
    let t_2 = unpack_4x8_snorm::<L>(t);
    return [t_2[0], t_2[1], t_2[2]];
}

#[inline(always)]
pub fn uv_of<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, vertex: L::Words) -> [L; 2] {
    let at = vertex.mul(word::<L>(9)).add(word::<L>(7));
    let t = words_at::<L>(bound.vertices, at, 0);
    let at_2 = at.add(word::<L>(1));
    let t_2 = words_at::<L>(bound.vertices, at_2, 0);
    let t_3 = [t, t_2];
    return [t_3[0].to_numbers(), t_3[1].to_numbers()];
}

#[inline(always)]
pub fn seen_pixel<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, at: [L; 2], found: [L::Words; 2]) -> Pixel<L> {
    let mut out: Pixel<L> = Pixel::<L> { surface: [word::<L>(0); 4], depth_m: L::splat(0.0), class_code: word::<L>(0), instance: word::<L>(0), flow_px: [L::splat(0.0); 2], normal: [L::splat(0.0); 4] };
    let depth_m = L::splat(1.0).div(found[1].to_numbers());
    let t = draw_with::<L, M>(bound, lanes, found[0]);
    let at_2 = t.mul(word::<L>(8));
    let draw = Draw::<L> { first_triangle: words_at::<L>(bound.draws, at_2, 0), n_triangles: words_at::<L>(bound.draws, at_2, 1), first_idx: words_at::<L>(bound.draws, at_2, 2), base_vertex: words_at::<L>(bound.draws, at_2, 3), instance: words_at::<L>(bound.draws, at_2, 4), view: words_at::<L>(bound.draws, at_2, 5), rest: [words_at::<L>(bound.draws, at_2, 6), words_at::<L>(bound.draws, at_2, 7)] };
    let first = draw.first_idx.add(word::<L>(3).mul(found[0].sub(draw.first_triangle)));
    let t_2 = words_at::<L>(bound.indices, first, 0);
    let at_3 = first.add(word::<L>(1));
    let t_3 = words_at::<L>(bound.indices, at_3, 0);
    let at_4 = first.add(word::<L>(2));
    let t_4 = words_at::<L>(bound.indices, at_4, 0);
    let t_5 = [t_2, t_3, t_4];
    let t_6 = [draw.base_vertex; 3];
    let corners = [t_5[0].add(t_6[0]), t_5[1].add(t_6[1]), t_5[2].add(t_6[2])];
    let t_7 = position_of::<L, M>(bound, corners[0]);
    let a = point_in_camera::<L, M>(bound, draw.instance, t_7);
    let t_8 = position_of::<L, M>(bound, corners[1]);
    let t_9 = point_in_camera::<L, M>(bound, draw.instance, t_8);
    let along = [t_9[0].sub(a[0]), t_9[1].sub(a[1]), t_9[2].sub(a[2])];
    let t_10 = position_of::<L, M>(bound, corners[2]);
    let t_11 = point_in_camera::<L, M>(bound, draw.instance, t_10);
    let aside = [t_11[0].sub(a[0]), t_11[1].sub(a[1]), t_11[2].sub(a[2])];
    let t_12 = ray_in_camera::<L, M>(bound, at);
    let t_13 = [t_12[0].mul(depth_m), t_12[1].mul(depth_m), t_12[2].mul(depth_m)];
    let offset = [t_13[0].sub(a[0]), t_13[1].sub(a[1]), t_13[2].sub(a[2])];
    let normal = cross(along, aside);
    let per_area = L::splat(1.0).div(dot(normal, normal).max(L::splat(1e-37)));
    let second = dot(cross(offset, aside), normal).mul(per_area).max(L::splat(0.0)).min(L::splat(1.0));
    let third = dot(cross(along, offset), normal).mul(per_area).max(L::splat(0.0)).min(L::splat(1.0).sub(second));
    let shares = [L::splat(1.0).sub(second).sub(third), second, third];
    let t_14 = normal_of::<L, M>(bound, corners[0]);
    let t_15 = normal_of::<L, M>(bound, corners[1]);
    let t_16 = normal_of::<L, M>(bound, corners[2]);
    let t_17 = [t_14[0].mul(shares[0]), t_14[1].mul(shares[0]), t_14[2].mul(shares[0])];
    let t_18 = [t_15[0].mul(shares[1]), t_15[1].mul(shares[1]), t_15[2].mul(shares[1])];
    let t_19 = [t_17[0].add(t_18[0]), t_17[1].add(t_18[1]), t_17[2].add(t_18[2])];
    let t_20 = [t_16[0].mul(shares[2]), t_16[1].mul(shares[2]), t_16[2].mul(shares[2])];
    let in_mesh = [t_19[0].add(t_20[0]), t_19[1].add(t_20[1]), t_19[2].add(t_20[2])];
    let t_21 = uv_of::<L, M>(bound, corners[0]);
    let t_22 = uv_of::<L, M>(bound, corners[1]);
    let t_23 = uv_of::<L, M>(bound, corners[2]);
    let t_24 = [t_21[0].mul(shares[0]), t_21[1].mul(shares[0])];
    let t_25 = [t_22[0].mul(shares[1]), t_22[1].mul(shares[1])];
    let t_26 = [t_24[0].add(t_25[0]), t_24[1].add(t_25[1])];
    let t_27 = [t_23[0].mul(shares[2]), t_23[1].mul(shares[2])];
    let uv_m = [t_26[0].add(t_27[0]), t_26[1].add(t_27[1])];
    let words = corners[0].mul(word::<L>(9));
    let at_5 = words.add(word::<L>(5));
    let codes = words_at::<L>(bound.vertices, at_5, 0);
    let labels = [codes.and(word::<L>(255)), codes.shr(word::<L>(8)).and(word::<L>(255)), codes.shr(word::<L>(16)).and(word::<L>(255)), codes.shr(word::<L>(24))];
    let at_6 = words.add(word::<L>(4));
    let t_28 = words_at::<L>(bound.vertices, at_6, 0);
    let at_7 = words.add(word::<L>(6));
    let t_29 = words_at::<L>(bound.vertices, at_7, 0);
    let t_30 = marks_of::<L, M>(bound, draw.instance);
    let marks = labels_of::<L>(lanes, t_28, labels, t_29, t_30);
    let pixel_m = depth_m.div(number::<L>(bound.views[0]));
    let t_31 = direction_in_world::<L, M>(bound, draw.instance, in_mesh);
    let t_32 = surface_pixel::<L>(depth_m, t_31, uv_m, marks, pixel_m);
    out = t_32;
    let t_33 = wants_flow::<L, M>(bound);
    let m = L::and(lanes, t_33);
    if L::any(m) {
        let t_34 = flow_of::<L, M>(bound, m, at, depth_m, draw.instance);
        out.flow_px = zip2(t_34, out.flow_px, |a, b| L::select(m, a, b));
    }
    let t_35 = out;
    return t_35;
}

#[inline(always)]
pub fn seen_sky<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, at: [L; 2]) -> Pixel<L> {
    let mut out: Pixel<L> = Pixel::<L> { surface: [word::<L>(0); 4], depth_m: L::splat(0.0), class_code: word::<L>(0), instance: word::<L>(0), flow_px: [L::splat(0.0); 2], normal: [L::splat(0.0); 4] };
    let mut v: L::Mask = L::mask(false);
    let t = sky_pixel::<L>(number::<L>(bound.views[7]));
    out = t;
    let t_2 = wants_flow::<L, M>(bound);
    v = L::and(t_2, L::not(number::<L>(bound.views[56]).eq(L::splat(0.0))));
    let t_3 = v;
    let m = L::and(lanes, t_3);
    if L::any(m) {
        let t_4 = ray_in_camera::<L, M>(bound, at);
        let before = rotate_rows::<L>([[number::<L>(bound.views[20]), number::<L>(bound.views[21]), number::<L>(bound.views[22]), number::<L>(bound.views[23])], [number::<L>(bound.views[24]), number::<L>(bound.views[25]), number::<L>(bound.views[26]), number::<L>(bound.views[27])], [number::<L>(bound.views[28]), number::<L>(bound.views[29]), number::<L>(bound.views[30]), number::<L>(bound.views[31])]], t_4);
        let t_5 = L::splat(0.0).lt(before[2]);
        let m_2 = L::and(m, t_5);
        if L::any(m_2) {
            let t_6 = pixel_of::<L, M>(bound, before);
            let t_7 = [at[0].sub(t_6[0]), at[1].sub(t_6[1])];
            out.flow_px = zip2(t_7, out.flow_px, |a, b| L::select(m_2, a, b));
        }
    }
    let t_8 = out;
    return t_8;
}

#[inline(always)]
pub fn pixel_at<L: Lanes, M: Maps<L>>(bound: &Bound<'_, M>, lanes: L::Mask, at: [L; 2], found: [L::Words; 2]) -> Pixel<L> {
    let mut result = Pixel::<L> { surface: [word::<L>(0); 4], depth_m: L::splat(0.0), class_code: word::<L>(0), instance: word::<L>(0), flow_px: [L::splat(0.0); 2], normal: [L::splat(0.0); 4] };
    let mut done = L::mask(false);
    let t = found[1].eq(word::<L>(0));
    let m = L::and(lanes, t);
    if L::any(m) {
        let t_2 = seen_sky::<L, M>(bound, m, at);
        result = Pixel::<L>::blend(m, t_2, result);
        done = L::or(done, m);
    }
    let m_2 = L::and(lanes, L::not(done));
    if L::any(m_2) {
        let t_3 = seen_pixel::<L, M>(bound, m_2, at, found);
        return Pixel::<L>::blend(done, result, t_3);
    }
    result
}
