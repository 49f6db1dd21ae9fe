//! Random arguments for functions of the shaders, in the ranges that their names have there.

use naga::{Function, Handle, Module, ScalarKind, Type, TypeInner};

use super::images::{FOCAL_PX, VIEW_PX};

type Rng = fastrand::Rng;

/// Sizes of the lists that resolving reads.
pub const N_TRIANGLES: u32 = 60;
pub const N_VERTICES: u32 = 90;
pub const N_INSTANCES: u32 = 7;

fn between(rng: &mut Rng, low: f32, high: f32) -> f32 {
    low + rng.f32() * (high - low)
}

fn unit_vector<const N: usize>(rng: &mut Rng) -> Vec<f32> {
    loop {
        let v: [f32; N] = std::array::from_fn(|_| between(rng, -1.0, 1.0));
        let length = v.iter().map(|x| x * x).sum::<f32>().sqrt();
        if (0.1..1.0).contains(&length) {
            return v.map(|x| x / length).to_vec();
        }
    }
}

/// Random words of a number or of a vector of numbers.
fn numbers(rng: &mut Rng, function: &str, name: &str, n: usize) -> Vec<f32> {
    let [width, height] = VIEW_PX.map(|x| x as f32);
    match (function, name, n) {
        (_, "normal" | "direction" | "mirrored" | "normal_in_world", 3) => unit_vector::<3>(rng),
        (_, "q", 4) => unit_vector::<4>(rng),
        (_, "in_camera" | "point_in_camera" | "point" | "before", 3) => {
            let depth_m = between(rng, 1.0, 60.0);
            let [x, y] = [0.6, 0.45].map(|reach| between(rng, -reach, reach) * depth_m);
            vec![x, y, depth_m]
        }
        (_, "ray", 3) => vec![between(rng, -0.6, 0.6), between(rng, -0.45, 0.45), 1.0],
        ("noise", "at", 2) => (0..2).map(|_| between(rng, -500.0, 500.0)).collect(),
        (_, "inside_m", 1) => vec![between(rng, -4.0, 2.0)],
        (_, "per_m", 1) => vec![between(rng, 0.2, 1.0)],
        ("blocked_sky", "offset", 3) => {
            let spread = [between(rng, 2.0, 26.0), between(rng, -9.0, 5.0)];
            vec![spread[0], spread[1], between(rng, -2.0, -1.2)]
        }
        ("near_shadow" | "far_shadow", "at", 2) => (0..2).map(|_| rng.f32()).collect(),
        (_, "pixel" | "at", 2) => vec![rng.f32() * width, rng.f32() * height],
        (_, "world_m", 3) => (0..3).map(|_| between(rng, -200.0, 200.0)).collect(),
        (_, "uv_m", 2) => vec![between(rng, 0.0, 60.0), between(rng, 0.0, 30.0)],
        (_, "pixel_m", 1) => vec![10f32.powf(between(rng, -2.5, -0.5))],
        (_, "depth_m" | "distance_m", 1) => vec![between(rng, 0.5, 150.0)],
        ("halved", _, 1) => vec![10f32.powf(between(rng, -2.0, 9.0))],
        (_, "gloss_power", 1) => vec![between(rng, 8.0, 180.0)],
        (_, "depth", 1) => vec![between(rng, 0.2, 0.8)],
        (_, "cosine", 1) => vec![between(rng, 0.05, 1.0)],
        (_, "facing" | "direction_z" | "x" | "y" | "a" | "b" | "by" | "number", _) => {
            (0..n).map(|_| between(rng, -1.0, 1.0)).collect()
        }
        (_, "m", _) => (0..n).map(|_| between(rng, -1.0, 1.0)).collect(),
        _ => (0..n).map(|_| rng.f32()).collect(),
    }
}

fn words(rng: &mut Rng, function: &str, name: &str, n: usize) -> Vec<u32> {
    let labels = |rng: &mut Rng| rng.u32(0..29) | rng.u32(0..17) << 8 | rng.u32(0..4) << 16;
    match (name, n) {
        ("pixel" | "at", 2) => VIEW_PX.map(|size| rng.u32(0..size)).to_vec(),
        // Of a corner: class, material, lamp, nothing.
        ("labels", 4) if function == "labels_of" => {
            let material = [10, 14, rng.u32(0..17)][rng.usize(0..3)];
            vec![rng.u32(0..29), material, rng.u32(0..40), 0]
        }
        ("labels", 3 | 4) => {
            let mut all = vec![rng.u32(..), labels(rng), rng.u32(..), rng.u32(..)];
            all.truncate(n);
            all
        }
        ("triangle", 1) => vec![rng.u32(0..N_TRIANGLES)],
        ("vertex", 1) => vec![rng.u32(0..N_VERTICES)],
        ("instance", 1) => vec![rng.u32(0..N_INSTANCES)],
        ("number", 1) if function == "wants" => vec![rng.u32(0..9)],
        ("found", 2) => {
            let inverse = between(rng, 0.02, 0.5);
            vec![
                rng.u32(0..N_TRIANGLES),
                [inverse.to_bits(), 0][usize::from(rng.u8(0..4) == 0)],
            ]
        }
        ("object_id", 1) => vec![[0, rng.u32(..)][rng.usize(0..2)]],
        ("packed", 4) => {
            let look = rng.u32(..) & 0xe0ff_ffff | rng.u32(0..17) << 24;
            let uv = [between(rng, 0.0, 40.0), between(rng, 0.0, 20.0)].map(f32::to_bits);
            vec![rng.u32(..), look, uv[0], uv[1]]
        }
        ("half", 1) => vec![rng.u32(0..12)],
        ("material" | "limit" | "stride", 1) => vec![rng.u32(0..24)],
        ("c" | "d", 1) => vec![[rng.u32(0..100), rng.u32(..)][rng.usize(0..2)]],
        _ => (0..n).map(|_| rng.u32(..)).collect(),
    }
}

fn of_type(
    rng: &mut Rng,
    module: &Module,
    ty: Handle<Type>,
    function: &str,
    name: &str,
    out: &mut Vec<u32>,
) {
    let mut flat = |kind: ScalarKind, n: usize| match kind {
        ScalarKind::Float => {
            out.extend(
                numbers(rng, function, name, n)
                    .into_iter()
                    .map(f32::to_bits),
            );
        }
        ScalarKind::Bool => out.extend((0..n).map(|_| rng.u32(0..2))),
        ScalarKind::Sint => out.extend((0..n).map(|_| rng.i32(-20..20) as u32)),
        _ => out.extend(words(rng, function, name, n)),
    };
    match &module.types[ty].inner {
        TypeInner::Scalar(scalar) => flat(scalar.kind, 1),
        TypeInner::Vector { size, scalar } => flat(scalar.kind, *size as usize),
        TypeInner::Array {
            base,
            size: naga::ArraySize::Constant(n),
            ..
        } => {
            for _ in 0..n.get() {
                of_type(rng, module, *base, function, name, out);
            }
        }
        TypeInner::Struct { members, .. } => {
            for member in members {
                let name = member.name.as_deref().unwrap_or_default();
                of_type(rng, module, member.ty, function, name, out);
            }
        }
        other => panic!("an argument of type {other:?}"),
    }
}

/// Puts a point, whose first words are its pixel and its place, where its pixel sees it; half of them
/// near what the image of depths shows.
fn place_at_pixel(rng: &mut Rng, words: &mut [u32]) {
    let depth_m = match rng.bool() {
        true => between(rng, 3.0, 5.0),
        false => between(rng, 1.0, 60.0),
    };
    for axis in 0..2 {
        let px = words[axis] as f32 + 0.5 - 0.5 * VIEW_PX[axis] as f32;
        words[2 + axis] = (px / FOCAL_PX * depth_m).to_bits();
    }
    words[4] = depth_m.to_bits();
}

/// The words of one call.
pub fn row(rng: &mut Rng, module: &Module, function: &Function) -> Vec<u32> {
    let mut out = Vec::new();
    let name = function.name.as_deref().unwrap_or_default();
    for argument in &function.arguments {
        let of = argument.name.as_deref().unwrap_or_default();
        let first = out.len();
        of_type(rng, module, argument.ty, name, of, &mut out);
        if module.types[argument.ty].name.as_deref() == Some("Point") {
            place_at_pixel(rng, &mut out[first..]);
        }
    }
    out
}
