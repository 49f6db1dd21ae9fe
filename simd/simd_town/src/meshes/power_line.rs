//! Wooden poles and the wires between them.

use schema_types::{Class, ObjectId};
use sensor_core::mesh::Surface;
use sensor_core::{Material, Mesh, MeshBuilder};
use simd_body::solid::tube;

use crate::geometry::{P2, left, unit};
use crate::scenery::{Chunks, Key, Layer};

/// Height of a power pole's cross-arm, and the places on it where wires hang.
const WIRES_M: (f64, [f64; 3]) = (8.15, [-0.85, 0.0, 0.85]);

/// A wooden pole with a cross-arm across y.
pub fn power_pole() -> Mesh {
    let mut builder = MeshBuilder::new("power pole");
    let wood = Surface::new(Class::POLES, Material::Bark, [104, 84, 64]);
    let glass = Surface::new(Class::POLES, Material::Matte, [188, 196, 194]);
    for (n, until_m) in [(7, 45.0), (3, 300.0)] {
        tube(
            &mut builder,
            wood,
            ([0.0, 0.0, -0.3], 0.15),
            ([0.0, 0.0, 8.4], 0.1),
            n,
        );
        builder.cuboid(wood, [0.0, 0.0, 7.95], [0.06, 1.05, 0.07]);
        if n == 7 {
            for y in WIRES_M.1 {
                tube(
                    &mut builder,
                    glass,
                    ([0.0, y as f32, 8.0], 0.04),
                    ([0.0, y as f32, WIRES_M.0 as f32], 0.03),
                    5,
                );
            }
        }
        builder.end_level(until_m);
    }
    builder.finish()
}

/// Three wires between two power poles (foot, heading), sagging.
pub fn wires(chunks: &mut Chunks, object: ObjectId, from: (P2, f64), to: (P2, f64)) {
    let black = Surface::new(Class::POLES, Material::Rubber, [30, 30, 32]).of(object);
    let ground = [from.0, to.0].map(|p| chunks.terrain.at(p));
    for y in WIRES_M.1 {
        let end = |(p, heading): (P2, f64)| p + left(unit(heading)) * y;
        let (a, b) = (end(from), end(to));
        let at = |share: f64, up: f64| {
            let p = a + (b - a) * share;
            let z = ground[0] + (ground[1] - ground[0]) * share + WIRES_M.0
                - 0.75 * 4.0 * share * (1.0 - share);
            [p.x, p.y, z + up]
        };
        let key = Key::at(Layer::Small, 0.5 * (a + b));
        let n = 6;
        for k in 0..n {
            let (s, t) = (k as f64 / f64::from(n), f64::from(k + 1) / f64::from(n));
            let face = [at(s, -0.014), at(t, -0.014), at(t, 0.014), at(s, 0.014)];
            chunks.polygon(key, 0..=1, black, &face, &[[0.0; 2]; 4]);
            chunks.polygon(
                key,
                0..=1,
                black,
                &[face[1], face[0], face[3], face[2]],
                &[[0.0; 2]; 4],
            );
        }
    }
}
