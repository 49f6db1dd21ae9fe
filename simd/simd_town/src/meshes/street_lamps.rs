//! Street lamps: steel lamps, lanterns of small towns, masts of motorways.

use schema_types::Class;
use sensor_core::mesh::Surface;
use sensor_core::{Material, Mesh, MeshBuilder};
use simd_body::solid::{post, tube};

/// Painted steel of poles.
pub(super) fn steel() -> Surface {
    Surface::new(Class::POLES, Material::Metal, [74, 78, 82])
}

fn iron() -> Surface {
    Surface::new(Class::POLES, Material::Metal, [44, 48, 50])
}

/// A street lamp: pole, arm along +x, lamp (bit 0).
pub fn street_lamp() -> Mesh {
    let mut builder = MeshBuilder::new("street lamp");
    let glow = Surface::lamp(Class::POLES, [255, 226, 178], 0);
    for (n, until_m) in [(8, 40.0), (4, 130.0)] {
        let thin = if n == 8 { 0.055 } else { 0.085 };
        tube(
            &mut builder,
            steel(),
            ([0.0, 0.0, -0.05], 0.10),
            ([0.0, 0.0, 7.6], thin),
            n,
        );
        tube(
            &mut builder,
            steel(),
            ([0.0, 0.0, 7.5], 0.8 * thin),
            ([1.5, 0.0, 8.0], 0.7 * thin),
            n,
        );
        builder.cuboid(steel(), [1.75, 0.0, 8.03], [0.36, 0.13, 0.05]);
        builder.cuboid(glow, [1.75, 0.0, 7.97], [0.30, 0.10, 0.02]);
        if n == 8 {
            tube(
                &mut builder,
                steel(),
                ([0.0, 0.0, -0.05], 0.15),
                ([0.0, 0.0, 0.8], 0.13),
                n,
            );
        }
        builder.end_level(until_m);
    }
    far_lamps(
        &mut builder,
        steel(),
        glow,
        [0.0, 0.0, 7.75],
        [2.1, 0.0, 7.98],
        [240.0, 350.0],
    );
    builder.finish()
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
        iron(),
        glow,
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
        steel,
        glow,
        [0.0, 0.0, 11.1],
        [2.6, 0.0, 11.3],
        [260.0, 420.0],
    );
    builder.finish()
}

/// Adds two levels of a lamp seen from far away: first a pole up to `top` and an arm whose end
/// glows, then the pole alone with a glowing top.
///
/// Poles are drawn thicker than they are: pixels miss what is much narrower than they are, and the
/// lamp's head would hang in the air.
fn far_lamps(
    builder: &mut MeshBuilder,
    metal: Surface,
    glow: Surface,
    top: [f32; 3],
    end: [f32; 3],
    until_m: [f32; 2],
) {
    let foot = [0.0, 0.0, -0.05];
    let between =
        |share: f32| std::array::from_fn::<f32, 3, _>(|i| top[i] + (end[i] - top[i]) * share);
    post(builder, metal, foot, top, until_m[0] / 1400.0);
    if end[0] > top[0] {
        post(builder, metal, top, between(0.68), until_m[0] / 1800.0);
        post(builder, glow, between(0.68), end, until_m[0] / 1600.0);
    } else {
        post(builder, glow, top, end, until_m[0] / 1000.0);
    }
    builder.end_level(until_m[0]);
    post(builder, metal, foot, top, until_m[1] / 1400.0);
    post(
        builder,
        glow,
        top,
        [top[0], top[1], top[2] + 0.4],
        until_m[1] / 1400.0,
    );
    builder.end_level(until_m[1]);
}
