//! A wheelchair for a seated person.

use schema_types::Class;
use sensor_core::mesh::Surface;
use sensor_core::{Material, Mesh, MeshBuilder};

use crate::solid::tube;

/// A wheelchair for a body of this height; origin on the ground under the middle of the body, x
/// forward.
pub fn wheelchair(height_m: f32) -> Mesh {
    let grow = (height_m / 1.8).clamp(0.7, 1.1);
    let mut builder = MeshBuilder::new("wheelchair");
    let metal = Surface::new(Class::PEDESTRIANS, Material::Metal, [150, 152, 156]);
    let rubber = Surface::new(Class::PEDESTRIANS, Material::Rubber, [30, 30, 32]);
    let seat = Surface::new(Class::PEDESTRIANS, Material::Cloth, [36, 40, 52]);
    let at = |p: [f32; 3]| p.map(|x| x * grow);
    builder.cuboid(seat, at([0.10, 0.0, 0.46]), at([0.22, 0.20, 0.02]));
    builder.cuboid(seat, at([-0.13, 0.0, 0.68]), at([0.018, 0.20, 0.22]));
    for side in [1.0f32, -1.0] {
        hoop(
            &mut builder,
            rubber,
            at([-0.06, side * 0.27, 0.30]),
            0.30 * grow,
            0.018 * grow,
            20,
        );
        hoop(
            &mut builder,
            metal,
            at([-0.06, side * 0.295, 0.30]),
            0.24 * grow,
            0.009 * grow,
            16,
        );
        for k in 0..6 {
            let a = std::f32::consts::TAU * k as f32 / 6.0;
            let rim = at([-0.06 + 0.29 * a.cos(), side * 0.27, 0.30 + 0.29 * a.sin()]);
            tube(
                &mut builder,
                metal,
                (at([-0.06, side * 0.27, 0.30]), 0.004),
                (rim, 0.004),
                3,
            );
        }
        hoop(
            &mut builder,
            rubber,
            at([0.42, side * 0.18, 0.08]),
            0.08 * grow,
            0.016 * grow,
            10,
        );
        let rods = [
            ([0.42, 0.18, 0.14], [0.34, 0.20, 0.44]),
            ([0.34, 0.20, 0.44], [-0.13, 0.21, 0.44]),
            ([-0.13, 0.21, 0.30], [-0.13, 0.21, 0.92]),
            ([-0.13, 0.21, 0.92], [-0.24, 0.21, 0.93]),
            ([-0.06, 0.27, 0.30], [-0.06, 0.20, 0.30]),
            ([-0.12, 0.22, 0.66], [0.24, 0.22, 0.66]),
            ([0.24, 0.22, 0.66], [0.30, 0.20, 0.44]),
            ([0.34, 0.14, 0.44], [0.52, 0.12, 0.12]),
        ];
        for (from, to) in rods {
            let mirrored = |[x, y, z]: [f32; 3]| at([x, side * y, z]);
            tube(
                &mut builder,
                metal,
                (mirrored(from), 0.012),
                (mirrored(to), 0.012),
                6,
            );
        }
        builder.cuboid(
            metal,
            at([0.56, side * 0.11, 0.10]),
            at([0.09, 0.07, 0.008]),
        );
    }
    builder.finish()
}

/// A tyre about an axle along y.
fn hoop(
    builder: &mut MeshBuilder,
    surface: Surface,
    centre_m: [f32; 3],
    radius_m: f32,
    thick_m: f32,
    n: usize,
) {
    let at = |k: usize| {
        let a = std::f32::consts::TAU * (k % n) as f32 / n as f32;
        [
            centre_m[0] + radius_m * a.cos(),
            centre_m[1],
            centre_m[2] + radius_m * a.sin(),
        ]
    };
    for k in 0..n {
        tube(builder, surface, (at(k), thick_m), (at(k + 1), thick_m), 4);
    }
}
