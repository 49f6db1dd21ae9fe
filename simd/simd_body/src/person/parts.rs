//! The parts of a body, each about its joint. Measures are shares of the body's height.

use sensor_core::MeshBuilder;
use sensor_core::mesh::Surface;

use super::shape::{Age, Hair, PersonShape};
use crate::solid::ellipsoid;
use crate::stack::{Ring, ring, stack};

/// With fewer sides than this, only what shapes the outline is built.
const FINE: usize = 8;

fn rings<const N: usize>(shape: &PersonShape, table: [[f32; 4]; N]) -> [Ring; N] {
    table.map(|row| ring(shape.height_m as f32, row))
}

/// Pelvis to the base of the neck; origin between the hip joints.
pub fn torso(builder: &mut MeshBuilder, shape: &PersonShape, n: usize) {
    let h = shape.height_m as f32;
    let p = shape.age.proportions();
    let (hip, shoulder, neck) = (p.hip as f32, p.shoulder as f32, p.neck as f32);
    let trunk = shoulder - hip;
    let at = |share: f32| share * trunk;
    let female = shape.look.female && shape.age != Age::Child;
    let (hips, waist, chest) = if female {
        (0.106, 0.070, 0.080)
    } else {
        (0.098, 0.082, 0.074)
    };
    let belly = match shape.age {
        Age::Elderly => 0.012,
        Age::Child => 0.010,
        _ => 0.0,
    };
    let broad = if female { 0.104 } else { 0.112 };
    let body = rings(
        shape,
        [
            [-0.060, 0.000, 0.030, 0.045],
            [-0.040, 0.000, 0.058, 0.088],
            [at(0.04), -0.004, 0.068, hips],
            [at(0.16), 0.0, 0.064 + belly, 0.5 * (hips + waist) + 0.004],
            [at(0.34), 0.002, 0.056 + belly, waist],
            [at(0.56), 0.004, 0.062 + 0.5 * belly, waist + 0.012],
            [
                at(0.74),
                if female { 0.012 } else { 0.004 },
                chest - 0.002,
                0.5 * (waist + broad) + 0.010,
            ],
            [at(0.90), 0.0, 0.062, broad + 0.004],
            [at(1.00) - 0.012, -0.004, 0.053, broad],
            [at(1.00) + 0.006, -0.006, 0.044, 0.086],
            [at(1.00) + 0.026, -0.006, 0.036, 0.050],
            [neck - hip + 0.012, -0.004, 0.031, 0.032],
        ],
    );
    let (top, bottom, skin) = (
        shape.surface(shape.look.top_rgb),
        shape.surface(shape.look.bottom_rgb),
        shape.surface(shape.look.skin_rgb),
    );
    let band = |i: usize| match i {
        0..=2 => bottom,
        10.. => skin,
        _ => top,
    };
    if n >= FINE {
        stack(builder, &body, n, band);
    } else {
        let kept = [0, 2, 4, 6, 8, 11];
        stack(builder, &kept.map(|i| body[i]), n + 2, |i| band(kept[i]));
    }
    if shape.look.skirt {
        // The upper part of the skirt; the rest belongs to the thighs and moves with them.
        let (hem, belt) = (-0.165, at(0.20));
        let cone = rings(
            shape,
            [
                [hem, 0.0, 0.084, 0.120],
                [0.0, 0.0, 0.076, 0.110],
                [belt, 0.0, 0.066 + belly, 0.090],
            ],
        );
        stack(builder, &cone, n, |_| bottom);
    }
    if female && n >= FINE {
        for side in [1.0, -1.0] {
            ellipsoid(
                builder,
                top,
                [0.044 * h, side * 0.038 * h, at(0.68) * h],
                [0.046 * h, 0.044 * h, 0.048 * h],
                10,
            );
        }
    }
}

/// Head with face and hair; origin at the base of the neck.
pub fn head(builder: &mut MeshBuilder, shape: &PersonShape, n: usize) {
    let h = shape.height_m as f32;
    let p = shape.age.proportions();
    let room = (1.0 - p.neck as f32) * h;
    let half_y = p.head_half_y * h;
    let half_x = 1.18 * half_y;
    let (skin, hair) = (
        shape.surface(shape.look.skin_rgb),
        shape.surface(shape.look.hair_rgb),
    );
    // Hair or cap cover the crown, so the skull ends a little lower.
    let bald = shape.look.hair == Hair::Bald;
    let skull_top = if bald { room } else { room - 0.006 * h };
    let chin = 0.05 * room;
    let (middle, half_z) = (0.5 * (skull_top + chin), 0.5 * (skull_top - chin));
    let skull: Vec<Ring> = [-1.0, -0.86, -0.55, -0.1, 0.35, 0.7, 0.92, 1.0]
        .iter()
        .zip([0.30, 0.62, 0.83, 0.97, 1.0, 0.82, 0.46, 0.05])
        .map(|(z, width)| Ring {
            z_m: middle + z * half_z,
            x_m: if *z < -0.3 { 0.012 * h } else { 0.006 * h },
            half_x_m: half_x * width * if *z < -0.3 { 0.88 } else { 0.96 },
            half_y_m: half_y * width,
        })
        .collect();
    if n >= FINE {
        stack(builder, &skull, n, |_| skin);
        face(builder, shape, middle, half_z, [half_x, half_y]);
    } else {
        stack(builder, &[0, 2, 4, 7].map(|i| skull[i]), n + 2, |_| skin);
    }
    let n = if n >= FINE { n } else { n + 2 };
    match shape.look.hair {
        Hair::Bald => {}
        Hair::Short | Hair::Long => crop(builder, hair, room, middle, half_z, [half_x, half_y], n),
        Hair::Cap => {
            let brim_m = middle + 0.42 * half_z;
            let cap = |z: f32, grow: f32| Ring {
                z_m: z,
                x_m: 0.004 * h,
                half_x_m: half_x * grow,
                half_y_m: half_y * grow,
            };
            stack(
                builder,
                &[
                    cap(brim_m, 1.08),
                    cap(room - 0.008 * h, 1.12),
                    cap(room, 0.9),
                ],
                n,
                |_| hair,
            );
            let peak = |z: f32, grow: f32| Ring {
                z_m: z,
                x_m: 0.62 * half_x,
                half_x_m: half_x * grow,
                half_y_m: half_y * 0.86,
            };
            stack(
                builder,
                &[
                    peak(brim_m - 0.003 * h, 0.72),
                    peak(brim_m + 0.004 * h, 0.70),
                ],
                n,
                |_| hair,
            );
        }
    }
    if shape.look.hair == Hair::Long {
        let back = |z: f32, x: f32, grow: f32| Ring {
            z_m: z,
            x_m: x,
            half_x_m: 0.45 * half_x * grow,
            half_y_m: half_y * grow,
        };
        stack(
            builder,
            &[
                back(-0.030 * h, -0.046 * h, 0.9),
                back(0.4 * room, -0.034 * h, 1.08),
                back(0.75 * room, -0.026 * h, 1.0),
            ],
            n,
            |_| hair,
        );
    }
}

/// Hair over the crown, the back and the sides: the hairline runs over the brow.
fn crop(
    builder: &mut MeshBuilder,
    hair: Surface,
    room: f32,
    middle: f32,
    half_z: f32,
    [half_x, half_y]: [f32; 2],
    n: usize,
) {
    let back = 0.13 * half_x;
    let rows = [
        (-0.25, 0.62, 0.90, 2.6),
        (0.10, 0.86, 1.03, 1.9),
        (0.45, 0.98, 1.07, 1.0),
        (0.75, 0.90, 0.95, 0.8),
    ];
    let mut cap: Vec<Ring> = rows
        .iter()
        .map(|(z, grow_x, grow_y, shift)| Ring {
            z_m: middle + z * half_z,
            x_m: -back * shift,
            half_x_m: half_x * grow_x,
            half_y_m: half_y * grow_y,
        })
        .collect();
    cap.push(Ring {
        z_m: room - 0.012 * room,
        x_m: -0.6 * back,
        half_x_m: 0.58 * half_x,
        half_y_m: 0.60 * half_y,
    });
    cap.push(Ring {
        z_m: room,
        x_m: -0.5 * back,
        half_x_m: 0.22 * half_x,
        half_y_m: 0.24 * half_y,
    });
    stack(builder, &cap, n, |_| hair);
}

fn face(
    builder: &mut MeshBuilder,
    shape: &PersonShape,
    middle: f32,
    half_z: f32,
    [half_x, half_y]: [f32; 2],
) {
    let h = shape.height_m as f32;
    let front = 0.006 * h + 0.955 * half_x;
    let shade = |rgb: [u8; 3], share: f32| shape.surface(rgb.map(|c| (f32::from(c) * share) as u8));
    let (skin, nose) = (shape.look.skin_rgb, middle - 0.12 * half_z);
    // Nose: a small wedge.
    let (tip, root) = (
        [front + 0.009 * h, 0.0, nose - 0.10 * half_z],
        [front - 0.003 * h, 0.0, nose + 0.22 * half_z],
    );
    let (left, right) = (
        [front - 0.004 * h, 0.16 * half_y, nose - 0.16 * half_z],
        [front - 0.004 * h, -0.16 * half_y, nose - 0.16 * half_z],
    );
    let side = shade(skin, 0.94);
    builder.triangle(side, [root, left, tip]);
    builder.triangle(side, [root, tip, right]);
    builder.triangle(shade(skin, 0.7), [left, right, tip]);
    for y in [0.38, -0.38] {
        let (y, z) = (y * half_y, middle + 0.10 * half_z);
        let x = front - 0.0065 * h;
        ellipsoid(
            builder,
            shade([235, 232, 226], 1.0),
            [x, y, z],
            [0.006 * h, 0.15 * half_y, 0.055 * half_z],
            6,
        );
        ellipsoid(
            builder,
            shade([40, 30, 24], 1.0),
            [x + 0.0035 * h, y, z],
            [0.004 * h, 0.07 * half_y, 0.05 * half_z],
            6,
        );
        let brow = [x + 0.004 * h, y, z + 0.15 * half_z];
        let brow_rgb = if shape.look.hair == Hair::Bald {
            [60, 46, 36]
        } else {
            shape.look.hair_rgb
        };
        builder.cuboid(
            shade(brow_rgb, 0.7),
            brow,
            [0.0025 * h, 0.17 * half_y, 0.016 * half_z],
        );
    }
    let mouth = [0.012 * h + 0.80 * half_x, 0.0, middle - 0.52 * half_z];
    builder.cuboid(
        shade([150, 74, 66], 1.0),
        mouth,
        [0.006 * h, 0.26 * half_y, 0.028 * half_z],
    );
    for y in [1.0, -1.0] {
        ellipsoid(
            builder,
            shade(skin, 0.9),
            [0.0, y * half_y, middle - 0.02 * half_z],
            [0.009 * h, 0.004 * h, 0.14 * half_z],
            6,
        );
    }
}

/// Shoulder to elbow; hangs down from the origin.
pub fn upper_arm(builder: &mut MeshBuilder, shape: &PersonShape, n: usize) {
    let length = -0.172;
    let arm = rings(
        shape,
        [
            [length - 0.012, 0.0, 0.012, 0.012],
            [length, 0.0, 0.020, 0.019],
            [0.5 * length, 0.002, 0.024, 0.022],
            [-0.04, 0.0, 0.028, 0.025],
            [-0.022, -0.001, 0.029, 0.0245],
            [-0.006, -0.002, 0.025, 0.020],
            [0.003, -0.003, 0.015, 0.011],
        ],
    );
    let (top, skin) = (
        shape.surface(shape.look.top_rgb),
        shape.surface(shape.look.skin_rgb),
    );
    let band = |i: usize| {
        if shape.look.short_sleeves && i < 2 {
            skin
        } else {
            top
        }
    };
    if n >= FINE {
        stack(builder, &arm, n, band)
    } else {
        stack(builder, &[arm[1], arm[2], arm[4]], n, |i| band(i + 1))
    }
}

/// Elbow to fingertips.
pub fn forearm(builder: &mut MeshBuilder, shape: &PersonShape, n: usize) {
    let wrist = -0.146;
    let arm = rings(
        shape,
        [
            [wrist, 0.0, 0.0125, 0.0115],
            [0.6 * wrist, 0.0, 0.018, 0.016],
            [0.2 * wrist, 0.0, 0.021, 0.019],
            [0.0, 0.0, 0.019, 0.018],
            [0.010, 0.0, 0.010, 0.010],
        ],
    );
    let hand = rings(
        shape,
        [
            [wrist - 0.098, 0.006, 0.006, 0.003],
            [wrist - 0.080, 0.005, 0.015, 0.007],
            [wrist - 0.045, 0.003, 0.021, 0.0085],
            [wrist - 0.015, 0.002, 0.018, 0.0095],
            [wrist + 0.004, 0.0, 0.0115, 0.010],
        ],
    );
    let skin = shape.surface(shape.look.skin_rgb);
    let sleeve = if shape.look.short_sleeves {
        skin
    } else {
        shape.surface(shape.look.top_rgb)
    };
    if n >= FINE {
        stack(builder, &arm, n, |_| sleeve);
        stack(builder, &hand, n, |_| skin);
        let h = shape.height_m as f32;
        ellipsoid(
            builder,
            skin,
            [0.022 * h, 0.0, (wrist - 0.04) * h],
            [0.006 * h, 0.006 * h, 0.022 * h],
            6,
        );
    } else {
        stack(builder, &[arm[0], arm[2], arm[3]], n, |_| sleeve);
        stack(builder, &[hand[0], hand[2], hand[4]], n, |_| skin);
    }
}

/// Hip to knee.
pub fn thigh(builder: &mut MeshBuilder, shape: &PersonShape, n: usize) {
    let p = shape.age.proportions();
    let length = (p.knee - p.hip) as f32;
    let leg = rings(
        shape,
        [
            [length - 0.014, 0.004, 0.016, 0.016],
            [length, 0.003, 0.029, 0.028],
            [0.6 * length, 0.002, 0.037, 0.035],
            [0.25 * length, 0.0, 0.047, 0.042],
            [-0.004, 0.0, 0.051, 0.044],
            [0.022, 0.0, 0.040, 0.034],
        ],
    );
    let cloth = shape.surface(if shape.look.skirt {
        shape.look.skin_rgb
    } else {
        shape.look.bottom_rgb
    });
    if n >= FINE {
        stack(builder, &leg, n, |_| cloth)
    } else {
        stack(builder, &[leg[1], leg[3], leg[4]], n, |_| cloth)
    }
    if shape.look.skirt {
        // Each thigh carries half of the skirt. The halves are so wide that they look like one
        // skirt when the person stands, and that no leg pokes through when it walks.
        let hem = 0.92 * length;
        let half = rings(
            shape,
            [
                [hem, 0.0, 0.070, 0.074],
                [0.55 * length, 0.0, 0.066, 0.068],
                [-0.03, 0.0, 0.058, 0.058],
            ],
        );
        stack(builder, &half, n, |_| shape.surface(shape.look.bottom_rgb));
    }
}

/// Knee to ankle.
pub fn shin(builder: &mut MeshBuilder, shape: &PersonShape, n: usize) {
    let p = shape.age.proportions();
    let length = 0.039 - p.knee as f32;
    let leg = rings(
        shape,
        [
            [length - 0.008, 0.0, 0.021, 0.019],
            [0.94 * length, 0.0, 0.021, 0.019],
            [0.62 * length, -0.004, 0.025, 0.024],
            [0.30 * length, -0.006, 0.033, 0.030],
            [0.0, 0.0, 0.030, 0.028],
            [0.014, 0.002, 0.017, 0.017],
        ],
    );
    let cloth = shape.surface(if shape.look.skirt {
        shape.look.skin_rgb
    } else {
        shape.look.bottom_rgb
    });
    if n >= FINE {
        stack(builder, &leg, n, |_| cloth)
    } else {
        stack(builder, &[leg[0], leg[3], leg[4]], n, |_| cloth)
    }
}

/// Shoe; origin at the ankle.
pub fn foot(builder: &mut MeshBuilder, shape: &PersonShape, n: usize) {
    let shoe = rings(
        shape,
        [
            [-0.039, 0.0225, 0.0775, 0.026],
            [-0.030, 0.0215, 0.0775, 0.028],
            [-0.018, 0.014, 0.068, 0.026],
            [-0.004, -0.004, 0.044, 0.023],
            [0.010, -0.012, 0.028, 0.021],
        ],
    );
    let (leather, sole) = (
        shape.surface(shape.look.shoe_rgb),
        shape.surface(shape.look.shoe_rgb.map(|c| c / 2)),
    );
    let band = |i: usize| if i == 0 { sole } else { leather };
    if n >= FINE {
        stack(builder, &shoe, n, band)
    } else {
        stack(builder, &[shoe[0], shoe[2], shoe[4]], n, |_| leather)
    }
}
