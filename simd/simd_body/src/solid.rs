//! Simple solids that many meshes are put together from: tubes, posts, spikes, ellipsoids.

use sensor_core::MeshBuilder;
use sensor_core::mesh::Surface;

use crate::vector::{cross, normalize, sub};

/// A tapered prism with `n` sides between two points, closed at both ends.
pub fn tube(
    builder: &mut MeshBuilder,
    surface: Surface,
    from: ([f32; 3], f32),
    to: ([f32; 3], f32),
    n: usize,
) {
    let axis = normalize(sub(to.0, from.0));
    let helper = if axis[2].abs() < 0.9 {
        [0.0, 0.0, 1.0]
    } else {
        [1.0, 0.0, 0.0]
    };
    let u = normalize(cross(helper, axis));
    let v = cross(axis, u);
    let direction = |k: usize| {
        let a = std::f32::consts::TAU * (k % n) as f32 / n as f32;
        std::array::from_fn::<f32, 3, _>(|i| u[i] * a.cos() + v[i] * a.sin())
    };
    let at = |end: ([f32; 3], f32), d: [f32; 3]| {
        std::array::from_fn::<f32, 3, _>(|i| end.0[i] + d[i] * end.1)
    };
    for k in 0..n {
        let (d0, d1) = (direction(k), direction(k + 1));
        builder.polygon_with_normals(
            surface,
            &[at(from, d0), at(from, d1), at(to, d1), at(to, d0)],
            &[d0, d1, d1, d0],
            &[[0.0; 2]; 4],
        );
    }
    let ring = |end: ([f32; 3], f32)| (0..n).map(|k| at(end, direction(k))).collect::<Vec<_>>();
    let mut start = ring(from);
    start.reverse();
    for (cap, radius) in [(start, from.1), (ring(to), to.1)] {
        if radius > 1e-4 {
            builder.polygon(surface, &cap, &vec![[0.0; 2]; n]);
        }
    }
}

/// Three directions perpendicular to an axis, evenly spaced about it.
fn three(axis: [f32; 3]) -> [[f32; 3]; 3] {
    let helper = if axis[2].abs() < 0.9 {
        [0.0, 0.0, 1.0]
    } else {
        [1.0, 0.0, 0.0]
    };
    let u = normalize(cross(helper, axis));
    let v = cross(axis, u);
    std::array::from_fn(|k| {
        let a = std::f32::consts::TAU * k as f32 / 3.0;
        std::array::from_fn(|i| u[i] * a.cos() + v[i] * a.sin())
    })
}

fn off(p: [f32; 3], direction: [f32; 3], by: f32) -> [f32; 3] {
    std::array::from_fn(|i| p[i] + direction[i] * by)
}

/// A three-sided cone from a ring to a tip, open below: a stem seen from far away.
pub fn spike(
    builder: &mut MeshBuilder,
    surface: Surface,
    (foot, radius): ([f32; 3], f32),
    tip: [f32; 3],
) {
    let out = three(normalize(sub(tip, foot)));
    for k in 0..3 {
        let (a, b) = (out[k], out[(k + 1) % 3]);
        let middle = normalize(std::array::from_fn(|i| a[i] + b[i]));
        let corners = [off(foot, a, radius), off(foot, b, radius), tip];
        builder.polygon_with_normals(surface, &corners, &[a, b, middle], &[[0.0; 2]; 3]);
    }
}

/// A three-sided prism between two points, open at both ends: a pole seen from far away.
pub fn post(
    builder: &mut MeshBuilder,
    surface: Surface,
    foot: [f32; 3],
    top: [f32; 3],
    radius: f32,
) {
    let out = three(normalize(sub(top, foot)));
    for k in 0..3 {
        let (a, b) = (out[k], out[(k + 1) % 3]);
        let corners = [
            off(foot, a, radius),
            off(foot, b, radius),
            off(top, b, radius),
            off(top, a, radius),
        ];
        builder.polygon_with_normals(surface, &corners, &[a, b, b, a], &[[0.0; 2]; 4]);
    }
}

/// An ellipsoid of `n` slices and `n / 2` stacks.
pub fn ellipsoid(
    builder: &mut MeshBuilder,
    surface: Surface,
    centre: [f32; 3],
    half: [f32; 3],
    n: usize,
) {
    let stacks = (n / 2).max(2);
    let direction = |i: usize, k: usize| {
        let (polar, around) = (
            std::f32::consts::PI * i as f32 / stacks as f32,
            std::f32::consts::TAU * (k % n) as f32 / n as f32,
        );
        [
            polar.sin() * around.cos(),
            polar.sin() * around.sin(),
            -polar.cos(),
        ]
    };
    for i in 0..stacks {
        for k in 0..n {
            let ways = match i {
                0 => vec![(0, k), (1, k + 1), (1, k)],
                _ if i + 1 == stacks => vec![(i, k), (i, k + 1), (i + 1, k)],
                _ => vec![(i, k), (i, k + 1), (i + 1, k + 1), (i + 1, k)],
            };
            let directions: Vec<[f32; 3]> = ways.iter().map(|&(a, b)| direction(a, b)).collect();
            let points: Vec<[f32; 3]> = directions
                .iter()
                .map(|d| std::array::from_fn(|a| centre[a] + half[a] * d[a]))
                .collect();
            let normals: Vec<[f32; 3]> = directions
                .iter()
                .map(|d| normalize(std::array::from_fn(|a| d[a] / half[a])))
                .collect();
            builder.polygon_with_normals(surface, &points, &normals, &vec![[0.0; 2]; points.len()]);
        }
    }
}
