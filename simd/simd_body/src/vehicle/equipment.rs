//! What outfits put on a body: light bars, roof signs, liveries, a fire engine's ladder.
//!
//! What stands on a roof lies within the vehicle's box: the body below it is that much lower.

use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder};

use super::bodywork::Bodywork;
use super::outfit::Outfit;
use super::shape::BodyStyle;
use crate::solid::tube;

/// Lamp bits of blue and red flashing lights: CARLA's special lights 1 and 2.
const FLASHING: [u8; 2] = [8, 9];

/// Adds what a car or van carries on its roof.
pub(super) fn on_car(builder: &mut MeshBuilder, body: &Bodywork, style: BodyStyle, detail: usize) {
    let (low, top) = (body.height() - 0.02, 2.0 * body.half[2]);
    match body.outfit {
        Outfit::Police => bar(
            builder,
            body,
            body.x(0.53),
            [low, top],
            0.56 * body.half_width_m,
            detail,
        ),
        Outfit::Ambulance => {
            let u = if style == BodyStyle::Van { 0.34 } else { 0.5 };
            bar(
                builder,
                body,
                body.x(u),
                [low, top],
                0.62 * body.half_width_m,
                detail,
            );
        }
        Outfit::Taxi => {
            let sign = body.lamp([255, 222, 140], 0);
            let (x, z) = (body.x(0.52), 0.5 * (low + top));
            if detail < 2 {
                builder.cuboid(body.dark(), [x, 0.0, low + 0.012], [0.12, 0.34, 0.02]);
            }
            builder.cuboid(
                sign,
                [x, 0.0, z + 0.01],
                [0.08, 0.30, 0.5 * (top - low) - 0.01],
            );
        }
        _ => {}
    }
}

/// A light bar across the roof: blue on the left, red on the right, white between.
fn bar(
    builder: &mut MeshBuilder,
    body: &Bodywork,
    x: f32,
    [low, top]: [f32; 2],
    half_y: f32,
    detail: usize,
) {
    let foot = low + 0.045;
    let (z, half_z) = (0.5 * (foot + top), 0.5 * (top - foot));
    builder.cuboid(
        body.dark(),
        [x, 0.0, 0.5 * (low + foot)],
        [0.10, 0.96 * half_y, 0.5 * (foot - low) + 0.004],
    );
    for (side, rgb, bit) in [
        (1.0f32, [40, 90, 255], FLASHING[0]),
        (-1.0, [255, 30, 24], FLASHING[1]),
    ] {
        let inner = if detail < 2 { 0.30 } else { 0.0 };
        builder.cuboid(
            body.lamp(rgb, bit),
            [x, side * 0.5 * (1.0 + inner) * half_y, z],
            [0.13, 0.5 * (1.0 - inner) * half_y, half_z],
        );
    }
    if detail < 2 {
        let clear = Surface::new(body.class, Material::Glass, [206, 210, 216]);
        builder.cuboid(clear, [x, 0.0, z], [0.12, 0.30 * half_y, 0.92 * half_z]);
    }
}

/// Adds what a lorry of this outfit has on its cab and on its box, which is given by `rear`,
/// `front`, `floor` and `roof`.
pub(super) fn on_lorry(
    builder: &mut MeshBuilder,
    body: &Bodywork,
    [rear, front, floor, roof]: [f32; 4],
    cab_top: f32,
    detail: usize,
) {
    let w = body.half_width_m;
    let (middle, half, high) = (0.5 * (rear + front), 0.5 * (front - rear), roof - floor);
    let matte = |rgb| Surface::new(body.class, Material::Matte, rgb);
    match body.outfit {
        Outfit::Plain => {
            for side in [1.0f32, -1.0] {
                let band = [middle, side * (w + 0.001), floor + 0.16 * high];
                builder.cuboid(body.paint(), band, [0.99 * half, 0.002, 0.05 * high]);
            }
        }
        Outfit::Drinks => {
            for side in [1.0f32, -1.0] {
                for k in 0..if detail < 2 { 8 } else { 1 } {
                    let n = if detail < 2 { 8.0 } else { 1.0 };
                    let u = (k as f32 + 0.5) / n;
                    let wave = if detail < 2 {
                        0.10 * (u * 7.0).sin()
                    } else {
                        0.0
                    };
                    let at = [
                        front - 2.0 * half * u,
                        side * (w + 0.001),
                        floor + (0.5 + wave) * high,
                    ];
                    builder.cuboid(matte([240, 238, 232]), at, [half / n, 0.002, 0.07 * high]);
                }
            }
        }
        Outfit::FireEngine => {
            let steel = Surface::new(body.class, Material::Metal, [168, 170, 174]);
            for side in [1.0f32, -1.0] {
                let band = [middle, side * (w + 0.001), floor + 0.06 * high];
                builder.cuboid(
                    matte([236, 236, 230]),
                    band,
                    [0.99 * half, 0.002, 0.035 * high],
                );
                let n = if detail < 2 { 3 } else { 1 };
                for k in 0..n {
                    let share = 1.0 / n as f32;
                    let x = front - 2.0 * half * (k as f32 + 0.5) * share;
                    builder.cuboid(
                        steel,
                        [x, side * (w + 0.001), floor + 0.52 * high],
                        [0.88 * share * half, 0.003, 0.34 * high],
                    );
                }
            }
            let x = front + 0.5;
            bar(
                builder,
                body,
                x,
                [cab_top - 0.02, cab_top + 0.14],
                0.78 * w,
                detail,
            );
            ladder(
                builder,
                steel,
                [rear + 0.15, front - 0.1],
                [roof, 2.0 * body.half[2]],
                detail,
            );
        }
        _ => {}
    }
}

/// Two ladders side by side on the roof.
fn ladder(
    builder: &mut MeshBuilder,
    steel: Surface,
    [rear, front]: [f32; 2],
    [low, top]: [f32; 2],
    detail: usize,
) {
    let z = top - 0.05;
    let rails: &[f32] = if detail < 2 {
        &[0.72, 0.24, -0.24, -0.72]
    } else {
        &[0.72, -0.72]
    };
    for &y in rails {
        builder.cuboid(
            steel,
            [0.5 * (rear + front), y, 0.5 * (top + z)],
            [0.5 * (front - rear), 0.025, 0.5 * (top - z)],
        );
    }
    if detail < 2 {
        let n = ((front - rear) / if detail == 0 { 0.33 } else { 0.66 }) as usize;
        for k in 0..n {
            let x = rear + (front - rear) * (k as f32 + 0.5) / n as f32;
            for y in [0.48f32, -0.48] {
                tube(
                    builder,
                    steel,
                    ([x, y - 0.22, z + 0.02], 0.016),
                    ([x, y + 0.22, z + 0.02], 0.016),
                    3,
                );
            }
        }
        for x in [rear + 0.3, front - 0.3] {
            builder.cuboid(
                steel,
                [x, 0.0, 0.5 * (low + z)],
                [0.03, 0.75, 0.5 * (z - low) + 0.005],
            );
        }
    }
}
