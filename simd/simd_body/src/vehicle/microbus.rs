//! What sets a microbus apart from a van: two colours, round headlamps, bumpers of chrome, upright
//! tail lamps, a flap for the engine.

use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder};

use super::bodywork::Bodywork;
use super::fittings::{lamp_block, plate};

/// Roof and pillars.
pub(super) fn upper(body: &Bodywork) -> Surface {
    Surface::new(body.class, Material::Matte, [232, 229, 218])
}

fn chrome(body: &Bodywork) -> Surface {
    Surface::new(body.class, Material::Metal, [206, 208, 210])
}

/// Heights over the ground as shares of the body's: headlamps, bumpers, tail lamps.
const HEADLAMPS: f32 = 0.395;
const BUMPERS: f32 = 0.205;
const TAIL_LAMPS: f32 = 0.36;

/// A disc that looks forwards, as a prism about x from the skin to `x`.
fn disc(
    builder: &mut MeshBuilder,
    rim: Surface,
    face: Surface,
    [x, y, z]: [f32; 3],
    [radius, depth]: [f32; 2],
    n: usize,
) {
    let at = |k: usize, x: f32| {
        let a = std::f32::consts::TAU * (k % n) as f32 / n as f32;
        [x, y + radius * a.cos(), z + radius * a.sin()]
    };
    let corners: Vec<[f32; 3]> = (0..n).map(|k| at(k, x)).collect();
    builder.polygon(face, &corners, &vec![[0.0; 2]; n]);
    if n > 6 {
        for k in 0..n {
            builder.polygon(
                rim,
                &[
                    at(k, x),
                    at(k, x - depth),
                    at(k + 1, x - depth),
                    at(k + 1, x),
                ],
                &[[0.0; 2]; 4],
            );
        }
    }
}

/// Adds front and rear: lamps, and in the finest level bumpers, plates, vents and a ring on the
/// nose.
pub(super) fn ends(builder: &mut MeshBuilder, body: &Bodywork, detail: usize) {
    front(builder, body, detail);
    rear(builder, body, detail);
    bumpers(builder, body, detail);
}

fn front(builder: &mut MeshBuilder, body: &Bodywork, detail: usize) {
    let (h, w, skin) = (body.height(), body.half_width_m, body.skin_m());
    let n = [14, 8, 6, 4][detail];
    for side in [1.0f32, -1.0] {
        let blinker = if side > 0.0 { 5 } else { 4 };
        let (y, z) = (side * 0.64 * w, HEADLAMPS * h);
        disc(
            builder,
            chrome(body),
            body.lamp([255, 246, 224], 1),
            [skin + 0.018, y, z],
            [0.108, 0.07],
            n,
        );
        if detail < 2 {
            // High beam in the middle of the glass, the position lamp under it.
            disc(
                builder,
                chrome(body),
                body.lamp([255, 250, 235], 2),
                [skin + 0.022, y, z + 0.02],
                [0.045, 0.01],
                n.min(8),
            );
            let mut lamp = |rgb: [u8; 3], bit: u8, z: f32, half: [f32; 2]| {
                lamp_block(
                    builder,
                    body.lamp(rgb, bit),
                    [skin - 0.042, y, z],
                    [0.06, half[0], half[1]],
                    [1.0, side],
                    detail,
                );
            };
            lamp([250, 250, 255], 0, z - 0.135, [0.05, 0.014]);
            lamp([255, 160, 30], blinker, z + 0.175, [0.085, 0.030]);
        }
    }
    if detail == 0 {
        disc(
            builder,
            chrome(body),
            chrome(body),
            [skin + 0.006, 0.0, 0.40 * h],
            [0.15, 0.03],
            18,
        );
        disc(
            builder,
            body.paint(),
            body.paint(),
            [skin + 0.009, 0.0, 0.40 * h],
            [0.125, 0.01],
            18,
        );
        // The grille of the fresh air under the windscreen.
        let (x, z) = (body.x(0.022), 0.505 * h);
        builder.cuboid(body.dark(), [x - 0.01, 0.0, z], [0.035, 0.55 * w, 0.022]);
    }
}

fn rear(builder: &mut MeshBuilder, body: &Bodywork, detail: usize) {
    let (h, w, skin) = (body.height(), body.half_width_m, body.skin_m());
    for side in [1.0f32, -1.0] {
        let blinker = if side > 0.0 { 5 } else { 4 };
        let mut lamp = |rgb: [u8; 3], bit: u8, up: f32, half: f32| {
            let at = [0.045 - skin, side * 0.80 * w, TAIL_LAMPS * h + up];
            lamp_block(
                builder,
                body.lamp(rgb, bit),
                at,
                [0.06, 0.055, half],
                [-1.0, side],
                detail,
            );
        };
        lamp([235, 20, 16], 0, -0.05, 0.048);
        lamp([255, 24, 18], 3, 0.05, 0.048);
        if detail < 2 {
            lamp([255, 150, 25], blinker, 0.138, 0.038);
            lamp([245, 245, 245], 6, -0.130, 0.030);
        }
    }
    if detail == 0 {
        let line = |builder: &mut MeshBuilder, half_y: f32, z: f32| {
            builder.cuboid(body.dark(), [0.012 - skin, 0.0, z], [0.016, half_y, 0.006])
        };
        for z in [0.30, 0.47] {
            line(builder, 0.62 * w, z * h);
        }
        plate(builder, body, [-body.half[0] + 0.006, 0.0, 0.26 * h]);
        builder.cuboid(
            body.dark(),
            [0.01 - skin, 0.0, 0.26 * h],
            [0.034, 0.27, 0.06],
        );
        // Vents behind the side windows, a rail for the sliding door.
        for side in [1.0f32, -1.0] {
            for k in 0..5 {
                let (x, z) = (body.x(0.915), (0.60 + 0.035 * k as f32) * h);
                builder.cuboid(
                    body.dark(),
                    [x, side * (0.945 - 0.012 * k as f32) * w, z],
                    [0.045, 0.02, 0.008],
                );
            }
        }
    }
}

fn bumpers(builder: &mut MeshBuilder, body: &Bodywork, detail: usize) {
    let (h, w, reach) = (body.height(), body.half_width_m, body.half[0]);
    let surface = chrome(body);
    for ahead in [1.0f32, -1.0] {
        let (thick, x) = (0.03, ahead * (reach - 0.03));
        builder.cuboid(surface, [x, 0.0, BUMPERS * h], [thick, 0.86 * w, 0.055]);
        if detail == 0 {
            for side in [1.0f32, -1.0] {
                builder.cuboid(
                    surface,
                    [x - ahead * 0.10, side * 0.905 * w, BUMPERS * h],
                    [0.09, 0.045 * w, 0.05],
                );
            }
        }
    }
    if detail == 0 {
        plate(builder, body, [reach - 0.006, 0.0, BUMPERS * h + 0.008]);
    }
}
