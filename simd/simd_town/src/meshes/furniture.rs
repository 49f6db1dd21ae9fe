//! Street furniture: benches, bins, bollards, shelters and other small things of the map.

use schema_types::Class;
use sensor_core::mesh::Surface;
use sensor_core::{Material, Mesh, MeshBuilder};
use simd_body::solid::{ellipsoid, tube};

/// A bench 1.8 m long; people on it look to +x.
pub fn bench() -> Mesh {
    let mut builder = MeshBuilder::new("bench");
    let (wood, iron) = (
        Surface::new(Class::STATIC, Material::Matte, [128, 88, 56]),
        Surface::new(Class::STATIC, Material::Metal, [52, 54, 56]),
    );
    for k in 0..4 {
        builder.cuboid(
            wood,
            [-0.15 + 0.12 * k as f32, 0.0, 0.45],
            [0.05, 0.9, 0.02],
        );
    }
    for k in 0..3 {
        builder.cuboid(
            wood,
            [-0.24 - 0.03 * k as f32, 0.0, 0.58 + 0.13 * k as f32],
            [0.02, 0.9, 0.05],
        );
    }
    for y in [-0.7, 0.7] {
        builder.cuboid(iron, [0.03, y, 0.21], [0.24, 0.03, 0.22]);
        builder.cuboid(iron, [-0.28, y, 0.66], [0.02, 0.03, 0.24]);
    }
    builder.end_level(45.0);
    builder.cuboid(wood, [0.03, 0.0, 0.45], [0.23, 0.9, 0.02]);
    builder.cuboid(wood, [-0.27, 0.0, 0.71], [0.03, 0.9, 0.19]);
    builder.end_level(110.0);
    builder.finish()
}

/// A litter bin.
pub fn bin() -> Mesh {
    let mut builder = MeshBuilder::new("bin");
    let green = Surface::new(Class::DYNAMIC, Material::Metal, [46, 84, 60]);
    let dark = Surface::new(Class::DYNAMIC, Material::Rubber, [24, 26, 26]);
    for (n, until_m) in [(10, 35.0), (5, 100.0)] {
        tube(
            &mut builder,
            green,
            ([0.0, 0.0, 0.0], 0.21),
            ([0.0, 0.0, 0.82], 0.25),
            n,
        );
        tube(
            &mut builder,
            dark,
            ([0.0, 0.0, 0.82], 0.26),
            ([0.0, 0.0, 0.95], 0.18),
            n,
        );
        builder.end_level(until_m);
    }
    builder.finish()
}

/// A bollard.
pub fn bollard() -> Mesh {
    let mut builder = MeshBuilder::new("bollard");
    let iron = Surface::new(Class::STATIC, Material::Metal, [56, 58, 62]);
    let ring = Surface::new(Class::STATIC, Material::Paint, [224, 224, 220]);
    tube(
        &mut builder,
        iron,
        ([0.0, 0.0, 0.0], 0.065),
        ([0.0, 0.0, 0.86], 0.055),
        8,
    );
    tube(
        &mut builder,
        ring,
        ([0.0, 0.0, 0.68], 0.066),
        ([0.0, 0.0, 0.76], 0.065),
        8,
    );
    ellipsoid(&mut builder, iron, [0.0, 0.0, 0.86], [0.06, 0.06, 0.05], 8);
    builder.end_level(30.0);
    tube(
        &mut builder,
        iron,
        ([0.0, 0.0, 0.0], 0.065),
        ([0.0, 0.0, 0.9], 0.05),
        4,
    );
    builder.end_level(90.0);
    builder.finish()
}

/// A bus shelter, 3 m wide, open towards +x.
pub fn shelter() -> Mesh {
    let mut builder = MeshBuilder::new("shelter");
    let metal = Surface::new(Class::STATIC, Material::Metal, [70, 74, 78]);
    let glass = Surface::new(Class::STATIC, Material::Glass, [120, 140, 146]);
    let poster = Surface::new(Class::STATIC, Material::Matte, [206, 120, 52]);
    for until_m in [140.0] {
        builder.cuboid(metal, [0.0, 0.0, 2.45], [0.75, 1.65, 0.05]);
        for (x, y) in [(-0.65, -1.55), (-0.65, 1.55), (0.55, -1.55), (0.55, 1.55)] {
            builder.cuboid(metal, [x, y, 1.2], [0.035, 0.035, 1.2]);
        }
        builder.cuboid(glass, [-0.65, 0.0, 1.25], [0.01, 1.5, 0.95]);
        builder.cuboid(poster, [-0.05, 1.55, 1.2], [0.5, 0.02, 0.85]);
        builder.cuboid(metal, [-0.35, -0.3, 0.46], [0.18, 0.9, 0.03]);
        builder.end_level(until_m);
    }
    builder.finish()
}

/// A fire hydrant with its outlet towards +x.
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

/// A letter box with its slot towards +x.
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

/// A grey cabinet for electrical equipment.
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
