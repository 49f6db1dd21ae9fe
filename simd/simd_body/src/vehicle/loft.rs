//! Lofting: a smooth skin through cross-sections.

use sensor_core::MeshBuilder;
use sensor_core::mesh::Surface;

use crate::vector::{cross, dot, normalize, sub};

/// Half of a closed cross-section at one x: from the middle of the floor up the left side to the
/// middle of the roof.
#[derive(Clone, Debug)]
pub struct Section {
    /// Place along the vehicle.
    pub x_m: f32,
    /// (y, z) from floor to roof; first and last have y = 0.
    pub ring_m: Vec<[f32; 2]>,
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
    // Normal of the corner (i, j) in the face with normal `own`: the mean over the faces about the
    // corner that do not meet that face at a sharp edge.
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

/// Closes a body at a section, towards the front or the rear.
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
