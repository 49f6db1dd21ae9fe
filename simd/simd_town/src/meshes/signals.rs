//! Poles and heads of traffic lights, and signs.

use schema_types::Class;
use sensor_core::mesh::Surface;
use sensor_core::{Material, Mesh, MeshBuilder};
use simd_body::solid::{post, tube};

use super::street_lamps::steel;
use crate::network::SignalKind;

/// Heights of a traffic light's heads over the pavement: on the pole and on the arm.
pub const HEADS_M: (f64, f64) = (2.75, 5.4);

/// A traffic light's pole: +x faces the traffic that must obey; an arm reaches `arm_m` towards −y,
/// over the carriageway.
pub fn light_pole(arm_m: f32) -> Mesh {
    let mut builder = MeshBuilder::new("traffic light pole");
    let top = if arm_m > 0.0 {
        HEADS_M.1 as f32 + 0.2
    } else {
        HEADS_M.0 as f32 + 0.75
    };
    for (n, until_m) in [(8, 40.0), (4, 110.0)] {
        tube(
            &mut builder,
            steel(),
            ([0.0, 0.0, -0.05], 0.09),
            ([0.0, 0.0, top], 0.07),
            n,
        );
        if arm_m > 0.0 {
            tube(
                &mut builder,
                steel(),
                ([0.0, 0.0, top - 0.15], 0.065),
                ([0.0, -arm_m, top], if n == 8 { 0.04 } else { 0.06 }),
                n,
            );
        }
        if n == 8 {
            let button = Surface::new(Class::POLES, Material::Matte, [210, 170, 40]);
            builder.cuboid(button, [0.0, 0.11, 1.1], [0.06, 0.05, 0.1]);
        }
        builder.end_level(until_m);
    }
    // Heads are drawn at any distance, so their poles are too. Far poles are thicker than near
    // ones, because pixels miss what is much narrower than they are.
    for (radius, until_m) in [(0.14, 220.0), (0.24, f32::INFINITY)] {
        post(
            &mut builder,
            steel(),
            [0.0, 0.0, -0.05],
            [0.0, 0.0, top],
            radius,
        );
        if arm_m > 0.0 {
            post(
                &mut builder,
                steel(),
                [0.0, 0.0, top - 0.1],
                [0.0, -arm_m, top],
                0.7 * radius,
            );
        }
        builder.end_level(until_m);
    }
    builder.finish()
}

/// A head with three lamps facing +x, centred on its origin: bit 0 red, 1 yellow, 2 green.
pub fn light_head() -> Mesh {
    let mut builder = MeshBuilder::new("traffic light head");
    let class = Class::TRAFFIC_LIGHT;
    let black = Surface::new(class, Material::Matte, [26, 28, 28]);
    for (n, until_m) in [(14, 35.0), (6, 80.0), (4, f32::INFINITY)] {
        if n > 4 {
            builder.cuboid(black, [0.0, 0.0, 0.0], [0.10, 0.16, 0.46]);
            builder.cuboid(black, [-0.09, 0.0, 0.0], [0.012, 0.27, 0.58]);
        } else {
            // From far away only the board is drawn, visible from both sides.
            let board = [
                [0.0, -0.27, -0.58],
                [0.0, 0.27, -0.58],
                [0.0, 0.27, 0.58],
                [0.0, -0.27, 0.58],
            ];
            builder.polygon(black, &board, &[[0.0; 2]; 4]);
            builder.polygon(
                black,
                &[board[3], board[2], board[1], board[0]],
                &[[0.0; 2]; 4],
            );
        }
        for (bit, (rgb, z)) in [
            ([255, 38, 28], 0.29),
            ([255, 190, 30], 0.0),
            ([40, 255, 120], -0.29f32),
        ]
        .into_iter()
        .enumerate()
        {
            let disc: Vec<[f32; 3]> = (0..n)
                .map(|k| {
                    let a = std::f32::consts::TAU * k as f32 / n as f32;
                    [0.106, 0.105 * a.cos(), z + 0.105 * a.sin()]
                })
                .collect();
            builder.polygon(
                Surface::lamp(class, rgb, bit as u8),
                &disc,
                &vec![[0.0; 2]; n],
            );
            if n == 14 {
                visor(&mut builder, black, z);
            }
        }
        builder.end_level(until_m);
    }
    builder.finish()
}

/// A half tube over a lamp, seen from both sides.
fn visor(builder: &mut MeshBuilder, surface: Surface, z: f32) {
    let at = |k: usize, x: f32| {
        let a = std::f32::consts::PI * (k as f32 / 6.0 * 1.2 - 0.1);
        [x, 0.118 * a.cos(), z + 0.118 * a.sin()]
    };
    for k in 0..6 {
        let quad = [at(k, 0.10), at(k, 0.26), at(k + 1, 0.26), at(k + 1, 0.10)];
        builder.polygon(surface, &quad, &[[0.0; 2]; 4]);
        let mut back = quad;
        back.reverse();
        builder.polygon(surface, &back, &[[0.0; 2]; 4]);
    }
}

/// A sign on a pole; its face looks to +x.
pub fn sign(kind: SignalKind) -> Mesh {
    let mut builder = MeshBuilder::new(format!("sign {kind:?}").to_lowercase());
    let class = Class::TRAFFIC_SIGNS;
    let paint = |rgb| Surface::new(class, Material::Matte, rgb);
    let (red, white, black, grey) = (
        paint([190, 22, 26]),
        paint([240, 240, 236]),
        paint([24, 24, 24]),
        paint([130, 132, 134]),
    );
    for (n, until_m) in [(20usize, 30.0), (8, 80.0), (6, 180.0)] {
        if n == 20 {
            tube(
                &mut builder,
                steel(),
                ([0.0, 0.0, -0.05], 0.035),
                ([0.0, 0.0, 2.75], 0.035),
                6,
            );
        } else {
            // From afar the pole is drawn thicker, so that the board visibly stands on something,
            // but never in front of the board.
            let radius = if n == 8 { 0.055 } else { 0.11 };
            let x = 0.03 - 0.9 * radius;
            post(
                &mut builder,
                steel(),
                [x, 0.0, -0.05],
                [x, 0.0, 2.6],
                radius,
            );
        }
        let (sides, turn, radius) = match kind {
            SignalKind::Stop => (8, 0.5, 0.40),
            // A yield sign's point is below.
            SignalKind::Yield => (3, 0.25, 0.46),
            _ => (n, 0.0, 0.36),
        };
        let face = |r: f32, x: f32| -> Vec<[f32; 3]> {
            (0..sides)
                .map(|k| {
                    let a = std::f32::consts::TAU * (k as f32 + turn) / sides as f32;
                    [x, r * a.cos(), 2.4 + r * a.sin()]
                })
                .collect()
        };
        let uv = vec![[0.0; 2]; sides];
        let mut back = face(radius, 0.036);
        back.reverse();
        builder.polygon(grey, &back, &uv);
        builder.polygon(
            if kind == SignalKind::Stop { white } else { red },
            &face(radius, 0.040),
            &uv,
        );
        let inner = if kind == SignalKind::Stop {
            (red, 0.93)
        } else {
            (
                white,
                if kind == SignalKind::Yield {
                    0.66
                } else {
                    0.78
                },
            )
        };
        builder.polygon(inner.0, &face(radius * inner.1, 0.046), &uv);
        match kind {
            SignalKind::Limit(kmh) if n == 20 => digits(&mut builder, black, kmh),
            SignalKind::Stop => builder.cuboid(white, [0.05, 0.0, 2.4], [0.004, 0.24, 0.06]),
            _ => {}
        }
        builder.end_level(until_m);
    }
    builder.finish()
}

/// Two digits of seven bars each on a face that looks to +x; whoever reads it has +y to the right.
fn digits(builder: &mut MeshBuilder, surface: Surface, number: u32) {
    const BARS: [u8; 10] = [0x3f, 0x06, 0x5b, 0x4f, 0x66, 0x6d, 0x7d, 0x07, 0x7f, 0x6f];
    for (place, digit) in [(-0.1f32, number / 10 % 10), (0.1, number % 10)] {
        // Bars a to g: (across, up, half across, half up).
        let bars = [
            (0.0, 0.14, 0.06, 0.016),
            (0.06, 0.07, 0.016, 0.07),
            (0.06, -0.07, 0.016, 0.07),
            (0.0, -0.14, 0.06, 0.016),
            (-0.06, -0.07, 0.016, 0.07),
            (-0.06, 0.07, 0.016, 0.07),
            (0.0, 0.0, 0.06, 0.016),
        ];
        for (i, (across, up, half_across, half_up)) in bars.into_iter().enumerate() {
            if BARS[digit as usize] >> i & 1 == 1 {
                builder.cuboid(
                    surface,
                    [0.05, place + across, 2.4 + up],
                    [0.003, half_across, half_up],
                );
            }
        }
    }
}
