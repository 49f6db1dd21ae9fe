//! Small things along the streets, lamp posts of other kinds, power poles.

use schema_types::{Class, ObjectId};
use sensor_core::mesh::Surface;
use sensor_core::{Material, Mesh, MeshBuilder};

use crate::chunk::{Chunks, Key, Layer};
use crate::furniture::far_lamps;
use crate::geometry::{P2, left, unit};
use simd_body::solid::{ellipsoid, tube};

fn iron() -> Surface {
    Surface::new(Class::POLES, Material::Metal, [44, 48, 50])
}

/// A lantern of a small town, 4.5 m high (lamp bit 0).
pub fn lantern() -> Mesh {
    let mut builder = MeshBuilder::new("lantern");
    let glow = Surface::lamp(Class::POLES, [255, 220, 160], 0);
    for (n, until_m) in [(8, 35.0), (4, 110.0)] {
        tube(
            &mut builder,
            iron(),
            ([0.0, 0.0, -0.05], 0.075),
            ([0.0, 0.0, 4.05], 0.045),
            n,
        );
        tube(
            &mut builder,
            glow,
            ([0.0, 0.0, 4.05], 0.13),
            ([0.0, 0.0, 4.45], 0.2),
            n,
        );
        tube(
            &mut builder,
            iron(),
            ([0.0, 0.0, 4.45], 0.26),
            ([0.0, 0.0, 4.68], 0.03),
            n,
        );
        if n == 8 {
            tube(
                &mut builder,
                iron(),
                ([0.0, 0.0, -0.05], 0.15),
                ([0.0, 0.0, 0.55], 0.11),
                n,
            );
            tube(
                &mut builder,
                iron(),
                ([0.0, 0.0, 3.5], 0.07),
                ([0.0, 0.0, 3.62], 0.07),
                n,
            );
        }
        builder.end_level(until_m);
    }
    far_lamps(
        &mut builder,
        (iron(), glow),
        [0.0, 0.0, 4.05],
        [0.0, 0.0, 4.6],
        [190.0, 300.0],
    );
    builder.finish()
}

/// A tall mast with an arm along +x, for wide roads (lamp bit 0).
pub fn mast() -> Mesh {
    let mut builder = MeshBuilder::new("lamp mast");
    let steel = Surface::new(Class::POLES, Material::Metal, [128, 132, 136]);
    let glow = Surface::lamp(Class::POLES, [255, 232, 196], 0);
    for (n, until_m) in [(8, 40.0), (4, 140.0)] {
        let thin = if n == 8 { 0.07 } else { 0.10 };
        tube(
            &mut builder,
            steel,
            ([0.0, 0.0, -0.05], 0.13),
            ([0.0, 0.0, 11.0], thin),
            n,
        );
        tube(
            &mut builder,
            steel,
            ([0.0, 0.0, 10.9], 0.8 * thin),
            ([1.9, 0.0, 11.3], 0.7 * thin),
            n,
        );
        builder.cuboid(steel, [2.2, 0.0, 11.32], [0.42, 0.16, 0.06]);
        builder.cuboid(glow, [2.2, 0.0, 11.25], [0.36, 0.13, 0.02]);
        builder.end_level(until_m);
    }
    far_lamps(
        &mut builder,
        (steel, glow),
        [0.0, 0.0, 11.1],
        [2.6, 0.0, 11.3],
        [260.0, 420.0],
    );
    builder.finish()
}

/// A fire hydrant, its mouth to +x.
pub fn hydrant() -> Mesh {
    let mut builder = MeshBuilder::new("hydrant");
    let red = Surface::new(Class::STATIC, Material::Matte, [176, 36, 30]);
    for (n, until_m) in [(10, 28.0), (4, 80.0)] {
        tube(
            &mut builder,
            red,
            ([0.0, 0.0, 0.0], 0.13),
            ([0.0, 0.0, 0.08], 0.13),
            n,
        );
        tube(
            &mut builder,
            red,
            ([0.0, 0.0, 0.0], 0.1),
            ([0.0, 0.0, 0.6], 0.09),
            n,
        );
        if n == 10 {
            tube(
                &mut builder,
                red,
                ([0.0, -0.17, 0.42], 0.045),
                ([0.0, 0.17, 0.42], 0.045),
                6,
            );
            tube(
                &mut builder,
                red,
                ([0.0, 0.0, 0.38], 0.055),
                ([0.17, 0.0, 0.38], 0.055),
                6,
            );
            ellipsoid(&mut builder, red, [0.0, 0.0, 0.6], [0.1, 0.1, 0.1], 8);
        }
        builder.end_level(until_m);
    }
    builder.finish()
}

/// A stone trough with flowers, 1.5 m along x.
pub fn planter() -> Mesh {
    let mut builder = MeshBuilder::new("planter");
    let stone = Surface::new(Class::STATIC, Material::Concrete, [158, 152, 144]);
    let leaves = Surface::new(Class::VEGETATION, Material::Foliage, [76, 108, 50]);
    for (n, until_m) in [(7, 30.0), (4, 90.0)] {
        builder.cuboid(stone, [0.0, 0.0, 0.25], [0.75, 0.3, 0.25]);
        for k in 0..if n == 7 { 5 } else { 2 } {
            let (x, r) = if n == 7 {
                (-0.56 + 0.28 * k as f32, 0.19)
            } else {
                (-0.36 + 0.72 * k as f32, 0.34)
            };
            ellipsoid(&mut builder, leaves, [x, 0.0, 0.56], [r, 0.24, 0.2], n);
        }
        if n == 7 {
            for k in 0..8 {
                let flower = Surface::new(
                    Class::VEGETATION,
                    Material::Matte,
                    [[206, 60, 84], [236, 190, 60], [232, 232, 236]][k % 3],
                );
                let (x, y) = (-0.6 + 0.17 * k as f32, if k % 2 == 0 { 0.1 } else { -0.1 });
                builder.cuboid(flower, [x, y, 0.74], [0.035, 0.035, 0.02]);
            }
        }
        builder.end_level(until_m);
    }
    builder.finish()
}

/// A stand for bicycles, hoops along x.
pub fn rack() -> Mesh {
    let mut builder = MeshBuilder::new("bicycle rack");
    let steel = Surface::new(Class::STATIC, Material::Metal, [140, 144, 148]);
    for (n, until_m) in [(5, 28.0), (3, 70.0)] {
        for k in 0..4 {
            let x = -0.9 + 0.6 * k as f32;
            let rail = |b: &mut MeshBuilder, from: [f32; 3], to: [f32; 3]| {
                tube(b, steel, (from, 0.025), (to, 0.025), n)
            };
            rail(&mut builder, [x, -0.32, -0.02], [x, -0.32, 0.78]);
            rail(&mut builder, [x, 0.32, -0.02], [x, 0.32, 0.78]);
            rail(&mut builder, [x, -0.33, 0.78], [x, 0.33, 0.78]);
        }
        builder.end_level(until_m);
    }
    builder.finish()
}

/// A letter box, its slot to +x.
pub fn letter_box() -> Mesh {
    let mut builder = MeshBuilder::new("letter box");
    let yellow = Surface::new(Class::STATIC, Material::Matte, [222, 176, 36]);
    let dark = Surface::new(Class::STATIC, Material::Matte, [40, 40, 42]);
    builder.cuboid(dark, [0.0, 0.0, 0.35], [0.05, 0.05, 0.35]);
    builder.cuboid(yellow, [0.0, 0.0, 1.0], [0.2, 0.26, 0.36]);
    builder.cuboid(dark, [0.2, 0.0, 1.2], [0.006, 0.17, 0.022]);
    builder.end_level(35.0);
    builder.cuboid(yellow, [0.0, 0.0, 1.0], [0.2, 0.26, 0.36]);
    builder.end_level(95.0);
    builder.finish()
}

/// A grey cabinet of the electricity works.
pub fn cabinet() -> Mesh {
    let mut builder = MeshBuilder::new("cabinet");
    let grey = Surface::new(Class::STATIC, Material::Matte, [140, 146, 142]);
    let dark = Surface::new(Class::STATIC, Material::Matte, [86, 90, 88]);
    builder.cuboid(grey, [0.0, 0.0, 0.62], [0.2, 0.5, 0.6]);
    builder.cuboid(dark, [0.2, 0.0, 0.62], [0.004, 0.008, 0.56]);
    builder.cuboid(dark, [0.2, 0.25, 0.95], [0.004, 0.13, 0.06]);
    builder.cuboid(dark, [0.0, 0.0, 1.24], [0.23, 0.53, 0.02]);
    builder.end_level(35.0);
    builder.cuboid(grey, [0.0, 0.0, 0.62], [0.2, 0.5, 0.62]);
    builder.end_level(100.0);
    builder.finish()
}

/// A cast-iron cover, flush with the road.
pub fn manhole() -> Mesh {
    let mut builder = MeshBuilder::new("manhole");
    let iron = Surface::new(Class::ROADS, Material::Matte, [46, 45, 44]);
    let ring = Surface::new(Class::ROADS, Material::Matte, [92, 92, 92]);
    for (n, until_m) in [(14usize, 22.0), (8, 45.0)] {
        let disc = |r: f32, z: f32| -> Vec<[f32; 3]> {
            (0..n)
                .map(|k| std::f32::consts::TAU * k as f32 / n as f32)
                .map(|a| [r * a.cos(), r * a.sin(), z])
                .collect()
        };
        builder.polygon(ring, &disc(0.4, 0.006), &vec![[0.0; 2]; n]);
        builder.polygon(iron, &disc(0.33, 0.011), &vec![[0.0; 2]; n]);
        builder.end_level(until_m);
    }
    builder.finish()
}

/// Height of the cross-arm of a power pole, and where on it the wires hang.
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
