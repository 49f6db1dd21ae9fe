//! Rounded solids as stacks of elliptic rings along z.

use sensor_core::MeshBuilder;
use sensor_core::mesh::Surface;

/// One ring: height, middle along x, half extents along x and y; metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ring {
    /// Height.
    pub z_m: f32,
    /// Middle along x.
    pub x_m: f32,
    /// Half extent along x.
    pub half_x_m: f32,
    /// Half extent along y.
    pub half_y_m: f32,
}

/// A ring from shares of `scale_m`.
pub fn ring(scale_m: f32, [z, x, half_x, half_y]: [f32; 4]) -> Ring {
    Ring {
        z_m: z * scale_m,
        x_m: x * scale_m,
        half_x_m: half_x * scale_m,
        half_y_m: half_y * scale_m,
    }
}

impl Ring {
    fn at(&self, angle: f32) -> [f32; 3] {
        [
            self.x_m + self.half_x_m * angle.cos(),
            self.half_y_m * angle.sin(),
            self.z_m,
        ]
    }

    fn radius_m(&self) -> f32 {
        0.5 * (self.half_x_m + self.half_y_m)
    }
}

/// Skins rings by rising height with `n` sides, closed at both ends; `surface(i)` is that of the
/// band above ring `i`.
pub fn stack(
    builder: &mut MeshBuilder,
    rings: &[Ring],
    n: usize,
    surface: impl Fn(usize) -> Surface,
) {
    let angle = |k: usize| std::f32::consts::TAU * (k % n) as f32 / n as f32;
    let slope = |i: usize| {
        let (a, b) = (
            rings[i.saturating_sub(1)],
            rings[(i + 1).min(rings.len() - 1)],
        );
        ((a.radius_m() - b.radius_m()) / (b.z_m - a.z_m).max(1e-4)).clamp(-3.0, 3.0)
    };
    let normal = |i: usize, k: usize| {
        let (r, a) = (&rings[i], angle(k));
        let (x, y) = (
            a.cos() * r.half_y_m.max(1e-4),
            a.sin() * r.half_x_m.max(1e-4),
        );
        let across = x.hypot(y).max(1e-6);
        let z = slope(i);
        let length = (1.0 + z * z).sqrt();
        [x / across / length, y / across / length, z / length]
    };
    for i in 0..rings.len() - 1 {
        for k in 0..n {
            let order = [(i, k), (i, k + 1), (i + 1, k + 1), (i + 1, k)];
            let points = order.map(|(i, k)| rings[i].at(angle(k)));
            builder.polygon_with_normals(
                surface(i),
                &points,
                &order.map(|(i, k)| normal(i, k)),
                &[[0.0; 2]; 4],
            );
        }
    }
    let last = rings.len() - 1;
    let bottom: Vec<[f32; 3]> = (0..n).rev().map(|k| rings[0].at(angle(k))).collect();
    let top: Vec<[f32; 3]> = (0..n).map(|k| rings[last].at(angle(k))).collect();
    for (cap, i, band) in [(bottom, 0, 0), (top, last, last - 1)] {
        if rings[i].radius_m() > 2e-3 {
            builder.polygon(surface(band), &cap, &vec![[0.0; 2]; n]);
        }
    }
}
