//! Small things on the skin of any body: lamps and number plates.

use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder};

use super::bodywork::Bodywork;

/// Adds a lamp that stands out of the skin a little. Coarser levels have only its front and, up to
/// the third level, its outer side. `towards` holds the signs of x and y in which it looks.
pub(super) fn lamp_block(
    builder: &mut MeshBuilder,
    surface: Surface,
    centre_m: [f32; 3],
    half_m: [f32; 3],
    towards: [f32; 2],
    detail: usize,
) {
    if detail == 0 {
        builder.cuboid(surface, centre_m, half_m);
        return;
    }
    let ([x, y, z], [hx, hy, hz], [ahead, out]) = (centre_m, half_m, towards);
    let front_x = x + ahead * hx;
    // Counter-clockwise as seen from the front of the lamp.
    let front = [(-ahead, -1.0), (ahead, -1.0), (ahead, 1.0), (-ahead, 1.0)]
        .map(|(a, b)| [front_x, y + a * hy, z + b * hz]);
    builder.polygon(surface, &front, &[[0.0; 2]; 4]);
    if detail < 3 {
        let side = [(out, -1.0), (-out, -1.0), (-out, 1.0), (out, 1.0)]
            .map(|(a, b)| [x + a * hx, y + out * hy, z + b * hz]);
        builder.polygon(surface, &side, &[[0.0; 2]; 4]);
    }
}

/// Number plate.
pub fn plate(builder: &mut MeshBuilder, body: &Bodywork, centre_m: [f32; 3]) {
    builder.cuboid(
        Surface::new(body.class, Material::Matte, [236, 236, 230]),
        centre_m,
        [0.006, 0.26, 0.055],
    );
}
