//! Bodies lofted through cross-sections, and the small solids that go with them.

use sensor_core::MeshBuilder;
use sensor_core::mesh::Surface;

/// Half of a closed cross-section at one x: from the middle of the floor up the left side to the
/// middle of the roof.
#[derive(Clone, Debug)]
pub struct Section {
    /// Place along the vehicle.
    pub x_m: f32,
    /// (y, z) from floor to roof; first and last have y = 0.
    pub ring_m: Vec<[f32; 2]>,
}

fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn normalize(a: [f32; 3]) -> [f32; 3] {
    let length = dot(a, a).sqrt();
    if length > 1e-9 {
        a.map(|x| x / length)
    } else {
        [0.0, 0.0, 1.0]
    }
}

/// Cosine of the angle beyond which an edge stays sharp.
const CREASE: f32 = 0.62;

/// Skins the sections from front to rear, both sides, and closes the two ends; `surface(segment,
/// strip)` says with what.
pub fn loft(
    builder: &mut MeshBuilder,
    sections: &[Section],
    surface: impl Fn(usize, usize) -> Surface,
    caps: [Surface; 2],
) {
    loft_with_holes(
        builder,
        sections,
        |segment, strip| Some(surface(segment, strip)),
        caps,
    );
}

/// As [`loft`], without the faces for which there is no surface.
pub fn loft_with_holes(
    builder: &mut MeshBuilder,
    sections: &[Section],
    surface: impl Fn(usize, usize) -> Option<Surface>,
    caps: [Surface; 2],
) {
    let point = |i: usize, j: usize| {
        [
            sections[i].x_m,
            sections[i].ring_m[j][0],
            sections[i].ring_m[j][1],
        ]
    };
    let (n_segments, n_strips) = (sections.len() - 1, sections[0].ring_m.len() - 1);
    let face = |i: usize, j: usize| {
        normalize(cross(
            sub(point(i + 1, j + 1), point(i, j)),
            sub(point(i, j + 1), point(i + 1, j)),
        ))
    };
    let faces: Vec<Vec<[f32; 3]>> = (0..n_segments)
        .map(|i| (0..n_strips).map(|j| face(i, j)).collect())
        .collect();
    // Normal of the corner (i, j) as the face (fi, fj) sees it: the mean of the faces that do not
    // meet it at a sharp edge.
    let corner_normal = |i: usize, j: usize, own: [f32; 3]| {
        let mut sum = [0.0; 3];
        for strip in &faces[i.saturating_sub(1)..(i + 1).min(n_segments)] {
            for n in &strip[j.saturating_sub(1)..(j + 1).min(n_strips)] {
                if dot(*n, own) > CREASE {
                    sum = std::array::from_fn(|k| sum[k] + n[k]);
                }
            }
        }
        if j == 0 || j == n_strips {
            sum[1] = 0.0;
        }
        normalize(sum)
    };
    for (i, strip) in faces.iter().enumerate() {
        for (j, own) in strip.iter().copied().enumerate() {
            let Some(surface) = surface(i, j) else {
                continue;
            };
            let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
            let points = corners.map(|(a, b)| point(a, b));
            let normals = corners.map(|(a, b)| corner_normal(a, b, own));
            let uv = points.map(|p| [p[0], p[2]]);
            builder.polygon_with_normals(surface, &points, &normals, &uv);
            let mirror = |v: [f32; 3]| [v[0], -v[1], v[2]];
            let order = [3, 2, 1, 0];
            builder.polygon_with_normals(
                surface,
                &order.map(|k| mirror(points[k])),
                &order.map(|k| mirror(normals[k])),
                &order.map(|k| uv[k]),
            );
        }
    }
    for (i, cap) in [(0, caps[0]), (n_segments, caps[1])] {
        end_cap(builder, &sections[i], cap, i == 0);
    }
}

/// Closes a body at a section; to the front or to the rear.
pub fn end_cap(builder: &mut MeshBuilder, section: &Section, surface: Surface, front: bool) {
    // Strips of trapezoids between mirrored points keep every face convex.
    for pair in section.ring_m.windows(2) {
        let [[y0, z0], [y1, z1]] = [pair[0], pair[1]];
        if z1 - z0 < 1e-5 {
            continue;
        }
        let x = section.x_m;
        let corners = if front {
            [[x, -y0, z0], [x, y0, z0], [x, y1, z1], [x, -y1, z1]]
        } else {
            [[x, y0, z0], [x, -y0, z0], [x, -y1, z1], [x, y1, z1]]
        };
        let kept: Vec<[f32; 3]> = corners
            .iter()
            .enumerate()
            .filter(|&(k, c)| !corners[..k].contains(c))
            .map(|(_, c)| *c)
            .collect();
        if kept.len() >= 3 {
            let uv: Vec<[f32; 2]> = kept.iter().map(|c| [c[1], c[2]]).collect();
            builder.polygon(surface, &kept, &uv);
        }
    }
}

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

/// Three directions across an axis, evenly about it.
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
