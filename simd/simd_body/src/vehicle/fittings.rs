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

const PLATE_HALF_M: [f32; 3] = [0.006, 0.26, 0.055];

fn plate_surface(body: &Bodywork) -> Surface {
    Surface::new(body.class, Material::Matte, [236, 236, 230])
}

/// Number plate with seven characters, each a few strokes wide.
pub fn plate(builder: &mut MeshBuilder, body: &Bodywork, centre_m: [f32; 3]) {
    builder.cuboid(plate_surface(body), centre_m, PLATE_HALF_M);
    let ink = Surface::new(body.class, Material::Matte, [24, 24, 28]);
    let ahead = centre_m[0].signum();
    let x = centre_m[0] + ahead * (PLATE_HALF_M[0] + 0.001);
    for (i, strokes) in CHARACTERS.iter().enumerate() {
        let place = i as f32 + if i < 2 { 0.0 } else { 0.5 };
        for [left, low, right, high] in *strokes {
            // Seen from outside, the first is on the left.
            let y = |share: f32| -ahead * (0.235 - 0.0635 * place - 0.044 * share);
            let z = |share: f32| centre_m[2] - 0.036 + 0.072 * share;
            let (y, z) = ([y(*left), y(*right)], [z(*low), z(*high)]);
            let corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[a, b]| [x, y[a], z[b]]);
            builder.polygon(ink, &corners, &[[0.0; 2]; 4]);
        }
    }
}

/// Number plate as it is seen from afar: its face.
pub fn far_plate(builder: &mut MeshBuilder, body: &Bodywork, centre_m: [f32; 3], ahead: f32) {
    lamp_block(
        builder,
        plate_surface(body),
        centre_m,
        PLATE_HALF_M,
        [ahead, 1.0],
        3,
    );
}

/// Strokes of GT 47 AUL: left, low, right, high as shares of the character's box.
const CHARACTERS: [&[[f32; 4]]; 7] = [
    &[
        [0.0, 0.0, 0.25, 1.0],
        [0.25, 0.82, 1.0, 1.0],
        [0.25, 0.0, 1.0, 0.18],
        [0.75, 0.18, 1.0, 0.5],
    ],
    &[[0.0, 0.82, 1.0, 1.0], [0.38, 0.0, 0.62, 0.82]],
    &[
        [0.0, 0.3, 0.25, 1.0],
        [0.25, 0.3, 1.0, 0.48],
        [0.6, 0.0, 0.85, 0.7],
    ],
    &[[0.0, 0.82, 1.0, 1.0], [0.6, 0.0, 0.85, 0.82]],
    &[
        [0.0, 0.0, 0.25, 1.0],
        [0.75, 0.0, 1.0, 1.0],
        [0.25, 0.82, 0.75, 1.0],
        [0.25, 0.4, 0.75, 0.56],
    ],
    &[
        [0.0, 0.0, 0.25, 1.0],
        [0.75, 0.0, 1.0, 1.0],
        [0.25, 0.0, 0.75, 0.18],
    ],
    &[[0.0, 0.0, 0.25, 1.0], [0.25, 0.0, 1.0, 0.18]],
];
